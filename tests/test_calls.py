"""Every public function, with each of its arguments replaced in turn by what it is not made for.

It may work. Otherwise the error is one of `jaxnc.errors` that names the argument, never one of Python, NumPy or JAX
from somewhere inside. All of them, several thousand calls: ``JAXNC_FUZZ=all pytest tests/test_calls.py``.
"""

import datetime
import decimal
import fractions
import functools
import importlib
import inspect
import os
import pickle
import random
import re
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.errors import brief
from jaxnc.synthesis.tracing import atlas

PACKAGES = (
    "",
    "dynamics",
    "families",
    "io",
    "kinematics",
    "library",
    "reporting",
    "synthesis",
    "system",
    "vehicle",
    "viz",
)
SAMPLE = 500  # calls in a run of the suite
PATIENCE = 60  # seconds for one call, with what it compiles
PHI = np.linspace(0.3, 0.6, 4)


# -- valid calls ---------------------------------------------------------------------------------------------------


def plane() -> nc.Mechanism:
    """A planar mechanism to which every method of the builder can add something."""
    m = nc.Mechanism("plane")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    for name, at in {"B": (0, 1), "C": (3.3, 2.9), "E": (4, 1), "S": (2, 0.5), "T": (2.5, 0.5)}.items():
        m.point(name, at)
    for name, points in {"crank": "AB", "coupler": "BC", "rocker": "DE", "loose": "ST"}.items():
        m.body(name, list(points))
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="D", to="E")
    return m


