"""Dynamics of an open chain by recursion over its links, in relative coordinates: nothing of it is natural coordinates.

Every joint is a screw, as drawn; a link's place is the product of the exponentials of the screws before it (Brockett).
Velocities, accelerations and inertias are six-vectors at the origin of the ground's axes: outwards velocities and
accelerations, inwards forces, and composite inertias for the mass matrix. It checks the dynamics of natural
coordinates, and is how the programs of relative coordinates did theirs.

Source: R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, ch. 5 (recursive Newton-Euler) and 6 (composite
rigid bodies).
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.families.bodies import Parts
from jaxnc.families.formulation import Formulation, compile_family, plan_relative
from jaxnc.families.program import Scribe
from jaxnc.families.relative import Relative, SpatialRelative
from jaxnc.families.shapes import rotation, skew_matrix
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.solvers import dense
from jaxnc.solvers.assembly import derive
from jaxnc.types import Array, ArrayLike, Numbers


@dataclass(frozen=True)
class ChainJoint:
    """One screw of the chain."""

    before: int  # the joint before it; -1 for none
    variable: int  # which variable it is
    axis: np.ndarray  # along or about which it moves as the variable grows, as drawn
    point: np.ndarray  # a point of that axis
    slides: bool  # whether it is a slide, and not a turn


@public
class Chain:
    """An open chain by its links and joints.

    Args:
        mechanism: the description; its joints leave no loop.

    Attributes:
        formulation: the same in relative coordinates; the variables are in its order.

    Raises:
        InputError: a loop, a joint without screws of its own, a body whose inertia is not plainly given, forces other
            than gravity.
    """

    def __init__(self, mechanism: Mechanism):
        natural = mechanism.compile()
        planner = plan_relative(Parts(mechanism), natural)
        self.formulation: Formulation = compile_family(planner, natural, "relative")
        if self.formulation.r:
            raise InputError(
                f"{natural.name!r} has loops: {self.formulation.r} equations in relative coordinates; the recursion is "
                f"for open chains"
            )
        m = mechanism.model
        if m.forces or m.masses or m.friction:
            name = next(iter((*m.forces, *m.masses, *m.friction)))
            raise InputError(f"{name!r}: the recursion knows bodies and gravity only; give other efforts as tau=")
        self.joints: list[ChainJoint] = []
        self.names = list(self.formulation.variables)
        self.last = {0: -1}
        for k in planner.hung:
            if isinstance(planner, Relative):
                self._plane(planner, k)
            else:
                self._space(planner, k)
        home = np.asarray(derive(self.formulation.system).home)
        self.home = jnp.array(home[self.formulation.topology.unknown])
        gravity = np.zeros(3)
        gravity[: m.dim] = m.gravity or (0.0,) * m.dim
        self.gravity = jnp.array(gravity)
        specs = {name: record.whole(body) for name, body in m.bodies.items()}
        self._efforts, self._mass = jit(self._recurse), jit(self._compose)
        self.inertias: dict[int, np.ndarray] = {}
        for k, part in enumerate(planner.parts.parts):
            for n in (n for n in part.bodies if specs[n].mass):
                at = np.array([_three(planner.a.home[p]) for p in planner.a.at(*specs[n].points)])
                self.inertias[k] = self.inertias.get(k, np.zeros((6, 6))) + _inertia(n, specs[n], at, m.dim)

    def _add(self, k: int, name: str, axis: np.ndarray, point: np.ndarray, slides: bool, sign: float = 1.0) -> None:
        self.joints.append(ChainJoint(self.last[k], self.names.index(name), sign * _three(axis), _three(point), slides))
        self.last[k] = len(self.joints) - 1

    def _plane(self, planner: Relative, k: int) -> None:
        hung, home = planner.hung[k], planner.a.home
        edge, self.last[k] = hung.edge, self.last[hung.parent]
        if edge.how == "free":
            part = planner.parts.parts[k]
            where = home[list(part.points)].mean(axis=0)
            for axis, name in zip(np.eye(2), (f"{part.name}.x", f"{part.name}.y"), strict=True):
                self._add(k, name, axis, where, True)
            self._add(k, part.angle or f"{part.name}.psi", np.array([0.0, 0.0, 1.0]), where, False)
            return
        if hung.distance:
            line = home[edge.line[1]] - home[edge.line[0]]
            if edge.how == "held":
                line = np.eye(2)[planner._free(edge.point)]
            sign = 1.0 if k == edge.second else -1.0
            if k != edge.second and hung.angle:
                raise InputError(
                    f"{planner.a.text(edge.owner)!r}: the recursion takes a pin in a slot from the slot's side only"
                )
            self._add(k, hung.distance, line / np.linalg.norm(line), home[edge.point], True, sign)
        if hung.angle:
            sign = -1.0 if hung.backwards else 1.0
            self._add(k, hung.angle, np.array([0.0, 0.0, 1.0]), home[edge.point], False, sign)

    def _space(self, planner: SpatialRelative, k: int) -> None:
        hung, home = planner.hung[k], planner.a.home
        edge, (mine, other) = hung.edge, hung.sides
        self.last[k] = self.last[hung.parent]
        if edge.how in ("spherical", "free"):
            raise InputError(
                f"{planner.a.text(edge.owner)!r} has Euler parameters, which are not independent; the recursion "
                f"takes revolute, prismatic, cylindrical and universal joints"
            )
        axis = planner.parts.unit_along(edge.axes[mine])
        if hung.distance:
            sign = float(next(f for f, what, _ in planner.displacement(Scribe(), hung) if what == "s"))
            self._add(k, hung.distance, axis, home[edge.at[mine]], True, sign)
        for i, name in enumerate(hung.angles):
            about = axis if i == 0 else planner.parts.unit_along(edge.axes[other])
            sign = 1.0
            if edge.how != "universal":
                sign = float(next(f for f, what, _ in planner.rotation(Scribe(), hung) if what == "s"))
            self._add(k, name, about, home[edge.at[mine]], False, sign)

    # -- recursion ----------------------------------------------------------------------------------------------

    def _screws(self, z: Array) -> tuple[list[Array], list[tuple[Array, Array]]]:
        """Screws of all joints, and the places (rotation, shift) of what follows each, from the drawing."""
        screws, places = [], []
        for joint in self.joints:
            r, t = places[joint.before] if joint.before >= 0 else (jnp.eye(3), jnp.zeros(3))
            axis, point = r @ joint.axis, r @ joint.point + t
            by = z[joint.variable] - self.home[joint.variable]
            if joint.slides:
                screws.append(jnp.concatenate([jnp.zeros(3), axis]))
                places.append((r, t + by * axis))
                continue
            screws.append(jnp.concatenate([axis, jnp.cross(point, axis)]))
            turn = rotation(axis, by)
            places.append((turn @ r, turn @ (t - point) + point))
        return screws, places

    def _carry(self, place: tuple[Array, Array], inertia: np.ndarray) -> Array:
        """An inertia at the origin, carried along with its link."""
        r, t = place
        back = jnp.block([[r.T, jnp.zeros((3, 3))], [-(r.T @ skew_matrix(t)), r.T]])
        return back.T @ inertia @ back

    def efforts(self, z: Numbers, dz: Numbers, ddz: Numbers) -> Array:
        """Efforts that the joints need for a motion (recursive Newton-Euler).

        Args:
            z: variables, ``(n,)``.
            dz: rates.
            ddz: accelerations.

        Returns:
            Torques and forces ``(n,)``, N m and N.
        """
        return self._efforts(*(jnp.asarray(x, float) for x in (z, dz, ddz)))

    def _recurse(self, z: Array, dz: Array, ddz: Array) -> Array:
        screws, places = self._screws(z)
        velocity, acceleration = [], []
        still = jnp.concatenate([jnp.zeros(3), -self.gravity])
        for joint, screw in zip(self.joints, screws, strict=True):
            before = joint.before
            v, a = (velocity[before], acceleration[before]) if before >= 0 else (jnp.zeros(6), still)
            rate = screw * dz[joint.variable]
            acceleration.append(a + screw * ddz[joint.variable] + _cross_motion(v, rate))
            velocity.append(v + rate)
        forces = [jnp.zeros(6) for _ in self.joints]
        for link, inertia in self.inertias.items():
            k = self.last[link]
            carried = self._carry(places[k], inertia)
            forces[k] = forces[k] + carried @ acceleration[k] + _cross_force(velocity[k], carried @ velocity[k])
        out = jnp.zeros(len(self.names))
        for k in reversed(range(len(self.joints))):
            out = out.at[self.joints[k].variable].add(jnp.dot(screws[k], forces[k]))
            if self.joints[k].before >= 0:
                forces[self.joints[k].before] = forces[self.joints[k].before] + forces[k]
        return out

    def mass_matrix(self, z: Numbers) -> Array:
        """The mass matrix ``(n, n)`` in a pose (composite rigid bodies)."""
        return self._mass(jnp.asarray(z, float))

    def _compose(self, z: Array) -> Array:
        screws, places = self._screws(z)
        composite = [jnp.zeros((6, 6)) for _ in self.joints]
        for link, inertia in self.inertias.items():
            k = self.last[link]
            composite[k] = composite[k] + self._carry(places[k], inertia)
        out = jnp.zeros((len(self.names), len(self.names)))
        for k in reversed(range(len(self.joints))):
            force, j = composite[k] @ screws[k], k
            while j >= 0:
                value, a, b = jnp.dot(screws[j], force), self.joints[k].variable, self.joints[j].variable
                out = out.at[a, b].set(value).at[b, a].set(value)
                j = self.joints[j].before
            before = self.joints[k].before
            if before >= 0:
                composite[before] = composite[before] + composite[k]
        return out

    def accelerations(self, z: ArrayLike, dz: Any, tau: Any = 0.0) -> Array:
        """Accelerations ``(n,)`` under gravity and the efforts `tau` ``(n,)`` on the variables."""
        z = jnp.asarray(z, float)
        bias = self.efforts(z, dz, jnp.zeros_like(z))
        right = jnp.broadcast_to(jnp.asarray(tau, float), z.shape) - bias
        return jax.jit(dense.eliminate)(self.mass_matrix(z), right[:, None])[0][:, 0]  # one program, not thirty


def _three(x: np.ndarray) -> np.ndarray:
    return np.concatenate([x, np.zeros(3 - len(x))])


def _cross_motion(v: Array, m: Array) -> Array:
    """Rate of a motion vector that is carried along with a velocity."""
    return jnp.concatenate([jnp.cross(v[:3], m[:3]), jnp.cross(v[:3], m[3:]) + jnp.cross(v[3:], m[:3])])


def _cross_force(v: Array, f: Array) -> Array:
    """Rate of a force vector that is carried along with a velocity."""
    return jnp.concatenate([jnp.cross(v[:3], f[:3]) + jnp.cross(v[3:], f[3:]), jnp.cross(v[:3], f[3:])])


def _inertia(name: str, spec: record.Body, at: np.ndarray, dim: int) -> np.ndarray:
    """A body's inertia at the origin as drawn, from its record alone: moments and mass ``(6, 6)``."""
    mass = float(spec.mass or 0.0)
    com = at.mean(axis=0) if spec.com is None else _three(np.array(spec.com))
    tensor = np.zeros((3, 3))
    if spec.inertia is not None:
        given = np.atleast_1d(np.array(spec.inertia, float))
        if dim == 2:
            tensor[2, 2] = given[0]
        else:
            xx, yy, zz, xy, xz, yz = given
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    elif spec.shape == "rod":
        d = at[1] - at[0]
        com = 0.5 * (at[0] + at[1]) if spec.com is None else com
        tensor = mass / 12.0 * (d @ d * np.eye(3) - np.outer(d, d))
    elif spec.shape is not None:
        raise InputError(f"body {name!r}: the recursion takes inertia= or shape='rod', not shape={spec.shape!r}")
    c = np.asarray(skew_matrix(com))
    return np.block([[tensor - mass * c @ c, mass * c], [-mass * c, mass * np.eye(3)]])
