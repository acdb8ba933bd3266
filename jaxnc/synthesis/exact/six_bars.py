"""Function generation at eight precision points: all six-bars whose output stands at given angles when the input does.

One link turns with neither input nor output, and two bars lead from it to places that move with these, see
`jaxnc.synthesis.exact.bar_paths`. With the pivots given, eight pairs leave one length free, which is given too.

Angles move in straight lines, but for a bend into complex ones: so the equations stay those of linkages, which have far
fewer solutions than equations of their form. A loop ends where angles have gone on by whole turns, which is where it
began. The linkage it begins with is real: solutions that are found there have conjugates.

Source: M. Plecnik and J. M. McCarthy, Numerical synthesis of six-bar linkages for mechanical computation, J. Mechanisms
Robotics 6 (2014) 031012, for the problem and its equations in isotropic coordinates.
"""

import dataclasses
import functools
import itertools
import math
import time
from collections.abc import Callable, Mapping

import numpy as np

from jaxnc.calls import public
from jaxnc.continuation.monodromy import is_new
from jaxnc.continuation.tracker import BOLD, FAR, Pace, PathEnds
from jaxnc.errors import InputError, counted
from jaxnc.kinematics.inputs import one_number
from jaxnc.kinematics.starts import load_arrays, save_arrays
from jaxnc.mechanism import Mechanism
from jaxnc.progress import bar
from jaxnc.synthesis.evaluate import map_threads
from jaxnc.synthesis.exact.bar_paths import BLOCK, MIRRORED, Attempt, BarPaths, Places, follow_all, follow_routes
from jaxnc.synthesis.exact.freudenstein import check_points
from jaxnc.synthesis.exact.linkage import Point, complex_of, describe_linkage, point_of, sweep_through, wrap_angle
from jaxnc.synthesis.exact.precision_points import FollowedDesigns, certify_designs
from jaxnc.synthesis.validate import check_name
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
_ATTEMPTS = (
    Attempt(Pace(1e-4, 0.01, 1e-6), wide=False),
    Attempt(Pace(1e-5, 0.01, 1e-6)),
    Attempt(Pace(1e-6, 0.001, 1e-7)),
)

TURNS = 7
"""Pairs of angles but the first."""

PAIRS = {
    "Watt II": ((0, 0), (1, 1)),
    "Stephenson II": ((0, 1), (1, 0), (1, 1)),
    "Stephenson III": ((0, 0), (1, 0), (1, 1)),
}
"""Bars whose places have the vector of the input (0) and of the output (1), of each kind."""

_GIVEN = {"Watt II": 0, "Stephenson II": 1, "Stephenson III": 0}  # the vector whose length is given
_DRAWS = 30  # linkages, of which the best conditioned one is taken


@dataclasses.dataclass(frozen=True)
class AngleTask:
    """Eight pairs of angles and what is known of the linkage, with conjugates as numbers of their own."""

    angles: np.ndarray  # of input and output, from the first pair on, (2, TURNS)
    b: np.ndarray  # of both bars, and b', (2, 2)
    given: np.ndarray  # of the first bar's place, a vector that turns with the input, and its primed one, (2,)
    square: np.ndarray  # of the length that is given, ()


FIELDS = tuple(f.name for f in dataclasses.fields(AngleTask))