def space() -> nc.Mechanism:
    """A mechanism in space to which every method of the builder can add something."""
    m = nc.Mechanism("space", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground("E", (1, 0, 0))
    for name, at in {"P": (0, 0, -1), "Q": (1, 0, -1), "R": (0.5, 0.5, -1), "W": (0, 0, -0.5)}.items():
        m.point(name, at)
    m.ground_vector("z", (0, 0, 1))
    m.ground_vector("y", (0, 1, 0))
    m.vector("u", (0, 1, 0))
    m.vector("v", (1, 0, 0))
    m.body("rod", ["O", "P"], vectors=["u"])
    m.body("other", ["Q", "R"], vectors=["v"])
    m.angle("phi", to=("O", "P"), about="y")
    m.angle("psi", to=("Q", "R"), about="v")
    return m


def loaded() -> nc.Mechanism:
    """A four-bar with loads."""
    m = nc.library.four_bar(coupler_point=(0.06, 0.03))
    m.mass("crank", 0.2)
    m.spring("return", "A", "C", stiffness=10.0)
    m.gravity = (0.0, -9.81)
    return m


def rod() -> nc.Mechanism:
    """One link on a hinge."""
    m = nc.Mechanism("rod")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    m.body("link", ["A", "B"], mass=1.0)
    m.angle("phi", at="A", to="B")
    m.gravity = (0.0, -9.81)
    return m


@functools.cache
def things() -> dict[str, Any]:
    """What calls are about, by the names of arguments; made once."""
    plain = nc.library.four_bar(coupler_point=(0.06, 0.03))
    system = loaded().compile()
    motion = nc.sweep(system, {"phi": PHI}, rates={"phi": 1.0})
    wheels = nc.library.double_wishbone()
    run = wheels.model.run
    ride = {name: np.linspace(drive.start, drive.end, 5)[1:4] for name, drive in run.inputs.items()}
    linkage = nc.synthesis.FourBar((0, 0), (0.4, 0.8), (2.4, 1.9), (3, 0), P=(1.5, 2.2))
    guidance = nc.synthesis.Guidance([[0.0, 0.0, 0.0], [1.0, 0.5, 0.3], [2.0, 0.4, 0.7]])
    dyads = guidance.dyad(moving=(0.3, 0.2)), guidance.dyad(moving=(-0.4, 0.5))
    return {
        "mechanism": plain,
        "system": system,
        "motion": motion,
        "thing": motion,
        "items": [motion],
        "ride": nc.sweep(wheels.compile(), ride, hold=run.hold),
        "linkage": linkage,
        "one": linkage,
        "other": linkage,
        "linkages": [linkage],
        "problem": nc.synthesis.PathGeneration(plain, "P", np.asarray(motion["P"]), timing=PHI),
        "target": np.asarray(motion["P"]),
        "guidance": guidance,
        "dyads": dyads,
        "simulated": nc.simulate(system, np.linspace(0.0, 0.02, 3)),
        "formulation": nc.formulate(plain, "relative"),
        "tolerance": nc.tolerance(system, {"phi": 1.2}, "C", {"B": 1e-4}, samples=3),
        "q": np.asarray(motion.q[0]),
        "z": np.zeros(3),
        "dz": np.zeros(3),
        "inputs": {"phi": 0.4},
        "outputs": "C",
        "output": "C",
        "t": np.linspace(0.0, 0.02, 3),
        "modes": nc.modes(system, {"phi": 0.4}),
        "circuits": nc.circuits(system, {"phi": PHI}),
        "name": "phi",
        "names": ["C"],
        "crank": "crank",
        "coupler": "coupler",
        "rocker": "rocker",
        "body": "coupler",
        "point": "P",
        "start": "B",
        "joint": "C",
        "end": "D",
        "f": lambda x: 2.0 * x,
        "path": "written",
        "tolerances": {"B": 1e-4},
        "values": PHI,
        "min": 0.3,
        "max": 1.0,
    }


def own() -> dict[str, dict[str, Any] | None]:
    """Arguments of functions that are called otherwise there; None of a function that is not tried, and why."""
    known = things()
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.3], [2.0, 0.4, 0.7]])
    guided = {"body": "coupler", "point": "P", "places": known["target"], "orientations": [0.0, 0.1, 0.2, 0.3]}
    outline = Path("outline.svg")
    outline.write_text('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0L10 0L10 10Z"/></svg>')
    quick = {"starts": 4, "refine": 2, "iterations": 2, "progress": False}
    swings = nc.formulate(rod(), "relative")  # compiled sooner than a loop
    return {
        "cache": None,  # changes what all tests share
        "widget": None,  # tests/viz/test_viz_widget.py
        "motion": {"inputs": {"phi": lambda t: 0.3 + t}},
        "circuit": {"poses": 5},
        "circuits": {"inputs": {"phi": PHI}},
        "sweep": {"inputs": {"phi": PHI}},
        "shard": {"devices": "all"},
        "stream": {"inputs": {"phi": PHI}, "path": "stream.npz", "progress": False, "chunk": 4},
        "equilibrium": {"system": rod().compile()},
        "linearise": {"system": rod().compile(), "state": {"phi": 0.4}},
        "sensitivity": {"inputs": {"phi": 0.4}},
        "suspension": {"motion": known["ride"]},
        "tolerance": {"samples": 3},
        "from_mjcf": {"path": plane().to_mjcf("robot.xml").path},
        "from_urdf": {"path": plane().to_urdf("robot.urdf").path},
        "load": {"path": plane().save("plane.toml")},
        "vehicle.suspension_report": {"motion": known["ride"]},
        "kinematics.grashof_type": dict.fromkeys(("ground", "crank", "coupler", "rocker"), 1.0),
        "io.load_csv": {"path": known["motion"].to_csv("motion.csv")},
        "io.load_npz": {"path": known["motion"].to_npz("motion.npz")},
        "io.outline": {"path": outline, "count": 12},
        "dynamics.energy_balance": {"motion": known["simulated"]},
        "families.compare": None,  # seconds for each call
        "library.cardan_shafts": {},
        "synthesis.Descent": None,  # what `descend` is made of
        "synthesis.FunctionGeneration": {"output": lambda motion: motion["C"][..., 0], "target": PHI},
        "synthesis.MotionGeneration": {**guided, "timing": PHI},
        "synthesis.Objective": {"residuals": lambda motion: motion["C"][:, 0]},
        "synthesis.Loss": {"function": lambda system: jnp.sum(system.parameters.points**2)},
        "synthesis.PathGeneration": {"timing": PHI},
        "synthesis.Guidance": {"poses": poses},
        "synthesis.SliderCrank": {"A": (0, 0), "B": (0.3, 0.5), "C": (1.5, 0), "P": (1, 0.6)},
        "synthesis.FourBar": {"A": (0, 0), "B": (0.4, 0.8), "C": (2.4, 1.9), "D": (3, 0), "P": (1.5, 2.2)},
        "synthesis.Stock": {"what": ("A", "B"), "sizes": (0.1, 0.2)},
        "synthesis.calibrate": {
            "inputs": {"phi": PHI},
            "measurements": {"C": known["motion"]["C"]},
            "variables": ["C"],
        },
        "synthesis.chebyshev_points": {"count": 3},
        "synthesis.clear_of": {"region": [(0, 0), (1, 1)]},
        "synthesis.clear_links": {"layers": ["crank", "rocker"]},
        "synthesis.condition": {"function": lambda motion: motion["C"][..., 0]},
        "synthesis.crank_turns": {},
        "synthesis.descend": {
            "problem": nc.synthesis.Loss(known["mechanism"], lambda system: jnp.sum(system.parameters.points**2)),
            "optimiser": __import__("optax").sgd(1e-3),
            "steps": 2,
            "starts": 2,
            "progress": False,
        },
        "synthesis.equal": {"first": ("A", "B"), "second": ("C", "D")},
        "synthesis.function_four_bars": {
            "function": lambda x: x**1.2,
            "over": (1.0, 2.0),
            "input_range": 1.0,
            "output_range": 1.0,
            "points": 5,
        },
        "synthesis.integer": {"what": ("A", "B")},
        "synthesis.no_flip": {"distance": 0.1},
        "synthesis.only_circuit": {"stops": {"C.y": (0.0, None)}},
        "synthesis.load": None,  # of what a search has saved
        "synthesis.local": {"along": ("B", "C"), "x": (0.0, 0.1)},
        "synthesis.direction": {"value": 0.3},
        "synthesis.length": {"max": 1.0},
        "synthesis.on_circuit": {"side": "left"},
        "synthesis.pareto": {
            "starts": 4,
            "refine": 2,
            "iterations": 2,
            "points": 3,
            "others": {"size": lambda motion: motion["C"][..., 0].sum()},
        },
        "synthesis.path_four_bars": None,  # a minute for each call
        "synthesis.precision_four_bars": {"inputs": (0.1, 0.5, 0.9), "outputs": (0.2, 0.4, 0.9)},
        "synthesis.precision_six_bars": None,  # minutes
        "synthesis.robust": {"samples": 3, "output": "C.x"},
        "synthesis.slider_crank_cognate": {
            "linkage": nc.synthesis.SliderCrank((0, 0), (0.3, 0.5), (1.5, 0), P=(1, 0.6))
        },
        "synthesis.slider_crank_function": {"inputs": (0.1, 0.5, 0.9), "outputs": (0.2, 0.4, 0.9)},
        "synthesis.solve": quick,
        "synthesis.stock": {"what": ("A", "B"), "sizes": (0.1, 0.2)},
        "synthesis.symmetric": {"first": "A", "second": "B"},
        "synthesis.atlas": {"count": 1, "bars": (4,), "folder": "atlas", "progress": False},
        "synthesis.dyadic_chains": {"bars": 6},
        "synthesis.trace": None,  # seconds for each call; tests/synthesis/test_trace.py has what is wrong there
        "synthesis.within": {"x": (0, 1)},
        "viz.band": {"tolerance": nc.tolerance(known["system"], {"phi": PHI}, "C.x", {"B": 1e-4}, samples=3)},
        "viz.plot_energy": {"motion": known["simulated"]},
        "families.simulate": {"formulation": swings, "step": 0.1},
        "families.mass_matrix": {"formulation": swings, "z": np.zeros(1)},
        "families.accelerations": {"formulation": swings, "z": np.zeros(1), "dz": np.zeros(1)},
        "kinematics.axodes": None,  # in space, as the error says
        "viz.draw_modes": None,  # tests/test_modes.py
        "viz.draw_modes_map": None,
        "viz.draw_dexterity": None,  # tests/kinematics/test_dexterity.py
        "viz.draw_circuits": None,
        "viz.animate": None,  # a second for each call
        "viz.burmester": None,  # of curves that only `Guidance.curves` makes
        "viz.plot": {"names": "C"},
        "viz.plot_families": None,  # of what `families.compare` makes
        "viz.trace_page": None,  # of a large atlas: tests/viz/test_trace_page.py
        "viz.to_html": {"path": "page.html"},
    }


