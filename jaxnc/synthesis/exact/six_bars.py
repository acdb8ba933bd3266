"""Function generation at eight precision points: all six-bars whose output stands at given angles when the input does.

Source: M. Plecnik and J. M. McCarthy, Numerical synthesis of six-bar linkages for mechanical computation, J. Mechanisms
Robotics 6 (2014) 031012, for the problem and its equations in isotropic coordinates.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np

from jaxnc.calls import public
from jaxnc.continuation.monodromy import is_new
from jaxnc.continuation.tracker import FAR, Pace, PathEnds
from jaxnc.errors import InputError, counted, nearest
from jaxnc.kinematics.inputs import one_number
from jaxnc.kinematics.position import sweep
from jaxnc.mechanism import Mechanism
from jaxnc.progress import bar
from jaxnc.synthesis.evaluate import map_threads
from jaxnc.synthesis.exact.bar_paths import SINGULAR, end_elsewhere
from jaxnc.synthesis.exact.freudenstein import check_points
from jaxnc.synthesis.exact.linkage import Point, complex_of, point_of, wrap_angle
from jaxnc.synthesis.exact.path_certificate import FollowedDesigns, certify_designs
from jaxnc.synthesis.exact.six_bar_paths import (
    BLOCK,
    PAIRS,
    TURNS,
    AngleTask,
    SixBarPaths,
    draw_bend,
    find_angle_starts,
)
from jaxnc.system.system import System
from jaxnc.types import Any, ArrayLike

_BODIES = {
    "Watt II": {"input": "AD", "coupler": "DE", "middle": "BEF", "link": "FG", "output": "CG"},
    "Stephenson II": {"input": "ADE", "first": "DF", "second": "EG", "middle": "HFG", "output": "CH"},
    "Stephenson III": {"input": "AD", "middle": "DEF", "rocker": "BE", "link": "FG", "output": "CG"},
}
PLACES = {
    "Watt II": {"A": (0, 0), "B": (2, 0), "C": (4, 0), "D": (0.3, 1), "E": (1.7, 1.5), "F": (2.5, 1.4),
                "G": (3.6, 1.1)},
    "Stephenson II": {"A": (0, 0), "C": (4, 0), "D": (0.3, 1), "E": (-0.6, 1.2), "F": (2, 2.2), "G": (1.5, 3),
                      "H": (3.5, 1.4)},
    "Stephenson III": {"A": (0, 0), "B": (2, 0), "C": (4, 0), "D": (0.3, 1), "E": (1.7, 1.5), "F": (1.5, 2.4),
                       "G": (3.6, 1.1)},
}  # fmt: skip
"""Joints of a six-bar of each kind that moves."""

_COUNTS = {"Watt II": 12560, "Stephenson II": 11956, "Stephenson III": 27184}  # solutions of angles in general position
_APART = {"Watt II": ("AB", "BC"), "Stephenson II": ("AC", "AD"), "Stephenson III": ("AB",)}
_ROUTES = 2
_PACES = ((Pace(1e-4, 0.01, 1e-6), False), (Pace(1e-5, 0.01, 1e-6), True), (Pace(1e-6, 0.001, 1e-7), True))


@public
@dataclasses.dataclass(frozen=True)
class SixBarDesign:
    """A six-bar that generates a function; ``print()`` says how well.

    Attributes:
        kind: ``"Watt II"``, ``"Stephenson II"`` or ``"Stephenson III"``.
        points: places of its joints by name, drawn at the first pair of angles; A, B and C are fixed.
        inputs: angle ``phi`` of the input at the pairs, from the x axis, radians, ``(8,)``.
        outputs: angle ``psi`` of the output, ``(8,)``.
        error: largest deviation of the output after really moving through the pairs, radians; NaN if it stops.
        proved: whether the solution is proved to exist, to be real and to be alone near it.
        defects: ``"branch"``: some pair is met by another assembly only; ``"dead point"``: the input cannot pass the
            range. Empty: the design works.
    """

    kind: str
    points: Mapping[str, Point]
    inputs: np.ndarray
    outputs: np.ndarray
    error: float
    proved: bool
    defects: tuple[str, ...]

    @property
    def size(self) -> float:
        """Largest distance of two joints at the first pair, a length."""
        z = np.array([complex(*point) for point in self.points.values()])
        return float(np.abs(z[:, None] - z).max())

    def mechanism(self) -> Mechanism:
        """The linkage as a description that can be changed, compiled and saved; see `system` for its coordinates."""
        return describe_six_bar(self.kind, self.points)

    @property
    def system(self) -> System:
        """The compiled linkage: drive ``phi``, read ``psi``, both from the x axis."""
        return _template(self.kind).replace({name: np.array(point) for name, point in self.points.items()})

    def __str__(self) -> str:
        joints = ", ".join(f"{name} ({x:.5g}, {y:.5g})" for name, (x, y) in self.points.items())
        state = f"{', '.join(self.defects)} defect" if self.defects else f"works, error {self.error:.1e}"
        return f"{self.kind}: {joints}; {state}"

    __repr__ = __str__


@public
@dataclasses.dataclass(frozen=True)
class SixBarDesigns(FollowedDesigns[SixBarDesign]):
    """All six-bars through eight pairs of angles, those without defects first, by size; ``print()`` lists them.

    Attributes:
        designs: the real ones.
        expected: how many solutions angles in general position have, complex ones included.
        found: how many finite, regular ones of them were found.
        routes: how often all were followed, each time another way.
        missing: how many paths ended neither in a regular solution of their own, nor at infinity, nor in a singular one
            or a linkage in which a bar has no length: at most so many regular solutions are missing.
        proved: for each design whether its solution is proved to exist, to be real and to be alone near it.
        disjoint: whether no two of the proved ones are one solution.
    """

    def __str__(self) -> str:
        return self.describe(counted(len(self), "six-bar"))

    __repr__ = __str__


@public
def precision_six_bars(
    kind: str,
    inputs: ArrayLike,
    outputs: ArrayLike,
    A: Point = (0.0, 0.0),
    C: Point = (1.0, 0.0),
    B: Point | None = None,
    D: Point | None = None,
    length: float = 1.0,
) -> SixBarDesigns:
    """All six-bars whose output stands at given angles when the input does, at eight precision points.

    With their pivots given, eight pairs of angles leave one length free, which is given too. All complex solutions are
    followed from a stored task to this one, and the real ones are moved through the pairs. The first call of a kind
    finds the solutions of the stored task, in some minutes, and keeps them in the user's cache (`jaxnc.cache`); it goes
    on where it was interrupted.

    Args:
        kind: ``"Watt II"``: input A-D, coupler D-E, a link E-B-F on a fixed pivot B, link F-G, output C-G.
            ``"Stephenson III"``: input A-D, a link D-E-F, rocker B-E, link F-G, output C-G. ``"Stephenson II"``: input
            A-D-E, links D-F and E-G, a link F-G-H, output C-H. To drive the other end exchange inputs and outputs, A
            and C.
        inputs: angles of the input from where it stands at any of them, radians, ``(8,)``, in order.
        outputs: angles of the output likewise, ``(8,)``.
        A: fixed pivot of the input, lengths.
        C: fixed pivot of the output.
        B: fixed pivot of the third link, of Watt II and Stephenson III.
        D: of Stephenson II, the input's joint D at the first pair.
        length: of A-D; of C-H for Stephenson II.

    Returns:
        The designs, drawn at the first pair.

    Raises:
        InputError: an unknown kind; angles that are not eight pairs of finite numbers, not in order, or that repeat; an
            output that does not turn; pivots that are left out or coincide; a length that is not positive.

    Source: M. Plecnik and J. M. McCarthy, J. Mechanisms Robotics 6 (2014) 031012. The numbers of solutions are our own
    count, by monodromy.
    """
    scale, places, task, x, y = _check_angles(kind, inputs, outputs, {"A": A, "B": B, "C": C, "D": D}, length)
    expected = _COUNTS[kind]
    with bar(expected, f"{kind}: start set, once", "solution", leave=False) as shown:
        starts = find_angle_starts(kind, lambda known: shown.update(min(known, expected) - shown.n))
    unknown = max(expected - starts.z.shape[1], 0)  # that the start set itself lacks
    expected, most = unknown + starts.z.shape[1], np.inf
    ends, routes = np.zeros((8, 0), complex), 0
    while routes < _ROUTES and ends.shape[1] < min(starts.z.shape[1], most):
        found, lost = _follow_all(kind, starts.task, starts.z, task, routes)
        ends = np.concatenate([ends, found[:, is_new(ends, found)]], axis=1)
        routes, most = routes + 1, min(most, found.shape[1] + lost)
    missing = unknown + int(max(min(starts.z.shape[1], most) - ends.shape[1], 0))
    here = SixBarPaths(kind, task, task, wide=True)
    real = here.find_real(ends)
    square = np.zeros((9, 9), complex)  # of the length, as a form of 1 and z
    square[0, 0], square[1 + here.which[0], 1 + here.which[1]] = -task.square, 1.0
    proved, disjoint = certify_designs(real, here.pairs, here.places(np.ones(1), 0)[0], [(square + square.T) / 2])
    designs = _make_designs(kind, places, scale, real[:8], proved, x, y)
    of_designs = tuple(design.proved for design in designs)
    return SixBarDesigns(designs, expected, ends.shape[1], routes, missing, of_designs, disjoint)


# -- statement ---------------------------------------------------------------------------------------------------------


def _check_angles(
    kind: str, inputs: ArrayLike, outputs: ArrayLike, given: dict[str, Any], length: float
) -> tuple[np.ndarray, dict[str, complex], AngleTask, np.ndarray, np.ndarray]:
    """Sizes by which each bar's equation is divided, places that are given, the task and its angles."""
    what = "precision_six_bars"
    if kind not in PAIRS:
        raise InputError(f"{what}: there is no kind {kind!r}; {nearest(kind, PAIRS)}")
    x, y = check_points(what, inputs, outputs)
    if len(x) != TURNS + 1:
        raise InputError(f"{what}: {len(x)} pairs of angles; there must be {TURNS + 1}")
    phi, psi = x - x[0], y - y[0]
    same = np.abs(np.exp(1j * x[:, None]) - np.exp(1j * x)) + np.abs(np.exp(1j * y[:, None]) - np.exp(1j * y)) < 1e-9
    if (same & ~np.eye(len(x), dtype=bool)).any():
        i, j = np.argwhere(np.triu(same, 1))[0]
        raise InputError(f"{what}: pairs {i} and {j} of inputs and outputs are the same but for whole turns")
    if np.abs(np.exp(1j * psi) - 1.0).max() < 1e-9:
        raise InputError(f"{what}: the outputs are all one angle; an output that stands still needs no linkage")
    needed = "ACD" if kind == "Stephenson II" else "ABC"
    places = {}
    for name, value in given.items():
        if name in needed and value is None:
            raise InputError(f"{what}: {kind} needs {name}=(x, y) too")
        if name not in needed and value is not None:
            raise InputError(f"{what}: {kind} takes no {name}; leave it out")
        if name in needed:
            places[name] = complex_of(what, name, value)
    for one, other in _APART[kind]:
        if abs(places[one] - places[other]) < 1e-9 * max(abs(places[n] - places["A"]) for n in needed):
            raise InputError(f"{what}: {one} and {other} are both {given[one]}; a {kind} has them apart")
    length = one_number(length, f"{what}: length")
    if not (math.isfinite(length) and length > 0):
        raise InputError(f"{what}: length = {length} must be a positive length")
    a, c = places["A"], places["C"]
    if kind == "Watt II":
        scale, b = np.array([places["B"] - a, places["B"] - c]), np.ones(2)
    elif kind == "Stephenson III":
        scale, b = np.full(2, a - places["B"]), np.array([1.0, (a - c) / (a - places["B"])])
    else:
        scale, b = np.full(2, a - c), np.ones(2)
    own = (places["D"] - a) / scale[0] if kind == "Stephenson II" else 0.0
    square = np.asarray((length / abs(scale[0])) ** 2 + 0j)
    task = AngleTask(np.stack([phi, psi])[:, 1:] + 0j, np.stack([b, np.conj(b)], axis=1) + 0j,
                     np.array([own, np.conj(own)]), square)  # fmt: skip
    return scale, places, task, x, y


