"""Sweeps designs in a pool of processes that are started by spawn: prints, as JSON, how their numbers compare."""

import json
import multiprocessing

import jax
import numpy as np

import jaxnc as nc

jax.config.update("jax_enable_x64", True)
ANGLES = np.linspace(0.0, 6.0, 25)


def midway(p, v, s, c):
    return p[2][0] - 0.5 * (p[0][0] + p[1][0]), p[2][1] - 0.5 * (p[0][1] + p[1][1])


MIDWAY = nc.constraints.Kind("midway", midway, rows=("x", "y"), powers=(1, 1), points=3)


def wind(t, state, parameters):
    return parameters * np.array([1.0, 0.5])


def drawn():
    """A four-bar with a kind, a force and masses of one's own."""
    m = nc.library.four_bar()
    plain = m.compile()
    m.point("M", np.asarray(0.5 * (plain["B"] + plain["C"])))
    m.constrain("midway", MIDWAY, points=["B", "C", "M"])
    m.point_mass("mass at C", "C", 2.0)
    m.force("force on C", "C", wind, 3.0)
    return m


def swept(system):
    """A design's motion, and whether the system that came is that which is compiled here, found where it is known."""
    here = drawn().compile()
    return nc.sweep(system, {"phi": ANGLES}, rates={"phi": 1.0}), {here.topology: True}.get(system.topology, False)


if __name__ == "__main__":
    system = drawn().compile()
    designs = [system, system.replace({"coupler.B-C": 1.05 * system["coupler.B-C"]})]
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        found = pool.map(swept, designs, chunksize=1)
    own = [jax.tree.leaves(nc.sweep(design, {"phi": ANGLES}, rates={"phi": 1.0})) for design in designs]
    equal = [
        all(np.array_equal(a, b) for a, b in zip(leaves, jax.tree.leaves(motion), strict=True))
        for leaves, (motion, _) in zip(own, found, strict=True)
    ]
    print(
        json.dumps(
            {
                "equal": equal,
                "apart": float(np.abs(found[0][0]["M"] - found[1][0]["M"]).max()),
                "known": [known for _, known in found],
                "same": [motion.system.topology == system.topology for motion, _ in found],
                "converged": [bool(motion.converged.all()) for motion, _ in found],
            }
        )
    )
