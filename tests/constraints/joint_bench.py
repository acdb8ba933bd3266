"""A bench for joints in space: every case of `rigs.CASES` in one mechanism, whose Jacobian has a block for each.

All of them are moved through the same poses, with one compilation for the whole.
"""

import jax
import numpy as np
from rigs import CASES, FRAME, STAY, Rig, after, moved, turn

import jaxnc as nc
from jaxnc.solvers.assembly import derive
from jaxnc.system.assemble import assemble

POSES = 30
SPAN = 1e-9  # distance between the space of twists found and the one expected
QUICK = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}  # compiled once, run little


def stances():
    """Where body 1 is in each pose: as drawn, its axes along the coordinate axes, half turns, anywhere."""
    rng, flat = np.random.default_rng(5), (FRAME, np.zeros(3))
    cycle = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    special = [STAY, flat, (cycle @ FRAME, np.ones(3)), (cycle.T @ FRAME, np.zeros(3))]
    special += [after(turn(axis, np.pi), flat) for axis in np.eye(3)]
    return special + [
        after((np.eye(3), rng.normal(size=3)), turn(rng.normal(size=3), rng.uniform(-3, 3)))
        for _ in range(POSES - len(special))
    ]


class Case:
    """One case of the bench: where its bodies are in each pose, its rows, columns and Jacobians."""

    def __init__(self, rig, allowed):
        self.rig, self.allowed = rig, allowed
        self.stances = [STAY] * POSES if rig.grounded else stances()
        self.displacements, self.found, self.residuals, self.jacobians = [], [], [], []

    def number(self, top):
        """Find its rows and the coordinates that can move."""
        prefix, self.position = self.rig.prefix, top.position
        self.columns = [i for i in top.unknown if top.coordinates[i].startswith(prefix)]
        self.rows = [i for i, row in enumerate(top.rows) if row.startswith(prefix)]
        self.written = np.array([top.rows[i].startswith(prefix + "joint:") for i in self.rows], bool)

    def put(self, k, q):
        """Move it into pose k, in q."""
        displacements, scalars, loose = self.allowed.place(k)
        stance, found = self.stances[k], {}
        for item, (is_vector, drawn, bodies) in self.rig.items.items():
            places = [] if bodies else [moved(stance, loose[item])]
            for body in bodies:
                whole = after(stance, STAY if body == 1 else displacements[body - 2])
                places.append(whole[0] @ drawn if is_vector else moved(whole, drawn))
            assert np.allclose(places, places[0], atol=1e-13), f"{item} is not shared in this displacement"
            at = self.position[self.rig.of(item) + ".x"]
            q[at : at + 3] = found[item] = places[0]
        for scalar, value in scalars.items():
            q[self.position[self.rig.of(scalar)]] = value
        self.displacements.append(displacements)
        self.found.append(found)

    def twists(self, k, null):
        """Twists of its bodies for each null vector, in the axes of body 1: ``(vectors, bodies, 6)``."""
        whole = np.zeros((len(null), len(self.position)))
        whole[:, self.columns] = null
        rotation, origin = self.stances[k]
        out = []
        for body in range(1, self.rig.count + 1):
            parts, speeds = [], []
            for item, (is_vector, _, bodies) in self.rig.items.items():
                if body in bodies:
                    w = self.found[k][item] - (0.0 if is_vector else origin)
                    spin = -np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
                    parts.append(np.hstack([spin, np.zeros((3, 3)) if is_vector else np.eye(3)]))
                    at = self.position[self.rig.of(item) + ".x"]
                    speeds.append(whole[:, at : at + 3])
            matrix, speeds = np.vstack(parts), np.hstack(speeds).T
            twist = np.linalg.lstsq(matrix, speeds, rcond=None)[0]
            np.testing.assert_allclose(matrix @ twist, speeds, atol=SPAN)  # it moves as a rigid body
            out.append(np.vstack([rotation.T @ twist[:3], rotation.T @ twist[3:]]).T)
        return np.stack(out, axis=1)


class Bench:
    """All cases twice in one mechanism, with body 1 free and on the ground."""

    def __init__(self):
        m = nc.Mechanism("all joints", dim=3)
        self.cases = {}
        for grounded in (False, True):
            for k, (name, (build, *_)) in enumerate(CASES.items()):
                rig = Rig(m, f"{'g' if grounded else 'f'}{k}_", grounded)
                self.cases[name, grounded] = Case(rig, build(rig))
        self.system = assemble(m)
        self.eq = derive(self.system)
        self.look = jax.jit(
            lambda eq, q: (nc.system.residual(eq, q), nc.system.jacobian(eq, q)), compiler_options=QUICK
        )
        for case in self.cases.values():
            case.number(self.system.topology)
        for k in range(POSES):
            q = np.array(self.eq.home)
            for case in self.cases.values():
                case.put(k, q)
            r, j = map(np.asarray, self.look(self.eq, q))
            for case in self.cases.values():
                case.residuals.append(r[case.rows])
                case.jacobians.append(j[np.ix_(case.rows, case.columns)])
        self.q = q