class SixBarPaths(BarPaths):
    """Paths from one task to another: what is known moves in straight lines, or in parabolas if there is a bend."""

    def __init__(self, kind: str, start: AngleTask, end: AngleTask, bend: AngleTask | None = None, wide: bool = False):
        self.pairs = PAIRS[kind]
        super().__init__(TURNS, wide)
        self.terms = {}
        for name in FIELDS:
            a, b = getattr(start, name), getattr(end, name)
            c = getattr(bend, name) if bend else np.zeros_like(a)
            self.terms[name] = (a, b - a + c, -c)
        self.which = 4 + _GIVEN[kind], 6 + _GIVEN[kind]

    def _about(self, name: str, at: np.ndarray) -> list[np.ndarray]:
        """Taylor coefficients of a part of the task, with an axis for lanes."""
        a, b, c = (term[..., None] for term in self.terms[name])
        return [a + at * (b + at * c), b + 2.0 * at * c, c + 0.0 * at]

    def places(self, at: np.ndarray, order: int) -> list[Places]:
        """Power series of places."""
        angles, b, given = (self._about(name, at) for name in ("angles", "b", "given"))
        turns = []
        for sign in (1j, -1j):
            series = [np.exp(sign * angles[0])]
            for k in range(1, order + 1):
                after = 2.0 * angles[2] * series[k - 2] if k > 1 else 0.0
                series.append(sign / k * (angles[1] * series[k - 1] + after))
            turns.append([series[0] - 1.0, *series[1:]])
        out = []
        for k in range(order + 1):
            place, move = np.zeros((2, 2, 1, len(at)), complex), np.zeros((2, 2, TURNS, len(at)), complex)
            for side in (0, 1):
                move[side, 0] = sum(given[i][side] * turns[side][k - i][0] for i in range(min(k, 2) + 1))
                if k < 3:
                    place[side, :, 0] = b[k][:, side]
                    place[side, 0] += given[k][side]
            out.append(Places((place[0], place[1]), (move[0], move[1]), (turns[0][k], turns[1][k])))
        return out

    def base(self, z: list[np.ndarray], at: np.ndarray) -> np.ndarray:
        """What is left of the square of the length, or its series."""
        k, (i, j) = len(z) - 1, self.which
        value = sum(z[m][i] * z[k - m][j] for m in range(k + 1))
        return np.asarray(value - self._about("square", at)[k] if k < 3 else value)[None]

    def base_slopes(self, z: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Derivatives of the square of the length."""
        i, j = self.which
        out = np.zeros((1, 8, z.shape[1]), complex)
        out[0, i], out[0, j] = z[j], z[i]
        return out


def draw_bend(kind: str, rng: np.random.Generator) -> AngleTask:
    """A way about what is singular among real tasks."""
    drawn = {name: rng.normal(size=shape) + 1j * rng.normal(size=shape)
             for name, shape in zip(FIELDS, ((2, TURNS), (2, 2), (2,), ()), strict=True)}  # fmt: skip
    b = np.where([[False], [kind == "Stephenson III"]], drawn["b"], 0.0)
    given = drawn["given"] if kind == "Stephenson II" else np.zeros(2)
    return AngleTask(drawn["angles"], b, given, np.asarray(drawn["square"]))


# -- start sets --------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class AngleStarts:
    """All solutions that were found of a real task: each has its conjugate among them."""

    task: AngleTask
    z: np.ndarray  # (8, solutions)
    loop: int  # how many loops have been run
    done: int  # how many solutions have been followed round the next
    before: int  # how many were known when that loop began
    whole: bool  # the last loop followed all and brought no other


_found: dict[str, AngleStarts] = {}  # in this process


def draw_linkage(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, AngleTask]:
    """A random real linkage and angles that it passes, in whatever assembly: its z, ``(8,)``, and the task."""
    while True:
        z = rng.normal(size=4) + 1j * rng.normal(size=4)
        free, own = rng.normal(size=2) + 1j * rng.normal(size=2)
        b = np.array([1.0, free if kind == "Stephenson III" else 1.0])
        given = np.array([own if kind == "Stephenson II" else 0.0, 0.0])
        passed = (pair for _ in range(100) if (pair := _pass_pair(kind, z, b, given, rng)) is not None)
        angles = list(itertools.islice(passed, TURNS))
        if len(angles) == TURNS:
            full = np.concatenate([z[:2], z[:2].conj(), z[2:], z[2:].conj()])
            square = np.abs(z[2 + _GIVEN[kind]]) ** 2 + 0j
            both = np.stack([b, b.conj()], axis=1)
            return full, AngleTask(np.array(angles).T + 0j, both, np.array([given[0], given[0].conj()]), square)


def _pass_pair(
    kind: str, z: np.ndarray, b: np.ndarray, given: np.ndarray, rng: np.random.Generator
) -> tuple[float, float] | None:
    """Angles that a linkage passes, by Newton's steps from random ones; None where they lead nowhere."""

    def ends(s: complex, t: complex, turn: complex) -> np.ndarray:
        p = b + given * s + [sum(z[2 + k] * (s, t)[k] for bar, k in PAIRS[kind] if bar == at) for at in (0, 1)]
        return p + turn * z[:2]

    long = np.abs(ends(1.0, 1.0, 1.0)) ** 2
    phi, x = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 2.0 * np.pi, 2)
    s = np.exp(1j * phi)
    for _ in range(12):
        t, turn = np.exp(1j * x)
        to = ends(s, t, turn)
        rest = np.abs(to) ** 2 - long
        if np.abs(rest).max() < 1e-13:
            return phi, float(x[0] % (2.0 * np.pi))
        by_t = np.array([(0, 1) in PAIRS[kind], True]) * z[3] * t
        slope = 2.0 * np.imag(to.conj()[:, None] * -np.stack([by_t, z[:2] * turn], axis=1))
        if abs(np.linalg.det(slope)) < 1e-3:
            return None
        x = x - np.linalg.solve(slope, rest)
    return None


