"""What is known, and of what: nothing is made up, no kind is known by its name, nothing is written to what is given."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar_mechanism, pendulum

import jaxnc as nc
from jaxnc.constraints.kind import dot
from jaxnc.io.tables import load_npz
from jaxnc.kinematics.inputs import make_plan
from jaxnc.kinematics.motion import drawn_motion
from jaxnc.solvers import host
from jaxnc.solvers.assembly import derive, to_host
from jaxnc.viz.poses import draft

T = np.linspace(0.0, 0.1, 3)
PULL = nc.forces.ForceKind(
    "couple", ("stiffness",), points=2,
    potential=lambda p, v, s, c: 0.5 * c[0] * dot(p[1] - p[0], p[1] - p[0]),
)  # fmt: skip
MADE = {
    "stream": lambda: drawn_motion(pendulum().compile(), ("phi",)),
    "picture": lambda: draft(pendulum()),
    "family": lambda: nc.families.simulate(nc.formulate(pendulum(), "natural"), T),
}


@pytest.mark.parametrize("name", MADE)
def test_what_was_not_solved_for_has_no_residual(name, tmp_path):
    motion = MADE[name]()
    assert motion.residual is None and motion.conditioning is None
    if name == "family":
        table = load_npz(motion.to_npz(tmp_path / "table.npz"))
        assert table.residual.shape == T.shape and np.isnan(table.residual).all()
        assert motion.pose(1).residual is None


def test_a_kind_of_a_users_own_may_be_called_as_one_of_the_librarys():
    m = pendulum()
    m.ground("Q", (1.0, 0.0))
    m.apply("pull", PULL, points=["B", "Q"], parameters={"stiffness": 3.0})
    pose = nc.solve_position(m.compile(), {"phi": -0.9}, rates={"phi": 1.0}, accelerations={"phi": 0.0})
    length = np.linalg.norm(np.asarray(pose["Q"] - pose["B"]))
    np.testing.assert_allclose(nc.reactions(pose).load("pull").value, 3.0 * length, rtol=1e-12)


def test_nothing_is_written_to_what_is_given():
    """Beside what is remembered with an owner, and properties: both are worked out from it alone."""
    system = four_bar_mechanism().compile()
    eq = to_host(derive(system))
    plan = make_plan(system, ("phi",), ())
    view = host.view_of(plan, eq)
    things = system, system.topology, system.parameters, plan, view

    def kept() -> list[dict[str, Any]]:
        worked_out = ({k for k, v in vars(type(x)).items() if isinstance(v, functools.cached_property)} for x in things)
        pairs = zip(things, worked_out, strict=True)
        return [{k: v for k, v in vars(x).items() if k not in {*names, "_remembered"}} for x, names in pairs]

    before = kept()
    values = np.linspace(0.7, 5.0, 60)
    found = host.solve_sequences(view, eq.home[:, None], values[:, None, None])
    host.pose_rates(view, found.q, [np.ones((1, 60))])
    nc.sweep(system, {"phi": values}, rates={"phi": 1.0})
    jax.jit(lambda s, u: nc.sweep(s, {"phi": u})["P"])(system, jnp.asarray(values))
    nc.travel(system, "phi")
    for thing, one, other in zip(things, before, kept(), strict=True):
        assert one.keys() == other.keys(), type(thing)
        assert all(one[k] is other[k] for k in one), type(thing)
