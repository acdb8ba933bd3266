"""The parts that a page is put together from: files beside this module, scripts without what only a reader needs."""

import re
from importlib.resources import files

_QUOTES = ('"', "`")
_STRINGS = re.compile(r'("[^"\n]*"|`[^`]*`)')
_SPACES = re.compile(r" *([{}()\[\],;:=<>?&|*!]) *|(?<![+-]) ([+/-]) (?![+-])")
_BRACKETED = re.compile(r"\([^()]*\)|\[[^\[\]]*\]|\{[^{}]*\}")


def filled(text: str, parts: dict[str, str]) -> str:
    """A text with its parts put in. What stands for a name is put in once: a title may look like one."""
    for name in ("PROGRAM", "CLOCK", "STAGE", "CHARTS", "LIVE", "SOLVER", "MORPHING", "HANDLING", "SHAPING", "MORE"):
        text = text.replace(f"{{{{{name}}}}}", parts.get(name, ""))
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], text)


def own(name: str) -> str:
    """A part of the page, from beside this module; scripts without comments and indentation."""
    text = files("jaxnc.viz").joinpath(name).read_text(encoding="utf-8")
    if not name.endswith(".js"):
        return text
    lines: list[str] = []
    whole = False  # whether the last line is one declaration, which the next one can go on with
    for line in (line.split("  // ")[0].strip() for line in text.splitlines()):
        if not line or line.startswith("//"):
            continue
        begins = line.startswith("const ")
        if begins and whole:
            lines[-1] = f"{lines[-1][:-1]},{line[6:]}"
        else:
            lines.append(line)
        whole = begins and _single(line)
    parts = (part if part[:1] in _QUOTES else _short(part) for part in _STRINGS.split("\n".join(lines)))
    text = re.sub(r"([;{,(])\n|\n(?=[})\]])", r"\1", "".join(parts))
    return re.sub(r";+(?=})", "", text)


def _single(line: str) -> bool:
    """Whether a line is one statement from its beginning to its end."""
    code = _STRINGS.sub("", line)
    while (inner := _BRACKETED.sub("", code)) != code:
        code = inner
    return code.endswith(";") and not any(sign in code[:-1] for sign in ";()[]{}")


def _short(code: str) -> str:
    return re.sub(r"\b0(\.\d)", r"\1", _SPACES.sub(r"\1\2", code.replace("const ", "let ")))
