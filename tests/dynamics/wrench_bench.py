"""A bench for wrenches: mechanisms with masses on all bodies, in motion, and laws that hold for each body by itself.

Whoever asks for wrenches is held against the balance of bodies, and against the power of joints.
"""

import functools
import itertools
from unittest import mock

import jax.numpy as jnp
import msgspec
import numpy as np
from independent import balance
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import jaxnc as nc
from jaxnc.dynamics.extended import extended, shown_places
from jaxnc.dynamics.model import dynamics, forces
from jaxnc.dynamics.reactions import all_parts
from jaxnc.dynamics.wrenches import cross
from jaxnc.mechanism import model as record
from jaxnc.system.assemble import assemble
from jaxnc.system.equations import places

G = 9.81
STATES = 5
RANK = 1e-9  # of the largest: singular values below are zero
SECTIONS = ("ground", "points", "ground_vectors", "vectors", "bodies", "angles", "distances", "joints", "relations")
DATA = ("form", "fixed", "joint", "shape", "kind")  # of records: no names
BALANCED = 1e-10  # of the largest wrench on the body: linear systems solved to rounding
IDLE = 1e-9  # power of a joint, of the largest power of a single wrench


def weighted(m):
    """Give every body a mass, a centre off its points and an inertia of its own; returns them by name."""
    down = np.zeros(m.model.dim)
    down[-1] = -G
    m.gravity = tuple(down)
    home = {**m.model.ground, **{k: getattr(p, "at", p) for k, p in m.model.points.items()}}
    bodies = {}
    for k, (name, data) in enumerate(m.model.bodies.items()):
        spec = data if isinstance(data, record.Body) else record.Body(data)
        places = np.array([home[p] for p in spec.points])
        size = 0.1 + np.ptp(places)
        mass, com, given = 1.0 + 0.3 * k, places.mean(axis=0), {}
        directions = len(spec.points) - 1 + len(spec.vectors)
        line = m.model.dim == 3 and not spec.vectors and np.linalg.matrix_rank(places[1:] - places[0], tol=1e-9) < 2
        if directions == 0:
            inertia = np.zeros((3, 3)) if m.model.dim == 3 else 0.0
        elif line:
            d = places[1] - places[0]
            com, given = 0.5 * (places[0] + places[1]), {"shape": "rod"}
            inertia = mass / 12 * (d @ d * np.eye(3) - np.outer(d, d))
        else:
            com = com + 0.1 * size * np.arange(1, m.model.dim + 1)
            inertia = 0.02 * (k + 1) * mass * size**2
            given = {"com": tuple(com), "inertia": inertia}
            if m.model.dim == 3:
                six = inertia * np.array([1.0, 1.2, 1.4, 0.1, 0.05, -0.1])
                given["inertia"] = tuple(six)
                xx, yy, zz, xy, xz, yz = six
                inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        m.model.bodies[name] = msgspec.structs.replace(spec, mass=mass, **given)
        bodies[name] = (spec.points, spec.vectors, mass, inertia, com)
    return bodies


def merged(mechanisms):
    """Several mechanisms beside each other in one, their names with a prefix: they compile in the time of one."""
    sections = {}
    for prefix, m in mechanisms.items():
        data = msgspec.to_builtins(m.model)
        data = {k: v for k, v in data.items() if isinstance(v, dict) and k in SECTIONS}
        names = {name for section in data.values() for name in section}
        names |= {j[k] for j in data.get("joints", {}).values() for k in ("angle", "distance") if k in j}

        def named(x, prefix=prefix, names=names, key=""):
            if isinstance(x, str):
                return prefix + x if key not in DATA and x.split(".")[0] in names else x
            if isinstance(x, dict):
                x = {k: v for k, v in x.items() if k not in ("lengths", "local")}  # as they are drawn
                return {named(k): named(v, key=k) for k, v in x.items()}
            return [named(y, key=key) for y in x] if isinstance(x, (list, tuple)) else x

        for section, members in data.items():
            sections.setdefault(section, {}).update({prefix + k: named(v) for k, v in members.items()})
        run = m.model.run
        drives = {prefix + k: {"from": d.start, "to": d.end} for k, d in run.inputs.items()}
        sections.setdefault("run", {"inputs": {}, "hold": []})["inputs"].update(drives)
        sections["run"]["hold"] += [prefix + k for k in run.hold]
    out = nc.Mechanism("bench", dim=next(iter(mechanisms.values())).model.dim)
    whole = msgspec.to_builtins(out.model) | sections
    out.model = msgspec.convert(whole, type(out.model))
    return out


