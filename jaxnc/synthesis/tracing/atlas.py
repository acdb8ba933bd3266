"""An atlas: linkages whose crank turns, with the curves that they trace, made from a seed.

Curves are compared by Fourier coefficients by arc length, whatever their place, size, turn and start.

Write a design of a chain of dyads as an ordinary mechanism, drawn where its crank begins.
"""

import functools
import os
import sys
import time
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import refuse_fork
from jaxnc.errors import InputError, JaxncError, OutputError
from jaxnc.mechanism import Mechanism
from jaxnc.process import cache_folder
from jaxnc.progress import bar
from jaxnc.synthesis.tracing import curves
from jaxnc.synthesis.tracing.chains import CRANK, GROUND, KINDS, Chain, ChainArrays, dyadic_chains
from jaxnc.synthesis.tracing.curves import EACH, begin, close
from jaxnc.synthesis.validate import as_seed, check_counts
from jaxnc.types import Array

TRACER = "P"
INPUT = "phi"
_NAMES = [c for c in "ABCDEFGHIJKLMNOQRSTUVW"]
_SAME = 1e-9  # of the drawing's size: places that are one


@public
class ChainDesign(NamedTuple):
    """A design of a chain as numbers, its place among them."""

    chain: Chain
    sign: np.ndarray  # (dyads,)
    design: np.ndarray  # (6 dyads + 2,), in units of the crank
    place: complex  # of the crank's pivot
    factor: complex  # size and turn
    begin: float  # angle of the crank, before the turn
    span: float  # how far it goes

    def frames(self, theta: Any) -> list[tuple[Any, Any]]:
        """Origins and directions of all bodies where the crank has an angle or some, complex, in units of the crank."""
        frames = begin(np.asarray(theta, float))
        for d, (kind, a, b) in enumerate(self.chain.dyads):
            row = self.design[EACH * d : EACH * (d + 1)]
            on, other = frames[a], frames[b]
            p, q = on.at((row[0], row[1])), other.at((row[2], row[3]))
            lines = ((np.cos(angle), np.sin(angle)) for angle in row[4:])
            frames += close(KINDS.index(kind), self.sign[d], p, q, on.along, other.along, *row[4:], *lines)[2]
        return [(x + 1j * y, c + 1j * s) for (x, y), (c, s) in frames]

    def trace(self, theta: Any) -> np.ndarray:
        """Place of the tracing point at some angles of the crank, complex ``(T,)``."""
        origin, along = self.frames(np.atleast_1d(theta))[self.chain.tracer]
        return self.place + self.factor * (origin + along * complex(*self.design[-2:]))


class _Sheet:
    """Names and places of a mechanism's points, and who carries them."""

    def __init__(self, drawn: ChainDesign):
        self.drawn, self.frames = drawn, drawn.frames(drawn.begin)
        self.places: dict[str, complex] = {}
        self.on: dict[int, list[str]] = {body: [] for body in range(drawn.chain.bars)}
        self.fresh = iter([*_NAMES, *(f"{c}{k}" for k in (1, 2, 3) for c in _NAMES)])
        self.size = 1.0

    @property
    def pin(self) -> str:
        """The point of the crank that is farthest from its pivot."""
        return max(self.on[CRANK][1:], key=lambda point: abs(self.places[point]))

    def add(self, at: complex, *bodies: int) -> str:
        """Take a point that bodies share; if one of them has a point there, that one."""
        for body in bodies:
            for name in self.on[body]:
                if abs(self.places[name] - at) <= _SAME * self.size:
                    for other in bodies:
                        if name not in self.on[other]:
                            self.on[other].append(name)
                    return name
        name = next(self.fresh)
        self.places[name] = at
        for body in bodies:
            self.on[body].append(name)
        return name


