"""The floors of the house: a file imports only downward, and a few rules beside it.

`violations(root)` reads every module of a package with `ast` and imports none of them. The second half of this
file feeds it small trees that break one rule each, so that the first half is known to be able to fail.
"""

import ast
import functools
import importlib
import re
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from places import ROOT

from jaxnc.doors import DOORS

PACKAGE = "jaxnc"

# The first name below the package decides the floor. A new module must be given one here.
FLOORS = {
    "types": 0,
    "errors": 0,
    "status": 0,
    "validate": 0,
    "calls": 0,
    "compiling": 0,
    "autodiff": 0,
    "process": 0,
    "internals": 0,
    "notebooks": 0,
    "pickling": 0,
    "progress": 0,
    "promotion": 0,
    "records": 0,
    "remembered": 0,
    "reading": 0,
    "exports": 0,
    "doors": 0,
    "constraints": 1,
    "forces": 1,
    "mechanism": 1,
    "system": 2,
    "solvers": 3,
    "continuation": 3,
    "kinematics": 4,
    "dynamics": 4,
    "families": 4,
    "vehicle": 5,
    "synthesis": 5,
    "library": 5,
    "viz": 6,
    "io": 6,
    "reporting": 6,
    "robots": 7,
    "workshop": 7,
    "cli": 8,
    "__main__": 8,
}
TOP = 8  # `import jaxnc` itself: the package re-exports from every floor

# Conveniences that may reach up, and only from inside a function: (file, module it may reach). What goes through the
# table of doors, jaxnc/doors.py, needs no line here.
DEFERRED_UPWARD = [
    ("jaxnc/kinematics/sensitivity.py", "jaxnc.io"),  # Sensitivity.to_csv
    ("jaxnc/vehicle/suspension.py", "jaxnc.io"),  # Suspension.to_csv
    ("jaxnc/vehicle/report.py", "jaxnc.io"),  # SuspensionReport.to_json
    ("jaxnc/synthesis/*", "jaxnc.viz"),  # BurmesterCurves.plot, Tolerance.plot, Result.gallery
    ("jaxnc/synthesis/result.py", "jaxnc.io"),  # Result.save
    ("jaxnc/synthesis/search/solve.py", "jaxnc.io"),  # the file that `solve` saves itself in
]

JAX_FAMILY = {"jax", "jaxlib", "equinox", "optax", "diffrax", "lineax", "optimistix"}
VAGUE_NAMES = {"util", "utils", "helper", "helpers", "common"}


@dataclass(frozen=True)
class Import:
    """One module that a file imports: its absolute dotted name, where, and whether inside a function."""

    target: str
    line: int
    deferred: bool
    star: bool = False


@functools.cache
def parsed(text: str) -> ast.Module:
    """What a module says, for all tests."""
    return ast.parse(text)


@pytest.fixture(scope="module", autouse=True)
def forgotten():
    """A million nodes are not to stay for the tests of other files."""
    yield
    parsed.cache_clear()


def is_type_checking(test: ast.expr) -> bool:
    return (isinstance(test, ast.Name) and test.id == "TYPE_CHECKING") or (
        isinstance(test, ast.Attribute) and test.attr == "TYPE_CHECKING"
    )


def absolute(name: str, level: int, package: str) -> str:
    """The dotted name of a (relative) import made in `package`; level 1 is the package itself."""
    if level == 0:
        return name
    base = package.split(".")
    base = base[: len(base) - level + 1]
    return ".".join([*base, name] if name else base)


def dynamic_target(node: ast.Call, package: str) -> str | None:
    """The target of `import_module("…")` or `__import__("…")` where it is written out."""
    called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", None)
    if called not in {"import_module", "__import__"} or not node.args:
        return None
    name = node.args[0].value if isinstance(node.args[0], ast.Constant) else None
    if not isinstance(name, str):
        return None
    level = len(name) - len(name.lstrip("."))
    return absolute(name.lstrip("."), level, package)