def pieces(matrix):
    """Pseudoinverse and null space of a matrix, one piece after another of those that nothing connects."""
    height, width = matrix.shape
    row, column = np.nonzero(matrix)
    graph = coo_array((np.ones(len(row)), (row, height + column)), shape=(height + width,) * 2)
    count, label = connected_components(graph, directed=False)
    inverse, null = np.zeros((width, height)), [np.zeros((width, 0))]
    for piece in range(count):
        rows, columns = np.flatnonzero(label[:height] == piece), np.flatnonzero(label[height:] == piece)
        left, sizes, right = np.linalg.svd(matrix[np.ix_(rows, columns)])
        rank = int(np.sum(sizes > RANK * np.max(sizes, initial=0.0)))
        inverse[np.ix_(columns, rows)] = right[:rank].T @ (left[:, :rank] / sizes[:rank]).T
        null.append(np.zeros((width, len(columns) - rank)))
        null[-1][columns] = right[rank:].T
    return inverse, np.concatenate(null, axis=1)


class Bench:
    """A mechanism in several states of motion at one pose, found with NumPy, and the wrenches in it.

    Rates and accelerations are anything that the rows' derivatives allow; multipliers and efforts follow from
    `M q̈ + Φ_qᵀ λ = Q`. The laws that the wrenches are held against know nothing of that.
    """

    def __init__(self, m):
        self.m, self.bodies = m, weighted(m)
        self.system = assemble(m, sparse=False)
        inner = extended(self.system)
        dyn, top = dynamics(inner), inner.topology
        q = np.asarray(dyn.eq.home)
        rng, n = np.random.default_rng(1), len(q)
        unknown = np.flatnonzero(~np.array(top.fixed))
        where = places(top)[:2]

        def jacobians(poses):
            found = all_parts(
                inner, dyn, np.zeros(STATES), poses, poses * 0, poses * 0, np.zeros((STATES, len(top.rows)))
            )
            out = np.zeros((STATES, len(top.rows), n))
            for k in range(STATES):
                np.add.at(out[k], where, np.asarray(found.entries[k]))
            return out, np.asarray(found.loads[0]) if found.loads else None

        plain = jacobians(np.tile(q, (STATES, 1)))[0][0]
        units = np.linalg.norm(plain, axis=1)
        j = plain / units[:, None]
        inverse, loose = pieces(j[:, unknown])  # and freedoms
        v, a, lam = np.zeros((STATES, n)), np.zeros((STATES, n)), np.zeros((STATES, len(top.rows)))
        h = 1e-3
        driven = (*m.model.run.inputs, *m.model.run.hold)
        at = [top.position[name] for name in driven]
        rest = np.array([c for c in unknown if c not in set(at)])
        force = np.asarray(forces(dyn, 0.0, q, 0 * q))
        self.efforts = np.zeros((STATES, len(at)))
        pulls, _ = pieces(j[:, rest])
        mass = np.asarray(dyn.mass)
        inertia = loose.T @ mass[np.ix_(unknown, unknown)] @ loose
        for k in range(STATES):
            v[k, unknown] = loose @ rng.normal(size=loose.shape[1])
            steps = np.array([-2.0, -1.0, 1.0, 2.0, 0.0])[:, None] * h
            far2, far1, near1, near2, _ = jacobians(q + steps * v[k])[0]
            bend = (8 * (near1 - far1) - (near2 - far2)) / (12 * h) @ v[k] / units
            a[k, unknown] = -inverse @ bend
            fall = rng.normal(size=len(inertia))
            if not at:  # nothing drives it: it moves as it must
                fall = np.linalg.solve(inertia, loose.T @ (force - mass @ a[k])[unknown])
            a[k, unknown] += loose @ fall
            wanted = force - mass @ a[k]
            lam[k] = pulls.T @ wanted[rest]
            short = j[:, rest].T @ lam[k] - wanted[rest]
            assert np.abs(short).max() <= 1e-9 * np.abs(wanted).max(), top.coordinates[rest[np.abs(short).argmax()]]
            self.efforts[k] = (j.T @ lam[k] - wanted)[at]
            lam[k] /= units
        zero, shown_at = np.zeros(STATES), shown_places(self.system.topology)
        q = np.tile(q, (STATES, 1))
        rates = tuple(jnp.asarray(x[:, shown_at]) for x in (v, a))
        arrays = jnp.asarray(q[:, shown_at]), rates, jnp.zeros((STATES, len(m.model.run.inputs)))
        inputs, held = tuple(m.model.run.inputs), tuple(m.model.run.hold)
        self.motion = nc.Motion(self.system, inputs, held, *arrays, zero.astype(int), zero, zero + 1.0)
        self.reactions = nc.dynamics.Reactions(self.motion, jnp.asarray(lam), jnp.asarray(self.efforts))
        self.wrenches = {
            body: {key: tuple(np.asarray(x) for x in w) for key, w in found.items()}
            for body, found in self.reactions.all().items()
        }
        self.q, self.v, self.a = (np.asarray(x) for x in (q[:, shown_at], *rates))

    def read(self, x, names):
        """Points or vectors out of coordinates ``(states, N)``: ``(states, names, dim)``."""
        top = self.system.topology
        at = [[top.position[f"{name}.{axis}"] for axis in "xyz"[: top.dim]] for name in names]
        return x[:, np.array(at, dtype=int).reshape(-1, top.dim)]

    @functools.cached_property
    def laws(self):
        """Per body and state: centre of mass, m a of it, rate of spin about it, velocity there, rotation rate."""
        model = self.m.model
        home = {**model.ground, **{k: getattr(p, "at", p) for k, p in model.points.items()}}
        arrows = {k: np.array(v) / np.linalg.norm(v) for k, v in {**model.ground_vectors, **model.vectors}.items()}
        out = {}
        for name, (points, vectors, mass, inertia, com) in self.bodies.items():
            drawn = [np.array([home[p] for p in points]), np.array([arrows[u] for u in vectors]).reshape(-1, model.dim)]
            moves = [[self.read(x, points), self.read(x, vectors)] for x in (self.q, self.v, self.a)]
            out[name] = []
            for k in range(STATES):
                now, rates, seconds = ([y[k] for y in x] for x in moves)
                place, force, spin, rate = balance.momentum_rates(mass, inertia, com, drawn, now, rates, seconds)
                speed = rates[0][0] + balance.turning(rate, place - now[0][0])
                out[name].append((place, force, spin, speed, rate))
        return out

    def check_balance(self):
        """Sum of all wrenches on each body against its own motion."""
        down = np.zeros(self.m.model.dim)
        down[-1] = -G
        for name, (points, vectors, mass, _, _) in self.bodies.items():
            found = self.wrenches[name]
            size = max(np.abs(f).max() for f, _ in found.values()) + mass * G
            turn = max(np.abs(c).max() for _, c in found.values()) + 0.1 * size
            for k, (_, force, spin, _, _) in enumerate(self.laws[name]):
                total = [sum(w[n][k] for w in found.values()) for n in (0, 1)]
                assert np.abs(total[0] - force).max() <= BALANCED * size, (name, total[0] - force)
                if len(points) + len(vectors) > 1:
                    assert np.abs(total[1] - spin).max() <= BALANCED * turn, (name, total[1] - spin)
            assert np.abs(found["weight"][0] - mass * down).max() <= BALANCED * mass * G, name
            assert np.abs(found["weight"][1]).max() <= BALANCED * turn, name

    def check_idle(self):
        """What passes through joints does no work, but that of an input which moves a point that bodies share."""
        efforts, powers = {}, self.powers()
        driven = (*self.motion.driven, *self.motion.held)
        for k, name in enumerate(driven):
            owner, _, axis = name.rpartition(".")
            if axis in ("x", "y", "z") and f"coordinate {name}" not in powers:
                rate = self.v[:, self.system.topology.position[name]]
                efforts[f"point {owner}"] = efforts.get(f"point {owner}", 0.0) + self.efforts[:, k] * rate
        for key, (power, most) in powers.items():
            if key != "weight" and not key.startswith("coordinate"):
                assert np.abs(power - efforts.get(key, 0.0)).max() <= IDLE * (most.max() + 1.0), (key, power, most)

    def check_agreement(self):
        """All ways to ask for a wrench against each other: by joint, by point, by body, by coordinate."""
        ledger = self.reactions._ledger()
        with mock.patch.object(nc.dynamics.Reactions, "_ledger", lambda _: ledger):  # made once: there are many points
            self._check_agreement()

    def _check_agreement(self):
        found, top = self.reactions, extended(self.system).topology
        joints = [j.name for j in top.joints if j.drawn and j.freedoms_removed]
        for b, body in enumerate(top.bodies):
            if body.name not in self.bodies:
                continue
            mine = self.wrenches[body.name]
            size = max(np.abs(x).max() for w in mine.values() for x in w) * (1.0 + np.abs(self.q).max())
            for key, (force, moment) in mine.items():
                sort, _, name = key.partition(" ")
                if sort not in ("joint", "relation"):
                    continue
                centre = np.array([law[0] for law in self.laws[body.name]])
                first = self.read(self.q, [top.points[body.points[0]]])[:, 0]
                asked = found.joint(key, on=body.name)
                assert np.abs(np.asarray(asked.force) - force).max() <= BALANCED * size, (body.name, key)
                carried = moment + cross(centre - first, force)
                assert np.abs(np.asarray(asked.moment) - carried).max() <= BALANCED * size, (body.name, key)
            for p in body.points:
                self._check_point(b, top.points[p], joints, size)
        for k, name in enumerate((*self.motion.driven, *self.motion.held)):
            assert np.array_equal(found.effort(name), self.efforts[:, k]), name

    def _check_point(self, b, point, joints, size):
        """What acts at a point is what the body lists of it, about the point; else joints, whole, and pulls on it."""
        top = extended(self.system).topology
        body = top.bodies[b].name
        here = self.reactions.on(body, about=point)
        force, moment = (np.asarray(x) for x in self.reactions.at(point, on=body))
        shared = sum(point in found.points for found in self.m.model.bodies.values()) > 1
        if f"point {point}" in here:
            rest = [force - here[f"point {point}"].force, moment - here[f"point {point}"].moment]
            assert max(np.abs(x).max() for x in rest) <= BALANCED * size, (body, point)
            return
        if shared or point in self.m.model.ground:
            return
        whole = [here[f"joint {j}"] for j in joints if f"joint {j}" in here]
        pulls = [w for key, w in here.items() if key.startswith(("coordinate", "relation")) or key.endswith("cable")]
        free = np.abs(np.array([w.force for w in pulls])).max(initial=0.0) > BALANCED * size
        for chosen in itertools.chain(*(itertools.combinations(whole, k) for k in range(len(whole) + 1))):
            left = [
                force - sum(np.asarray(w.force) for w in chosen),
                moment - sum(np.asarray(w.moment) for w in chosen),
            ]
            close = [np.abs(x).max() <= BALANCED * size for x in left]
            if close[1] and (close[0] or free):
                return
        raise AssertionError((body, point, force, moment, {k: w for k, w in here.items()}))

    def powers(self):
        """Power of what exerts wrenches, over all bodies together, and its largest part, by name."""
        out = {}
        for name, found in self.wrenches.items():
            for key, (force, moment) in found.items():
                for k, (_, _, _, speed, rate) in enumerate(self.laws[name]):
                    parts = force[k] @ speed, np.dot(moment[k], rate)
                    total, most = out.setdefault(key, (np.zeros(STATES), np.zeros(STATES)))
                    total[k] += sum(parts)
                    most[k] = max(most[k], *map(abs, parts))
        return out