def find_angle_starts(kind: str, show: Callable[[int], object] = lambda known: None) -> AngleStarts:
    """Find all solutions of a task by loops, or read them from the user's cache.

    Each loop follows all solutions that are known, until one brings no others. What is known is written into the
    cache on the way, also on Ctrl-C, and the next call goes on from there. `show` is told how many are known.
    """
    key = f"{kind.replace(' ', '-')}-1"  # the number of the form of the files
    starts = _found.get(kind) or _load(key) or _begin(kind)
    here = SixBarPaths(kind, starts.task, starts.task, wide=True)
    written = time.monotonic()
    try:
        while not starts.whole:
            loop = _draw_loop(kind, starts)
            part = starts.z[:, starts.done : starts.done + 8 * BLOCK]
            z, done = _join_new(starts.z, _go_round(part, loop, here)), starts.done + part.shape[1]
            if done < z.shape[1]:
                starts = dataclasses.replace(starts, z=z, done=done)
            else:
                whole = z.shape[1] == starts.before > 100  # fewer are not all
                starts = AngleStarts(starts.task, z, starts.loop + 1, 0, z.shape[1], whole)
            show(z.shape[1])
            if starts.whole or time.monotonic() - written > 5.0:  # seconds
                _save(starts, key)
                written = time.monotonic()
    except KeyboardInterrupt:
        if not _save(starts, key):
            raise
        raise KeyboardInterrupt(
            f"precision_six_bars(): {counted(starts.z.shape[1], 'solution')} of a {kind} known after "
            f"{counted(starts.loop, 'loop')} are kept; the same call goes on from there"
        ) from None
    _found[kind] = starts
    return starts


def _begin(kind: str) -> AngleStarts:
    """The best conditioned one of some random linkages."""
    rng = np.random.default_rng(1)
    best, least = None, np.inf
    for _ in range(_DRAWS):
        z, task = draw_linkage(kind, rng)
        paths, at = SixBarPaths(kind, task, task), np.zeros(1)
        _, linear, _ = paths.correct(paths.turned(z[:, None], at), at, np.arange(1))
        condition = np.linalg.cond(linear.inverse[0]) if np.isfinite(linear.inverse).all() else np.inf
        if condition < least:
            best, least = AngleStarts(task, np.stack([z], axis=1), 0, 0, 1, False), condition
    assert best is not None
    return best


def _draw_loop(kind: str, starts: AngleStarts) -> SixBarPaths:
    rng = np.random.default_rng([2, starts.loop])
    turns = 2.0 * np.pi * rng.integers(-1, 2, (2, TURNS))
    end = dataclasses.replace(starts.task, angles=starts.task.angles + turns)
    return SixBarPaths(kind, starts.task, end, draw_bend(kind, rng))


