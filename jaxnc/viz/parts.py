"""The parts that a page is put together from: files beside this module, scripts without what only a reader needs."""

import re
from importlib.resources import files

_STRINGS = re.compile(r'("[^"\n]*"|`[^`]*`)')
_SPACES = re.compile(r"(?<=[\w$]) (?=[\w$])|(?<=[+-]) (?=[+-])|( +)")
_VALUES = re.compile(r"\$\{([^{}`]*)\}")  # of templates
_NAMES = {"true": "!0", "false": "!1", "Infinity": "1/0"}
_BRACKETED = re.compile(r"\([^()]*\)|\[[^\[\]]*\]|\{[^{}]*\}")


# Parts that hold others, the outer before the inner.
_NESTED = ("PROGRAM", "CLOCK", "STAGE", "CHARTS", "LIVE", "SOLVER", "MORPHING", "HANDLING", "SIZING", "SHAPING", "MORE")


def filled(text: str, parts: dict[str, str]) -> str:
    """A text with its parts put in. What stands for a name is put in once: a title may look like one."""
    for name in _NESTED:
        text = text.replace(f"{{{{{name}}}}}", parts.get(name, ""))
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], text)


def own(name: str) -> str:
    """A part of the page, from beside this module; scripts without comments and spaces, names and lines as they are."""
    text = files("jaxnc.viz").joinpath(name).read_text(encoding="utf-8")
    if not name.endswith(".js"):
        return text
    lines: list[str] = []
    whole = False  # whether the last line is one declaration, which the next one can go on with
    for line in (line.split("  // ")[0].strip() for line in text.splitlines()):
        if not line or line.startswith("//"):
            continue
        begins = line.startswith(("const ", "let "))
        if begins and whole:
            lines[-1] = f"{lines[-1][:-1]},{line.split(' ', 1)[1]}"
        else:
            lines.append(line)
        whole = begins and _single(line)
    text = re.sub(r"([;{,(}])\n|\n(?=[})\]])", r"\1", _shortened("\n".join(lines)))
    return re.sub(r";+(?=})", "", text)


def _shortened(text: str) -> str:
    """Without spaces that only a reader needs, in what is no string, and in the values of templates."""
    parts = _STRINGS.split(text)
    for k, part in enumerate(parts):
        if part[:1] == "`":
            parts[k] = _VALUES.sub(lambda found: f"${{{_shortened(found[1])}}}", part)
        elif part[:1] != '"':
            parts[k] = _short(part)
    return "".join(parts)


def _single(line: str) -> bool:
    """Whether a line is one statement from its beginning to its end."""
    code = _STRINGS.sub("", line)
    while (inner := _BRACKETED.sub("", code)) != code:
        code = inner
    return code.endswith(";") and not any(sign in code[:-1] for sign in ";()[]{}")


def _short(code: str) -> str:
    code = _SPACES.sub(lambda found: "" if found[1] else " ", code.replace("const ", "let "))
    for name, short in _NAMES.items():
        code = re.sub(rf"\b{name}\b", short, code)
    return re.sub(r"\b0(\.\d)", r"\1", code)
