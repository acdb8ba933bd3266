"""The reference: one page for each package, from its ``__all__``; and names in docstrings that lead to them."""

import builtins
import importlib
import inspect
import re
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import tables
from docutils import nodes
from from_repository import write
from said import PACKAGES as ABOUT
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

DOCS = Path(__file__).parent.parent
JOINTS = [
    "Revolute",
    "Prismatic",
    "Gear",
    "Rolling",
    "Cable",
    "Weld",
    "Spherical",
    "Cylindrical",
    "Universal",
    "Screw",
    "Planar",
    "BevelGear",
    "RackAndPinion",
    "ConstantVelocity",
    "Skate",
    "RollingDisc",
]  # records of joints
UNNAMED = (
    "jaxnc.dynamics.flow.Flow",
    "jaxnc.families.comparison.Row",
    "jaxnc.families.planner.Atlas",
    "jaxnc.families.planner.Variable",
    "jaxnc.synthesis.conditions.Seen",
    "jaxnc.synthesis.problem.Extras",
    "jaxnc.synthesis.tolerance.spread.Question",
    "jaxnc.synthesis.problem.Variables",
    "jaxnc.system.identity.Owner",
    "jaxnc.system.topology.BlockLayout",
    *(f"jaxnc.mechanism.model.{name}" for name in JOINTS),
)  # classes that signatures name and no package offers
OWN_PAGE = 10  # methods: a class with as many has a page of its own
ABOVE = "object, int, IntEnum, Exception, OSError, ValueError, RuntimeError, Struct, ABC, Generic, AnyWidget"


def public(package: str) -> dict[str, Any]:
    """What a package offers by name, packages excepted."""
    module = importlib.import_module(package)
    own = (n for n, v in vars(module).items() if n[0] != "_" and getattr(v, "__module__", "") == package)
    found = {name: getattr(module, name) for name in getattr(module, "__all__", None) or own}
    return {name: value for name, value in found.items() if not inspect.ismodule(value)}


def where(name: str, value: Any, package: str) -> str:
    """The first package that offers a thing: there it is described."""
    return next((p for p in ABOUT if public(p).get(name) is value), package)


@cache
def names() -> dict[str, str]:
    """Full names of what is described, by every name that docstrings and signatures may use for it."""
    found: dict[str, str] = {}
    for package in ABOUT:
        for name, value in public(package).items():
            full = f"{where(name, value, package)}.{name}"
            short = package.removeprefix("jaxnc").removeprefix(".")
            also = [name, f"nc.{short}.{name}" if short else f"nc.{name}", f"{short}.{name}", f"{package}.{name}", full]
            if hasattr(value, "__module__") and hasattr(value, "__qualname__"):
                also.append(f"{value.__module__}.{value.__qualname__}")
            for key in also:
                found.setdefault(key, full)
    return found


def kind(value: Any) -> str:
    """How Sphinx calls what a value is."""
    if inspect.isclass(value):
        return "exception" if issubclass(value, Exception) else "class"
    return "function" if inspect.isroutine(value) else "data"


def methods(value: Any) -> list[str]:
    """Documented public members of a class."""
    named = (n for n in dir(value) if not n.startswith("_") and inspect.getdoc(inspect.getattr_static(value, n)))
    return list(named) if inspect.isclass(value) else []


def described(name: str, value: Any) -> list[str]:
    """The directive that describes a name."""
    out = [f".. auto{kind(value)}:: {name}"]
    if kind(value) == "class":
        out += ["   :members:", f"   :inherited-members: {ABOVE}"]
        out += ["   :undoc-members:"] if issubclass(value, Enum) else []
    if kind(value) == "data":
        out = [f".. py:data:: {name}", "", f"   {said(value)}"]
    return [*out, ""]


def said(value: Any) -> str:
    """One line on a constant, which has no docstring."""
    source = f", {value.source}" if getattr(value, "source", "") else ""
    if isinstance(value, dict):
        return f"A dictionary of {len(value)}, by name."
    if isinstance(value, (tuple, list)):
        return f"{', '.join(map(str, value))}."
    if hasattr(value, "name"):
        return f"The kind *{value.name}*{source}: see the :doc:`tables </tables/index>`."
    raise ExtensionError(f"the reference does not know what to say of {value!r}")


def purpose(value: Any) -> str:
    """Say what a thing is for: the subject of the module that it stands in."""
    about = inspect.getdoc(inspect.getmodule(value)) if kind(value) != "data" else ""
    return re.split(r"[.:,] |[.:]$", about.splitlines()[0])[0].replace("`", "") if about else "Constants"


def place(value: Any) -> tuple[int, str]:
    """Order things by the package that they come from, then by the module; constants come last."""
    module = getattr(value, "__module__", "") if kind(value) != "data" else ""
    known = [k for k, package in enumerate(ABOUT) if package != "jaxnc" and module.startswith(f"{package}.")]
    return (max(known), module) if known else (-1 if module else len(ABOUT), module)


