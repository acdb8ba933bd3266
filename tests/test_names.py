"""The public face: what stands at the top and why, what is in the packages, and that what is returned can be named."""

import collections.abc
import importlib
import inspect
import json
import pkgutil
import re
import types
import typing

import pytest
from places import DOCS, ROOT

import jaxnc as nc

# Every name at the top, and the guide that says what it is for; without a guide, the place of a name is its package.
GUIDES = {
    "AssemblyError": "docs/modelling.md",
    "CallError": "docs/modelling.md",
    "InputError": "docs/modelling.md",
    "JaxncError": "docs/modelling.md",
    "Mechanism": "README.md",
    "MechanismError": "docs/modelling.md",
    "ModelFileError": "docs/modelling.md",
    "Motion": "docs/modelling.md",
    "OutputError": "docs/modelling.md",
    "Status": "docs/modelling.md",
    "System": "docs/modelling.md",
    "cache": "docs/batches.md",
    "circuits": "docs/modes.md",
    "circuit": "docs/modelling.md",
    "constraints": "docs/dynamics.md",
    "dexterity": "docs/modes.md",
    "diagnose": "docs/modelling.md",
    "dynamics": "docs/dynamics.md",
    "equilibrium": "docs/dynamics.md",
    "families": "docs/families.md",
    "forces": "docs/dynamics.md",
    "formulate": "docs/families.md",
    "from_mjcf": "docs/robots.md",
    "from_urdf": "docs/robots.md",
    "grashof": "docs/modelling.md",
    "instant_centre": "docs/modelling.md",
    "inverse_dynamics": "docs/dynamics.md",
    "io": "docs/batches.md",
    "jit": "docs/batches.md",
    "kinematics": "docs/modelling.md",
    "library": "README.md",
    "linearise": "docs/dynamics.md",
    "load": "docs/modelling.md",
    "mobility": "docs/modelling.md",
    "flip_margin": "docs/modes.md",
    "modes": "docs/modes.md",
    "motion": "docs/modelling.md",
    "reactions": "docs/dynamics.md",
    "report": "docs/report.md",
    "reporting": "docs/report.md",
    "robots": "docs/robots.md",
    "sensitivity": "docs/spatial.md",
    "shard": "docs/batches.md",
    "simulate": "docs/dynamics.md",
    "solve_position": "docs/batches.md",
    "stream": "docs/batches.md",
    "suspension": "docs/spatial.md",
    "sweep": "README.md",
    "synthesis": "README.md",
    "system": "docs/dynamics.md",
    "tolerance": "docs/tolerance.md",
    "transmission_angle": "docs/modelling.md",
    "travel": "docs/start.md",
    "vehicle": "docs/spatial.md",
    "viz": "docs/dynamics.md",
    "widget": "docs/widget.md",
    "workshop": "docs/files.md",
}
PACKAGES = tuple(name for name in nc.__all__ if inspect.ismodule(getattr(nc, name)))
LAZY = ("constraints", "dynamics", "io", "kinematics", "robots", "synthesis", "system", "vehicle", "viz", "workshop")


def text(path):
    said = (ROOT / path).read_text(encoding="utf-8")
    return "\n".join("".join(c["source"]) for c in json.loads(said)["cells"]) if path.endswith("ipynb") else said


def test_each_name_at_the_top_is_there_because_a_guide_uses_it():
    assert sorted(GUIDES) == nc.__all__ == sorted(nc.__all__) == dir(nc)
    said = {path: set(re.findall(r"\bnc\.(\w+)", text(path))) for path in set(GUIDES.values())}
    assert not [name for name, path in GUIDES.items() if name not in said[path]]


def test_each_option_of_an_analysis_is_in_a_guide():
    """An option exists because a guide says when to choose it."""
    analyses = (nc.solve_position, nc.sweep, nc.motion, nc.circuit, nc.travel, nc.diagnose, nc.sensitivity, nc.stream)
    analyses += (nc.simulate, nc.equilibrium, nc.linearise, nc.Mechanism.compile)
    pages = ["README.md", *(f"docs/{p.name}" for p in (DOCS).glob("*.md"))]
    said = set(re.findall(r"\b(\w+)=", " ".join(map(text, pages))))
    given = [(f.__name__, p) for f in analyses for p in inspect.signature(f).parameters.values()]
    options = {(name, p.name) for name, p in given if p.default is not p.empty}
    assert not sorted(option for option in options if option[1] not in said)


