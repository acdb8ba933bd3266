"""Shapes stand in signatures, and they are true: one run through the library with jaxtyping's import hook asking."""

import json

import pytest
from processes import child, ended

pytest.importorskip("jaxtyping")


@pytest.mark.slow
def test_arrays_have_the_shapes_that_signatures_say():
    (told,) = ended(child("shapes"))
    seen, refused = json.loads(told.splitlines()[-1])
    assert {
        "jaxnc.dynamics.energy.energy",
        "jaxnc.kinematics.traced.pose_rates",
        "jaxnc.solvers.dense.newton_steps",
        "jaxnc.solvers.plan.Plan.linearise",
        "jaxnc.system.equations.residual",
        "jaxnc.system.equations.jacobian",
        "jaxnc.system.design.redraw",
    } <= set(seen)
    assert len(seen) >= 35, "few functions were asked: does the hook still reach them?"
    assert "dense.newton_steps" in refused and "right" in refused, "a right-hand side of another length was let through"
