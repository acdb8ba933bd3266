"""Six-bars whose input and output pass eight pairs of angles: all solutions of the equations, by paths and loops.

One link turns with neither input nor output, and two bars lead from it to places that move with these, see
`jaxnc.synthesis.exact.bar_paths`. With the pivots given, eight pairs leave one length free, which is given too.

Angles move in straight lines, but for a bend into complex ones: so the equations stay those of linkages, which have far
fewer solutions than equations of their form. A loop ends where angles have gone on by whole turns, which is where it
began. The linkage it begins with is real: solutions that are found there have conjugates.
"""

import dataclasses
import functools
import itertools
import time
from collections.abc import Callable

import numpy as np

from jaxnc.continuation.monodromy import is_new
from jaxnc.continuation.tracker import BOLD, FAR
from jaxnc.errors import counted
from jaxnc.kinematics.starts import load_arrays, save_arrays
from jaxnc.synthesis.evaluate import map_threads
from jaxnc.synthesis.exact.bar_paths import MIRRORED, BarPaths, Places

TURNS = 7
"""Pairs of angles but the first."""

PAIRS = {
    "Watt II": ((0, 0), (1, 1)),
    "Stephenson II": ((0, 1), (1, 0), (1, 1)),
    "Stephenson III": ((0, 0), (1, 0), (1, 1)),
}
"""Bars whose places have the vector of the input (0) and of the output (1), of each kind."""

BLOCK = 384
"""Lanes that are followed together."""

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