def test_what_a_guide_says_is_there():
    """Every `nc.…` of README, docs, notebooks and docstrings leads somewhere."""
    guides = ["README.md", "CONTRIBUTING.md", *(f"docs/{p.name}" for p in (DOCS).glob("*.md"))]
    guides += [f"notebooks/{p.name}" for p in (ROOT / "notebooks").glob("*.ipynb")]
    said = {(path, dotted) for path in guides for dotted in re.findall(r"\bnc((?:\.[A-Za-z]\w*)+)", text(path))}
    for path in (ROOT / "jaxnc").rglob("*.py"):
        given = re.findall(r"`jaxnc((?:\.[A-Za-z]\w*)+)", path.read_text(encoding="utf-8"))
        said |= {(str(path.relative_to(ROOT)), dotted) for dotted in given}
    for path, dotted in said:
        thing = nc
        for part in dotted[1:].split("."):
            if inspect.ismodule(thing) and not hasattr(thing, part):
                importlib.import_module(f"{thing.__name__}.{part}")
            assert hasattr(thing, part), f"{path}: {dotted[1:]}"
            thing = getattr(thing, part)


@pytest.mark.parametrize("package", LAZY)
def test_no_name_is_hidden_by_a_module(package):
    """Importing a module puts it into its package: `viz.band` was a function the first time and a module afterwards."""
    home = getattr(nc, package)
    inside = {module.name for module in pkgutil.iter_modules(home.__path__)}
    assert not inside & set(home.__all__) and sorted(home.__all__) == dir(home)
    for module in inside:
        importlib.import_module(f"jaxnc.{package}.{module}")
    for _ in range(2):
        assert not [name for name in home.__all__ if inspect.ismodule(getattr(home, name))]


def mentioned(annotation):
    """The classes in an annotation."""
    if isinstance(annotation, type):
        yield annotation
    origin = typing.get_origin(annotation)
    if origin is collections.abc.Callable:
        return
    for part in typing.get_args(annotation):
        yield from mentioned(part)


def results(thing, known):
    """The annotations of what a function, or the methods and attributes of a class, give."""
    if inspect.isclass(thing):
        members = [v.fget if isinstance(v, property) else v for k, v in vars(thing).items() if k[0] != "_"]
        functions = [v for v in members if inspect.isfunction(v)]
        results = thing.__module__.startswith(("jaxnc.kinematics", "jaxnc.vehicle", "jaxnc.dynamics", "jaxnc.io"))
        given = [v for k, v in vars(thing).get("__annotations__", {}).items() if k[0] != "_" and results]
    else:
        functions, given = [inspect.unwrap(thing)], []
    given += [f.__annotations__["return"] for f in functions if "return" in f.__annotations__]
    space = {**known, **vars(inspect.getmodule(thing))}
    return [eval(a, space) if isinstance(a, str) else a for a in given]


def test_what_functions_return_is_importable_from_their_package():
    """And what these hold and their methods return, of whatever package."""
    known = {name: importlib.import_module(name) for name in ("pandas", "xarray")}
    for info in pkgutil.walk_packages(nc.__path__, "jaxnc."):
        if not info.name.startswith("jaxnc.cli"):
            module = importlib.import_module(info.name)
            for name, thing in vars(module).items():
                if not inspect.ismodule(thing):  # also what is imported for annotations only
                    known.setdefault(name, thing)
    homes = {name: getattr(nc, name) for name in PACKAGES}
    names = {name: homes[name].__all__ for name in homes}
    open_ = [getattr(nc, n) for n in nc.__all__ if n not in PACKAGES]
    open_ += [getattr(homes[p], n) for p in PACKAGES for n in names[p]]
    seen, missing = set(), set()
    while open_:
        thing = open_.pop()
        if id(thing) in seen or not (inspect.isclass(thing) or inspect.isfunction(thing)):
            continue
        seen.add(id(thing))
        for annotation in results(thing, known):
            for found in mentioned(annotation):
                if not found.__module__.startswith("jaxnc."):
                    continue
                package = found.__module__.split(".")[1]
                home = homes.get(package, nc)
                if getattr(home, found.__name__, None) is not found and getattr(nc, found.__name__, None) is not found:
                    missing.add(f"{getattr(thing, '__qualname__', thing)} gives {found.__module__}.{found.__name__}")
                open_.append(found)
    assert not missing, "\n".join(sorted(missing))
    assert isinstance(known["Motion"], type) and len(seen) > 100 and isinstance(nc, types.ModuleType)
