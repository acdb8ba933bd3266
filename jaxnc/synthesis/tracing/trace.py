"""`trace`: from a drawn curve to the best linkages of dyads that trace it."""

import collections
import dataclasses
import functools
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import refuse_fork
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.progress import bar
from jaxnc.synthesis.clearance import ClearOf, refuse_enclosed
from jaxnc.synthesis.conditions import AnyTransmission, Condition, CrankTurns, TransmissionAngle, Within
from jaxnc.synthesis.evaluate import map_threads
from jaxnc.synthesis.result import Progress
from jaxnc.synthesis.search.solve import SavedSearch, interruptible
from jaxnc.synthesis.tracing.atlas import (
    BARS,
    INPUT,
    Atlas,
    Candidates,
    ChainDesign,
    atlas,
    chain_arrays,
    chains_beginning,
    check_bars,
    to_mechanism,
)
from jaxnc.synthesis.tracing.chains import GROUND, Chain, ChainArrays, dyadic_chains
from jaxnc.synthesis.tracing.curves import EACH, Walls, to_walls
from jaxnc.synthesis.tracing.fit import (
    CLOSING,
    COUNT,
    FIRM,
    Lanes,
    Target,
    begin_timed,
    least_gaps,
    match_points,
    redraw_last,
    refine,
    start_lanes,
    trace_curves,
)
from jaxnc.synthesis.validate import as_floats, as_interval, as_seed, as_timing, check_limit
from jaxnc.system.system import System
from jaxnc.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ATLAS = 200_000
_WIDTH = 64  # designs that are refined to the end in a round
_TOGETHER = 32  # designs that a processor refines in one go
_GROUPS = 3  # of candidates that are looked at in a round
_STEPS = (8, 28, 60)  # of a candidate, of a promising one, of one of the best
_JUMPS = np.array([0.02, 0.07, 0.1, 0.4])  # by how much chance changes the numbers of a design
_DRAWN = 1024  # last dyads that are drawn at random for some of the best designs
_DRAWN_FOR = 8  # so many of them
_DRAWN_KEPT = 16  # of those dyads, the designs that are refined
_POOL = 256  # designs that are kept on the way
_OF_LINE = 3  # of them, that come from one candidate: or all would soon be in one valley, and stay there
_SMOOTH = 0.02  # of the target's size: nearer than this the target may be a curve of the linkage itself
_LARGE = 20.0  # sizes of the target: no link is longer
_LEAST = float(np.radians(8.0))  # of the transmission angle
_POSES = 720  # at which a design is judged
_TURNS = {4: 1, 6: 2, 8: 3}  # how often linkages with so many bars are looked at
_LONGEST = 86_400  # seconds
_ONE_TURN = "a curve is passed in one turn of the crank"
_ALONG = 2000  # points by arc length, of a distance between curves
_ROUGHLY = 300  # points of a curve where designs are only put in order
_ALIKE = 2e-3  # of the target's size: curves no farther apart are the same one


