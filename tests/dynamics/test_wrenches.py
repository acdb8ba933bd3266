"""Wrenches on bodies: each body's own balance, write_out without the library's rows, and joints that do no work."""

import functools
import itertools
from unittest import mock

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest
from independent import balance
from rigs import CASES, STAY, Rig
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import jaxnc as nc
from jaxnc import library
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


def library_of(dim):
    found = {f"{name} ": make() for name, make in library.CATALOGUE.items()}
    return merged({name: m for name, m in found.items() if m.model.dim == dim})


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
def test_library(dim):
    """Every mechanism of the library, with masses on all bodies: each body in balance, each joint without power."""
    bench = Bench(library_of(dim))
    bench.check_balance()
    bench.check_idle()
    bench.check_agreement()


RIGS = tuple(CASES)  # every joint in space in all of its forms


@functools.cache
def rigged():
    """Free bodies, two or three to a joint, tumbling as they fall."""
    m, rigs, free = nc.Mechanism("rigs", dim=3), {}, {}
    for k, name in enumerate(RIGS):
        rig = Rig(m, f"r{k}_", False)
        free[name] = CASES[name][0](rig)
        rigs[name] = rig
    return Bench(m), rigs, free


@pytest.mark.slow
def test_joints_in_space_balance():
    bench, _, _ = rigged()
    bench.check_balance()
    bench.check_agreement()


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_joint_in_space_is_one_wrench_without_power(name):
    """What joins two bodies is one wrench, opposite on both, and does no work on any of their relative freedoms."""
    bench, rigs, free = rigged()
    allowed, bodies = free[name], [rigs[name].of(f"body{b + 1}") for b in range(rigs[name].count)]
    twists = allowed.twists([STAY] * (len(bodies) - 1)).reshape(-1, len(bodies) - 1, 6)
    found = []
    for body in bodies:
        largest = max(np.abs(x).max() for w in bench.wrenches[body].values() for x in w)
        exerted = {
            key: w
            for key, w in bench.wrenches[body].items()
            if key != "weight" and max(np.abs(x).max() for x in w) > BALANCED * largest
        }
        if len(bodies) == 2:
            assert len(exerted) == 1, exerted.keys()
        centre = np.array([law[0] for law in bench.laws[body]])
        total = [sum(w[n] for w in exerted.values()) for n in (0, 1)]
        found.append((total[0], total[1] + np.cross(centre, total[0])))
    size = np.abs(found[0][0]).max() + np.abs(found[0][1]).max()
    assert size > 1e-3
    for n in (0, 1):
        assert np.abs(sum(w[n] for w in found)).max() <= BALANCED * size
    for twist in twists:  # of bodies 2, 3, … relative to body 1: rotation, and velocity at the origin
        power = sum(w[1] @ t[:3] + w[0] @ t[3:] for w, t in zip(found[1:], twist, strict=True))
        assert np.abs(power).max() <= IDLE * size


def test_a_rolling_disc_is_held_by_one_force_at_the_contact():
    """Accelerated along a line by a torque on its centre: friction m a, and no moment about the contact."""
    m, radius, mass, inertia = nc.Mechanism("disc"), 0.3, 1.88, 0.05
    for name, at in {"A": (0, 0), "B": (2, 0)}.items():
        m.ground(name, at)
    for name, at in {"C": (0.5, radius), "R": (0.5, 2 * radius), "K": (0.5, 0)}.items():
        m.point(name, at)
    m.body("disc", ["C", "R"], mass=mass, com=(0.5, radius), inertia=inertia)
    m.rolling("rolling", centre="C", rim="R", contact="K", line=("A", "B"), angle="phi", distance="s")
    m.gravity = (0, -G)
    motion = nc.motion(m.compile(), {"s": lambda t: 0.5 + 0.6 * t * t}, [0.0, 0.3])
    found = nc.inverse_dynamics(motion.system, motion).reactions
    held = found.joint("rolling", on="disc", about="C")
    # The input pushes at the centre, along the line: m a + I a / R², of which friction takes I a / R².
    a = 1.2
    friction = -inertia * a / radius**2
    assert np.allclose(held.force, [friction, mass * G], rtol=1e-12)
    assert np.allclose(held.moment, radius * friction, rtol=1e-12)
    assert np.allclose(found.on("disc")["coordinate s"].force, [mass * a - friction, 0.0], rtol=1e-12, atol=1e-12)
    assert np.allclose(found.joint("rolling", on="disc", about="C").moment + 0.0, -inertia * a / radius, rtol=1e-12)