BUILDER = {  # of the builder's methods: what they are given in the plane, and in space
    "ground": ({"name": "new", "at": (1, 1)}, {"name": "new", "at": (1, 1, 1)}),
    "point": ({"name": "new", "at": (1, 1)}, {"name": "new", "at": (1, 1, 1)}),
    "ground_vector": (None, {"name": "new", "direction": (1, 0, 0)}),
    "vector": (None, {"name": "new", "direction": (1, 0, 0)}),
    "marker": ({"name": "new", "on": "crank", "at": (1, 1)}, {"name": "new", "on": "rod", "direction": (0, 0, 1)}),
    "body": ({"name": "new", "points": ["B", "E"]}, {"name": "new", "points": ["P", "Q"]}),
    "mass": ({"body": "crank", "mass": 1.0}, {"body": "rod", "mass": 1.0, "inertia": (1, 1, 1)}),
    "point_mass": ({"name": "new", "point": "B", "mass": 1.0}, None),
    "spring": ({"name": "new", "start": "B", "to": "D", "stiffness": 1.0}, None),
    "damper": ({"name": "new", "start": "phi", "damping": 1.0}, None),
    "stop": ({"name": "new", "start": "phi", "stiffness": 1.0, "upper": 2.0}, None),
    "force": ({"name": "new", "point": "B", "value": (1, 0)}, {"name": "new", "point": "P", "value": (1, 0, 0)}),
    "torque": ({"name": "new", "coordinate": "phi", "value": 1.0}, None),
    "load": ({"name": "new", "function": lambda t, q, v, p: 0.0 * q}, None),
    "apply": ({"name": "new", "kind": nc.forces.COUPLE, "points": ["A", "B"], "parameters": {"value": 1.0}}, None),
    "friction": ({"name": "new", "coefficient": 0.1, "bodies": ("crank", "coupler"), "at": "B", "radius": 0.01}, None),
    "angle": ({"name": "new", "at": "A", "to": "B"}, {"name": "new", "to": ("Q", "R"), "about": "z"}),
    "distance": ({"name": "new", "start": "A", "to": "C"}, {"name": "new", "start": "O", "to": "R"}),
    "relation": ({"name": "new", "terms": {"phi": 1.0, "psi": -1.0}}, None),
    "constrain": ({"name": "new", "kind": nc.constraints.DISTANCE, "points": ["A", "C"]}, None),
    "revolute": ({"name": "new", "point": "B", "other": "S"}, {"name": "new", "axes": ("u", "v")}),
    "prismatic": (
        {"name": "new", "line": ("A", "B"), "on": ("S", "T")},
        {"name": "new", "line": ("O", "P"), "on": ("Q", "R"), "directions": ("u", "v")},
    ),
    "slot": ({"name": "new", "point": "S", "line": ("A", "B")}, {"name": "new", "point": "R", "line": ("O", "P")}),
    "gear": ({"name": "new", "angle1": "phi", "angle2": "psi"}, None),
    "rolling": (
        {"name": "new", "centre": "B", "rim": "C", "contact": "S", "line": ("A", "D"), "angle": "n", "distance": "d"},
        None,
    ),
    "skate": ({"name": "new", "point": "B", "heading": ("B", "C")}, None),
    "cable": ({"name": "new", "points": ["A", "B", "C"]}, None),
    "weld": ({"name": "new", "body": "crank", "other": "loose"}, None),
    "spherical": (None, {"name": "new", "point": "P", "other": "Q"}),
    "cylindrical": (None, {"name": "new", "line": ("O", "P"), "on": "R"}),
    "save": ({"path": "plane.toml"}, None),
    "to_mjcf": ({"path": "plane.xml"}, None),
    "to_urdf": ({"path": "plane.urdf"}, None),
}