class Curve(NamedTuple):
    """A target as it was given, and evenly spaced about its centre."""

    given: np.ndarray  # (N, 2)
    closed: bool
    centre: np.ndarray  # (2,)
    size: float  # root mean square distance from the centre, by arc length
    even: np.ndarray  # corners at equal distances, in units of the size about the centre, (COUNT, 2)
    timing: np.ndarray | None  # of the points as given, counted from the first: they rise or fall

    @property
    def line(self) -> np.ndarray:
        """The corners as they were given, the first one again at the end of a closed curve."""
        return np.vstack([self.given, self.given[:1]]) if self.closed else self.given

    @property
    def sample(self) -> np.ndarray:
        """Which of the points as given a search looks at, at most COUNT."""
        return _thin(len(self.given), COUNT)

    @property
    def parts(self) -> list[np.ndarray]:
        """Which of the points as given are looked at together, so that all are, or many of very many."""
        every = _thin(len(self.given), _ALONG)
        return np.array_split(every, -(-len(every) // COUNT))

    @classmethod
    def of(cls, points: Any, closed: bool | None, timing: Any = None) -> "Curve":
        """Check a curve and space it evenly."""
        given = as_floats(points, "trace: points must be real numbers (x, y); complex z are np.c_[z.real, z.imag]")
        if given.ndim != 2 or given.shape[-1] != 2 or len(given) < 3:
            raise InputError(f"trace: points must be places in the plane, (N, 2) with N >= 3; got shape {given.shape}")
        if not (good := (np.abs(given) < 1e150).all(axis=1)).all():  # squares of larger numbers are infinite
            raise InputError(f"trace: points[{int(np.argmin(good))}] is NaN, infinite or beyond 1e150; leave it out")
        steps = np.linalg.norm(np.diff(given, axis=0), axis=1)
        if not steps.max() > 1e-150:
            raise InputError("trace: all points are the same to within 1e-150; draw a curve")
        when = None if timing is None else as_timing(timing, len(given), "trace: timing", 2.0 * np.pi, remedy=_ONE_TURN)
        keep = np.append(True, steps > 1e-12 * steps.max()) if when is None else np.ones(len(given), bool)
        given = given[keep]
        gap = np.linalg.norm(given[-1] - given[0])
        if closed is None:
            near = steps[keep[1:]]
            closed = bool(len(given) > 3 and gap <= 1.5 * max(np.median(near), near[0], near[-1]))
        if not isinstance(closed, bool | np.bool_):
            raise InputError(f"trace: closed={closed!r}: expected True, False, or None to see whether the ends meet")
        if closed and gap <= 1e-9 * steps.max():
            given, when = given[:-1], None if when is None else when[:-1]
        if len(given) < 3:
            raise InputError("trace: points must be at least three different ones")
        corners = np.vstack([given, given[:1]]) if closed else given
        even = space_evenly(corners, COUNT + 1 if closed else COUNT)[: COUNT if closed else None]
        dense = space_evenly(corners, _ALONG)
        centre = dense.mean(axis=0)
        size = float(np.sqrt(np.mean(np.sum((dense - centre) ** 2, axis=1))))
        when = None if when is None else when - when[0]
        return cls(given, bool(closed), centre, size, (even - centre) / size, when)

    def target(
        self,
        both: bool,
        sine: float,
        ground: np.ndarray,
        longest: float,
        mean: bool = False,
        walls: tuple[Walls, ...] = (),
        which: np.ndarray | None = None,
    ) -> Target:
        """The curve as `fit.refine` takes it: both ways evenly, or `which` of the points as they were given."""
        points, weight, when = self.even, np.full(COUNT, 1.0 / COUNT), np.zeros(COUNT)
        which = self.sample if which is None else which
        if not both:
            own, count = (self.given[which] - self.centre) / self.size, len(which)
            points = np.concatenate([own, np.repeat(own[-1:], COUNT - count, axis=0)])
            weight = np.where(np.arange(COUNT) < count, 1.0 / count, 0.0)
        if self.timing is not None:
            when[: len(which)] = self.timing[which]
        ways = map(float, (self.closed, both, mean))
        asked = sine, longest, when, float(self.timing is not None), ground, CLOSING
        return Target(*map(jnp.asarray, (points, weight, *ways, *asked)), walls=walls)


def _thin(count: int, most: int) -> np.ndarray:
    """Choose at most so many of a count, evenly, the ends among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def space_evenly(corners: np.ndarray, count: int) -> np.ndarray:
    """Points at equal distances along a polyline, its ends among them, ``(count, 2)``."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    at = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(at, along, corners[:, k]) for k in range(2)], axis=1)


def curve_distance(one: np.ndarray, other: np.ndarray, count: int = _ALONG) -> float:
    """Mean distance of two polylines ``(N, 2)``: from points by arc length to the other one, both ways added."""
    one, other = space_evenly(one, count), space_evenly(other, count)
    return float(_distances(one, other).mean() + _distances(other, one).mean())


def _distances(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distances of points from a polyline, by the two pieces at its nearest corner."""
    from scipy.spatial import KDTree

    near = np.asarray(KDTree(line).query(points)[1])
    best = np.full(len(points), np.inf)
    for start in (np.maximum(near - 1, 0), np.minimum(near, len(line) - 2)):
        piece = line[start + 1] - line[start]
        off = points - line[start]
        long = np.sum(piece**2, axis=1)
        share = np.clip(np.sum(off * piece, axis=1) / np.where(long > 0, long, 1.0), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(off - share[:, None] * piece, axis=1))
    return best


@public
@dataclasses.dataclass(frozen=True, eq=False)
class TracedDesign:
    """A linkage that traces a curve.

    Attributes:
        chain: its chain of dyads.
        distance: mean distance between its curve and the target, both ways added, in units of the target's root mean
            square distance from its centre; with given timings the root mean square of the errors at the points.
        exact: whether it meets the points as they were given, but for rounding (of more than 2,000, so many).
        curve: its curve, in the target's place and unit, ``(N, 2)``.
        closed: whether the last point of its curve is joined to the first.
        transmission: the smallest transmission angle of its dyads along the curve, radians.
        turns: whether the crank can turn all round.
        numbers: the design as numbers.
    """

    chain: Chain
    distance: float
    exact: bool
    curve: np.ndarray
    closed: bool
    transmission: float
    turns: bool
    numbers: ChainDesign

    @property
    def bars(self) -> int:
        """Number of links, the ground among them."""
        return self.chain.bars

    @property
    def name(self) -> str:
        """Name of its kind of linkage."""
        return self.chain.name

    @functools.cached_property
    def _built(self) -> tuple[Mechanism, float]:
        return to_mechanism(self.numbers)

    @property
    def mechanism(self) -> Mechanism:
        """The linkage as an ordinary mechanism: angle ``phi`` of the crank, tracing point ``P``."""
        return self._built[0]

    @functools.cached_property
    def system(self) -> System:
        """The mechanism, compiled."""
        return self.mechanism.compile()

    @property
    def travel(self) -> tuple[float, float]:
        """Where the crank begins and ends, radians: ``phi`` of `mechanism`."""
        return self._built[1], self._built[1] + self.numbers.span

    def move(self, poses: int = 181) -> Motion:
        """Move the mechanism over its travel by the robust solver.

        Args:
            poses: how many, evenly by the angle of the crank.
        """
        from jaxnc.kinematics.position import sweep

        return sweep(self.system, {INPUT: np.linspace(*self.travel, poses)})

    def save(self, path: str | Path) -> Path:
        """Write the mechanism as a model file that runs over its travel.

        Args:
            path: the file, ``.toml`` or ``.json``.
        """
        from jaxnc.mechanism import model as record

        low, high = self.travel
        self.mechanism.model.run = record.Run(inputs={INPUT: record.Drive(low, high, 181)}, outputs=["P"])
        return self.mechanism.save(path)

    def clearance(self, region: Any, width: float = 0.0) -> float:
        """Distance that its links keep from a region over the travel, between poses too; below zero where they meet it.

        Args:
            region: as of `clear_of`, in the target's unit.
            width: of the links, in the same unit.
        """
        drawn, walls = self.numbers, to_walls(ClearOf.of(region, width=width), (self.bars,))
        whole = [drawn.place.real, drawn.place.imag, drawn.factor.real, drawn.factor.imag, drawn.begin, drawn.span]
        row = np.concatenate([drawn.design, whole])
        lane = Lanes(ChainArrays.of((self.chain,)), np.asarray(drawn.sign, float)[None], row[None])
        return float(least_gaps(lane, _POSES, 0.0, walls)[0])

    @property
    def rank(self) -> tuple[float, int, float]:
        """Key by which designs are ordered: by their distance, of exact ones by their bars first."""
        return (0.0 if self.exact else self.distance), self.bars, self.distance

    @property
    def line(self) -> np.ndarray:
        """Its curve as corners of a line, the first one again at the end of a closed one."""
        return np.vstack([self.curve, self.curve[:1]]) if self.closed else self.curve


@public
@dataclasses.dataclass(frozen=True, eq=False)
class TraceResult:
    """Linkages that trace a curve, best first; ``print()`` shows the table.

    Attributes:
        points: the target as it was given, ``(N, 2)``.
        closed: whether it is closed.
        designs: what was found.
        refined: how many candidates were refined.
        seconds: how long it took.
        stopped: how the search ended, in words.
    """

    points: np.ndarray
    closed: bool
    designs: tuple[TracedDesign, ...]
    refined: int
    seconds: float
    stopped: str

    @property
    def best(self) -> TracedDesign:
        """The nearest design."""
        if not self.designs:
            raise InputError("trace found no linkage that meets the conditions; loosen them, or give it more seconds")
        return self.designs[0]

    @property
    def found(self) -> bool:
        """True if a linkage meets the conditions."""
        return bool(self.designs)

    @property
    def interrupted(self) -> bool:
        """True if Ctrl-C ended the search."""
        return self.stopped.startswith("interrupted")

    @property
    def front(self) -> tuple[TracedDesign, ...]:
        """For each number of bars the nearest design, as far as it is nearer than those with fewer."""
        out: list[TracedDesign] = []
        for bars in BARS:
            own = [d for d in self.designs if d.bars == bars]
            if own and (not out or own[0].distance < out[-1].distance):
                out.append(own[0])
        return tuple(out)

    def __str__(self) -> str:
        exact = sum(d.exact for d in self.designs)
        lines = [
            f"trace of {'a closed' if self.closed else 'an open'} curve: {len(self.designs)} linkages, "
            f"{self.refined:,} candidates refined{'' if self.refined else ' (they are as in the atlas)'}; the search "
            f"{self.stopped}, and with the closest look at the best it took {self.seconds:.3g} s",
            "      distance  bars  transmission  crank      linkage",
        ]
        for k, d in enumerate(self.designs, 1):
            turn = "turns" if d.turns else f"{np.degrees(abs(d.numbers.span)):.0f}°"
            how, angle = f"{d.distance:<8.3g}{'=' if d.exact else ' '}", f"{np.degrees(d.transmission):>11.1f}°"
            lines.append(f"  {k:>2}  {how} {d.bars:>4}  {angle}  {turn:<9}  {d.name}")
        if exact:
            lines.append("  = meets all points as they were given; what is left is between them")
        return "\n".join(lines)

    def plot(self, path: str | Path | None = None, count: int = 6) -> "Figure":
        """Draw the best designs over the target; the target dotted.

        Args:
            path: file to write, by its ending.
            count: how many designs.
        """
        from jaxnc.viz import synthesis

        return synthesis.traces(self, path, count)


class _Terms(NamedTuple):
    """What is asked of designs beside the curve."""

    least: float  # transmission angle
    turning: bool
    ground: np.ndarray  # a box, (2, 2)
    walls: tuple[Walls, ...]  # what links keep clear of

    @classmethod
    def of(cls, conditions: Sequence[Condition], bars: Sequence[int]) -> "_Terms":
        angles, turning, box = [], False, ((-np.inf, np.inf), (-np.inf, np.inf))
        walls = []
        if isinstance(conditions, Condition) or not isinstance(conditions, Sequence):
            raise InputError("trace: subject_to= takes a list of conditions, such as [S.transmission_angle(0.35)]")
        for one in conditions:
            if isinstance(one, TransmissionAngle) and one.joint is None:
                angles.append(float(one.least))
            elif isinstance(one, AnyTransmission):
                angles.append(0.0)
            elif isinstance(one, CrankTurns) and one.kind is None and not one.margin:
                turning = True
            elif isinstance(one, Within) and one.point == "ground" and len(one.box) == 2:
                both = ((max(a[0], b[0]), min(a[1], b[1])) for a, b in zip(box, one.box, strict=True))
                box = tuple(as_interval(pair, "trace: subject_to: what is within 'ground'") for pair in both)
            elif isinstance(one, ClearOf):
                walls.append(to_walls(one, bars))
            else:
                told = one.name if isinstance(one, Condition) else repr(one)
                raise InputError(
                    f"trace: subject_to has {told!r}; what is known before there is a linkage are "
                    f"transmission_angle(min) of all dyads, crank_turns() of any kind and by any margin, "
                    f"within('ground', x=…, y=…) and clear_of(region). State the others in a PathGeneration that "
                    f"begins at a design's mechanism"
                )
        return cls(max(angles, default=_LEAST), turning, np.array(box).T, tuple(walls))


@public
def trace(
    points: Any,
    closed: bool | None = None,
    timing: Any = None,
    bars: Sequence[int] = BARS,
    subject_to: Sequence[Condition] = (),
    seconds: float = 60.0,
    key: Array | None = None,
    keep: int = 10,
    sliders: bool = True,
    only: Sequence[str] | None = None,
    source: Atlas | None = None,
    progress: bool | None = None,
    checkpoint: str | Path | None = None,
    resume: str | Path | None = None,
) -> TraceResult:
    """Find linkages that trace a curve: four-, six- and eight-bars of dyads with turning and sliding pairs.

    Curves of an atlas that are alike, wherever they are and however large, are refined by least squares of distances
    both ways; place, turn and size are solved for, and the timings are free. The curve of a closed target is that of a
    crank that turns all round; an open one is traced over a part of the turn.

    Args:
        points: the curve, ``(N, 2)``, in order; straight between them.
        closed: the last point is joined to the first; if not given, where they are as near as neighbours are. The
            table says how it was taken.
        timing: angles of the crank at the points, radians, from wherever it begins, over one turn; free if not given.
        bars: numbers of links that are looked for, of 4, 6 and 8.
        subject_to: `transmission_angle`, `crank_turns`, `within` for ``"ground"``, all pivots of the ground, and
            `clear_of`; links are called ``"crank"``, ``"link 2"`` and so on, all that move if none are named.
        seconds: time for the search, without that for an atlas that has to be made.
        key: of the random numbers, ``jax.random.key(0)`` if not given.
        keep: designs in the result.
        sliders: whether joints may slide.
        only: names of linkages that are looked for, such as ``"Watt II"``; see `TracedDesign.name`.
        source: an atlas of your own; that of 200,000 linkages if not given, which is made at first use.
        progress: show a bar with the best distance; if not given, where stderr is a terminal, and in a notebook.
        checkpoint: file in which the search is kept after every round, replaced in one step.
        resume: such a file, from which the search goes on for `seconds` more (and in which it is kept, unless
            `checkpoint` names another).

    Returns:
        The linkages, best first. Ctrl-C returns the best ones so far.

    Raises:
        InputError: points that are no curve, conditions that need names, no time, a file of another search.
    """
    refuse_fork()
    wanted = check_bars("trace", bars)
    limit = check_limit(
        "trace", "a positive number; a search that goes on for good needs an end", 1e-9, seconds=seconds
    )
    target, terms = Curve.of(points, closed, timing), _Terms.of(subject_to, wanted)
    if limit > _LONGEST:
        raise InputError(f"trace: seconds={seconds!r}; a search needs an end: at most {_LONGEST}")
    seed = as_seed("trace", key)
    rng = np.random.default_rng(seed)
    if isinstance(keep, bool) or not isinstance(keep, int | np.integer) or keep < 1:
        raise InputError(f"trace: keep={keep!r}: expected a number of designs, at least 1")
    allowed = _allowed(only, sliders, wanted)
    chains = [chain for b in wanted for chain in dyadic_chains(b) if allowed is None or allowed(chain)]
    riding = {f"link {chain.tracer}" for chain in chains}  # one of them carries the tracing point
    about = [c for c in subject_to if isinstance(c, ClearOf) and (c.links is None or riding <= {*c.links})]
    refuse_enclosed("trace", about, None, target.given)
    known = atlas(_ATLAS, progress=progress) if source is None else source
    if not isinstance(known, Atlas):
        raise InputError(f"trace: source={source!r}: expected an atlas, as nc.synthesis.atlas() returns it")
    course = SavedSearch("trace", limit, checkpoint)
    searches: list[_Search] = []
    try:
        with interruptible():
            for b, own in zip(wanted, rng.spawn(len(wanted)), strict=True):
                if b in known.shelves:
                    simpler = next((search for search in searches if search.bars == b - 2), None)
                    searches.append(_Search(target, terms, known, b, allowed, own, simpler))
            if checkpoint is not None or resume is not None:
                designs = [float(np.abs(shelf.design).sum()) for shelf in known.shelves.values()]
                numbers = (*target, *terms, *designs, *(only or ()), sliders)
                course.set_common(numbers, bars=list(wanted), key=list(seed))
            if resume is not None:
                kept = course.resume(resume)
                for search in searches:
                    own = f"{search.bars}_"
                    search.restore({name.removeprefix(own): a for name, a in kept.items() if name.startswith(own)})
            stopped = _search(searches, course, progress)
    except KeyboardInterrupt:
        stopped = f"interrupted after {course.seconds:.3g} s{course.hint}"
    found = _judge(target, terms, searches, keep, stopped.startswith("interrupted"))
    refined = sum(search.refined for search in searches)
    return TraceResult(as_floats(points).copy(), target.closed, found, refined, course.seconds, stopped)


def _allowed(only: Any, sliders: bool, bars: Sequence[int]) -> Callable[[Chain], bool] | None:
    if only is not None:
        names = {chain.name for b in bars for chain in dyadic_chains(b)}
        if (
            isinstance(only, str)
            or not isinstance(only, Sequence)
            or not only
            or not all(isinstance(n, str) for n in only)
        ):
            raise InputError(f"trace: only={only!r}: expected names of linkages, such as ['Watt II']")
        for name in only:
            if name not in names:
                raise InputError(f"trace: only= has no linkage {name!r}; {nearest(name, names)}")
    if only is None and sliders:
        return None
    return lambda chain: (only is None or chain.name in only) and (sliders or not chain.sliders)


class _Search:
    """The search among linkages with some number of bars, round by round."""

    def __init__(
        self,
        target: Curve,
        terms: _Terms,
        known: Atlas,
        bars: int,
        allowed: Callable[[Chain], bool] | None,
        rng: np.random.Generator,
        simpler: "_Search | None" = None,
    ):
        self.bars, self.target, self.rng, self.simpler = bars, target, rng, simpler
        # A little more than asked for, so that what is found meets it between the poses too.
        sine = float(np.sin(min(terms.least * 1.01 + 0.001, np.pi / 2)) ** 2)
        ground = (_draw_in(terms.ground, target.size) - target.centre) / target.size
        walls = [wall.in_units(target.centre, target.size) for wall in terms.walls]
        # By so much more, in sizes of the target, links shall be clear in the poses that are looked at.
        walls = tuple(wall._replace(room=wall.room + 0.01) for wall in walls)
        self.goal = target.target(target.timing is None, sine, ground, _LARGE, walls=walls)
        self.points = target.target(False, sine, ground, _LARGE, walls=walls)
        # All points, where more are given than are looked at on the way.
        parts = target.parts if len(target.parts) > 1 else []
        self.rest = [target.target(False, sine, ground, _LARGE, walls=walls, which=which) for which in parts]
        self.means = target.target(True, sine, ground, _LARGE, True, walls)._replace(closing=jnp.asarray(FIRM))
        self.allowed = np.array([allowed is None or allowed(chain) for chain in dyadic_chains(bars)])
        # Six designs of a chain are kept on the way, and more where there are few chains.
        self.of_chain = max(6, _POOL // max(int(self.allowed.sum()), 1))
        self.taken = self.refined = self.rounds = 0
        self.polished = np.inf
        self.took, self.pace = 0.0, 0.0  # seconds of the last round, and of a step of a design
        self.pool: Lanes | None = None
        self.cost = np.zeros(0)
        self.line = np.zeros(0, int)  # of each design, from which candidate it comes
        self.lines = 0
        self.exact: Lanes | None = None
        self.queue = known.find(target.even, target.closed, bars, 4096, allowed)
        if len(self.queue.misfit):
            lanes = self._start(slice(_WIDTH))
            self._keep(lanes, np.maximum(self.queue.misfit[:_WIDTH], 0.0), self._begin_lines(lanes))

    @property
    def best(self) -> float:
        """Root mean square of the distances of the nearest design so far."""
        return float(np.sqrt(self.cost[0])) if len(self.cost) else np.inf

    def round(self) -> None:
        """Refine the next candidates, or, in turns, what chance makes of the best designs."""
        self.rounds += 1
        if self.taken < len(self.queue.misfit) and (self.rounds < 4 or self.rounds % 4 == 0):
            lanes = self._next()
            line = self._begin_lines(lanes)
        elif len(self.cost):
            lanes, line = self._vary()
        else:  # nothing was found that moves
            return
        lanes, cost = self._refine(lanes, _STEPS[0])
        self.refined += len(cost)
        promising = np.argsort(cost, kind="stable")[:_WIDTH]
        found = self._refine(_some(lanes, promising), _STEPS[1])
        if self.rounds == 1:  # what was looked up is measured in another way
            self.pool, self.cost, self.line = None, np.zeros(0), np.zeros(0, int)
        self._keep(*found, line[promising])
        if len(self.cost) and (self.rounds in (1, 3) or self.rounds % 6 == 0):
            self._polish()

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Write the state as arrays; the candidates come from the atlas again."""
        state = json.dumps(self.rng.bit_generator.state)
        counts = [self.taken, self.refined, self.rounds, self.lines, self.polished]
        out = {"state": np.array(state), "counts": np.array(counts), "cost": self.cost, "line": self.line}
        for name in ("pool", "exact"):
            lanes = getattr(self, name)
            if lanes is not None:
                parts = (*lanes.chain, lanes.sign, lanes.row)
                out |= {f"{name}_{k}": np.asarray(array) for k, array in enumerate(parts)}
        return out

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go back to what `to_arrays` returned."""
        self.rng.bit_generator.state = json.loads(str(arrays["state"]))
        self.cost, self.line = arrays["cost"], arrays["line"]
        self.taken, self.refined, self.rounds, self.lines = (int(n) for n in arrays["counts"][:4])
        self.polished = float(arrays["counts"][4])
        for name in ("pool", "exact"):
            parts = [arrays[key] for k in range(6) if (key := f"{name}_{k}") in arrays]
            setattr(self, name, Lanes(ChainArrays(*parts[:4]), *parts[4:]) if parts else None)

    def _begin_lines(self, lanes: Lanes) -> np.ndarray:
        """Number designs that come from none of the pool."""
        self.lines += len(lanes.row)
        return np.arange(self.lines - len(lanes.row), self.lines)

    def _start(self, chosen: slice) -> Lanes:
        """Put candidates where they fit best."""
        some = Candidates(self.queue.shelf.at(chosen), *(array[chosen] for array in self.queue[1:]))
        lanes = start_lanes(self.target.even, self.target.closed, some, chain_arrays(self.bars).at(some.shelf.chain))
        return lanes if self.target.timing is None else begin_timed(lanes, self.goal)

    def _next(self) -> Lanes:
        chosen = slice(self.taken, min(self.taken + _GROUPS * _WIDTH, len(self.queue.misfit)))
        self.taken = chosen.stop
        return self._start(chosen)

    def _vary(self) -> tuple[Lanes, np.ndarray]:
        """Change the numbers of good designs, and give others, also simpler ones, a last dyad made at random."""
        lanes, line = self._jump()
        parts = [self._redraw(self)]
        if self.simpler is not None and self.simpler.rounds:
            parts.append(self._redraw(self.simpler))
        for part in parts:
            if part is not None:
                lanes, line = _join(lanes, part), np.append(line, self._begin_lines(part))
        return lanes, line

    def _jump(self) -> tuple[Lanes, np.ndarray]:
        """Change all numbers of good designs a little, or those of one dyad or of the tracing point more."""
        assert self.pool is not None
        count, dyads = 2 * _WIDTH - 2 * _DRAWN_KEPT, (self.bars - 2) // 2
        parents = _choose(self.rng, count, len(self.cost))
        lanes = _some(self.pool, parents)
        row = np.array(lanes.row)
        which = self.rng.choice(len(_JUMPS), count, p=[0.3, 0.05, 0.5, 0.15])
        own = np.arange(row.shape[1] - 6) // EACH == self.rng.integers(0, dyads + 1, count)[:, None]
        size = np.where((which < 2)[:, None] | own, _JUMPS[which, None], 0.0)
        row[:, :-6] *= np.exp(size * self.rng.normal(size=size.shape))
        row[:, :-6] += 0.3 * size * self.rng.normal(size=size.shape)
        if not self.target.closed:
            free = [1.0, self.target.timing is None]  # begin and range of the crank: timings give the range
            row[:, -2:] += free * np.minimum(_JUMPS[which, None], 0.2) * self.rng.normal(size=(count, 2))
        return lanes._replace(row=row), self.line[parents]

    def _redraw(self, source: "_Search") -> Lanes | None:
        """Put last dyads made at random on the first dyads of good designs, or on whole ones that have a dyad less.

        When the target is passed is known of a good design; with that the rest is linear, and many dyads are tried
        in the time of one refinement.
        """
        if source.pool is None or not len(source.cost):
            return None
        dyads = (self.bars - 2) // 2
        parents = _some(source.pool, _choose(self.rng, _DRAWN_FOR, len(source.cost)))
        theta, goal = (np.asarray(array) for array in match_points(parents, source.goal))
        of = np.arange(_DRAWN) % _DRAWN_FOR
        chain = np.full(_DRAWN, -1)
        for k in range(_DRAWN_FOR):
            front = np.stack([array[k] for array in parents.chain[:3]])[:, : dyads - 1]
            may, likely = chains_beginning(self.bars, tuple(front.reshape(-1).tolist()))
            likely = likely * self.allowed[may]
            if likely.sum() > 0:
                chain[of == k] = self.rng.choice(may, _DRAWN // _DRAWN_FOR, p=likely / likely.sum())
        good = np.flatnonzero(chain >= 0)
        if not len(good):
            return None
        full = np.resize(good, _DRAWN)
        of, chain = of[full], chain[full]
        kept = EACH * (dyads - 1)
        row, sign = np.zeros((_DRAWN, EACH * dyads + 8)), np.ones((_DRAWN, dyads))
        row[:, :kept], row[:, -6:] = parents.row[of, :kept], parents.row[of, -6:]
        sign[:, :-1] = parents.sign[of, : dyads - 1]
        change = self.rng.choice([0.0, 0.0, 0.05, 0.15], (_DRAWN, 1))
        row[:, :kept] *= np.exp(change * self.rng.normal(size=(_DRAWN, kept)))
        lanes = Lanes(chain_arrays(self.bars).at(chain), sign, row)
        lanes, left = redraw_last(lanes, theta[of], (goal @ [1, 1j])[of], self.rng.uniform(size=(_DRAWN, 8)))
        order = np.argsort(left, kind="stable")[: int(np.isfinite(left).sum())]
        taken, chosen = np.zeros(_DRAWN_FOR, int), []
        for k in order:  # of each parent some
            taken[of[k]] += 1
            if taken[of[k]] <= _DRAWN_KEPT // 4:
                chosen.append(k)
        return _some(lanes, np.array(chosen[:_DRAWN_KEPT], int)) if chosen else None

    def count_last(self, near: float) -> int:
        """Count the designs that are refined to least distances at the end: few where it is not as near as the best."""
        if self.target.timing is not None or self.exact is not None or not self.rounds:
            return 0
        return min(2 * _WIDTH if self.best <= near else _TOGETHER, len(self.cost))

    def finish(self, count: int) -> list[Lanes]:
        """The best designs: that meet all points, of least squares, and so many of them refined to least distances."""
        out = [self.exact] if self.exact is not None else []
        if self.pool is not None and len(self.cost):
            out.append(_some(self.pool, slice(_WIDTH)))
            if count:
                best = self._refine(_some(self.pool, slice(count)), _STEPS[2], self.means)[0]
                out += [_some(best, slice(k, k + _WIDTH)) for k in range(0, len(best.row), _WIDTH)]
        return out

    def _polish(self) -> None:
        """Refine the best to the end, unless they were, and see whether one meets the points as they were given."""
        assert self.pool is not None
        if self.polished == float(self.cost[:_TOGETHER].sum()):
            return
        best = slice(_TOGETHER)
        self._keep(*self._refine(_some(self.pool, best), _STEPS[2]), self.line[best])
        self.polished = float(self.cost[:_TOGETHER].sum())
        if self.best < _SMOOTH and len(self.target.sample) > self.pool.row.shape[1]:
            own, error = self._refine(_some(self.pool, slice(_WIDTH)), _STEPS[2], self.points, 6)
            if 1e-7**2 < error.min() < 1e-3**2:  # on their way, in a valley that turns
                best = _some(own, np.argsort(error, kind="stable")[:_TOGETHER])
                own, error = self._refine(best, 4 * _STEPS[2], self.points, 6)
            good = np.flatnonzero(error < 1e-7**2)  # of the target's size: the points are met
            for part in self.rest if len(good) else []:
                error[good] = np.maximum(error[good], self._refine(_some(own, good), 0, part, 6)[1])
            good = good[error[good] < 1e-7**2]
            good = good[_keep_to_line(self.target, _some(own, good))] if len(good) else good
            if len(good):
                self.exact = _some(own, good[np.argsort(error[good], kind="stable")])

    def _refine(self, lanes: Lanes, steps: int, goal: Target | None = None, feet: int = 0) -> tuple[Lanes, np.ndarray]:
        """Refine any number of designs, so many at a time that a program is compiled once."""

        def work(first: int) -> tuple[np.ndarray, np.ndarray]:
            part = _some(lanes, slice(first, first + _TOGETHER))
            count = len(part.row)
            row, _, cost = refine(_fill(part, _TOGETHER), self.goal if goal is None else goal, steps, feet)
            return np.asarray(row)[:count], np.asarray(cost)[:count]

        begun = time.perf_counter()
        found = map_threads(work, range(0, len(lanes.row), _TOGETHER), self.refined > 0)
        if steps:
            self.pace = (time.perf_counter() - begun) / (steps * len(lanes.row))
        rows, costs = zip(*found, strict=True)
        cost = np.concatenate(costs)
        return lanes._replace(row=np.concatenate(rows)), np.where(np.isfinite(cost), cost, np.inf)

    def _keep(self, lanes: Lanes, cost: np.ndarray, line: np.ndarray) -> None:
        """Put designs among the best, none twice, of no chain and no candidate too many: they shall stay different."""
        if self.pool is not None:
            lanes, cost, line = _join(self.pool, lanes), np.append(self.cost, cost), np.append(self.line, line)
        order = np.argsort(cost, kind="stable")
        order = order[np.isfinite(cost[order])]
        kept, seen, of_chain, of_line = [], set(), collections.Counter(), collections.Counter()
        for k in order:
            chain = tuple(np.concatenate([np.ravel(array[k]) for array in lanes.chain]).tolist())
            mark = (f"{cost[k]:.2g}", chain)
            if mark not in seen and of_chain[chain] < self.of_chain and of_line[line[k]] < _OF_LINE:
                seen.add(mark)
                of_chain[chain] += 1
                of_line[line[k]] += 1
                kept.append(k)
        chosen = np.array(kept[:_POOL], int)
        self.pool, self.cost, self.line = _some(lanes, chosen), cost[chosen], line[chosen]


def _some(lanes: Lanes, index: Any) -> Lanes:
    return Lanes(lanes.chain.at(index), lanes.sign[index], lanes.row[index])


def _fill(lanes: Lanes, width: int) -> Lanes:
    """Repeat designs up to the number that programs are compiled for."""
    return _some(lanes, np.arange(width) % len(lanes.row))


def _join(a: Lanes, b: Lanes) -> Lanes:
    chain = type(a.chain)(*(np.concatenate([x, y]) for x, y in zip(a.chain, b.chain, strict=True)))
    return Lanes(chain, np.concatenate([a.sign, b.sign]), np.concatenate([a.row, b.row]))


def _choose(rng: np.random.Generator, count: int, among: int) -> np.ndarray:
    """Choose designs by chance, the better, which come first, the more often."""
    return np.minimum(rng.geometric(0.06, count) - 1, among - 1)


def _search(searches: list[_Search], course: SavedSearch, progress: bool | None) -> str:
    """Let searches go on in turns until time is over or a design is exact."""

    def state() -> dict[str, np.ndarray]:
        return {f"{s.bars}_{name}": array for s in searches for name, array in s.to_arrays().items()}

    course.save(state)  # what was looked up, should there be no time for a round
    with bar(None, "trace", "round", progress) as shown:
        while True:
            best = min(searches, key=lambda s: s.best)
            told = f"best {best.best:.2g} of the curve's size, {best.bars} bars"
            shown.set_postfix_str(told if best.rounds else f"{told}, as in the atlas")
            exact = next((s for s in searches if s.exact is not None), None)
            if exact is not None:
                return f"stopped at linkages of {exact.bars} bars that meet all points"
            # What comes last takes time too.
            counts = zip(searches, _counts_last(searches), strict=True)
            left = course.limit - course.seconds - sum(count * _STEPS[2] * s.pace for s, count in counts)
            # Linkages of four bars are looked through soon; those of eight are many. Who is left behind waits longer.
            far = {s.bars: 4.0 if s.rounds > 6 and s.best > 2.0 * best.best else 1.0 for s in searches}
            search = min(searches, key=lambda s: s.rounds * far[s.bars] / _TURNS[s.bars])
            # A round is begun if half of it is sure to fit, by the last one, or the longest of the others.
            if left <= 0.5 * (search.took or max(s.took for s in searches)):
                return f"stopped after {course.seconds:.3g} s{course.hint}"
            begun = course.seconds
            search.round()
            search.took = course.seconds - begun
            shown.update()
            course.history.append(Progress(course.seconds, sum(s.refined for s in searches), search.best))
            course.save(state)


def _counts_last(searches: list[_Search]) -> list[int]:
    """Count for each search the designs that are refined at the end."""
    near = 2.0 * min((search.best for search in searches), default=np.inf)
    return [search.count_last(near) for search in searches]


def _judge(target: Curve, terms: _Terms, searches: list[_Search], keep: int, at_once: bool) -> tuple[TracedDesign, ...]:
    """Look closely at the best designs: at many poses, by the distance of curves, each curve once."""
    out: list[TracedDesign] = []
    for search, count in zip(searches, _counts_last(searches), strict=True):
        own = []
        for k, lanes in enumerate(search.finish(0 if at_once else count)):
            own += _look_closely(target, terms, lanes, search.bars, k == 0 and search.exact is not None)
        kept: list[TracedDesign] = []
        for design in sorted(own, key=lambda design: design.rank):
            if len(kept) < keep and all(_differ(design, other, target) for other in kept):
                kept.append(_measured(design, target))
        out += kept
    return tuple(sorted(out, key=lambda design: design.rank)[:keep])


def _measured(design: TracedDesign, target: Curve, count: int = _ALONG) -> TracedDesign:
    """Measure how far a design's curve is from the target; where timings are given, from point to point."""
    if target.timing is not None:
        found = design.numbers.trace(design.numbers.begin + target.timing)
        wanted = target.given @ [1, 1j]
        return dataclasses.replace(design, distance=float(np.sqrt(np.mean(np.abs(found - wanted) ** 2))) / target.size)
    return dataclasses.replace(design, distance=curve_distance(design.line, target.line, count) / target.size)


def _keep_to_line(target: Curve, lanes: Lanes) -> np.ndarray:
    """Say which curves through all points are those of the target: between two points they do not go far astray.

    Where the crank is at the points is given, nothing is asked of the curve between them.
    """
    count, line = len(lanes.row), target.line
    if target.timing is not None:
        return np.ones(count, bool)
    curves = np.asarray(trace_curves(_fill(lanes, _WIDTH), _POSES, float(target.closed))[0])[:count]
    gap = np.linalg.norm(np.diff(line, axis=0), axis=1).max()  # of neighbours: a curve may bulge by as much
    dense = space_evenly(line, _ALONG)
    return np.array([_distances(target.centre + target.size * c, dense).max() <= gap for c in curves])


def _look_closely(target: Curve, terms: _Terms, lanes: Lanes, bars: int, exact: bool) -> list[TracedDesign]:
    """Move designs in many poses, and take those that meet the conditions there."""
    closed, count = float(target.closed), len(lanes.row)
    full = _fill(lanes, _WIDTH)
    curves, sines = (np.asarray(a)[:count] for a in trace_curves(full, _POSES, closed))
    turning = sines
    if not target.closed:
        row = np.array(full.row)
        row[:, -1] = 2.0 * np.pi
        turning = np.asarray(trace_curves(full._replace(row=row), _POSES, 1.0)[1])[:count]
    clear = np.full(count, np.inf)
    for wall in terms.walls:
        gap = least_gaps(full, _POSES, closed, wall.in_units(target.centre, target.size))
        clear = np.minimum(clear, np.asarray(gap)[:count])
    found = []
    for k, row in enumerate(np.asarray(lanes.row)):
        turns = target.closed or bool(turning[k] > 1e-4)  # between poses dyads that do not close may hide below
        if not sines[k] >= 0.999 * np.sin(terms.least) ** 2 or (terms.turning and not turns):
            continue
        if not clear[k] >= 0.0:
            continue
        factor, place = complex(*row[-4:-2]) * target.size, complex(*(target.centre + target.size * row[-6:-4]))
        if not _within(lanes, k, place, factor, terms.ground, target.size):
            continue
        chain = _chain_of(lanes, k, bars)
        drawn = ChainDesign(chain, np.asarray(lanes.sign[k]), row[:-6], place, factor, float(row[-2]), float(row[-1]))
        angle = float(np.arcsin(np.sqrt(np.clip(sines[k], 0.0, 1.0))))
        points = target.centre + target.size * curves[k]
        design = TracedDesign(chain, 0.0, exact, points, target.closed, angle, turns, drawn)
        found.append(_measured(design, target, _ROUGHLY))
    return found


def _draw_in(box: np.ndarray, size: float) -> np.ndarray:
    """Draw in a box a little, so that what is found by penalties for going beyond is not beyond it."""
    width = box[1] - box[0]
    less = np.where(width > 4e-3 * size, 1e-3 * size, 0.25 * width)
    return box + np.array([less, -less])


def _within(lanes: Lanes, k: int, place: complex, factor: complex, box: np.ndarray, size: float) -> bool:
    """Say whether all pivots of the ground are in a box."""
    if not np.isfinite(box).any():
        return True
    each = np.asarray(lanes.row[k])[:-8].reshape(-1, 6)
    local = [0j]
    for row, a, b in zip(each, lanes.chain.first[k], lanes.chain.second[k], strict=True):
        local += [complex(*spot) for spot, body in ((row[:2], a), (row[2:4], b)) if body == GROUND]
    at = place + factor * np.array(local)
    at = np.stack([at.real, at.imag], axis=1)
    narrow = box[1] - box[0] <= 4e-3 * size  # penalties do not bring a pivot onto a line
    slack = np.where(narrow, 1e-3 * abs(factor), 0.0)
    return bool(((at >= box[0] - slack) & (at <= box[1] + slack)).all())


def _chain_of(lanes: Lanes, k: int, bars: int) -> Chain:
    """Find the chain that is written as arrays."""
    arrays = chain_arrays(bars)
    same = arrays.tracer == lanes.chain.tracer[k]
    for name in ("kind", "first", "second"):
        same &= (getattr(arrays, name) == getattr(lanes.chain, name)[k]).all(axis=1)
    return dyadic_chains(bars)[int(np.flatnonzero(same)[0])]


def _differ(one: TracedDesign, other: TracedDesign, target: Curve) -> bool:
    """Say whether two designs are different: other chains, or curves that are apart."""
    return one.chain != other.chain or curve_distance(one.line, other.line, _ROUGHLY) > _ALIKE * target.size
