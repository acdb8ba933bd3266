"""Newton's step as one program against the dense matrices that it stands for, and guesses in NumPy."""

import math

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.kinematics import on_host
from jaxnc.kinematics.inputs import make_plan
from jaxnc.reading import Builder, function
from jaxnc.solvers.assembly import derive, hosted, settle
from jaxnc.solvers.host import HostView

MECHANISMS = {
    "four-bar": (lambda: nc.library.four_bar(explicit=False), ("phi",), ()),
    "jansen": (nc.library.jansen_leg, ("phi",), ()),
    "gears": (nc.library.gear_pair, ("phi",), ()),
    "five-bar": (nc.library.five_bar, ("phi", "psi"), ()),
    "held": (nc.library.five_bar, ("phi",), ("psi",)),
    "quick return": (nc.library.quick_return, ("phi",), ()),
}


def both_ways(name):
    """A view of a plan with the program, another without, and poses that do not meet the constraints quite."""
    make, names, hold = MECHANISMS[name]
    system = make().compile()
    names = tuple(n for n in names if n in system.topology.coordinates) or system.topology.scalars[:1]
    eq = derive(system)
    view, dense = (HostView(make_plan(system, names, hold), hosted(eq)) for _ in range(2))
    dense.written = None
    q = np.asarray(settle(eq, np.zeros(eq.home.shape)).q)
    moved = 0.02 * float(eq.length) * np.random.default_rng(2).uniform(-1.0, 1.0, (len(q), 7))
    moved[view.plan.fixed] = 0.0
    return view, dense, q[:, None] + moved


@pytest.mark.parametrize("name", MECHANISMS)
def test_the_program_of_a_plan_is_its_dense_algebra(name):
    view, dense, q = both_ways(name)
    assert view.written is not None
    size = float(view.eq.length)
    for at in (q, q[:, :1]):  # lanes, and one lane as plain numbers
        here, there = view.evaluate(at), dense.evaluate(at)
        np.testing.assert_allclose(here.residual, there.residual, atol=1e-13 * size)
        np.testing.assert_allclose(here.step, there.step, atol=1e-11 * size)
        np.testing.assert_allclose(here.slopes, there.slopes, atol=1e-10 * np.abs(there.slopes).max())
        product, other = (np.prod(x.signs, axis=0) * np.exp(x.sizes.sum(axis=0)) for x in (here, there))
        np.testing.assert_allclose(np.abs(product), np.abs(other), rtol=1e-10)
        np.testing.assert_allclose(view.conditioning(at), dense.conditioning(at), rtol=1e-8)
        right = np.random.default_rng(3).uniform(-1.0, 1.0, here.residual.shape)
        solved, wanted = view.solver(at)(right), dense.solver(at)(right)
        np.testing.assert_allclose(solved, wanted, atol=1e-11 * max(1.0, np.abs(wanted).max()))
        for x, y in zip(view.polished(at), dense.polished(at), strict=True):
            np.testing.assert_allclose(x, y, atol=1e-8 * max(1.0, np.abs(y).max()))


def test_what_is_singular_is_not_finite_and_has_no_conditioning():
    view, _, q = both_ways("four-bar")
    stretched = np.array(q[:, :1])
    position = MECHANISMS["four-bar"][0]().compile().topology.position
    at, pin, pivot = ([position[f"{p}.{x}"] for x in "xy"] for p in "CBD")
    stretched[at] = 0.5 * (stretched[pin] + stretched[pivot])  # the coupler in one line with the rocker
    with np.errstate(all="ignore"):
        assert not np.isfinite(view.newton(stretched)[1]).all() or np.abs(view.newton(stretched)[1]).max() > 1e12
        assert view.conditioning(stretched)[0] < 1e-12


def test_programs_of_plain_numbers():
    b = Builder(2)
    x, y = b.first
    ops = [b.op(name, x) for name in ("sign", "floor", "ceil", "round", "abs", "sin", "exp", "not", "finite")]
    ops += [b.op(name, x, y) for name in ("max", "min", "rem", "pow", "atan2")]
    ops.append(b.op("select", b.op("lt", x, y), x, y))
    program = b.program(ops)
    for values in ((2.5, 1.25), (0.5, 2.0), (3.5, -1.0), (0.0, 1.0)):
        plain, lanes = function(program, math)(values), function(program)([np.array([v]) for v in values])
        np.testing.assert_allclose(plain, [float(v[0]) for v in lanes], atol=1e-15)
    assert function(program, math)((-2.5, 2.0))[0] == -1.0


def test_the_pose_nearest_to_a_guess_is_that_of_the_compiled_solver():
    system = nc.library.four_bar(explicit=False).compile()
    phi = np.array([1.0, 1.2, 2.0, 2.6])
    start = nc.solve_position(system, {"phi": 1.1})
    B, C = (np.asarray(start[name]) for name in "BC")
    D = np.asarray(start["D"])
    along = (D - B) / np.linalg.norm(D - B)
    mirrored = C - 2 * ((C - B) - along * ((C - B) @ along))
    for guess in (start, {"C": C}, {"C": mirrored}):
        found = nc.solve_position(system, {"phi": phi}, start=guess)
        traced = jax.jit(lambda u, guess=guess: nc.solve_position(system, {"phi": u}, start=guess).q)(phi)
        np.testing.assert_allclose(found.q, traced, atol=1e-12)
        assert isinstance(found.poses, np.ndarray) and bool(found.converged.all())
    other = nc.solve_position(system, {"phi": 1.1}, start={"C": mirrored})
    np.testing.assert_allclose(other["C"], mirrored, atol=1e-12)
    near = on_host.nearest(make_plan(system, ("phi",), ()), hosted(derive(system)), start.q[None], np.array([[1.1]]))
    np.testing.assert_allclose(near.poses[0], start.q, atol=1e-13)