def page(package: str) -> dict[str, str]:
    """The pages of a package in the site's sources."""
    here = {n: v for n, v in public(package).items() if where(n, v, package) == package}
    elsewhere = {n: v for n, v in public(package).items() if n not in here}
    groups: dict[str, list[str]] = {}
    for name, value in sorted(here.items(), key=lambda item: place(item[1])):
        groups.setdefault(purpose(value), []).append(name)
    out = [package, "=" * len(package), "", ABOUT[package].replace("`", "``"), "", f".. currentmodule:: {package}", ""]
    if elsewhere:
        out += ["Also here: " + ", ".join(f":py:obj:`{n}`" for n in elsewhere) + ".", ""]
    pages = {}
    own = [n for n, v in here.items() if kind(v) == "class" and len(methods(v)) >= OWN_PAGE]
    if own:
        out += [".. toctree::", "   :maxdepth: 1", "", *(f"   {package}.{n}" for n in own), ""]
    for n in own:
        head = [n, "=" * len(n), "", f".. currentmodule:: {package}", ""]
        pages[f"api/{package}.{n}.rst"] = "\n".join([*head, *described(n, here[n])])
    for title, members in groups.items():
        out += [title, "-" * len(title), ""]
        some = [n for n in members if kind(here[n]) != "data"]
        if len(some) > 1 or set(some) & set(own):
            out += [".. autosummary::", "   :nosignatures:", "", *(f"   {n}" for n in some), ""]
        for n in members:
            out += [] if n in own else described(n, here[n])
    return pages | {f"api/{package}.rst": "\n".join(out)}


def make(app: Sphinx) -> None:
    """Write the pages of the reference, and the tables."""
    pages: dict[str, str] = tables.pages()
    for package in ABOUT:
        pages |= page(package)
    head = [
        "Reference",
        "=========",
        "",
        "Made from the docstrings. What a function returns is described with it, or in the package that it is of.",
        "",
    ]
    title = "Named in signatures"
    pages["api/others.rst"] = "\n".join(
        [title, "=" * len(title), "", "Classes that functions take or return, and that no package offers by name.", ""]
        + [f".. autoclass:: {name}\n" for name in UNNAMED]
    )
    rows = [f"* :doc:`{package}`: {about.replace('`', '``')}" for package, about in ABOUT.items()]
    tree = ["", ".. toctree::", "   :hidden:", "", *(f"   {package}" for package in ABOUT), "   others"]
    pages["api/index.rst"] = "\n".join([*head, *rows, *tree, ""])
    for path, text in pages.items():
        write(DOCS / path, text)
    for path in (*(DOCS / "api").iterdir(), *(DOCS / "tables").iterdir()):
        if path.relative_to(DOCS).as_posix() not in pages:
            path.unlink()  # what it was of is gone


def inside(target: str) -> Any:
    """What a full name stands for, or None."""
    module, _, name = target.rpartition(".")
    try:
        return getattr(importlib.import_module(module), name, None) if module else None
    except ImportError:
        return None


def ours(target: str) -> bool:
    return target.split(".")[0] in ("jaxnc", "nc") or target in names()


def resolve(app: Sphinx, env: Any, node: Any, content: Any) -> Any:
    """Names of the library by whatever path they are called; those of others are left as they are."""
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    python = env.domains["py"]
    stem, _, last = target.rpartition(".")
    for full in (names().get(target), names().get(last), f"{names().get(stem)}.{last}"):
        if full and full in python.objects and full != target:
            return python.resolve_xref(env, node["refdoc"], app.builder, "obj", full, node, content)
    top = target.split(".")[0]
    others = hasattr(builtins, top) or (top != "jaxnc" and not ours(target)) or isinstance(inside(target), TypeVar)
    return content if others or node.get("named") else None


def named(role: str, raw: str, text: str, line: int, inliner: Any, options: Any = None, content: Any = ()) -> Any:
    """A name in single backticks: a link where the reference has it, code in any case."""
    code = nodes.literal(raw, text, classes=["py"])
    stem, _, last = text.removesuffix("()").rpartition(".")
    full = names().get(text.removesuffix("()"))
    if not full and stem in names():
        full = f"{names()[stem]}.{last}"
    if not full:
        return [code], []
    node = pending_xref(raw, refdomain="py", reftype="obj", reftarget=full, refexplicit=True, named=True)
    node["refdoc"] = inliner.document.settings.env.docname
    return [node.__iadd__(code)], []


def sentence(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """The first line of a property's docstring is a sentence: napoleon would take what is before a colon for a type."""
    if what in ("property", "attribute") and lines:
        lines[:0] = ["..", ""]


def several(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Several names that are described together: Sphinx would take all but the last for a type."""
    for k, line in enumerate(lines):
        if found := re.match(r":(ivar|param) ([^:]*, [^:]*):", line):
            lines[k] = line.replace(found[2], found[2].replace(", ", ",\u200b"), 1)


def signature(app: Sphinx, what: str, name: str, value: Any, options: Any, text: str | None, back: str | None) -> Any:
    """A signature without values that cannot be written, such as ``<factory>``, and with short names of shapes.

    A class that is made of what no package offers is made by the library: its arguments are not for users.
    """

    def short(said: str | None) -> str | None:
        if not said:
            return said
        said = re.sub(r"~?[\w.]*\bArray \| ~?[\w.]*ndarray \|.*?complex", "~jax.typing.ArrayLike", said)
        said = said.replace("jaxlib._jax.Array", "~jax.Array").replace("~~", "~")
        said = re.sub(r"~?[\w.]*\bAnnotated\[float, [^\]]*\]", "float", said)
        return re.sub(r"<[^<>]*>", "...", re.sub(r",? _\w+: [\w.]+ = \w+", "", said))

    if what == "class" and text and any(n not in names() for n in re.findall(r"~?(jaxnc[\w.]*)", text)):
        text = ""
    return short(text), short(back)


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    from docutils.parsers.rst import roles

    roles.register_local_role("named", named)
    app.connect("builder-inited", make)
    app.connect("autodoc-process-docstring", sentence, priority=400)
    app.connect("autodoc-process-docstring", several, priority=600)
    app.connect("autodoc-process-signature", signature)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
