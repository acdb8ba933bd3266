"""Joints in space: six velocities probed in many poses, against the twists that each joint must allow.

All cases stand in one mechanism, whose Jacobian has a block for each: one compilation for all of them.
"""

import numpy as np
import pytest
from joint_bench import POSES, SPAN, Bench
from rigs import CASES

pytestmark = pytest.mark.slow

CLOSED = 1e-12  # residual of a pose computed by hand, of sizes about 2
ZERO = 1e-11  # singular values that are zero
RANK = 1e-3  # smallest other singular value: no joint is close to losing a row anywhere


@pytest.fixture(scope="module")
def bench():
    return Bench()


def basis(columns):
    """An orthonormal basis of a space of twists, as columns; its dimension is the rank."""
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, values > 1e-8]


@pytest.mark.parametrize("grounded", [False, True], ids=["free", "on the ground"])
@pytest.mark.parametrize("name", CASES)
def test_relative_motions(bench, name, grounded):
    """Velocities of the whole (six if body 1 is free) and those of the joint, and no others, at every pose."""
    case, freedoms = bench.cases[name, grounded], CASES[name][-1]
    for k in range(POSES):
        where, jacobian = f"pose {k}", case.jacobians[k]
        assert np.abs(case.residuals[k]).max(initial=0.0) < CLOSED, f"{where}: the bodies cannot get there"
        _, values, right = np.linalg.svd(jacobian)
        rank = int(np.sum(values > ZERO))
        null = right[rank:]
        assert values[rank - 1] > RANK, f"{where}: nearly singular"
        assert len(null) == freedoms + (0 if grounded else 6), f"{where}: {len(null)} velocities"
        twists = case.twists(k, null)
        relative = (twists[:, 1:] - twists[:, :1]).reshape(len(null), 6 * (case.rig.count - 1))
        found, expected = basis(relative.T), basis(case.allowed.twists(case.displacements[k]).T)
        assert found.shape == expected.shape == (6 * (case.rig.count - 1), freedoms), where
        assert np.linalg.norm(found @ found.T - expected @ expected.T) < SPAN, where


@pytest.mark.parametrize("name", CASES)
def test_written_and_independent_rows(bench, name):
    """The table of the documentation: rows that the joint writes, and how many of them are independent."""
    _, written, independent, coordinates, _ = CASES[name]
    case, top = bench.cases[name, False], bench.system.topology
    assert int(case.written.sum()) == written
    for jacobian in case.jacobians:
        whole, without = (np.linalg.matrix_rank(j, tol=1e-9) for j in (jacobian, jacobian[~case.written]))
        assert whole - without == independent
    mixed = [s for s in top.scalars if s in (case.rig.of("turn"), case.rig.of("way"))]
    loose = [item for item, (_, _, bodies) in case.rig.items.items() if not bodies]
    assert coordinates == len(mixed) + 3 * len(loose)


def test_jacobian_against_differences(bench):
    """Every kind of a joint or body in the whole Jacobian, away from assembled poses."""
    rng = np.random.default_rng(8)
    q = bench.q + 0.05 * rng.normal(size=len(bench.q))
    jacobian = np.asarray(bench.look(bench.eq, q)[1])
    for _ in range(3):
        d = rng.normal(size=len(q))
        high, low = (np.asarray(bench.look(bench.eq, q + step * d)[0]) for step in (1e-6, -1e-6))
        np.testing.assert_allclose(jacobian @ d, (high - low) / 2e-6, atol=1e-7)