def to_mechanism(drawn: ChainDesign, name: str = "") -> tuple[Mechanism, float]:
    """Write a design as a mechanism; the angle of its crank as it is drawn, radians, comes with it.

    The crank turns by the angle ``phi``, and the point ``P`` traces. Joints that turn are points that bodies share; a
    sliding link has a prismatic joint with the line on which it slides.
    """
    sheet = _Sheet(drawn)
    long = float(np.median([max(abs(complex(*row[:2])), 0.1) for row in drawn.design[:-2].reshape(-1, EACH)]))
    slides, m = _hang(sheet, long), Mechanism(name or drawn.chain.name)

    def put(at: complex) -> tuple[float, float]:
        z = drawn.place + drawn.factor * at
        return float(z.real), float(z.imag)

    ends: dict[int, tuple[str, complex]] = {}
    for _, body, at, along in slides:  # a sliding body's direction is that of two of its points
        first = sheet.add(at, body)
        ends[body] = first, at + long * along
    on: dict[int, tuple[str, str]] = {}
    for body, (first, far) in ends.items():
        on[body] = first, sheet.add(far, body)
    for point, at in sheet.places.items():
        (m.ground if point in sheet.on[GROUND] else m.point)(point, put(at))
    for body in range(CRANK, drawn.chain.bars):
        m.body("crank" if body == CRANK else f"link {body}", _farthest_first(sheet, body))
    for k, (line, body, _, _) in enumerate(slides):
        m.prismatic(f"slide {k + 1}", line, on[body])
    m.angle(INPUT, at=sheet.on[CRANK][0], to=sheet.pin)
    return m, float(np.angle(drawn.factor * sheet.places[sheet.pin]))


def _hang(sheet: _Sheet, long: float) -> list[tuple[tuple[str, str], int, complex, complex]]:
    """Hang up all dyads: points go on the sheet, and of what slides the line, the body, its place and its direction.

    A line has its second point so far from the first as `long` says. The tracing point comes last.
    """
    drawn, chain, frames = sheet.drawn, sheet.drawn.chain, sheet.frames
    sheet.add(0j, GROUND, CRANK)
    slides: list[tuple[tuple[str, str], int, complex, complex]] = []
    for d, (kind, a, b) in enumerate(chain.dyads):
        row = drawn.design[EACH * d : EACH * (d + 1)]
        one, two = 2 + 2 * d, 3 + 2 * d
        (o, u), (oo, w) = frames[a], frames[b]
        p, q = o + u * complex(row[0], row[1]), oo + w * complex(row[2], row[3])
        if kind[0] == "R":
            sheet.add(p, a, one)
        if kind == "RPR":
            sheet.add(q, b, two)
            slides.append((_line(sheet, one, q, frames[one][1], long), two, q, frames[one][1]))
            continue
        inner = frames[two][0] if kind != "RRR" else frames[one][0] + frames[one][1] * row[4]
        sheet.add(inner, one, two)
        if kind == "RRR":
            sheet.add(q, b, two)
        if kind[0] == "P":
            slides.append((_line(sheet, a, p, frames[one][1], long), one, inner, frames[one][1]))
        if kind[2] == "P":
            slides.append((_line(sheet, b, q, frames[two][1], long), two, inner, frames[two][1]))
    origin, along = frames[chain.tracer]
    sheet.places[TRACER] = origin + along * complex(*drawn.design[-2:])
    sheet.on[chain.tracer].append(TRACER)
    return slides