@functools.cache
def methods() -> dict[str, dict[str, Any] | None]:
    """Arguments for the methods of results, as `own` has them for functions."""
    return {
        "motion.__getitem__": {"name": "P"},
        "motion.pose": {"index": 1},
        "motion.jerk": None,  # the motion has none, as the error says
        "motion.screw_axis": None,  # in space, as the error says
        "motion.animate": None,  # a second for each call
        "motion.to_parts": None,  # tests/workshop/test_workshop.py
        "motion.to_html": {"path": "page.html"},
        "motion.quaternion": None,
        "tolerance.plot": None,  # over a sequence of poses
        "tolerance.ratio": {"name": "C.x"},
        "linkage.move": {"inputs": {"phi": PHI}},
        "guidance.four_bar": None,  # of dyads that fit each other
        "formulation.of": None,
        "formulation.place": None,
        "motion.plot": {"names": "P"},
        **{f"motion.{name}": {"name": "P"} for name in ("velocity", "acceleration")},
        "system.__getitem__": {"name": "A"},
        "system.replace": {"values": {"A": (0.01, 0.0)}},
        "system.from_named": {"values": things()["system"].named()},
        "system.astype": {"dtype": "float64"},
        "tolerance.__getitem__": {"name": "C.x"},
        "guidance.dyad": {"moving": (0.3, 0.2)},
        "guidance.pole": {"first": 0, "second": 1},
        "guidance.curves": None,  # of four poses
        "guidance.curve_dyad": None,
        "formulation.motion": None,
    }


