"""Change points, where branches cross: the motion goes on along its tangent, whatever the grid and the route.

A parallelogram carries its coupler without turning it, so C = B + (base, 0) is its closed form at every angle; the
other branch, which crosses it at 0 and π, is the antiparallelogram. A slider-crank with equal links has
C = (2 r cos φ, 0), crossed at ±90° by the branch on which the slider rests in the crank's axis.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar_joint

import jaxnc as nc

CRANK, BASE = 0.1, 0.3
EXACT = 3e-10  # close to a change point (conditioning 1.7e-6) each rounding of the longest bar, 5e-17, makes 3e-11
SINGULAR = int(nc.Status.SINGULAR)


@functools.cache
def parallelogram() -> nc.System:
    return nc.library.parallelogram(CRANK, BASE, third=None).compile()


@functools.cache
def equal_links() -> nc.System:
    m = nc.Mechanism("slider-crank with equal links")
    m.ground("O", (0, 0))
    m.ground("E", (3, 0))
    m.point("B", (np.cos(1.0), np.sin(1.0)))
    m.point("C", (2 * np.cos(1.0), 0))
    m.body("crank", ["O", "B"])
    m.body("rod", ["B", "C"])
    m.slot("guide", "C", ("O", "E"))
    m.angle("phi", at="O", to="B")
    return m.compile()


def check(u, C, status, at, form) -> None:
    """Every pose on the branch, singular ones exactly where the grid meets a change point, and in their place."""
    u, status = np.asarray(u), np.asarray(status)
    from_it = np.abs((u - at + 0.5 * np.pi) % np.pi - 0.5 * np.pi)  # change points are half a turn apart
    assert np.array_equal(status, np.where(from_it < 1e-9, SINGULAR, 0))
    np.testing.assert_allclose(C, form(u), atol=EXACT)


def parallel(u):
    return np.stack([BASE + CRANK * np.cos(u), CRANK * np.sin(u)], -1)


def in_line(u):
    return np.stack([2 * np.cos(u), np.zeros_like(u)], -1)


def joint(u, base, coupler=None):
    """The coupler's end beside the ground pivot at ``(base, 0)``, by two circles, above B -> D."""
    pivots = jnp.zeros(2), jnp.array([base, 0.0])
    return four_bar_joint(CRANK, base if coupler is None else coupler, CRANK, *pivots, u, 1.0)


GRIDS = {
    "ends and middle on them": np.linspace(0.0, 2 * np.pi, 37),
    "backwards": np.linspace(2 * np.pi, 0.0, 37),
    "both ends on them": np.linspace(-np.pi, np.pi, 37),
    "from before to behind": np.linspace(0.1, -7.0, 37),
    "close beside them": np.linspace(0.0, 2 * np.pi, 37) + 5e-4,
    "closer": np.linspace(0.0, 2 * np.pi, 37) - 1e-5,
    "coarse": np.linspace(0.0, 36 * np.pi / 2, 37),
    "to and fro": np.pi * np.sin(np.linspace(0.3, 9.0, 37)),
    "turning back on it": np.concatenate([np.linspace(1.0, np.pi, 19), np.linspace(np.pi, 1.0, 18)]),
    "many close by": np.pi + np.linspace(-2e-3, 2e-3, 37),
}


@pytest.mark.parametrize("grid", GRIDS)
def test_parallelogram_stays_one_on_every_grid(grid):
    u = GRIDS[grid]
    for mo in (nc.sweep(parallelogram(), {"phi": u}), nc.solve_position(parallelogram(), {"phi": u})):
        check(u, mo["C"], mo.status, 0.0, parallel)


@pytest.mark.parametrize("crank, base", [(0.624, 1.698), (1.175, 2.905), (1.279, 1.607), (1.336, 2.9), (0.807, 1.668)])
@pytest.mark.parametrize("count", [37, 91, 180])
def test_the_antiparallelogram_goes_on_too(crank, base, count):
    """Its determinants fall slowly: a step over the change point is as long as they say."""

    def form(u):  # the parallelogram's corner, reflected in the line from B to D
        b = crank * np.exp(1j * np.asarray(u))
        along = (base - b) / np.abs(base - b)
        return b + 2 * np.real((base) * np.conj(along)) * along - base

    begin = 0.9
    b, c = crank * np.exp(1j * begin), form(begin)
    linkage = nc.synthesis.FourBar((0, 0), (b.real, b.imag), (c.real, c.imag), (base, 0))
    for shift in (0.003, 0.021, 0.043):
        u = begin + shift + np.linspace(0, 2 * np.pi, count)
        motion = linkage.move({"phi": u})
        assert not motion.failures
        np.testing.assert_allclose(np.asarray(motion["C"]) @ [1, 1j], form(u), atol=1e-8)


