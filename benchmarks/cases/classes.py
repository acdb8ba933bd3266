"""Every class of mechanism beside eight naive Newton steps: the whole library, and robots that are read from files."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks import robots
from benchmarks.clock import Way
from benchmarks.ratios import NAIVE
from benchmarks.suite import Suite
from jaxnc.solvers.assembly import derive

_STEPS = 8  # as `NAIVE` says
_MET = 1e-9  # of the mechanism's size: a residual that is larger is no solution
_SAME = 1e-8  # of the size: poses that are farther apart are two
_PART = 0.08  # of an input's range, to either side of the drawing
_TURNS = 0.3  # radians that a robot's hinges turn to either side
_SLIDES = 0.05  # metres that its slides move
_NAIVE = 20_000  # lanes at most
WIDE = 60  # unknowns: programs of gradients of more are compiled for minutes, and are left out
_SLOPE = 1e-5  # relative: what differences may be off


class Class(NamedTuple):
    """A mechanism, and the inputs that it is asked for."""

    name: str
    system: nc.System
    driven: Sequence[str]
    hold: Sequence[str]
    low: np.ndarray  # smallest input of each driven coordinate
    high: np.ndarray


def _library() -> Iterator[Class]:
    for name, make in nc.library.CATALOGUE.items():
        mechanism = make()
        run = mechanism.model.run
        if run is None or not run.inputs:
            continue
        system = mechanism.compile()
        low, high = [], []
        for k, drive in run.inputs.items():
            a, b = sorted((drive.start, drive.end))
            at = float(np.asarray(derive(system).home)[system.topology.position[k]])
            at = next((u for u in (at, at + 2 * np.pi) if a <= u <= b), at)
            low.append(max(at - _PART * (b - a), min(a, at)))
            high.append(min(at + _PART * (b - a), max(b, at)))
        yield Class(name, system, tuple(run.inputs), tuple(run.hold or ()), np.array(low), np.array(high))


def _robots() -> Iterator[Class]:
    for name in robots.ROBOTS:
        robot = robots.read(name)
        top, home = robot.system.topology, np.asarray(derive(robot.system).home)
        at = np.array([home[top.position[c]] for c in robot.actuated])
        turns = dict(zip(top.scalars, top.angles, strict=True))
        width = np.array([_TURNS if turns[c] else _SLIDES for c in robot.actuated])
        yield Class(f"robot {name}", robot.system, robot.actuated, robot.held, at - width, at + width)


def every_class() -> Iterator[Class]:
    """Yield robots from files, then the mechanisms of the library that have inputs."""
    yield from _robots()
    yield from _library()


def naive(one: Class) -> Any:
    """Return jitted Newton steps from the drawing on the library's own public residual, lane by lane."""
    top, home = one.system.topology, jnp.asarray(derive(one.system).home)
    driven = np.array([top.position[c] for c in one.driven])
    known = {*driven.tolist(), *(top.position[c] for c in one.hold)}
    unknown = np.array([c for c in range(len(home)) if c in set(top.unknown.tolist()) - known])

    def solve(u):
        q = home.at[driven].set(u)

        def residual(x):
            return nc.system.residual(one.system, q.at[unknown].set(x))

        x = home[unknown]
        for _ in range(_STEPS):
            r, j = residual(x), jax.jacfwd(residual)(x)
            if j.shape[0] == j.shape[1]:
                x = x - jnp.linalg.solve(j, r)
            else:
                square = j.T @ j
                x = x - jnp.linalg.solve(square + 1e-13 * jnp.trace(square) * jnp.eye(len(x)), j.T @ r)
        return q.at[unknown].set(x), jnp.max(jnp.abs(residual(x)))

    return jax.jit(jax.vmap(solve))


