"""A pose is the same whatever is solved beside it: alone, among others, mapped, traced, by the host and by XLA."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

NEAR = 1e-10  # regular poses are solved to rounding, which is magnified towards the end of a branch


def _steep(p, v, s, c):
    return (p[0][1] * (1.0 + (1200.0 * p[0][0]) ** 2),)


STEEP = nc.constraints.Kind("steep", _steep, rows=("row",), points=1, source="a straight line")


def steep():
    """A point on a straight line, whose row becomes steeper by eight powers of ten along it."""
    m = nc.Mechanism("steep")
    m.ground("O", (0, 0))
    m.constrain("line", STEEP, points=[m.point("P", (0.3, 0.0))])
    return m


# A mechanism, and what is driven between which values: its whole travel if they are not given.
CASES = {
    "line": (steep, {"P.x": (0.0, 30.0)}),
    "rocker": (nc.library.four_bar, {"B.x": None}),
    "five-bar": (nc.library.five_bar, {"phi": (0.0, 3.0), "psi": (0.0, 3.0)}),
}
PLACES = np.array([0.0, 1e-9, 1e-6, 1e-4, 0.01, 0.2, 0.55, 0.9, 1 - 1e-5, 1 - 1e-8, 1.0, -1e-4, 1.5])


def values(system, ranges):
    """Values over the whole range of each input, at its ends, right before these and beyond."""
    ends = {}
    for name, given in ranges.items():
        ends[name] = given or [float(x) for x in (nc.travel(system, name).lower, nc.travel(system, name).upper)]
    each = np.meshgrid(*(low + (high - low) * PLACES[:: len(ends)] for low, high in ends.values()))
    return {name: x.ravel() for name, x in zip(ends, each, strict=True)}


def solved(system, inputs):
    pose = nc.solve_position(system, inputs, throw=False)
    return pose.status, pose.q


@pytest.mark.parametrize("case", CASES)
def test_company_changes_neither_status_nor_value(case):
    make, ranges = CASES[case]
    system = make().compile()
    inputs = values(system, ranges)
    count = len(next(iter(inputs.values())))
    order = np.random.default_rng(1).permutation(count)
    halves = [solved(system, {n: x[part] for n, x in inputs.items()}) for part in np.array_split(order, 2)]
    each = jax.tree.map(lambda x: jnp.stack([x] * count), system)
    alone = [solved(system, {n: float(x[k]) for n, x in inputs.items()}) for k in range(count)]
    status, poses = (np.stack(x) for x in zip(*alone, strict=True))
    found = {
        "together": solved(system, inputs),
        "halves": [np.concatenate(x)[np.argsort(order)] for x in zip(*halves, strict=True)],
        "many": [x[:count] for x in solved(system, {n: np.tile(x, 100) for n, x in inputs.items()})],
        "jit": jax.jit(solved)(system, inputs),
        "vmap": jax.jit(jax.vmap(solved, (None, 0)))(system, inputs),
        "designs": jax.jit(jax.vmap(solved))(each, inputs),
    }
    assert (status == nc.Status.CONVERGED).sum() > count // 2
    for name, (statuses, others) in found.items():
        np.testing.assert_array_equal(statuses, status, err_msg=name)
        right = status == nc.Status.CONVERGED
        np.testing.assert_allclose(np.asarray(others)[right], poses[right], atol=NEAR, err_msg=name)
