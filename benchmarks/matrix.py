"""Poses by every route: the number of lanes, tracing and mapping change neither status nor value.

``python -m benchmarks.matrix`` runs all 270 combinations of lanes, route, inputs and mechanism, each against places and
derivatives that NumPy finds by other means, and prints those that disagree; a test runs some that cover all pairs. The
mechanisms are planar and have three freedoms: one of dyads, whose blocks have closed forms; a platform on three legs,
which has none; and one with redundant rows, a third crank beside a parallelogram.
"""

import functools
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from jaxnc.status import Status

LANES = (1, 15, 16, 511, 512, 20_000)
ROUTES = ("eager", "jit", "vmap", "jit of vmap", "grad")
INPUTS = (1, 2, 3)
DRIVES = ("phi1", "phi2", "phi3")
PLACES = {"float64": 1e-12, "float32": 3e-5}  # of the size: of 16 and 7 digits
SLOPES = {"float64": 1e-10, "float32": 3e-3}  # of the largest: the inverse of the Jacobian takes some of them
_DISTINCT = 2000  # lanes; where there are more, those that are met come again: others are followed one by one
_ONE_IN = 8  # of those beyond a dead point: each of them is followed to where it stops
_MARGIN = 0.015  # by which lanes are clear of dead points
_WAY = np.linspace(0.05, 1.0, 20)


class Case(NamedTuple):
    """One combination."""

    kind: str
    inputs: int
    lanes: int
    route: str
    dtype: str = "float64"

    def __str__(self) -> str:
        return f"{self.kind}, {self.inputs} inputs, {self.lanes} lanes, {self.route}, {self.dtype}"


class Point(NamedTuple):
    """A point ``(2, lanes)`` and its derivatives with respect to the three inputs ``(2, 3, lanes)``."""

    at: np.ndarray
    to: np.ndarray


class Answer(NamedTuple):
    """Points of a rig, and how far from a dead point it is: negative where it does not assemble."""

    points: list[Point]
    margin: np.ndarray


class Rig(NamedTuple):
    """A mechanism of three inputs, and where its points are.

    Attributes:
        draw: the description.
        points: names of the points that are compared.
        start: inputs in the drawing.
        reach: how far from there they are taken, ``(3, 2)``.
        solve: the points at inputs ``(3, lanes)``.
    """

    draw: Callable[[], nc.Mechanism]
    points: tuple[str, ...]
    start: tuple[float, float, float]
    reach: tuple[tuple[float, float], ...]
    solve: Callable[[np.ndarray], Answer]


def _tip(pivot: tuple[float, float], length: float, x: np.ndarray, k: int) -> Point:
    """The tip of the k-th crank."""
    to = np.zeros((2, 3, x.shape[1]))
    to[0, k], to[1, k] = -length * np.sin(x[k]), length * np.cos(x[k])
    return Point(np.stack([pivot[0] + length * np.cos(x[k]), pivot[1] + length * np.sin(x[k])]), to)


def _dyad(a: Point, ra: float, b: Point, rb: float) -> tuple[Point, np.ndarray]:
    """Where two bars meet, to the left of the line from a to b; the square of its sine seen from a."""
    d = b.at - a.at
    square = np.sum(d * d, axis=0)
    along = 0.5 * (1.0 + (ra * ra - rb * rb) / square)
    left = ra * ra / square - along * along
    height = np.sqrt(np.maximum(left, 0.0))
    at = a.at + along * d + height * np.stack([-d[1], d[0]])
    # (at - a)·d(at) = (at - a)·da, and the same for b
    u, v = at - a.at, at - b.at
    first, second = (np.einsum("in,ikn->kn", w, p.to) for w, p in ((u, a), (v, b)))
    with np.errstate(all="ignore"):
        to = np.stack([first * v[1] - second * u[1], second * u[0] - first * v[0]]) / (u[0] * v[1] - u[1] * v[0])
    return Point(at, to), left


def _bars(m: nc.Mechanism, *pairs: str) -> None:
    for pair in pairs:
        m.body(pair, pair.split("-"))


def _drawn(m: nc.Mechanism, rig: "Rig", names: tuple[str, ...]) -> None:
    """Points where the rig's own solution has them."""
    found = rig.solve(np.array(rig.start)[:, None]).points
    for name, point in zip(names, found, strict=True):
        m.point(name, tuple(map(float, point.at[:, 0])))


_A, _B, _C = (0.0, 0.0), (4.0, 0.0), (2.0, 5.0)  # pivots of the cranks of the dyads