def calls() -> Iterator[tuple[str, Callable[[], Any], dict[str, Any]]]:
    """Every public function and method: its name, what gives it, and the arguments of a valid call."""
    known, others, seen = things(), own(), set()
    for package in PACKAGES:
        home = importlib.import_module(f"jaxnc.{package}".rstrip("."))
        for name in home.__all__:
            thing = getattr(home, name)
            called = f"{package}.{name}".lstrip(".")
            takes = inspect.isfunction(thing) or (inspect.isclass(thing) and called in others)
            if not takes or thing in seen or others.get(called, {}) is None:
                continue
            seen.add(thing)
            given = dict(others.get(called, {}))
            for p in inspect.signature(thing).parameters.values():
                if p.default is p.empty and p.name not in given and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD):
                    assert p.name in known, f"say in own() what a valid call of {called} has for {p.name}"
                    given[p.name] = known[p.name]
            yield called, (lambda thing=thing: thing), given
    for name, both in BUILDER.items():
        for make, given in zip((plane, space), both, strict=True):
            if given is not None:
                yield f"{make.__name__}.{name}", (lambda make=make, name=name: getattr(make(), name)), given
    for noun in ("motion", "system", "formulation", "tolerance", "linkage", "guidance"):
        thing = known[noun]
        for name, member in inspect.getmembers(type(thing)):
            if (name.startswith("_") and name != "__getitem__") or not inspect.isfunction(member):
                continue
            given = dict(methods().get(f"{noun}.{name}") or {})
            if methods().get(f"{noun}.{name}", {}) is None:
                continue
            parameters = list(inspect.signature(member).parameters.values())[1:]
            if not parameters:
                continue
            for p in parameters:
                if p.default is p.empty and p.name not in given and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD):
                    assert p.name in known, f"say in methods() what a valid call of {noun}.{name} has for {p.name}"
                    given[p.name] = known[p.name]
            yield f"{noun}.{name}", (lambda thing=thing, name=name: getattr(thing, name)), given


@pytest.fixture(autouse=True)
def small_atlases(monkeypatch):
    """Atlases of four-bars alone, and no more than are drawn at once."""
    monkeypatch.setattr(atlas, "BARS", (4,))
    monkeypatch.setattr(atlas, "_PART", 500)