def pair(internal=False, **more):
    """Two wheels on the ground, the second one loaded with 2 N m."""
    m = nc.Mechanism("pair")
    for k, (x, r, mass) in enumerate(((0.0, 0.1, 1.0), (-0.1 if internal else 0.3, 0.2, 2.0)), start=1):
        m.ground(f"O{k}", (x, 0))
        m.point(f"P{k}", (x + r, 0))
        m.body(f"w{k}", [f"O{k}", f"P{k}"], mass=mass, com=(x, 0), inertia=0.01)
        m.angle(f"phi{k}", at=f"O{k}", to=f"P{k}")
    m.gear("mesh", "phi1", "phi2", internal=internal, **more)
    m.torque("load", "phi2", 2.0)
    m.gravity = (0, -G)
    return m


@pytest.mark.parametrize("internal", [False, True])
def test_gears_press_on_their_bearings(internal):
    """2 N m on 0.2 m: 10 N across the line of centres, and 10 tan 20° along it where a pressure angle is given."""
    alpha = np.radians(20)
    for more, along in (({}, 0.0), ({"pressure_angle": alpha}, 10 * np.tan(alpha))):
        system = pair(internal, **more).compile()
        motion = nc.motion(system, {"phi1": lambda t: 0.3 + 2.0 * t}, [0.0, 0.1])
        found = nc.inverse_dynamics(system, motion)
        r = found.reactions
        on = np.array(r.joint("mesh", on="w1").force)
        # External: the driver is held back at (0.1, 0) downwards, pressed towards its own centre; the same in a ring.
        across = -10.0 if not internal else 10.0
        assert np.allclose(on, [-along, across], rtol=1e-12, atol=1e-12)
        assert np.allclose(r.joint("mesh", on="w1").moment, across * 0.1, rtol=1e-12)
        assert np.allclose(r.joint("mesh", on="w2").force, -on, rtol=1e-12, atol=1e-12)
        assert np.allclose(r.joint("mesh", on="w2").moment, -2.0, rtol=1e-12)
        for k, sign in ((1, 1.0), (2, -1.0)):
            bearing = np.array([0.0, k * G]) - sign * on
            assert np.allclose(r.at(f"O{k}", on=f"w{k}").force, bearing, rtol=1e-12, atol=1e-12)
            assert np.allclose(r.support(f"O{k}"), bearing, rtol=1e-12, atol=1e-12)
        assert np.allclose(found["phi1"], 1.0 if not internal else -1.0, rtol=1e-12)


def test_friction_in_the_bearing_of_a_gear_feels_the_tooth_force():
    """A weightless pair without inertia: the driver carries 1 N m and μ r F in its own pin."""
    m = pair()
    m.gravity = (0, 0)
    m.friction("rub", coefficient=0.1, bodies=("w1", "ground"), at="O1", radius=0.02, speed=1e-6)
    system = m.compile()
    motion = nc.motion(system, {"phi1": lambda t: 0.3 - 2.0 * t}, [0.0, 0.1])
    found = nc.inverse_dynamics(system, motion)
    assert np.allclose(found["phi1"], 1.0 - 0.1 * 0.02 * 10.0, rtol=1e-9)
    assert np.allclose(found.reactions.on("w1")["load rub"].moment, 0.1 * 0.02 * 10.0, rtol=1e-9)