def _go_round(z: np.ndarray, loop: SixBarPaths, here: SixBarPaths) -> np.ndarray:
    """Regular finite ends of a loop."""
    blocks = np.array_split(z, max(1, -(-z.shape[1] // BLOCK)), axis=1)
    out = map_threads(functools.partial(loop.follow, pace=BOLD), blocks, prepared=True)
    ends, last = here.polish(np.concatenate([ends.w[:, ends.arrived] for ends in out], axis=1))
    # 1e-9 of the solution is the most by which a last step moves the regular end of a loop.
    return ends[:8, (last < 1e-9) & (np.abs(ends[:8]).max(axis=0, initial=0.0) < FAR)]


def _join_new(known: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Add solutions that are new, and their conjugates."""
    both = np.stack([z, z[MIRRORED].conj()], axis=2).reshape(8, -1)
    return np.concatenate([known, both[:, is_new(known, both)]], axis=1)


def _load(key: str) -> AngleStarts | None:
    arrays = load_arrays(key)
    try:
        if arrays is None:
            return None
        task = AngleTask(*(arrays[name] for name in FIELDS))
        loop, done, before, whole = (int(v) for v in arrays["history"])
        return AngleStarts(task, arrays["z"], loop, done, before, bool(whole))
    except (KeyError, ValueError):
        return None  # damaged: it is made anew


def _save(starts: AngleStarts, key: str) -> bool:
    arrays = {name: getattr(starts.task, name) for name in FIELDS} | {"z": starts.z}
    history = np.array([starts.loop, starts.done, starts.before, starts.whole])
    return save_arrays(arrays | {"history": history}, key)


# -- designs -----------------------------------------------------------------------------------------------------------


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

    def __repr__(self) -> str:
        joints = ", ".join(f"{name} ({x:.5g}, {y:.5g})" for name, (x, y) in self.points.items())
        state = f"{', '.join(self.defects)} defect" if self.defects else f"works, error {self.error:.1e}"
        return f"{self.kind}: {joints}; {state}"


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

    def __repr__(self) -> str:
        return self.describe(counted(len(self), "six-bar"))


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
    known, unknown = starts.z.shape[1], max(expected - starts.z.shape[1], 0)  # that the start set itself lacks
    ends, routes, lost = follow_routes(lambda k: _follow_all(kind, starts.task, starts.z, task, k), _ROUTES, known)
    here = SixBarPaths(kind, task, task, wide=True)
    real = here.find_real(ends)
    square = np.zeros((9, 9), complex)  # of the length, as a form of 1 and z
    square[0, 0], square[1 + here.which[0], 1 + here.which[1]] = -task.square, 1.0
    proved, disjoint = certify_designs(here, real, [(square + square.T) / 2])
    designs = _make_designs(kind, places, scale, real[:8], proved, x, y)
    of_designs = tuple(design.proved for design in designs)
    return SixBarDesigns(designs, unknown + known, ends.shape[1], routes, unknown + lost, of_designs, disjoint)


# -- statement ---------------------------------------------------------------------------------------------------------


def _check_angles(
    kind: str, inputs: ArrayLike, outputs: ArrayLike, given: dict[str, Any], length: float
) -> tuple[np.ndarray, dict[str, complex], AngleTask, np.ndarray, np.ndarray]:
    """Sizes by which each bar's equation is divided, places that are given, the task and its angles."""
    what = "precision_six_bars"
    check_name(kind, PAIRS, f"{what}: there is no kind {kind!r}")
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
    """Follow all paths from the stored task to this one, see `follow_all`; each route bends another way."""
    near = dataclasses.replace(task, angles=start.angles + wrap_angle(np.real(task.angles - start.angles)))
    bend = draw_bend(kind, np.random.default_rng([3, route]))
    here = SixBarPaths(kind, task, task, wide=True)
    paths = {wide: SixBarPaths(kind, start, near, bend, wide) for wide in (False, True)}

    def follow(attempt: Attempt, lanes: np.ndarray) -> PathEnds:
        return paths[attempt.wide].follow(z[:, lanes], attempt.pace)

    def are_none(z: np.ndarray) -> np.ndarray:
        return _have_no_length(here, z) | (np.abs(z).max(axis=0) >= FAR)

    return follow_all(z, _ATTEMPTS, follow, here, are_none, z.shape[1], label=f"{kind}: paths")


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
    design = SixBarDesign(kind, points, inputs, outputs, math.nan, proved, ())
    motion, at = sweep_through(design.system, inputs, 8)  # steps from one pair of angles to the next
    if not np.asarray(motion.converged).all():
        return dataclasses.replace(design, defects=("dead point",))
    error = float(np.abs(wrap_angle(np.asarray(motion["psi"])[at] - outputs)).max())
    # An output that is further off, in radians, after really moving there is not met.
    return dataclasses.replace(design, error=error, defects=() if error < 1e-8 else ("branch",))


def describe_six_bar(kind: str, points: Mapping[str, Point]) -> Mechanism:
    """Describe a six-bar of a kind with its joints at some places: angles ``phi`` and ``psi`` are input and output."""
    angles = {"phi": "AD", "psi": "CH" if kind == "Stephenson II" else "CG"}
    return describe_linkage(kind, points, "ABC", _BODIES[kind], angles)


@functools.cache
def _template(kind: str) -> System:
    """A compiled linkage that all of a kind share."""
    return describe_six_bar(kind, PLACES[kind]).compile()