def test_every_valid_call_is_valid(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, get, given in calls():
        try:
            call(get(), given)
        except Exception as error:
            pytest.fail(f"{name}: {type(error).__name__}: {error}")
        finally:
            plt.close("all")


def call(function: Callable[..., Any], given: dict[str, Any]) -> Any:
    """Call a function with arguments by name; those that cannot be given so in their place."""
    in_place = []
    for p in inspect.signature(function).parameters.values():
        if p.kind is p.VAR_POSITIONAL and p.name in given:
            in_place = [x for x in [given[p.name]]]
            before = [q for q in inspect.signature(function).parameters.values() if q.kind is q.POSITIONAL_OR_KEYWORD]
            ahead = [given[q.name] for q in before[: list(inspect.signature(function).parameters).index(p.name)]]
            rest = {k: v for k, v in given.items() if k != p.name and k not in [q.name for q in before[: len(ahead)]]}
            return function(*ahead, *in_place, **rest)
    return function(**given)


# -- what is no argument -------------------------------------------------------------------------------------------

WRONG: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "true": lambda: True,
    "negative": lambda: -1,
    "zero": lambda: 0,
    "huge": lambda: 1e308,
    "400 digits": lambda: 10**400,
    "400 digits in a place": lambda: (10**400, 0),
    "NaN": lambda: float("nan"),
    "infinity": lambda: np.inf,
    "complex": lambda: 1j,
    "fraction": lambda: fractions.Fraction(1, 3),
    "decimal": lambda: decimal.Decimal("0.5"),
    "0-d array": lambda: np.array(0.4),
    "array": lambda: np.array([1.0, 2.0]),
    "empty array": lambda: np.zeros(0),
    "matrix": lambda: np.ones((3, 2)),
    "big array": lambda: np.zeros((2, 3, 4, 5)),
    "array of NaN": lambda: np.full(4, np.nan),
    "complex array": lambda: np.ones(3, complex),
    "objects": lambda: np.array([None, "a", 1.0], object),
    "words": lambda: np.array(["a", "b"]),
    "dates": lambda: np.array(["2024-01-01"], "datetime64[D]"),
    "date": lambda: datetime.date(2024, 1, 1),
    "masked": lambda: np.ma.masked_array([1.0, 2.0], [True, False]),
    "of JAX": lambda: jnp.ones(2),
    "text": lambda: "nowhere",
    "empty text": lambda: "",
    "bytes": lambda: b"B",
    "list": lambda: [1.0, 2.0],
    "empty list": lambda: [],
    "list of lists": lambda: [[1.0], [2.0, 3.0]],
    "list of texts": lambda: ["nowhere", "B"],
    "mixed list": lambda: ["B", None],
    "tuple": lambda: ("A", "B", "C"),
    "set": lambda: {1.0, 2.0},
    "mapping": lambda: {"nothing": 1.0},
    "mapping of texts": lambda: {"phi": "B"},
    "mapping of None": lambda: {"phi": None},
    "mapping by numbers": lambda: {1: 2},
    "empty mapping": dict,
    "function": lambda: lambda: 0,
    "function of all": lambda: lambda *a, **k: None,
    "generator": lambda: (x for x in range(3)),
    "object": object,
    "class": lambda: int,
    "system": lambda: things()["system"],
    "motion": lambda: things()["motion"],
    "mechanism": lambda: nc.library.slider_crank(),
}

SAID_AS = {  # what messages call an argument beside its name
    "at": "place",
    "value": "place",  # of a force, its components
    "radii": "radius",
    "path": "file",
    "t": "time",
    "q": "coordinates",
    "z": "coordinates",
    "f": "function",
    "index": "pose",
    "min": "low",
    "max": "high",
}


class Late(BaseException):
    """A call took too long."""


def fault(name: str, get: Callable, given: dict[str, Any], argument: str, wrong: Callable[[], Any]) -> str | None:
    """What is wrong with how a call with one wrong argument ends; None if nothing is."""

    def late(*_: Any) -> None:
        raise Late

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE)
    try:
        return _fault(get(), given, argument, wrong())
    except Late:
        return f"takes more than {PATIENCE} s"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        plt.close("all")


def _fault(function: Callable, given: dict[str, Any], argument: str, value: Any) -> str | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            call(function, {**given, argument: value})
    except nc.JaxncError as error:
        said = str(error).lower()
        described = re.search(rf"^ +\**{argument}: (.*)", inspect.getdoc(function) or "", re.M)
        words = {argument, argument.rstrip("s"), argument.replace("_", " "), SAID_AS.get(argument, argument)}
        words |= {value} if isinstance(value, str) else set()
        words |= {brief(value), repr(value)[:30], type(value).__name__}
        words |= set(inspect.signature(function).parameters)  # with which it may be at odds
        words |= {w for w in re.findall(r"[a-z]{4,}", described[1].lower())} if described else set()
        words |= {str(x) for x in value} if isinstance(value, dict | tuple | list) else set()
        words |= {str(x) for x in value.flat} if isinstance(value, np.ndarray) and value.dtype.kind == "U" else set()
        if not any(word and word.lower() in said for word in words):
            return f"does not name it: {type(error).__name__}: {error}"
    except Late:
        raise
    except Exception as error:
        places = [f for f in traceback.extract_tb(error.__traceback__) if "/jaxnc/" in f.filename]
        where = f"{places[-1].filename.rpartition('/jaxnc/')[2]}:{places[-1].lineno}" if places else "outside"
        return f"{type(error).__name__} ({where}): {str(error)[:120]}"
    return None


def trials() -> list[tuple]:
    """All calls with one wrong argument each."""
    return [
        (name, get, given, argument, what)
        for name, get, given in calls()
        for argument in inspect.signature(get()).parameters
        for what in WRONG
    ]