def test_the_pivot_of_a_slotted_arm_does_not_carry_the_slot():
    """A pin at 0.3 m from the pivot presses with 5 N across the arm: what holds the arm there is the support."""
    m = nc.Mechanism("arm")
    m.ground("A", (0, 0))
    m.ground("G", (0.3, -0.4))
    m.point("C", (0.5, 0))
    m.point("B", (0.3, 0))
    m.body("arm", ["A", "C"], mass=1.0, com=(0, 0), inertia=0.0)
    m.body("crank", ["G", "B"], mass=1.0, com=(0.3, -0.4), inertia=0.0)
    m.slot("slot", "B", line=("A", "C"))
    m.angle("phi", at="G", to="B")
    m.angle("psi", at="A", to="C")
    m.torque("load", "psi", 1.5)
    m.gravity = (0, -G)
    system = m.compile()
    found = nc.inverse_dynamics(system, nc.motion(system, {"phi": lambda t: np.pi / 2 + 0.0 * t}, [0.0, 0.1])).reactions
    assert np.allclose(found.joint("slot", on="arm").force, [0.0, -5.0], atol=1e-12)
    assert np.allclose(found.at("A", on="arm").force, [0.0, 5.0 + G], atol=1e-12)
    assert np.allclose(found.support("A"), [0.0, 5.0 + G], atol=1e-12)


def test_weights_are_drawn_at_the_centre_of_mass():
    from jaxnc.dynamics.reactions import nodal_forces

    m = nc.Mechanism("plate")
    m.ground("O", (0, 0))
    m.point("P", (1.0, 0))
    m.body("plate", ["O", "P"], mass=2.0, com=(0.4, 0.3), inertia=0.1)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -G)
    system = m.compile()
    motion = nc.motion(system, {"phi": lambda t: np.pi / 2 * t}, [0.0, 1.0])
    places, weights = nodal_forces(nc.reactions(motion))["weight"]
    assert np.allclose(places[:, 0], [(0.4, 0.3), (-0.3, 0.4)], atol=1e-12)
    assert np.array_equal(weights[:, 0], [(0.0, -2.0 * G)] * 2)


def test_a_pressure_angle_is_in_radians():
    m = pair()
    with pytest.raises(nc.MechanismError, match=r"pressure_angle=20.*radians.*0\.349"):
        m.gear("other", "phi1", "phi2", pressure_angle=20)