def _solve_dyads(x: np.ndarray) -> Answer:
    a, b, c = _tip(_A, 1.0, x, 0), _tip(_B, 1.0, x, 1), _tip(_C, 0.8, x, 2)
    p, first = _dyad(a, 2.2, b, 2.2)
    q, second = _dyad(p, 2.6, c, 2.4)
    return Answer([a, b, c, p, q], np.minimum(first, second))


def _draw_dyads() -> nc.Mechanism:
    m = nc.Mechanism("dyads")
    for name, at in (("A0", _A), ("B0", _B), ("C0", _C)):
        m.ground(name, at)
    _drawn(m, RIGS["closed"], ("A", "B", "C", "P", "Q"))
    _bars(m, "A0-A", "B0-B", "C0-C", "A-P", "B-P", "P-Q", "C-Q")
    for phi, at, to in zip(DRIVES, ("A0", "B0", "C0"), "ABC", strict=True):
        m.angle(phi, at=at, to=to)
    return m


_APART = ((0.0, 0.0), (3.0, 0.0), (4.5, 0.0))  # pivots of the parallelogram and the crank beside it
_D, _E = (8.5, 0.0), (6.5, 5.0)


def _solve_redundant(x: np.ndarray) -> Answer:
    moved = [_tip(pivot, 1.0, x, 0) for pivot in _APART]
    b, c = _tip(_D, 1.0, x, 1), _tip(_E, 0.8, x, 2)
    p, first = _dyad(moved[2], 2.2, b, 2.2)
    q, second = _dyad(p, 2.6, c, 2.4)
    # A parallelogram may change where it is flat.
    return Answer([*moved, b, c, p, q], np.minimum(np.minimum(first, second), np.sin(x[0]) ** 2))


def _draw_redundant() -> nc.Mechanism:
    m = nc.Mechanism("a third crank")
    for name, at in zip(("G0", "G1", "G2", "B0", "C0"), (*_APART, _D, _E), strict=True):
        m.ground(name, at)
    _drawn(m, RIGS["redundant"], ("P0", "P1", "P2", "B", "C", "P", "Q"))
    _bars(m, "G0-P0", "G1-P1", "G2-P2", "P0-P1-P2", "B0-B", "C0-C", "P2-P", "B-P", "P-Q", "C-Q")
    for phi, at, to in zip(DRIVES, ("G0", "B0", "C0"), ("P0", "B", "C"), strict=True):
        m.angle(phi, at=at, to=to)
    return m


_FEET = ((0.0, 0.0), (6.0, 0.0), (3.0, 5.2))
_CORNERS = 1.15 * np.stack([np.cos([3.67, 5.76, 1.57]), np.sin([3.67, 5.76, 1.57])])  # of the platform, (2, 3)
_HOME = np.array([3.0, 1.8, 0.25])  # of its centre, and how it is turned
_BENT = (1.9, 3.9, 6.0)  # angles of the cranks in the drawing