def test_library_parallelogram_in_38_poses():
    """The grid that gave 38 poses of the antiparallelogram, each of them CONVERGED."""
    u = np.linspace(-np.pi, np.pi, 38)
    mo = nc.sweep(parallelogram(), {"phi": u}, rates={"phi": 2.0})
    check(u, mo["C"], mo.status, 0.0, parallel)
    want = np.where(np.asarray(mo.status)[:, None] == 0, 2.0 * CRANK * np.stack([-np.sin(u), np.cos(u)], -1), 0.0)
    np.testing.assert_allclose(mo.velocity("C"), want, atol=1e-10)  # none where there is no derivative


@pytest.mark.parametrize("grid", ["ends and middle on them", "to and fro", "close beside them"])
def test_equal_links_slide_past_the_crank(grid):
    u = GRIDS[grid] + 0.5 * np.pi
    for mo in (nc.sweep(equal_links(), {"phi": u}), nc.solve_position(equal_links(), {"phi": u})):
        check(u, mo["C"], mo.status, 0.5 * np.pi, in_line)


@pytest.mark.parametrize("apart", [0.0, 8.8e-16, 1e-14, 1e-11])
def test_values_that_differ_by_rounding_do_not_lose_the_branch(apart):
    """What determinants change by in such a step is rounding: the step before it says where they are going."""
    a = 1 + 2 * np.pi / 3
    u = np.array([1.0, 1 + np.pi / 3, a, a + apart, 1 + np.pi, 1 + 4 * np.pi / 3])
    motion = nc.sweep(parallelogram(), {"phi": u})
    check(u, motion["C"], motion.status, 0.0, parallel)
    points, status = jax.jit(lambda u: (lambda m: (m["C"], m.status))(nc.sweep(parallelogram(), {"phi": u})))(u)
    check(u, points, status, 0.0, parallel)
    turns = np.linspace(1.0, 1.0 + 4 * np.pi, 13)  # lanes take whole turns off, which leaves such values
    motion = nc.solve_position(parallelogram(), {"phi": turns})
    check(turns, motion["C"], motion.status, 0.0, parallel)


def test_many_lanes_and_long_sweeps():
    u = np.linspace(0.0, 2 * np.pi, 601)
    for mo in (nc.sweep(parallelogram(), {"phi": u}), nc.solve_position(parallelogram(), {"phi": u})):
        check(u, mo["C"], mo.status, 0.0, parallel)


@pytest.mark.slow
def test_traced_mapped_and_designs_side_by_side():
    def poses(u):
        mo = nc.solve_position(parallelogram(), {"phi": u})
        return mo["C"], mo.status

    def swept(base, u):
        mo = nc.sweep(parallelogram().replace({"D": jnp.array([base, 0.0]), "C": joint(1.0, base)}), {"phi": u})
        return mo["C"] - jnp.array([base - BASE, 0.0]), mo.status

    for count in (37, 600):
        u = jnp.linspace(0.0, 2 * np.pi, count)
        check(u, *jax.jit(jax.vmap(poses))(u), 0.0, parallel)
    u = jnp.linspace(0.0, 2 * np.pi, 37)
    offsets = jnp.array([0.0, 5e-4, 1e-5, -0.1])
    C, status = jax.vmap(swept)(jnp.array([0.3, 0.25, 0.4, 0.3]), u + offsets[:, None])
    for k, offset in enumerate(offsets):
        check(u + offset, C[k], status[k], 0.0, parallel)


def test_the_exact_pose_has_no_derivative_and_its_place():
    def place(u):
        return nc.solve_position(parallelogram(), {"phi": u}, throw=False)["C"]

    for u in (0.0, np.pi, -np.pi):
        mo = nc.solve_position(parallelogram(), {"phi": u}, throw=False)
        check(u, mo["C"], mo.status, 0.0, parallel)
        assert float(mo.conditioning) < 1e-10
    np.testing.assert_array_equal(jax.jacfwd(place)(np.pi), [0.0, 0.0])
    np.testing.assert_allclose(jax.jacfwd(place)(3.0), [-CRANK * np.sin(3.0), CRANK * np.cos(3.0)], atol=1e-12)


@pytest.mark.parametrize("off", [1e-9, 1e-7, 1e-4])
def test_almost_a_parallelogram_is_not_taken_for_one(off):
    """With a coupler that is longer by a little branches do not cross: each turns into the other, as they must."""
    system = parallelogram().replace({"C": joint(1.0, BASE, BASE + off)})
    u = np.linspace(0.5, 2 * np.pi - 0.5, 37)  # past π; at 0 its branches end
    mo = nc.sweep(system, {"phi": u})
    assert bool(jnp.all(mo.converged))
    want = np.stack([joint(x, BASE, BASE + off) for x in u])
    assert np.max(np.abs(want - parallel(u))) > 0.1
    np.testing.assert_allclose(mo["C"], want, atol=1e-9)
    stopped = nc.sweep(system, {"phi": np.linspace(0.5, -2 * np.pi + 0.5, 37)})
    assert not bool(jnp.any(stopped.converged[4:])), "it does not close on the other side of 0"