def test_reactions_are_those_of_the_masses_that_were_asked_for():
    """A crank at a steady speed: the ground holds m (a - g) with the mass of the system, not that of the motion's."""
    m = nc.Mechanism("crank")
    m.ground("O", (0, 0))
    m.point("P", (2, 0))
    m.body("bar", ["O", "P"], mass=1.0)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -10.0)
    light = m.compile()
    motion = nc.sweep(light, {"phi": np.array([0.0, 0.5])}, rates={"phi": 3.0})
    heavy = nc.inverse_dynamics(light.replace({"bar.mass": 7.0}), motion)
    away = np.stack([np.cos([0.0, 0.5]), np.sin([0.0, 0.5])], axis=1)
    wanted = 7.0 * (np.array([0.0, 10.0]) - 9.0 * away)  # the centre, at a radius of 1, is pulled inwards
    np.testing.assert_allclose(heavy.reactions.support("O"), wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(heavy["phi"], 70.0 * away[:, 0], rtol=1e-9)


def truss(*forces):
    """Two bars without mass on two supports, which meet at C."""
    m = nc.Mechanism("truss")
    m.ground("A", (0, 0))
    m.ground("B", (2, 0))
    m.point("C", (1, 1))
    m.body("left", ["A", "C"])
    m.body("right", ["B", "C"])
    for k, force in enumerate(forces):
        m.force(f"load {k}", "C", force)
    return m


def test_bars_of_a_truss_without_mass_carry_what_the_method_of_joints_gives():
    found = nc.equilibrium(truss((3.0, -10.0)).compile()).reactions
    left, right = np.linalg.solve(np.array([[-1.0, 1.0], [-1.0, -1.0]]) / np.sqrt(2.0), [-3.0, 10.0])
    np.testing.assert_allclose(found.at("A", on="left").force, -left * np.array([1.0, 1.0]) / np.sqrt(2.0), atol=1e-12)
    np.testing.assert_allclose(
        found.at("B", on="right").force, right * np.array([1.0, -1.0]) / np.sqrt(2.0), atol=1e-12
    )
    with pytest.raises(nc.errors.InputError, match=r"(?s)truss.*mass="):
        nc.simulate(truss((3.0, -10.0)).compile(), np.linspace(0.0, 1.0, 3))


def test_an_input_holds_a_load_on_bars_without_mass():
    """A lever of length 2 at 30 degrees under a weight of 5: the input's torque is its moment."""
    m = nc.Mechanism("lever")
    m.ground("A", (0, 0))
    m.point("B", (2 * np.cos(np.pi / 6), 1.0))
    m.body("lever", ["A", "B"])
    m.angle("phi", at="A", to="B")
    m.force("weight", "B", (0.0, -5.0))
    moment = 5.0 * 2.0 * np.cos(np.pi / 6)
    held = nc.equilibrium(m.compile(), hold={"phi": np.pi / 6}).reactions
    np.testing.assert_allclose(held.effort("phi"), moment, rtol=1e-12)
    motion = nc.sweep(m.compile(), {"phi": np.array([np.pi / 6, np.pi / 3])}, rates={"phi": 0.0})
    efforts = nc.inverse_dynamics(m.compile(), motion).reactions.effort("phi")
    np.testing.assert_allclose(efforts, [moment, 5.0], rtol=1e-12)


def test_a_lever_without_mass_rests_where_its_spring_carries_the_load():
    """A spring without free length pulls with k (D - B): the lever of length 2 points along k D + W."""
    m = nc.Mechanism("lever")
    m.ground("A", (0, 0))
    m.ground("D", (0, 2))
    m.point("B", (2, 0))
    m.body("lever", ["A", "B"])
    m.spring("spring", "B", "D", stiffness=100.0, free=0.0)
    m.force("load", "B", (90.0, -80.0))
    system = m.compile()
    found, along = nc.equilibrium(system), np.array([0.6, 0.8])
    np.testing.assert_allclose(found["B"], 2.0 * along, rtol=1e-12)
    np.testing.assert_allclose(found.reactions.at("A", on="lever").force, 50.0 * along, rtol=1e-12)
    assert found.stable
    by_support = jax.grad(lambda s: nc.equilibrium(s)["B"][0])(system)["D"]
    np.testing.assert_allclose(by_support, 200.0 / 150.0 * np.array([0.64, -0.48]), rtol=1e-9)


def test_names_of_two_things_are_told_apart():
    m = nc.Mechanism("slider")
    m.ground("A", (0, 0))
    m.ground("G", (4, 0))
    m.point("B", (1, 1))
    m.point("S", (3, 0))
    m.body("crank", ["A", "B"], mass=1.0)
    m.body("slide", ["B", "S"], mass=1.0)
    m.slot("slide", "S", ("A", "G"))
    m.angle("phi", at="A", to="B")
    found = nc.equilibrium(m.compile(), hold={"phi": 0.7}).reactions
    with pytest.raises(nc.errors.InputError, match=r"(?s)'slide'.*body.*joint.*'joint slide'"):
        found.rows("slide")
    assert len(found.rows("joint slide")) == 1 and len(found.rows("body slide")) == 1
    with pytest.raises(nc.errors.InputError, match="'psi'"):
        found.effort("psi")


def test_the_effort_of_a_torque_is_that_of_its_load():
    m = nc.Mechanism("crank")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    m.body("crank", ["A", "B"], mass=1.0)
    m.angle("phi", at="A", to="B")
    m.torque("motor", "phi", 3.0)
    run = nc.simulate(m.compile(), np.linspace(0.0, 0.1, 3))
    reactions = nc.reactions(run)
    with pytest.raises(nc.errors.InputError, match=r"(?s)'phi'.*load\('motor'\)"):
        reactions.effort("phi")
    np.testing.assert_allclose(reactions.load("motor").value, 3.0)