def to_joints(drawn: ChainDesign) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Write a design of turning joints as points and bars between them.

    Returns:
        Places ``(n, 2)``, the crank's pivot first, its pin second, the tracing point last; which pairs are bars,
        ``(n, n)`` of 0 and 1; and which points stay where they are, ``(n,)`` of 0 and 1.
    """
    sheet = _Sheet(drawn)
    _hang(sheet, 1.0)
    first = [sheet.on[CRANK][0], sheet.pin]
    order = [*first, *(point for point in sheet.places if point not in first)]
    at = {point: k for k, point in enumerate(order)}
    bars = np.zeros((len(order), len(order)), np.int8)
    for body in range(CRANK, drawn.chain.bars):
        base = first if body == CRANK else sheet.on[body][:2]
        pairs = [tuple(base), *((end, point) for point in sheet.on[body] if point not in base for end in base)]
        for a, b in pairs:
            bars[at[a], at[b]] = bars[at[b], at[a]] = 1
    z = drawn.place + drawn.factor * np.array([sheet.places[point] for point in order])
    fixed = np.array([point in sheet.on[GROUND] for point in order], np.int8)
    return np.stack([z.real, z.imag], axis=1), bars, fixed


def _line(sheet: _Sheet, body: int, at: complex, along: complex, long: float) -> tuple[str, str]:
    """Two points of a body on a line of it."""
    return sheet.add(at, body), sheet.add(at + long * along, body)


def _farthest_first(sheet: _Sheet, body: int) -> list[str]:
    """Points of a body, its base of two far ones first: what rides on them is known best then."""
    names = list(sheet.on[body])
    places = np.array([sheet.places[n] for n in names])
    apart = np.abs(places[:, None] - places)
    first, second = np.unravel_index(apart.argmax(), apart.shape)
    base = [names[i] for i in sorted((int(first), int(second)))]
    return [*base, *(n for n in names if n not in base)]


# -- Fourier coefficients of curves ------------------------------------------------------------------------------------


HARMONICS = 10  # of closed curves, either way round
WAVES = 14  # of open ones
_SHIFTS = 64  # starts that are tried when closed curves are laid on one another
_ORDER = np.r_[-HARMONICS:0, 1 : HARMONICS + 1]


def closed_coefficients(points: Any, of: Any = np) -> Any:
    """Fourier coefficients of closed curves by arc length.

    Args:
        points: corners, ``(…, T, 2)``; the last one is joined to the first.
        of: the array module.

    Returns:
        Real and imaginary parts for the harmonics -K … -1, 1 … K, ``(…, 2 K, 2)``, in units of the curve.
    """
    step = of.roll(points, -1, axis=-2) - points
    middle, length = points + 0.5 * step, of.sqrt(of.sum(step * step, axis=-1))
    total = of.sum(length, axis=-1)[..., None]
    weight = length / of.where(total > 0, total, 1.0)
    angle = 2.0 * np.pi * (of.cumsum(weight, axis=-1) - 0.5 * weight)
    phase = angle[..., None, :] * _ORDER[:, None]
    cos, sin = of.cos(phase) * weight[..., None, :], of.sin(phase) * weight[..., None, :]
    x, y = middle[..., 0][..., None], middle[..., 1][..., None]
    return of.concatenate([cos @ x + sin @ y, cos @ y - sin @ x], axis=-1)


def open_coefficients(points: Any, of: Any = np, share: Any = 1.0) -> Any:
    """Cosine coefficients of open curves by arc length.

    Args:
        points: corners, ``(…, T, 2)``.
        of: the array module.
        share: 1 where the piece from a corner to the next belongs to the curve, else 0, ``(…, T - 1)``.

    Returns:
        x and y for 1 … W half waves, ``(…, W, 2)``, in units of the curve.
    """
    step = points[..., 1:, :] - points[..., :-1, :]
    length = of.sqrt(of.sum(step * step, axis=-1)) * share
    before = of.cumsum(length, axis=-1) - 0.5 * length
    total = of.sum(length, axis=-1)[..., None]
    angle = np.pi * before / of.where(total > 0, total, 1.0)
    weight = length / of.where(total > 0, total, 1.0)
    middle = points[..., :-1, :] + 0.5 * step
    middle = middle - of.sum(middle * weight[..., None], axis=-2)[..., None, :]
    waves = of.cos(angle[..., None, :] * np.arange(1, WAVES + 1)[:, None]) * weight[..., None, :]
    return 2.0 * waves @ middle


def normalise(coefficients: Any, of: Any = np) -> Any:
    """Divide by their size, ``(…, n, 2)``."""
    size = of.sqrt(of.sum(coefficients**2, axis=(-1, -2)))[..., None, None]
    return coefficients / of.where(size > 0, size, 1.0)


def upright(coefficients: Any, of: Any = np) -> Any:
    """Turn open curves so that their first wave lies along x, ``(…, W, 2)``."""
    x, y = coefficients[..., 0], coefficients[..., 1]
    size = of.sqrt(x[..., :1] ** 2 + y[..., :1] ** 2)
    c, s = x[..., :1] / of.where(size > 0, size, 1.0), y[..., :1] / of.where(size > 0, size, 1.0)
    return of.stack([x * c + y * s, y * c - x * s], axis=-1)


def magnitudes(coefficients: Any) -> np.ndarray:
    """Sizes of harmonics, which no turn and no start changes, ``(…, n)``."""
    return np.sqrt(np.sum(np.asarray(coefficients, np.float32) ** 2, axis=-1))


def _complex(coefficients: np.ndarray) -> np.ndarray:
    return coefficients[..., 0].astype(np.float32) + 1j * coefficients[..., 1].astype(np.float32)


def lay_closed(target: np.ndarray, found: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lay closed curves on a target as well as turning, starting and mirroring can.

    Args:
        target: its coefficients, of size 1, ``(2 K, 2)``.
        found: those of the curves, ``(N, 2 K, 2)``.

    Returns:
        The mean square that is left, by which angle each is turned, and whether it is mirrored first, ``(N,)`` each.
    """
    goal, own = _complex(target), _complex(found)
    wave = np.exp(2j * np.pi * _ORDER[:, None] * np.arange(_SHIFTS) / _SHIFTS).astype(np.complex64)
    ways = (own, own[:, ::-1], np.conj(own[:, ::-1]), np.conj(own))  # as it is, backwards, mirrored, both
    return _lay_best([((goal * np.conj(way)) @ wave).T for way in ways])