def _corners(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the platform ``(2, 3, lanes)`` from its centre and angle ``(3, lanes)``; how they move as it turns."""
    c, s = np.cos(z[2]), np.sin(z[2])
    arm = np.stack(
        [np.outer(_CORNERS[0], c) - np.outer(_CORNERS[1], s), np.outer(_CORNERS[0], s) + np.outer(_CORNERS[1], c)]
    )
    return z[:2, None] + arm, np.stack([-arm[1], arm[0]])


@functools.cache
def _rods() -> np.ndarray:
    """Squares of the legs' lengths as drawn."""
    corners = _corners(_HOME[:, None])[0]
    tips = np.stack([_tip(f, 1.0, np.array(_BENT)[:, None], k).at for k, f in enumerate(_FEET)], axis=1)
    return np.sum((corners - tips) ** 2, axis=0)


def _solve_platform(x: np.ndarray) -> Answer:
    """Newton's method along the way from the drawing; the determinant says how far from a dead point it is."""
    start, n = np.array(_BENT)[:, None], x.shape[1]
    z, margin, first = np.repeat(_HOME[:, None], n, axis=1), np.full(n, np.inf), None
    for t in np.concatenate([[0.0], _WAY]):
        tips = [_tip(f, 1.0, start + t * (x - start), k) for k, f in enumerate(_FEET)]
        at = np.stack([tip.at for tip in tips], axis=1)
        for _ in range(8):
            corners, turned = _corners(z)
            leg = corners - at
            slope = np.stack([leg[0], leg[1], np.sum(leg * turned, axis=0)])  # (3 unknowns, 3 legs, lanes)
            rest = 0.5 * (np.sum(leg * leg, axis=0) - _rods())
            z = z - np.linalg.solve(slope.transpose(2, 1, 0), rest.T[..., None])[..., 0].T
        determinant = np.linalg.det(slope.transpose(2, 1, 0))
        first = determinant[:1] if first is None else first
        margin = np.minimum(margin, np.where(np.abs(rest).max(axis=0) < 1e-12, determinant / first, -1.0))
        z = np.where(margin > 0.0, z, _HOME[:, None])
    # Two tips too far apart for the legs and the platform between them: it certainly does not assemble.
    legs, side = np.sqrt(_rods()[:, 0]), np.linalg.norm(_CORNERS[:, 0] - _CORNERS[:, 1])
    gaps = [np.linalg.norm(at[:, i] - at[:, j], axis=0) - legs[i] - legs[j] - side for i, j in ((0, 1), (1, 2), (0, 2))]
    beyond = np.max(gaps, axis=0) > _MARGIN
    margin = np.where(beyond, -1.0, np.where(margin < 0.0, 0.0, margin))
    corners, turned = _corners(z)
    leg = corners - at
    slope = np.stack([leg[0], leg[1], np.sum(leg * turned, axis=0)])
    push = np.stack(
        [np.einsum("in,ikn->kn", leg[:, k], tip.to) for k, tip in enumerate(tips)]
    )  # (3 legs, 3 inputs, lanes)
    dz = np.linalg.solve(slope.transpose(2, 1, 0), push.transpose(2, 0, 1)).transpose(1, 2, 0)
    moved = [Point(corners[:, k], dz[:2] + turned[:, k, None] * dz[2]) for k in range(3)]
    return Answer([*tips, *moved], margin)


def _draw_platform() -> nc.Mechanism:
    m = nc.Mechanism("platform on three legs")
    for k, foot in enumerate(_FEET):
        m.ground(f"G{k}", foot)
    _drawn(m, RIGS["not closed"], ("C0", "C1", "C2", "P0", "P1", "P2"))
    _bars(m, "G0-C0", "G1-C1", "G2-C2", "C0-P0", "C1-P1", "C2-P2", "P0-P1-P2")
    for k, phi in enumerate(DRIVES):
        m.angle(phi, at=f"G{k}", to=f"C{k}")
    return m


_DRAWN = (1.2, 2.0, 4.0)
_NEAR = ((-0.6, 1.7), (-1.6, 0.3), (-0.5, 0.5))
_AROUND = ((-0.5, 1.6), (-0.6, 0.6), (-0.6, 0.6))
RIGS = {
    "closed": Rig(_draw_dyads, ("A", "B", "C", "P", "Q"), _DRAWN, _NEAR, _solve_dyads),
    "not closed": Rig(_draw_platform, ("C0", "C1", "C2", "P0", "P1", "P2"), _BENT, _AROUND, _solve_platform),
    "redundant": Rig(_draw_redundant, ("P0", "P1", "P2", "B", "C", "P", "Q"), _DRAWN, _NEAR, _solve_redundant),
}


@functools.cache
def system(kind: str, dtype: str = "float64") -> nc.System:
    """A compiled rig."""
    return RIGS[kind].draw().compile(dtype=dtype)


@functools.cache
def inputs(kind: str, count: int) -> np.ndarray:
    """Inputs ``(3, lanes)``, the first one met: clear of dead points all the way from the drawing, or beyond one."""
    rig, rng = RIGS[kind], np.random.default_rng(3)
    start = np.array(rig.start)[:, None]
    x = start + np.stack([rng.uniform(*r, 4 * _DISTINCT) for r in rig.reach])
    x[count:] = start[count:]
    way = (1.0,) if kind == "not closed" else _WAY  # it looks along the way by itself
    margins = np.stack([rig.solve(start + t * (x - start)).margin for t in way])
    met = margins.min(axis=0) > _MARGIN
    beyond = (margins[-1] < -_MARGIN) & (np.diff(margins > 0, axis=0).sum(axis=0) <= 1)
    beyond &= np.cumsum(beyond) % _ONE_IN == 1
    chosen = np.flatnonzero(met | beyond)
    chosen = np.concatenate([chosen[met[chosen]][:1], chosen])[:_DISTINCT]
    assert len(chosen) == _DISTINCT, "too few lanes are clear of dead points"
    return x[:, chosen]


@functools.cache
def reference(kind: str, count: int) -> Answer:
    """What is right at the inputs."""
    return RIGS[kind].solve(inputs(kind, count))


def _lanes(case: Case) -> np.ndarray:
    """Which inputs its lanes have: all of them once, and then again those that are met, as long as there are lanes."""
    met = np.flatnonzero(reference(case.kind, case.inputs).margin > 0)
    return np.concatenate([np.arange(_DISTINCT), np.resize(met, LANES[-1] - _DISTINCT)])[: case.lanes]


@functools.cache
def _places(points: tuple[str, ...]) -> Callable[[nc.Motion], Any]:
    """Reads points ``(lanes, points, 2)`` off a motion: one program, where operation by operation is one for each."""
    return jax.jit(lambda motion: jnp.stack([motion[p] for p in points], axis=-2))


@jax.jit
def _weighed(places: Any, weights: Any) -> Any:
    return jnp.sum(places * weights)


def answer(case: Case) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """What the library gives: places ``(lanes, points, 2)``, statuses, derivatives ``(inputs, lanes)`` by "grad"."""
    s, rig = system(case.kind, case.dtype), RIGS[case.kind]
    driven, hold = DRIVES[: case.inputs], DRIVES[case.inputs :]
    x = inputs(case.kind, case.inputs)[: case.inputs, _lanes(case)].astype(case.dtype)

    def one(*values: Any) -> tuple[Any, Any]:
        motion = nc.solve_position(s, dict(zip(driven, values, strict=True)), hold=hold, throw=False)
        return _places(rig.points)(motion), motion.status

    def many(x: Any) -> tuple[Any, Any]:
        return one(*x)

    routes: dict[str, Callable] = {
        "eager": many,
        "jit": nc.jit(many),
        "vmap": lambda x: jax.vmap(one)(*x),
        "jit of vmap": nc.jit(lambda x: jax.vmap(one)(*x)),
    }
    if case.route != "grad":
        places, status = routes[case.route](list(x))
        return np.asarray(places), np.asarray(status), None
    weights = _weights(len(rig.points))

    def total(x: Any) -> tuple[Any, Any]:
        places, status = many(x)
        return _weighed(places, weights.astype(case.dtype)), (places, status)

    (_, (places, status)), slopes = jax.value_and_grad(total, has_aux=True)(list(map(jnp.asarray, x)))
    return np.asarray(places), np.asarray(status), np.stack(slopes)


def _weights(points: int) -> np.ndarray:
    """What a gradient sums up the places with."""
    return np.random.default_rng(1).uniform(0.5, 1.5, (points, 2))


def disagreements(case: Case) -> list[str]:
    """What of a case is wrong, each in a sentence."""
    rig = RIGS[case.kind]
    right, lanes = reference(case.kind, case.inputs), _lanes(case)
    met = right.margin[lanes] > 0
    places, status, slopes = answer(case)
    wanted = np.stack([p.at for p in right.points]).transpose(2, 0, 1)[lanes]
    out = []
    expected = np.where(met, int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE))
    if (status != expected).any():
        k = int(np.flatnonzero(status != expected)[0])
        said, there = Status(int(status[k])).name, "" if met[k] else "not "
        out.append(f"{(status != expected).sum()} of {len(met)} statuses: lane {k}, which is {there}met, is {said}")
    good = met & (status == 0)
    size = np.abs(wanted[met]).max()
    off = np.abs(places - wanted)[good].max(initial=0.0) / size
    if not off <= PLACES[case.dtype]:
        out.append(f"places are off by {off:.1e} of the size")
    if slopes is not None:
        to = np.stack([p.to for p in right.points])[:, :, : case.inputs, lanes]
        exact = np.where(met, np.einsum("pikn,pi->kn", to, _weights(len(rig.points))), 0.0)
        off = np.abs(slopes - exact).max() / np.abs(exact).max()
        if not off <= SLOPES[case.dtype]:
            out.append(f"derivatives are off by {off:.1e} of the largest")
    return out


