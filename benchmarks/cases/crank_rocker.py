"""One four-bar, very many angles: this library beside everything else that can do it."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks.circles import FourBars, fraction
from benchmarks.clock import Way
from benchmarks.mechanisms import four_bar
from benchmarks.suite import Suite

BARS = FourBars.default()
_MOST_NAIVE = 200_000  # lanes: LAPACK batched over 1,000,000 lanes takes minutes here (jax 0.10.1), 700,000 do not


@dataclasses.dataclass(frozen=True)
class Turn:
    """Angles ``start + step · (1, 2, … N)``, or the same in another order."""

    start: float
    step: float
    phi: np.ndarray

    @classmethod
    def draw(cls, seed: int, count: int) -> "Turn":
        """A full turn that begins somewhere else for every seed."""
        start, step = 0.1 + 0.37 * seed, 2 * np.pi / count
        return cls(start, step, start + step * np.arange(1, count + 1) - np.pi)

    def shuffled(self, seed: int) -> "Turn":
        """The same angles in random order."""
        return dataclasses.replace(self, phi=np.random.default_rng(seed).permutation(self.phi))


def _points(found: np.ndarray, data: Turn, accepted: Any = None) -> float:
    wanted = BARS.poses(data.phi)[1]
    return fraction(found, wanted, float(BARS.ground), None if accepted is None else np.asarray(accepted))


def ours(count_of_checks: str = "status, residual and branch of every lane included") -> Way:
    """This library's general engine on the library's four-bar."""
    system = four_bar(BARS).compile()
    return Way(
        "jaxnc",
        lambda phi: jax.block_until_ready(nc.solve_position(system, {"phi": phi}, throw=False)),
        lambda mo, data: _points(np.asarray(mo["C"]), data, mo.converged),
        prepare=lambda data: jnp.asarray(data.phi),
        compiles=True,
        note=count_of_checks,
    )


def by_hand(unknowns: int) -> Way:
    """The hand-written JAX kernel."""
    from benchmarks.peers import hand_written

    run = hand_written.kernel(BARS, unknowns)
    return Way(
        f"JAX by hand, n = {unknowns}",
        lambda phi: jax.block_until_ready(run(phi)),
        lambda out, data: _points(np.column_stack(out[:2]), data, out[3] == 0),
        prepare=lambda data: jnp.asarray(data.phi),
        compiles=True,
        note="this mechanism only; residual and branch checked",
    )


def naive(unknowns: int) -> Way:
    """What everybody writes."""
    from benchmarks.peers.naive import four_bar as run_of

    run = run_of(BARS, unknowns)
    note = "vmap(while_loop + jacfwd + linalg.solve), one cold guess; no branch check"
    return _mapped(f"naive JAX, n = {unknowns}", run, note)


def _mapped(name: str, run: Callable, note: str) -> Way:
    """A function of angles that gives all unknowns of every lane, and which lanes converged, under jit."""
    return Way(
        name,
        lambda phi: jax.block_until_ready(run(phi)),
        lambda out, data: _points(np.asarray(out[0])[:, -2:], data, out[1]),
        prepare=lambda data: jnp.asarray(data.phi),
        compiles=True,
        most=_MOST_NAIVE,
        note=note,
    )


def _optimistix() -> list[Way]:
    from benchmarks.peers.optimistix_newton import newton

    note = "root_find under vmap, rtol = atol = 1e-12; no branch check"
    return [_mapped("optimistix Newton, n = 4", newton(BARS, 4), note)]


def numba_newton() -> list[Way]:
    from benchmarks.peers.numba_newton import newton

    run = newton(BARS)
    return [
        Way(
            "numba Newton, n = 4",
            lambda data: run(data.phi),
            lambda out, data: _points(out[0], data, out[1]),
            compiles=True,
            note="scalar, LU with pivoting",
        )
    ]


def _c() -> list[Way]:
    from benchmarks.peers.c_loops import CLoops

    loops = CLoops(BARS)
    ways = []
    for name, label, note in (
        ("newton_scalar", "C Newton, scalar, n = 4", "LU with pivoting"),
        ("newton_simd4", "C Newton, 8 lanes, n = 4", "LU, pivoting where a pivot can vanish, by selection"),
        ("newton_simd2", "C Newton, 8 lanes, n = 2", "crank pin eliminated"),
        ("closed_form", "C closed form", "no iteration, no residual"),
    ):
        way = Way(
            label,
            lambda data, run=loops[name]: run(data.phi),
            lambda out, data: _points(out[0].T, data, out[1] == 0),
            note=note,
            build_s=loops.build_s,
            compiles=True,
        )
        ways.append(way)
    return ways


def _scipy() -> list[Way]:
    from benchmarks.peers.scipy_loop import fsolve_loop

    run = fsolve_loop(BARS)
    return [
        Way(
            "SciPy fsolve loop, n = 2",
            lambda data: run(data.phi),
            _points,
            most=4000,
            note="with its Jacobian, xtol = 1e-11, one cold guess",
        )
    ]


def _pylinkage() -> list[Way]:
    from benchmarks.peers import dyads

    return [
        Way(
            "pylinkage step_fast",
            lambda made: dyads.step_fast(*made),
            _points,
            prepare=lambda data: (dyads.linkage(BARS, data.start - np.pi, data.step), len(data.phi)),
            note="closed form of each dyad in numba, in steps of the crank; compiled code is cached by the package",
            compiles=True,
        )
    ]


def _numpy() -> Way:
    return Way("NumPy closed form", lambda data: BARS.poses(data.phi)[1], _points, note="no iteration, no residual")


def turn(suite: Suite) -> None:
    """All ways over a full turn in order."""
    ways = [
        ours(),
        by_hand(2),
        by_hand(4),
        *suite.peer("naive JAX", lambda: [naive(2), naive(4)]),
        *suite.peer("optimistix", _optimistix, "optimistix"),
        *suite.peer("numba", numba_newton, "numba"),
        *suite.peer("C", _c),
        *suite.peer("pylinkage", _pylinkage, "pylinkage"),
        *suite.peer("SciPy", _scipy, "scipy"),
        _numpy(),
    ]
    suite.compare("four-bar", ways, Turn.draw, suite.size(1_000_000, 100_000))


def shuffled(suite: Suite) -> None:
    """The same angles in random order, for those ways that can: a sweep along the turn is no help here."""
    ways = [ours(), by_hand(2), *suite.peer("C", lambda: [w for w in _c() if "n = 2" in w.name]), _numpy()]

    def draw(seed: int, count: int) -> Turn:
        return Turn.draw(seed, count).shuffled(seed)

    suite.compare("four-bar-random", ways, draw, suite.size(1_000_000, 100_000))