def lay_open(target: np.ndarray, found: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lay open curves on a target as well as turning and mirroring can; arguments and results as of `lay_closed`."""
    goal, own = _complex(target), _complex(found)
    back = (-1.0) ** np.arange(1, WAVES + 1)
    ways = (own, own * back, np.conj(own), np.conj(own) * back)
    return _lay_best([np.sum(goal * np.conj(way), axis=1)[None] for way in ways])


def _lay_best(fits: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Choose for each curve the best of four ways, the last two mirrored, and starts, ``(starts, N)`` of each way."""
    every = np.concatenate(fits)
    which = np.abs(every).argmax(axis=0)
    chosen = every[which, np.arange(every.shape[1])]
    return 1.0 - np.abs(chosen) ** 2, np.angle(chosen), which >= 2 * len(fits[0])


# -- the atlas ---------------------------------------------------------------------------------------------------------


BARS = (4, 6, 8)
_FORM = 2  # of the files, and of how designs are made; another number when either changes
_PART = 25_000  # designs of a file
_POSES = 64  # at which designs are looked at when they are made
_LEAST = float(np.sin(np.radians(8.2)) ** 2)  # of the transmission angle: 8 degrees, as poses in between are estimated
_LANES = 2048  # designs that are made together
_SHARES = {4: 0.1, 6: 0.3, 8: 0.6}
_SLIDERS = (0.55, 0.25, 0.12, 0.08)  # shares of designs with none, one, two, three and more sliding pairs
_LONGEST = 40.0  # of a link, in sizes of its curve
_CLOSE = 1500  # designs near a curve by the sizes of their harmonics that are looked at with their phases
_SHORT, _LONG = 6, 60  # steps of the crank in an open piece of a curve


@public
class Shelf(NamedTuple):
    """Designs with the same number of bars; the first axis is that of designs."""

    bars: int
    chain: np.ndarray  # index in `dyadic_chains`, (N,)
    sign: np.ndarray  # assemblies, (N, dyads)
    design: np.ndarray  # (N, 6 dyads + 2)
    sine: np.ndarray  # square of the sine of the smallest transmission angle, (N,)
    window: np.ndarray  # an open piece of the curve: where the crank begins and how far it turns, (N, 2)
    closed: np.ndarray  # coefficients of the whole curve, of size 1, (N, 20, 2)
    open: np.ndarray  # of the open piece, of size 1, upright, (N, 14, 2)

    @property
    def chains(self) -> tuple[Chain, ...]:
        """All chains with so many bars."""
        return dyadic_chains(self.bars)

    def at(self, index: Any) -> "Shelf":
        """Select designs."""
        return Shelf(self.bars, *(array[index] for array in self[1:]))


@public
class Candidates(NamedTuple):
    """Designs whose curves are like a target, the most alike first."""

    shelf: Shelf
    misfit: np.ndarray  # mean square that is left, of curves of size 1
    turn: np.ndarray  # by which they have to be turned
    mirrored: np.ndarray  # whether they have to be mirrored first


@public
class Atlas:
    """Linkages whose crank turns, with the curves that they trace.

    Attributes:
        shelves: the designs by their number of bars.
        seconds: how long it took to make, without what was there.
    """

    def __init__(self, shelves: dict[int, Shelf], seconds: float = 0.0):
        self.shelves = shelves
        self.seconds = seconds

    def __len__(self) -> int:
        return sum(len(shelf.chain) for shelf in self.shelves.values())

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(s.chain):,} of {bars} bars" for bars, s in sorted(self.shelves.items()))
        return f"Atlas({counts})"

    def find(
        self, target: Any, closed: bool, bars: int, count: int, allowed: Callable[[Chain], bool] | None = None
    ) -> Candidates:
        """Find the designs whose curves are most like a target, in whatever place, size and turn."""
        shelf = self.shelves[bars]
        if allowed is not None:
            may = np.array([allowed(chain) for chain in shelf.chains])
            shelf = shelf.at(np.flatnonzero(may[shelf.chain]))
        if closed:
            goal = normalise(closed_coefficients(target))
            sizes = self._sizes(shelf) if allowed is None else magnitudes(shelf.closed)
            queries = np.stack([magnitudes(goal), magnitudes(goal)[::-1]])
            lay, stored = lay_closed, shelf.closed
        else:
            goal = normalise(open_coefficients(target))
            straight = upright(goal)
            back = straight * (-1.0) ** np.arange(1, len(goal) + 1)[:, None]
            mirror = np.array([1.0, -1.0])
            queries = np.stack([w.reshape(-1) for s in (straight, upright(back)) for w in (s, s * mirror)])
            sizes, lay, stored = shelf.open.reshape(len(shelf.chain), -1).astype(np.float32), lay_open, shelf.open
        apart = np.min(_squares(sizes) - 2.0 * (queries.astype(np.float32) @ sizes.T) + 1.0, axis=0)
        many = min(max(_CLOSE, 2 * count), len(apart))
        near = np.argpartition(apart, many - 1)[:many] if many else np.zeros(0, int)
        misfit, turn, mirrored = lay(goal, stored[near].astype(np.float32))
        order = np.argsort(misfit, kind="stable")[:count]
        return Candidates(shelf.at(near[order]), misfit[order], turn[order], mirrored[order])

    def save(self, path: str | Path, count: int | None = None, points: int = 200, progress: bool | None = None) -> Path:
        """Write linkages of turning joints, with their curves, as arrays for whoever trains models on them.

        The layout is that of the LINKS data (A. Heyrani Nobari et al., 2022): ``x0`` the places of joints
        ``(N, n, 2)``, the crank's pivot first, its pin second; ``connectivity`` which of them bars join ``(N, n, n)``;
        ``node_types`` which stay where they are ``(N, n)``. Joints that a linkage does not have are zeros behind
        the ``joints`` that it has ``(N,)``; the last of those traces ``target_curves``, ``(N, points, 2)``, at even
        steps of the crank all round.

        Args:
            path: the file, ``.npz``.
            count: how many linkages; all of turning joints if not given.
            points: of each curve.
            progress: show a bar; if not given, where stderr is a terminal, and in a notebook.
        """
        path = Path(path)
        if path.suffix != ".npz":
            raise InputError(f"save: path={str(path)!r}: arrays are written as .npz; end the name in .npz")
        check_counts("save", points=points, **({} if count is None else {"count": count}))
        rows = [(s, k) for s in self.shelves.values() for k in range(len(s.chain)) if not s.chains[s.chain[k]].sliders]
        found = []
        with bar(len(rows[:count]), "linkages", "linkage", progress) as shown:
            for shelf, k in rows[:count]:
                row = (shelf.sign[k].astype(float), shelf.design[k].astype(float))
                drawn = ChainDesign(shelf.chains[shelf.chain[k]], *row, 0j, 1 + 0j, 0.0, 2.0 * np.pi)
                found.append((*to_joints(drawn), drawn.trace(np.arange(points) * (2.0 * np.pi / points))))
                shown.update()
        joints = np.array([len(places) for places, *_ in found], np.int32)
        most = int(joints.max(initial=0))
        arrays: dict[str, Any] = {
            "x0": np.zeros((len(found), most, 2)),
            "connectivity": np.zeros((len(found), most, most), np.int8),
            "node_types": np.zeros((len(found), most), np.int8),
            "joints": joints,
            "target_curves": np.array([np.stack([z.real, z.imag], axis=1) for *_, z in found]).reshape(-1, points, 2),
        }
        for k, (places, bars, fixed, _) in enumerate(found):
            n = len(places)
            arrays["x0"][k, :n], arrays["connectivity"][k, :n, :n], arrays["node_types"][k, :n] = places, bars, fixed
        try:
            with path.open("wb") as file:
                np.savez_compressed(file, allow_pickle=False, **arrays)
        except OSError as error:
            raise OutputError(f"{path}: {error.strerror or error}; name another file") from None
        return path

    def _sizes(self, shelf: Shelf) -> np.ndarray:
        kept = self.__dict__.setdefault("_magnitudes", {})
        if shelf.bars not in kept:
            kept[shelf.bars] = magnitudes(shelf.closed)
        return kept[shelf.bars]