def _compared(suite: Suite, one: Class, count: int, gradients: bool) -> None:
    size, last = float(derive(one.system).length), {}

    def run(inputs):
        return jax.block_until_ready(nc.solve_position(one.system, inputs, hold=one.hold).poses)

    def poses(u):
        found = nc.solve_position(one.system, dict(zip(one.driven, u, strict=True)), hold=one.hold)
        return found.q, found.status

    compiled, steps = jax.jit(jax.vmap(poses)), naive(one)

    def truth(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses that are known to be right: this library's, which the public residual is asked about."""
        if last.get("data") is not data:
            inputs = {c: data[:, k] for k, c in enumerate(one.driven)}
            found = nc.solve_position(one.system, inputs, hold=one.hold)
            off = jax.vmap(lambda q: jnp.max(jnp.abs(nc.system.residual(one.system, q))))(found.q)
            good = np.asarray(found.converged) & (np.asarray(off) <= _MET * size)
            last.update(data=data, q=np.asarray(found.q), good=good)
        return last["q"], last["good"]

    def right(out: Any, data: np.ndarray) -> float:
        q, good = truth(data)
        at = np.array([one.system.topology.position[f"{p}.x"] for p in one.system.topology.points])
        off = np.abs(np.asarray(out[0])[:, at] - q[:, at]).max(axis=1) if len(at) else np.zeros(len(q))
        return float(np.mean(good & (off <= _SAME * size)))

    def eager(data: np.ndarray) -> dict[str, np.ndarray]:
        return {c: np.ascontiguousarray(data[:, k]) for k, c in enumerate(one.driven)}

    note = f"{len(one.system.topology.unknown)} coordinates, {len(one.driven)} inputs"
    ways = [
        Way("jaxnc", run, lambda _, data: float(np.mean(truth(data)[1])), prepare=eager, compiles=True, note=note),
        Way("jaxnc: jit", lambda u: jax.block_until_ready(compiled(u)), right, prepare=jnp.asarray, compiles=True),
    ]

    def make() -> list[Way]:
        return [
            Way(
                NAIVE,
                lambda u: jax.block_until_ready(steps(u)),
                right,
                prepare=jnp.asarray,
                compiles=True,
                most=_NAIVE,
            )
        ]

    def draw(seed: int, count: int) -> np.ndarray:
        u = np.random.default_rng([seed, 7]).uniform(size=(count, len(one.driven)))
        return one.low + (one.high - one.low) * u

    if gradients and len(one.system.topology.unknown) <= WIDE:
        ways += value_and_gradient(one)
    suite.compare(f"class {one.name}, {count:,}", [*ways, *suite.peer("naive JAX", make)], draw, count)


def value_and_gradient(one: Class) -> list[Way]:
    """A number of all points, and its gradient by the design: right if it is that of differences along one way.

    Points count by weights: some mechanisms keep a sum of plain squares, and XLA sees it. An overconstrained mechanism
    does not close any more where its points are moved, and has no derivative.
    """
    spread = len(one.system.topology.points) * one.system.topology.dim  # angles may be drawn where they jump by a turn
    weights = np.random.default_rng(4).normal(size=spread)

    def total(system: nc.System, u: jax.Array) -> tuple[jax.Array, jax.Array]:
        def part(u: jax.Array) -> tuple[jax.Array, jax.Array]:
            found = nc.solve_position(system, dict(zip(one.driven, u, strict=True)), hold=one.hold)
            return jnp.where(found.converged, (found.q[:spread] @ weights) ** 2, 0.0), found.converged

        parts, met = jax.vmap(part)(u)
        return jnp.mean(parts), jnp.sum(met)

    value, both = jax.jit(total), jax.jit(jax.value_and_grad(total, has_aux=True))
    points = one.system.parameters.points
    way = np.random.default_rng(5).normal(size=points.shape)

    def moved(h: float) -> nc.System:
        return jax.tree.map(lambda x: x + h * way if x is points else x, one.system)

    def right(out: Any, data: np.ndarray) -> float | None:
        u, h = jnp.asarray(data), 1e-6 * float(derive(one.system).length)
        (_, met), gradient = out
        (above, first), (below, second) = value(moved(h), u), value(moved(-h), u)
        if not met == first == second:
            return None
        wanted, slopes = (float(above) - float(below)) / (2 * h), np.asarray(gradient.parameters.points)
        found = float(np.sum(slopes * way))
        return float(abs(found - wanted) <= _SLOPE * max(abs(wanted), float(np.linalg.norm(slopes))))

    def run(f: Any) -> Any:
        return lambda u: jax.block_until_ready(f(one.system, u))

    return [
        Way("jaxnc: value", run(value), lambda *_: None, prepare=jnp.asarray, compiles=True),
        Way("jaxnc: value and gradient", run(both), right, prepare=jnp.asarray, compiles=True),
    ]


def _all(suite: Suite, count: int, gradients: bool = False) -> None:
    for one in every_class():
        if suite.only and one.name not in suite.only:
            continue
        _compared(suite, one, count, gradients)
        jax.clear_caches()


def hundreds(suite: Suite) -> None:
    """256 lanes of each."""
    _all(suite, 256)


def thousands(suite: Suite) -> None:
    """2,048 lanes of each, and gradients."""
    _all(suite, suite.size(2048, 256), gradients=True)


def very_many(suite: Suite) -> None:
    """100,000 lanes of each."""
    _all(suite, suite.size(100_000, 512))