def test_wrong_arguments_are_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    every = trials()
    wish = os.environ.get("JAXNC_FUZZ", str(SAMPLE))
    chosen = every if wish == "all" else random.Random(7).sample(every, min(int(wish), len(every)))
    faults = [
        f"{name}({argument}= {what}): {said}"
        for name, get, given, argument, what in chosen
        if (said := fault(name, get, given, argument, WRONG[what]))
    ]
    assert not faults, f"{len(faults)} of {len(chosen)} calls\n" + "\n".join(faults)


# -- slips of the pen ----------------------------------------------------------------------------------------------


def told(call: Callable[[], Any], *parts: str) -> None:
    """A call that is refused as such: one error, that of Python not behind it, which says the parts."""
    with pytest.raises(nc.CallError) as caught:
        call()
    assert isinstance(caught.value, TypeError) and isinstance(caught.value, nc.JaxncError)
    assert all(part in str(caught.value) for part in parts), str(caught.value)
    assert caught.value.__cause__ is None and caught.value.__context__ is None
    inside = [f.name for f in traceback.extract_tb(caught.value.__traceback__) if "/jaxnc/" in f.filename]
    assert inside == ["call"]


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: plane().spring("s", "B", "D", stiffness=1, free_length=2), ["spring()", "free_length=", "'free'"]),
        (lambda: plane().spring("s", "B", "D", stiffness=1, length=2), ["length=", "'free'"]),
        (lambda: plane().spring("s", "B", "D", k=1), ["k=", "'stiffness'", "It needs name, start, stiffness="]),
        (lambda: plane().damper("d", "phi", c=1), ["c=", "'damping'"]),
        (lambda: plane().spring("s", "B", "D"), ["spring() lacks stiffness (N/m"]),
        (lambda: plane().point("Q", (0, 1), fixed=True), ["point(): fixed must be a text", "got True"]),
        (lambda: plane().body("b", ["B", "E"], sahpe="rod"), ["'shape'"]),
        (lambda: plane().compile(spars=True), ["compile()", "'sparse'"]),
        (lambda: nc.grashof(things()["system"]), ["grashof() lacks crank"]),
        (lambda: nc.sensitivity(things()["motion"]), ["sensitivity() lacks outputs"]),
        (lambda: nc.suspension(things()["ride"], centre="wheel_centre"), ["centre=", "'wheel_centre'"]),
        (lambda: nc.sweep(things()["system"], phi=PHI), ["phi=", "{'phi': …}", "needs system, inputs"]),
        (lambda: nc.sweep(things()["system"], {"phi": PHI}, hold=5), ["hold must be a list of names", "got 5"]),
        (lambda: nc.sweep(things()["system"], {"phi": PHI}, inputs={}), ["inputs twice"]),
        (lambda: nc.equilibrium(things()["system"], phi=1.0), ["phi=", "one mapping, state={'phi': …}"]),
        (lambda: plane().spring("s", points=("B", "D"), stiffness=1), ["points=", "'start'"]),
        (lambda: plane().spring("s", "B", "D", stiffness=1, natural_length=2), ["natural_length=", "'free'"]),
        (lambda: nc.simulate(things()["system"], duration=1.0), ["duration=", "'t'"]),
        (lambda: things()["motion"].plot("C", 1), ["each of names must be", "got 1"]),
        (lambda: nc.Mechanism("a", 2, "", "m", "rad", "too much"), ["Mechanism() is given 6 arguments", "takes 5"]),
        (lambda: nc.mobility(), ["mobility() lacks system"]),
        (lambda: nc.synthesis.PathGeneration(things()["mechanism"], target=PHI), ["lacks point"]),
        (lambda: things()["motion"].velocity(), ["velocity() lacks name"]),
        (lambda: nc.library.four_bar(crnk=1.0), ["'crank'"]),
        (lambda: nc.constraints.cable(cuont=3), ["cable()", "'count'"]),
    ],
)
def test_a_call_that_does_not_bind_is_told_in_words(call, parts):
    told(call, *parts)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda m: m.force("B", (0.0, -1.0)), "lacks value .*needs name, point, value"),
        (lambda m: m.force("B", (0.0, -1.0), name="pull"), "name twice"),
        (lambda m: m.force("B", lambda t, x, p: (0, p), 1.0), "name of a point is wanted, after its own"),
        (lambda m: m.torque("phi", 1.0), "lacks value.*name, coordinate, value"),
        (lambda m: m.torque("phi", lambda t, x, p: p, 1.0), "coordinate is wanted, after its own"),
        (lambda m: m.point_mass("B", 2.0), "lacks mass .*needs name, point, mass"),
        (lambda m: m.point_mass("B", 2.0, "weight"), "point is wanted, after its own"),
        (lambda m: m.relation({"phi": 1.0}), "lacks terms"),
        (lambda m: m.relation({"phi": 1.0}, 0.0, name="tie"), "name twice"),
        (lambda m: m.constrain(nc.constraints.DISTANCE, ["A", "B"]), "has its name first"),
        (lambda m: m.constrain(nc.constraints.DISTANCE, points=["A", "B"]), "lacks kind"),
        (lambda m: m.apply(nc.forces.COUPLE, ["A", "B"]), "has its name first"),
    ],
)
def test_what_has_its_name_last_or_none_is_told_the_order(call, said):
    with pytest.raises(nc.JaxncError, match=said):
        call(plane())


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda: plane().pin, "Mechanism.*'pin'.*'revolute'"),
        (lambda: plane().moment("M", "phi", 1.0), "'moment'; did you mean 'torque'"),
        (lambda: plane().revolut, "did you mean 'revolute'"),
        (lambda: things()["motion"].velocities("P"), "Motion.*'velocities'.*'velocity'"),
        (lambda: things()["system"].replce({}), "System.*'replce'.*'replace'"),
    ],
)
def test_what_an_object_has_not_is_told_with_what_is_near(ask, said):
    with pytest.raises(nc.JaxncError, match=said) as caught:
        ask()
    assert isinstance(caught.value, AttributeError)
    assert not hasattr(plane(), "pin") and getattr(things()["motion"], "pin", None) is None