# -- solutions ---------------------------------------------------------------------------------------------------------


def _follow_all(kind: str, start: AngleTask, z: np.ndarray, task: AngleTask, route: int) -> tuple[np.ndarray, int]:
    """Follow all paths from the stored task to this one; each route bends another way.

    Returns the regular finite ends, and how many paths are lost: they ended neither there nor at infinity, nor in a
    singular solution or a linkage that is none.
    """
    near = dataclasses.replace(task, angles=start.angles + wrap_angle(np.real(task.angles - start.angles)))
    bend = draw_bend(kind, np.random.default_rng([3, route]))
    here = SixBarPaths(kind, task, task, wide=True)
    ends, good, elsewhere = np.array(z), np.zeros(z.shape[1], bool), np.zeros(z.shape[1], bool)
    for pace, wide in _PACES:
        rest = np.flatnonzero(~good & ~elsewhere)
        blocks = np.array_split(rest, max(1, len(rest) // BLOCK))
        paths = SixBarPaths(kind, start, near, bend, wide)
        with bar(len(rest), f"{kind}: paths", "path", leave=False) as shown:
            found = map_threads(functools.partial(_follow_some, paths, z, pace, shown), blocks)
        for lanes, out in zip(blocks, found, strict=True):
            w, last = here.polish(out.w)
            with np.errstate(all="ignore"):
                none = _have_no_length(here, w[:8]) | (np.abs(w[:8]).max(axis=0) >= FAR)
            met = out.arrived & (last < SINGULAR)
            ends[:, lanes], good[lanes] = w[:8], met & ~none
            if wide:
                elsewhere[lanes] = end_elsewhere(out, met, none, pace is _PACES[-1][0])
        # Of two paths that met in one end either may have left its own.
        kept, back = np.flatnonzero(good), np.flatnonzero(good)[::-1]
        good[kept] = is_new(ends[:, :0], ends[:, kept])
        if not wide:
            good[back] &= is_new(ends[:, :0], ends[:, back])
    return ends[:, good], int((~good & ~elsewhere).sum())


def _follow_some(paths: SixBarPaths, z: np.ndarray, pace: Pace, shown: Any, lanes: np.ndarray) -> PathEnds:
    out = paths.follow(z[:, lanes], pace)
    shown.update(len(lanes))
    return out


def _have_no_length(paths: SixBarPaths, z: np.ndarray) -> np.ndarray:
    """Where a bar has no length, or one of the vectors that are solved for."""
    (known,) = paths.places(np.ones(z.shape[1]), 0)
    q, qq, r, rr = z.reshape(4, 2, -1)
    p, pp = (b[:, 0] + paths.gather(v) for b, v in zip(known.b, (r, rr), strict=True))
    pairs = np.abs([(q, qq), (r, rr), (q + p, qq + pp)])
    # of the distance of the pivots
    return pairs.max(axis=1).min(axis=(0, 1)) < 1e-8


# -- linkages ----------------------------------------------------------------------------------------------------------


def _make_designs(
    kind: str, places: dict[str, complex], scale: np.ndarray, z: np.ndarray, proved: np.ndarray, x: Any, y: Any
) -> tuple[SixBarDesign, ...]:
    """Real solutions as linkages that were moved through the pairs, the best first."""
    joints = _joints(kind, z[[0, 1, 4, 5]], places, scale)
    fixed = {name: at for name, at in places.items() if name != "D"}
    designs = []
    for k in range(z.shape[1]):
        points = {name: point_of(at) for name, at in (fixed | {n: v[k] for n, v in joints.items()}).items()}
        designs.append(_move_six_bar(kind, points, bool(proved[k]), x, y))
    designs.sort(key=lambda design: (len(design.defects), design.size))
    return tuple(designs)


def _joints(kind: str, z: np.ndarray, places: Mapping[str, complex], scale: np.ndarray) -> dict[str, np.ndarray]:
    """Places of the joints at the first pair, of the vectors q and r of solutions, ``(4, solutions)``."""
    a, c, r = places["A"], places["C"], z[2:] * scale[:, None]
    q = z[:2] * scale[:, None]
    if kind == "Stephenson II":
        h = c - r[1]
        return {"D": places["D"] + 0.0 * h, "E": a + r[0], "F": h - q[0], "G": h - q[1], "H": h}
    if kind == "Watt II":
        return {"D": a - r[0], "E": places["B"] + q[0], "F": places["B"] + q[1], "G": c - r[1]}
    d = a + r[0]
    return {"D": d, "E": d + q[0], "F": d + q[1], "G": c - r[1]}


def _move_six_bar(kind: str, points: dict[str, Point], proved: bool, x: np.ndarray, y: np.ndarray) -> SixBarDesign:
    z = {name: complex(*point) for name, point in points.items()}
    end = z["H" if kind == "Stephenson II" else "G"]
    phi, psi = (float(np.angle(v)) for v in (z["D"] - z["A"], end - z["C"]))
    inputs, outputs = phi + x - x[0], psi + y - y[0]
    steps = 8  # of the sweep from one pair of angles to the next
    at = np.arange(len(x)) * steps
    design = SixBarDesign(kind, points, inputs, outputs, math.nan, proved, ())
    motion = sweep(design.system, {"phi": np.interp(np.arange(at[-1] + 1), at, inputs)})
    if not np.asarray(motion.converged).all():
        return dataclasses.replace(design, defects=("dead point",))
    error = float(np.abs(wrap_angle(np.asarray(motion["psi"])[at] - outputs)).max())
    # An output that is further off, in radians, after really moving there is not met.
    return dataclasses.replace(design, error=error, defects=() if error < 1e-8 else ("branch",))


def describe_six_bar(kind: str, points: Mapping[str, Any]) -> Mechanism:
    """Describe a six-bar of a kind with its joints at some places: angles ``phi`` and ``psi`` are input and output."""
    m = Mechanism(kind)
    for name, at in points.items():
        (m.ground if name in "ABC" else m.point)(name, at)
    for name, joints in _BODIES[kind].items():
        m.body(name, list(joints))
    m.angle("phi", at="A", to="D")
    m.angle("psi", at="C", to="H" if kind == "Stephenson II" else "G")
    return m


@functools.cache
def _template(kind: str) -> System:
    """A compiled linkage that all of a kind share."""
    return describe_six_bar(kind, PLACES[kind]).compile()
