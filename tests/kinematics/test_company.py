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


def tripod():
    """A plate on three legs, each in a plane through its foot; a plane is a row with two numbers of its own."""
    m = nc.Mechanism("tripod", dim=3)
    for k, turn in enumerate((0.1, 2.0, 4.3)):
        x, y = np.cos(turn), np.sin(turn)
        m.ground(f"A{k}", (x, y, 0.05 * k))
        m.point(f"B{k}", (0.55 * x, 0.55 * y, 1.1 + 0.06 * k))
        plane = nc.constraints.Kind(
            f"plane {k}", lambda p, v, s, c, x=x, y=y: (y * p[0][0] - x * p[0][1],), points=1, source="a plane"
        )
        m.constrain(f"in{k}", plane, points=[f"B{k}"])
        m.distance(f"L{k}", f"A{k}", f"B{k}")
    m.body("plate", ["B0", "B1", "B2"])
    return m


def test_lanes_that_have_arrived_end_no_step_of_those_that_have_not():
    """Compiled code takes some lanes further, others rest beside them: whatever these hold, it is no reason to stop."""
    system = tripod().compile()
    drawn = nc.solve_position(system, {}, hold=["L0", "L1", "L2"])
    near = 1.0 + 0.08 * np.random.default_rng(0).uniform(-1.0, 1.0, (3, 2048))
    inputs = {f"L{k}": float(drawn[f"L{k}"]) * near[k] for k in range(3)}
    poses = jax.jit(lambda u: nc.solve_position(system, u, throw=False, repair=False))(inputs)
    np.testing.assert_array_equal(poses.status, 0)
    for k in range(3):
        length = np.linalg.norm(np.asarray(poses[f"B{k}"]) - np.asarray(drawn[f"A{k}"]), axis=1)
        np.testing.assert_allclose(length, inputs[f"L{k}"], rtol=1e-12)


@pytest.mark.parametrize("repair", [True, False])
@pytest.mark.parametrize("case", ["rocker", "five-bar"])
def test_what_is_no_input_takes_no_other_lane_along(case, repair):
    """Compiled code cannot refuse it: its lane says so, and all others and their derivatives are as without it."""
    make, name = {"rocker": (nc.library.four_bar, "phi"), "five-bar": (nc.library.five_bar, "phi")}[case]
    system = make().compile()
    drawn = nc.solve_position(system, {}, hold=[name] if case == "rocker" else ["phi", "psi"])
    held = {} if case == "rocker" else {"psi": float(drawn["psi"])}
    good, rest = float(drawn[name]) + np.linspace(-0.2, 0.2, 40), np.arange(40) != 7

    def total(u):
        poses = nc.solve_position(system, {name: u, **held}, throw=False, repair=repair)
        return jnp.sum(jnp.where(poses.status[:, None] == 0, poses.q, 0.0)), (poses.status, poses.q)

    look = jax.jit(jax.grad(total, has_aux=True))
    right, (_, q) = look(good)
    for bad in (np.nan, np.inf, 1e12):
        slope, (status, found) = look(np.where(rest, good, bad))
        assert status[7] == (nc.Status.TOO_FAR if bad == 1e12 else nc.Status.DID_NOT_ASSEMBLE)
        np.testing.assert_array_equal(status[rest], 0)
        np.testing.assert_allclose(found[rest], q[rest], atol=1e-13)
        np.testing.assert_allclose(slope[rest], right[rest], atol=1e-11)
        assert slope[7] == 0.0


def test_a_sequence_ends_where_an_input_is_no_number():
    system = nc.library.four_bar().compile()
    angles = np.where(np.arange(30) == 12, np.nan, np.linspace(1.0, 1.5, 30))
    motion = jax.jit(lambda u: nc.sweep(system, {"phi": u}, throw=False))(angles)
    np.testing.assert_array_equal(motion.status[:12], 0)
    assert motion.status[12] == nc.Status.DID_NOT_ASSEMBLE
    np.testing.assert_array_equal(motion.status[13:], nc.Status.NOT_REACHED)