def test_gravity_that_is_called_says_how_it_is_set():
    for m, given in ((plane(), (0.0, -9.81)), (space(), (0.0, 0.0, -9.81))):
        for _ in range(2):
            with pytest.raises(nc.CallError, match=r"gravity.*not called.*gravity = "):
                m.gravity(9.81)
            m.gravity = given
        assert m.gravity == given
        m.gravity = plane().gravity
        assert not m.gravity and m.model.gravity is None


def test_what_users_own_functions_raise_is_theirs():
    with pytest.raises(KeyError, match="table"):
        nc.motion(things()["system"], {"phi": lambda t: {}["table"]}, PHI)
    with pytest.raises(TypeError, match="unsupported"):
        nc.sensitivity(things()["system"], lambda mo: mo["C"] + object(), {"phi": 1.2})


def test_public_functions_are_what_they_were_to_tools():
    """Signatures, docstrings, names and pickles are those of the function that was written."""
    for function in (nc.sweep, nc.grashof, nc.library.four_bar, nc.constraints.cable):
        assert pickle.loads(pickle.dumps(function)) is function
        assert function.__module__.startswith("jaxnc.") and function.__doc__
        assert inspect.signature(function) == inspect.signature(inspect.unwrap(function))
    assert str(inspect.signature(nc.Mechanism.spring)).startswith("(self, name: str, start: str, to: str | None")
    assert list(inspect.signature(nc.Mechanism).parameters)[:2] == ["name", "dim"]


def test_all_that_is_public_is_opened():
    """Functions, and the methods of classes, of every package."""
    closed = []
    for package in (*PACKAGES, "constraints", "forces"):
        home = importlib.import_module(f"jaxnc.{package}".rstrip("."))
        for name in home.__all__:
            thing = getattr(home, name)
            if inspect.isfunction(thing) and not hasattr(thing, "_public"):
                closed.append(f"{package}.{name}")
            if not inspect.isclass(thing) or issubclass(thing, BaseException) or hasattr(thing, "__struct_fields__"):
                continue
            for method, member in vars(thing).items():
                takes = inspect.isfunction(member) and len(inspect.signature(member).parameters) > 1
                if method[0] != "_" and takes and not hasattr(member, "_public"):
                    closed.append(f"{package}.{name}.{method}")
    assert not closed, closed


def test_right_calls_do_not_look_for_names_that_were_meant(monkeypatch):
    """The search takes a quarter of a small sweep."""
    system = nc.library.four_bar().compile()
    monkeypatch.setattr("jaxnc.calls.nearest", lambda name, *_: pytest.fail(f"asked for {name!r}"))
    motion = nc.sweep(system, {"phi": np.array([1.0, 2.0])}, rates={"phi": 1.0})
    nc.solve_position(system, {"phi": 1.0})
    assert motion.velocity("C").shape == (2, 2)
