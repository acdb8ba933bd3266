"""All assemblies of a mechanism, against a published platform that has forty real ones."""

import numpy as np
import pytest
from mechanisms import reference
from scipy.spatial.transform import Rotation

import jaxnc as nc

ROUNDING = 1e-12  # poses of size one


@pytest.mark.slow
def test_all_forty_assemblies_of_dietmaiers_platform():
    """Each of the published platform's 40 real modes is found once, from 500 rigid starts, and nothing else is."""
    data = reference("stewart_dietmaier40")
    base, hand, legs = (np.array(data["definition"][k]) for k in ("base_points", "platform_points", "leg_lengths"))
    poses = np.array(data["reference"]["poses"])
    want = hand @ np.swapaxes(Rotation.from_quat(poses[:, [1, 2, 3, 0]]).as_matrix(), 1, 2) + poses[:, None, 4:]
    m = nc.Mechanism("platform with 40 modes", dim=3)
    for k in range(6):
        m.ground(f"A{k}", base[k])
        m.point(f"B{k}", want[7, k])
    m.body("platform", [f"B{k}" for k in range(6)])
    for k in range(6):
        m.distance(f"L{k}", f"A{k}", f"B{k}")
    f = nc.formulate(m, "independent")
    found = f.assemblies({f"L{k}": legs[k] for k in range(6)}, starts=500)
    got = np.stack([np.asarray(found[f"B{k}"]) for k in range(6)], axis=1)
    apart = np.abs(got[:, None] - want).max(axis=(2, 3))
    assert len(got) == 40 and bool(found.converged.all())
    assert sorted(apart.argmin(axis=1)) == list(range(40))
    assert apart.min(axis=1).max() < 1e-10  # the least conditioned mode, 1e-4, magnifies rounding
    assert apart[0].argmin() == 7, "the one that was drawn comes first"
    reach = np.linalg.norm(got - base, axis=-1)
    np.testing.assert_allclose(reach, np.broadcast_to(legs, reach.shape), atol=ROUNDING)