def imports(tree: ast.AST, package: str, modules: set[str], deferred: bool = False) -> Iterator[Import]:
    """Every import below `tree` that happens at run time."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, node.lineno, deferred)
        elif isinstance(node, ast.ImportFrom):
            source = absolute(node.module or "", node.level, package)
            for alias in node.names:
                inner = f"{source}.{alias.name}"
                # `from package import module` imports the module; any other name is the source's own.
                yield Import(inner if inner in modules else source, node.lineno, deferred, alias.name == "*")
        elif isinstance(node, ast.If) and is_type_checking(node.test):
            yield from imports(ast.Module(node.orelse, []), package, modules, deferred)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            yield from imports(node, package, modules, True)
        else:
            if isinstance(node, ast.Call) and (target := dynamic_target(node, package)):
                yield Import(target, node.lineno, deferred)
            yield from imports(node, package, modules, deferred)


def below(target: str, prefix: str) -> bool:
    return target == prefix or target.startswith(prefix + ".")


def config_changes(tree: ast.Module) -> Iterator[int]:
    """Lines that use `jax.config.update` or set an attribute of `jax.config`, under any alias."""
    names = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                first = alias.name.split(".")[0]
                names[alias.asname or first] = alias.name if alias.asname else first
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            for alias in node.names:
                names[alias.asname or alias.name] = f"{node.module}.{alias.name}"

    def dotted(node: ast.expr) -> str:
        if isinstance(node, ast.Attribute):
            return f"{dotted(node.value)}.{node.attr}"
        return names.get(node.id, "") if isinstance(node, ast.Name) else ""

    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and (
            dotted(node) == "jax.config.update"
            or (isinstance(node.ctx, ast.Store) and dotted(node.value) == "jax.config")
        ):
            yield node.lineno


def check_import(file: str, own: str, made: Import) -> Iterator[str]:
    """What is wrong with one import of `file`, whose own first name below the package is `own`."""
    if made.star:
        yield f"star import of {made.target}"
    library = made.target.split(".")[0]
    if own == "mechanism" and library in JAX_FAMILY:
        yield f"imports {made.target}: a mechanism is described without JAX"
    if own != "viz" and library == "matplotlib":
        yield f"imports {made.target}: only {PACKAGE}/viz may"
    if library != PACKAGE or own not in FLOORS:
        return
    parts = made.target.split(".")
    floor = FLOORS.get(parts[1]) if len(parts) > 1 else TOP
    if floor is None:
        yield f"imports {made.target}, which has no floor: give it one in tests/test_floors.py"
        return
    if floor <= FLOORS[own]:
        return
    upward = f"{made.target} (floor {floor}) from floor {FLOORS[own]}"
    if not made.deferred:
        yield f"imports upward: {upward}"
    elif not any(fnmatchcase(file, pattern) and below(made.target, prefix) for pattern, prefix in DEFERRED_UPWARD):
        yield f"imports upward inside a function that is not a listed convenience: {upward}"


def violations(root: Path) -> list[str]:
    """Every broken rule in `root`/jaxnc, each as "file:line: what"."""
    files = sorted((root / PACKAGE).rglob("*.py"))
    names = {file: list(file.relative_to(root).with_suffix("").parts) for file in files}
    modules = {".".join(parts[:end]) for parts in names.values() for end in range(1, len(parts) + 1)}
    found = []
    for path in files:
        file, parts = path.relative_to(root).as_posix(), names[path]
        own = parts[1]
        is_init = parts[-1] == "__init__"
        text = path.read_text(encoding="utf-8")
        tree = parsed(text)

        def report(line: int, what: str, file: str = file) -> None:
            found.append(f"{file}:{line}: {what}")

        if own not in FLOORS and parts != [PACKAGE, "__init__"]:
            report(1, f"{PACKAGE}.{own} has no floor: give it one in tests/test_floors.py")
        if vague := [part for part in parts if part.strip("_") in VAGUE_NAMES]:
            report(1, f"'{vague[0]}' says nothing about what is in it: name the noun")
        if own != "cli" and file != "jaxnc/cli/main.py":
            for line in config_changes(tree):
                report(line, "changes jax.config: only the command line and cache() may")
        if is_init:
            for node in tree.body:
                if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and node.name not in {
                    "__getattr__",
                    "__dir__",
                }:
                    report(node.lineno, f"defines {node.name}: an __init__ only re-exports")
        for made in imports(tree, ".".join(parts[:-1]), modules):
            for what in check_import(file, own, made):
                report(made.line, what)
    return found


# ---------------------------------------------------------------------------------------------------------------
# the package


def test_the_package_keeps_its_floors():
    assert (ROOT / PACKAGE / "__init__.py").is_file()
    assert not (found := violations(ROOT)), "\n" + "\n".join(found)


def circle(root: Path) -> list[str]:
    """The modules of a circle of imports, those within functions counted; none is []. Packages only re-export."""
    files = {p: ".".join(p.relative_to(root).with_suffix("").parts) for p in (root / PACKAGE).rglob("*.py")}
    modules = {name.removesuffix(".__init__") for name in files.values()}
    needed = {}
    for path, name in files.items():
        if path.name != "__init__.py":
            tree = parsed(path.read_text(encoding="utf-8"))
            needed[name] = {i.target for i in imports(tree, name.rpartition(".")[0], modules)} - {name}
    try:
        TopologicalSorter({k: v & needed.keys() for k, v in needed.items()}).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_module_comes_back_to_itself(tmp_path):
    assert circle(ROOT) == []
    plant(
        tmp_path,
        CLEAN | {"jaxnc/types.py": "def f():\n    import jaxnc.errors", "jaxnc/errors.py": "import jaxnc.types"},
    )
    assert set(circle(tmp_path)) == {"jaxnc.types", "jaxnc.errors"}


def test_every_allowance_names_floors_that_exist():
    for pattern, target in DEFERRED_UPWARD:
        own = pattern.split("/")[1].rstrip("*")
        assert FLOORS[own] < FLOORS[target.split(".")[1]], (pattern, target)


def opened(root: Path) -> list[tuple[str, str]]:
    """Every call of `door("…")` in the package: the file's first name below the package, and the door."""
    found = []
    for path in sorted((root / PACKAGE).rglob("*.py")):
        for node in ast.walk(parsed(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "door":
                name = node.args[0]
                assert isinstance(name, ast.Constant), f"{path}:{node.lineno}: a door is named in plain text"
                found.append((path.relative_to(root / PACKAGE).parts[0].removesuffix(".py"), name.value))
    return found


def test_every_door_leads_upward_to_a_function_and_is_opened():
    used = opened(ROOT)
    assert {name for _, name in used} == set(DOORS)
    for own, name in used:
        module, _, function = DOORS[name].partition(":")
        assert FLOORS[module.split(".")[1]] > FLOORS[own], f"{name} does not lead upward: import it"
        assert callable(getattr(importlib.import_module(module), function)), name


# ---------------------------------------------------------------------------------------------------------------
# the checker

CLEAN = {
    "jaxnc/__init__.py": "from jaxnc.errors import E\n\ndef __getattr__(name):\n    raise AttributeError(name)\n",
    "jaxnc/errors.py": "class E(Exception):\n    pass\n",
    "jaxnc/types.py": "import jax\n",
    "jaxnc/constraints/__init__.py": "from .distance import row\n",
    "jaxnc/constraints/distance.py": "import jax.numpy as jnp\n\ndef row(x):\n    return jnp.sum(x)\n",
    "jaxnc/mechanism/__init__.py": "from .model import Mechanism\n",
    "jaxnc/mechanism/model.py": (
        "from typing import TYPE_CHECKING\n"
        "from .. import errors\n"
        "if TYPE_CHECKING:\n"
        "    import jax\n"
        "    from jaxnc.system import System\n"
        "class Mechanism:\n"
        "    def save(self):\n"
        "        return door('Mechanism.save')(self)\n"
    ),
    "jaxnc/system/__init__.py": "from jaxnc.constraints.distance import row\n",
    "jaxnc/solvers/newton.py": "import jax\nfrom jaxnc import errors\n",
    "jaxnc/kinematics/sensitivity.py": "def to_csv():\n    from ..io import target\n",
    "jaxnc/io/files.py": "def write():\n    return 'jax.config.update(...)'\n",
    "jaxnc/viz/curves.py": "import matplotlib.pyplot as plt\nfrom ..kinematics import motion\n",
    "jaxnc/cli.py": "import jax\nimport jaxnc\njax.config.update('jax_enable_x64', True)\n",
}

UP = "imports upward: jaxnc"
UNLISTED = "not a listed convenience"
X64 = "'jax_enable_x64', True"

# (what is broken, file, its text, the line reported, a piece of what is said)
BROKEN = [
    ("absolute", "jaxnc/system/up.py", "import os\nfrom jaxnc.solvers.newton import step", 2, UP + ".solvers.newton"),
    ("relative", "jaxnc/system/up.py", "from ..solvers import newton", 1, "(floor 3) from floor 2"),
    ("module of the root", "jaxnc/solvers/up.py", "from jaxnc import viz", 1, UP + ".viz"),
    ("dots only", "jaxnc/solvers/up.py", "from .. import viz", 1, UP + ".viz"),
    ("root file", "jaxnc/types.py", "from .solvers import newton", 1, UP + ".solvers.newton"),
    ("plain import", "jaxnc/kinematics/up.py", "import jaxnc.io.files as f", 1, UP + ".io.files"),
    ("whole package", "jaxnc/kinematics/up.py", "import jaxnc", 1, UP + " (floor 8)"),
    ("name of the package", "jaxnc/kinematics/up.py", "from jaxnc import Motion", 1, UP + " (floor 8)"),
    ("in an __init__", "jaxnc/constraints/__init__.py", "from ..system import System", 1, UP + ".system"),
    ("under try", "jaxnc/system/up.py", "try:\n    import jaxnc.viz\nfinally:\n    pass", 2, UP + ".viz"),
    ("in a class body", "jaxnc/system/up.py", "class A:\n    from jaxnc import viz", 2, UP + ".viz"),
    (
        "else of TYPE_CHECKING",
        "jaxnc/system/up.py",
        "import typing as t\nif t.TYPE_CHECKING:\n    pass\nelse:\n    import jaxnc.viz",
        5,
        UP + ".viz",
    ),
    ("by name", "jaxnc/system/up.py", "import importlib\nv = importlib.import_module('jaxnc.viz')", 2, UP + ".viz"),
    (
        "by relative name",
        "jaxnc/system/up.py",
        "from importlib import import_module\nv = import_module('..viz', __package__)",
        2,
        UP + ".viz",
    ),
    ("deferred", "jaxnc/system/up.py", "def f():\n    from ..viz import curves", 2, UNLISTED),
    ("deferred, async", "jaxnc/kinematics/sweep.py", "async def f():\n    from jaxnc.viz import curves", 2, UNLISTED),
    ("deferred, another target", "jaxnc/mechanism/up.py", "def f():\n    import jaxnc.viz", 2, UNLISTED),
    ("listed but not deferred", "jaxnc/mechanism/up.py", "from jaxnc.system import System", 1, UP + ".system"),
    ("listed prefix only", "jaxnc/mechanism/up.py", "def f():\n    import jaxnc.systematic", 2, "has no floor"),
    ("matplotlib", "jaxnc/io/up.py", "def f():\n    from matplotlib import pyplot", 2, "only jaxnc/viz may"),
    ("jax in mechanism", "jaxnc/mechanism/up.py", "import jax.numpy as jnp", 1, "without JAX"),
    ("jax in mechanism, deferred", "jaxnc/mechanism/up.py", "def f():\n    from jax import lax", 2, "without JAX"),
    ("jax in mechanism, one file", "jaxnc/mechanism.py", "import diffrax", 1, "without JAX"),
    ("star", "jaxnc/solvers/up.py", "from math import *", 1, "star import of math"),
    ("star of our own", "jaxnc/solvers/up.py", "from ..types import *", 1, "star import of jaxnc.types"),
    ("utils", "jaxnc/solvers/utils.py", "", 1, "'utils' says nothing"),
    ("_helpers", "jaxnc/solvers/_helpers.py", "", 1, "'_helpers' says nothing"),
    ("common folder", "jaxnc/solvers/common/rows.py", "", 1, "'common' says nothing"),
    ("def in __init__", "jaxnc/__init__.py", "import os\ndef load():\n    pass", 2, "defines load"),
    ("class in __init__", "jaxnc/system/__init__.py", "class System:\n    pass", 1, "defines System"),
    ("config", "jaxnc/types.py", f"import jax\njax.config.update({X64})", 2, "changes jax.config"),
    (
        "config, deferred",
        "jaxnc/types.py",
        f"def f():\n    from jax import config\n    config.update({X64})",
        3,
        "changes",
    ),
    ("config, assigned", "jaxnc/types.py", "import jax as j\nj.config.jax_enable_x64 = True", 2, "changes jax.config"),
    ("no floor", "jaxnc/attic.py", "", 1, "jaxnc.attic has no floor"),
]


def plant(root: Path, tree: dict[str, str]) -> None:
    for name, text in tree.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def test_checker_passes_a_clean_tree(tmp_path):
    plant(tmp_path, CLEAN)
    assert violations(tmp_path) == []


@pytest.mark.parametrize(("file", "text", "line", "says"), [pytest.param(*case[1:], id=case[0]) for case in BROKEN])
def test_checker_reports(tmp_path, file, text, line, says):
    plant(tmp_path, CLEAN | {file: text})
    found = violations(tmp_path)
    assert len(found) == 1, found
    assert found[0].startswith(f"{file}:{line}: ")
    assert says in found[0]


def test_checker_reports_every_violation_at_once(tmp_path):
    chosen = {file: text for _, file, text, _, _ in BROKEN}
    plant(tmp_path, CLEAN | chosen)
    reported = {line.split(":")[0] for line in violations(tmp_path)}
    assert reported == set(chosen)


def third_parties(root: Path) -> set[str]:
    """What the package imports that is neither its own nor Python's."""
    found = set()
    for path in (root / PACKAGE).rglob("*.py"):
        tree = parsed(path.read_text(encoding="utf-8"))
        found |= {made.target.split(".")[0] for made in imports(tree, PACKAGE, set())}
    return found - {PACKAGE, *sys.stdlib_module_names}


def test_dependencies_are_declared_as_used(tmp_path):
    """No module imports what may not be installed, and nothing is installed that no module imports."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    drawing = declared["optional-dependencies"]["plot"]
    names = {re.split(r"[^\w-]", text)[0] for text in (*declared["dependencies"], *drawing)}
    modules = {"pillow": "PIL"}  # distributions that are not called what they are imported as
    optional = {"anywidget", "traitlets", "jaxtyping", "pandas", "xarray", "mujoco"}  # of extras
    optional |= {"ezdxf", "IPython"}  # the latter is there in a notebook, and asked for nowhere else
    comes_along = {"mpl_toolkits", "jaxlib"}  # one with matplotlib; one is jax's other half, pinned beside it
    used = third_parties(ROOT)
    assert {modules.get(name, name) for name in names} - comes_along == used - optional - comes_along
    plant(tmp_path, CLEAN | {"jaxnc/types.py": "def f():\n    import optax.losses"})
    assert "optax" in third_parties(tmp_path)


LAPACK = re.compile(r"\b(jnp|lax|jsp|jax\.numpy|jax\.scipy|jax\.lax)\.linalg\.(?!norm\b)\w+|jax\.scipy\.linalg")


def test_two_modules_alone_reach_lapack():
    """Batched, its kernels can wait for each other for ever; these say how batches are kept from them."""
    found = []
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        if path.relative_to(ROOT / PACKAGE).as_posix() in ("solvers/dense.py", "solvers/saddle.py"):
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if LAPACK.search(line.partition("#")[0]):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    assert not found
    assert LAPACK.search((ROOT / PACKAGE / "solvers/dense.py").read_text(encoding="utf-8"))