def every() -> Iterator[Case]:
    """All combinations."""
    for kind, count, lanes, route in itertools.product(RIGS, INPUTS, LANES, ROUTES):
        yield Case(kind, count, lanes, route)


def pairs(lanes: tuple[int, ...] = LANES) -> list[Case]:
    """Some of them, in which every two settings meet."""
    axes = (tuple(RIGS), INPUTS, lanes, ROUTES)

    def met(c: tuple) -> set:
        return {(i, c[i], j, c[j]) for i, j in itertools.combinations(range(4), 2)}

    left, chosen = set().union(*map(met, itertools.product(*axes))), []
    while left:
        best = max(itertools.product(*axes), key=lambda c: len(met(c) & left))
        left = left - met(best)
        chosen.append(Case(*best))
    return sorted(chosen)


def main() -> int:
    """Run all, print what disagrees."""
    jax.config.update("jax_enable_x64", True)
    wrong, number = 0, 0
    for case in every():
        begin = time.perf_counter()
        found = disagreements(case)
        wrong, number = wrong + bool(found), number + 1
        said = f": {'; '.join(found)}" if found else ""
        print(f"{'WRONG' if found else 'right'} {time.perf_counter() - begin:7.2f} s  {case}{said}", flush=True)
    print(f"{number - wrong} of {number} agree")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