def _squares(rows: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", rows, rows)


@public
def atlas(
    count: int = 200_000,
    bars: Sequence[int] = BARS,
    key: Array | None = None,
    folder: str | Path | None = None,
    progress: bool | None = None,
) -> Atlas:
    """Make an atlas of crank-driven linkages and their curves, or read what was made before.

    Designs are drawn at random over all chains of dyads; lengths are chosen so that the crank turns. Every design is
    moved all the way round by the closed form of its dyads. None is kept whose transmission angle falls below
    8 degrees, between the 64 poses too, or of which a link turns by more than 45 degrees from one pose to the next.
    The designs are kept in files of 25,000: what was interrupted goes on, and a larger atlas keeps the smaller one.

    Args:
        count: how many designs, rounded up to whole files.
        bars: numbers of links that are wanted, of 4, 6 and 8.
        key: of the random numbers, ``jax.random.key(0)`` if not given.
        folder: where the files are kept; in the user's cache if not given.
        progress: show a bar; if not given, where stderr is a terminal, and in a notebook.

    Returns:
        The atlas.

    Raises:
        InputError: a count or a number of bars that is none.
        JaxncError: the files cannot be written.
    """
    refuse_fork()
    check_counts("atlas", count=count)
    wanted = check_bars("atlas", bars)
    seed = as_seed("atlas", key)
    where = _folder(folder)
    parts = -(-count // _PART)
    begun, read = time.perf_counter(), []
    missing = 0
    with bar(parts * _PART, "atlas", "linkage", progress) as shown:
        for part in range(parts):
            path = where / f"{_FORM}-{'-'.join(map(str, seed))}-{part}.npz" if where else None
            shelves = _read(path)
            if shelves is None:
                missing += 1
                shelves = _make_part(seed, part, shown.update)
                _write(path, shelves)
            else:
                shown.update(_PART)
            read.append(shelves)
    joined = {
        b: Shelf(b, *(np.concatenate(arrays) for arrays in zip(*(s[b][1:] for s in read), strict=True)))
        for b in BARS
        if b in wanted
    }
    return Atlas(joined, (time.perf_counter() - begun) if missing else 0.0)


def check_bars(what: str, bars: Any) -> tuple[int, ...]:
    """Return numbers of bars that were asked for."""
    given = (bars,) if isinstance(bars, int | np.integer) else bars
    if (
        isinstance(given, str)
        or not isinstance(given, Sequence | np.ndarray | set | frozenset | range)
        or not len(given)
    ):
        raise InputError(f"{what}: bars={bars!r}: expected some of 4, 6 and 8, such as (4, 6)")
    for one in given:
        if isinstance(one, bool) or one not in BARS:
            raise InputError(f"{what}: bars={bars!r}: linkages of dyads have 4, 6 or 8 bars here, not {one!r}")
    return tuple(sorted({int(one) for one in given}))


def _folder(folder: str | Path | None) -> Path | None:
    """Find, and make, the folder that keeps the files; None where caches are switched off."""
    if folder is None:
        told = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
        own = cache_folder(os.environ, sys.platform, told)
        if own is None:
            return None
        folder = Path(own) / "atlas"
    if not isinstance(folder, str | Path) or not str(folder).strip():
        raise InputError(f"atlas: folder={folder!r}: expected the name of a folder, as text or a pathlib.Path")
    where = Path(folder).expanduser()
    try:
        where.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise JaxncError(f"atlas: folder {where} cannot be made: {error.strerror or error}; name another one") from None
    return where


def _read(path: Path | None) -> dict[int, Shelf] | None:
    """Read a file of an atlas; None if there is none, or it was cut short."""
    if path is None or not path.is_file():
        return None
    try:
        with path.open("rb") as whole, np.load(whole) as file:
            return {b: Shelf(b, *(file[f"{name}_{b}"] for name in Shelf._fields[1:])) for b in BARS}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _write(path: Path | None, shelves: dict[int, Shelf]) -> None:
    if path is None:
        return
    new = path.with_suffix(f".{os.getpid()}.tmp")
    arrays = {
        f"{name}_{b}": array for b, s in shelves.items() for name, array in zip(s._fields[1:], s[1:], strict=True)
    }
    try:
        with new.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        new.replace(path)
    except OSError as error:
        new.unlink(missing_ok=True)
        raise JaxncError(
            f"the atlas cannot be kept in {path.parent}: {error.strerror or error}; give atlas(folder=…) another "
            f"place, or set JAXNC_CACHE=off to make it anew each time"
        ) from None


def _make_part(seed: list[int], part: int, tell: Callable[[int], Any]) -> dict[int, Shelf]:
    rng = np.random.default_rng((*seed, part, 1))  # numbers of its own, the same in every form
    shelves = {}
    for bars in BARS:
        wanted, found = round(_SHARES[bars] * _PART), []
        while (have := sum(len(s.chain) for s in found)) < wanted:
            found.append(make(bars, rng))
            tell(min(len(found[-1].chain), wanted - have))
        shelf = Shelf(bars, *(np.concatenate(a) for a in zip(*(s[1:] for s in found), strict=True)))
        shelves[bars] = shelf.at(slice(wanted))
    return shelves


@functools.cache
def _likelihoods(bars: int) -> np.ndarray:
    """How often each chain is taken: by its number of sliding pairs, then all alike."""
    sliders = np.array([min(chain.sliders, len(_SLIDERS) - 1) for chain in dyadic_chains(bars)])
    counts = np.bincount(sliders, minlength=len(_SLIDERS))
    share = np.array(_SLIDERS) * (counts > 0)
    return (share / share.sum() / np.maximum(counts, 1))[sliders]


@functools.cache
def _by_front(bars: int) -> dict[tuple[int, ...], np.ndarray]:
    arrays, found = chain_arrays(bars), {}
    fronts = np.stack(arrays[:3], axis=1)[:, :, :-1].reshape(len(arrays.tracer), -1)
    for k, front in enumerate(fronts.tolist()):
        found.setdefault(tuple(front), []).append(k)
    return {front: np.array(which) for front, which in found.items()}


def chains_beginning(bars: int, front: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Find the chains with given first dyads.

    Args:
        bars: number of links with the ground.
        front: kinds of all dyads but the last one, then the bodies on which they hang, the first ones and the second.

    Returns:
        Indices in `dyadic_chains`, and how often each is taken when one is made at random.
    """
    which = _by_front(bars).get(front, np.zeros(0, int))
    return which, _likelihoods(bars)[which]


@functools.cache
def chain_arrays(bars: int) -> ChainArrays:
    """All chains with some number of bars as arrays, in the order of `dyadic_chains`."""
    return ChainArrays.of(dyadic_chains(bars))


def make(bars: int, rng: np.random.Generator) -> Shelf:
    """Make some designs; those whose crank does not turn are left out."""
    dyads = (bars - 2) // 2
    index = rng.choice(len(_likelihoods(bars)), _LANES, p=_likelihoods(bars)).astype(np.int16)
    uniform = rng.uniform(size=(_LANES, dyads + 1, 8)).astype(np.float32)
    start = rng.uniform(0.0, 2.0 * np.pi, _LANES).astype(np.float32)
    steps = rng.integers(_SHORT, _LONG + 1, _LANES)
    made = _made(chain_arrays(bars).at(index), uniform, start, steps)
    sign, design, sine, size, closed, part = (np.asarray(a) for a in made)
    good = (
        (sine > _LEAST)
        & np.isfinite(design).all(axis=1)
        & np.isfinite(closed).all(axis=(1, 2))
        & np.isfinite(part).all(axis=(1, 2))
    )
    good &= np.abs(design[:, : curves.EACH * dyads]).max(axis=1) < _LONGEST * size
    window = np.stack([start, steps * np.float32(2.0 * np.pi / _POSES)], axis=1).astype(np.float32)
    whole = Shelf(
        bars, index, sign.astype(np.int8), design, sine, window, closed.astype(np.float16), part.astype(np.float16)
    )
    return whole.at(good)


@jax.jit
def _made(chain: ChainArrays, uniform: Array, start: Array, steps: Array) -> tuple[Array, ...]:
    grid = jnp.arange(_POSES + 1, dtype=jnp.float32) * np.float32(2.0 * np.pi / _POSES)

    def one(chain: ChainArrays, uniform: Array, start: Array, steps: Array) -> tuple[Array, ...]:
        sign, design, traced = curves.sample(chain, uniform, start + grid)
        points = traced.point.T
        inside = jnp.arange(_POSES) < steps
        own = points[:-1] - jnp.mean(points[:-1], axis=0)
        size = jnp.sqrt(jnp.mean(jnp.sum(own * own, axis=1)))
        part = upright(normalise(open_coefficients(points, jnp, inside), jnp), jnp)
        least = jnp.min(curves.least_between(traced.sine[:, :-1]))
        return sign, design, least, size, normalise(closed_coefficients(own, jnp), jnp), part

    return jax.vmap(one)(chain, uniform, start, steps)
