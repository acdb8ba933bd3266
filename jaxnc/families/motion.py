"""Motion under forces in any family: masses and forces of the natural coordinates, seen through the map to them.

With q = q(z), ``q̇ = J ż`` and ``q̈ = J z̈ + J̇ ż``, virtual power gives ``Jᵀ M J z̈ + Φ_zᵀ λ = Jᵀ (Q - M J̇ ż)`` beside
``Φ(z) = 0``. The mass matrix M of natural coordinates is constant; that of the family is not.
"""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.dynamics.extended import extended, lift
from jaxnc.dynamics.flow import ACCELERATION, StageSolution, select_stage
from jaxnc.dynamics.integrate import equal_steps
from jaxnc.dynamics.model import Dynamics, dynamics, forces
from jaxnc.dynamics.steps import MotionState, settle, step
from jaxnc.errors import AssemblyError, InputError
from jaxnc.families.formulation import Formulation, Independent
from jaxnc.kinematics.inputs import array, finite, positive
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record
from jaxnc.solvers import assembly
from jaxnc.solvers.assembly import derive, free_plan
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.saddle import saddle
from jaxnc.status import Status
from jaxnc.system.equations import Equations, residual
from jaxnc.types import Array, ArrayLike
from jaxnc.validate import as_shape


@public
def mass_matrix(formulation: Formulation, z: ArrayLike) -> Array:
    """The mass matrix of a family in a pose.

    Args:
        formulation: the formulation.
        z: the variables, ``(n,)``.

    Returns:
        ``Jᵀ M J``, ``(n, n)``, kg, kg m or kg m².

    Raises:
        InputError: nothing has a mass, or a closed chain in independent coordinates.
    """
    return _mass(_family(formulation), jnp.asarray(as_shape(z, "the variables z", formulation.n)))


@public
def accelerations(formulation: Formulation, z: ArrayLike, dz: ArrayLike, t: float = 0.0) -> Array:
    """Second time derivatives of the variables of a family, under the mechanism's forces.

    Args:
        formulation: the formulation.
        z: the variables, ``(n,)``; they meet the constraints.
        dz: their rates, ``(n,)``; they too.
        t: time, s.

    Returns:
        Accelerations ``(n,)``.

    Raises:
        InputError: as `mass_matrix`; the mechanism has friction.
    """
    family, n = _family(formulation), formulation.n
    z, dz = (jnp.asarray(as_shape(x, what, n)) for x, what in ((z, "the variables z"), (dz, "their rates dz")))
    return _accelerations(family, jnp.asarray(as_shape(t, "time t")), z, dz)


@public
def simulate(formulation: Formulation, t: ArrayLike, z: object = None, dz: object = None, step: float = 1e-3) -> Motion:
    """Move a mechanism under its forces in the coordinates of a family.

    Args:
        formulation: the formulation.
        t: times to be kept, ``(T,)``, s; the first is the start.
        z: the variables at the start, ``(n,)``; the assembled drawing if not given.
        dz: their rates, ``(n,)``; at rest if not given. What does not meet the constraints is taken to the nearest
            that does.
        step: longest step of the Runge-Kutta method of fourth order; pose and rates are projected on the constraints
            after each.

    Returns:
        The motion in natural coordinates, with velocities and accelerations.

    Raises:
        InputError: as `accelerations`; times that do not grow.
        AssemblyError: it breaks off; in traced code the status says so.
    """
    family = _family(formulation)
    times = np.asarray(array(t, "time t"), float)
    finite(times, "time t")
    if times.ndim != 1 or len(times) < 2 or not np.all(np.diff(times) > 0):
        raise InputError(f"time t must grow from value to value, shape (T,); got shape {times.shape}")
    positive(step, "step=")
    step = float(step)
    top = formulation.topology
    if z is None:
        z = assembly.settle(family.own, np.zeros(len(top.coordinates))).q[top.unknown]
    z = jnp.asarray(as_shape(z, "the variables z", formulation.n))
    dz = jnp.zeros_like(z) if dz is None else jnp.asarray(as_shape(dz, "their rates dz", formulation.n))
    for what, x in (("z", z), ("dz", dz)):
        finite(x, what)
    count = max(1, int(np.ceil(np.max(np.diff(times)) / step - 1e-9)))
    qs, vs, accs, gaps = _integrate(family, jnp.array(times), z, dz, count)
    met = gaps <= 1.0
    bad = np.zeros(0, int) if isinstance(met, Tracer) else np.flatnonzero(~np.asarray(met))
    if len(bad):
        raise AssemblyError(
            f"{formulation.natural.name!r} in {formulation.family} coordinates breaks off at t = {times[bad[0]]:g} s: "
            f"the constraints are no longer met; take a shorter step, or start where they are"
        )
    none = jnp.zeros((len(times), 0))
    good = jnp.where(met, int(Status.CONVERGED), int(Status.CAME_APART))
    return Motion(formulation.natural, (), (), qs, (vs, accs), none, good, None, None,
                  jnp.array(times))  # fmt: skip


@record
class _Family:
    """The motion of a design in the variables of a family, as `jaxnc.dynamics.steps` integrates it.

    The numbers that do not depend on the pose are derived once, by programs that others need too.
    """

    formulation: Formulation
    dyn: Dynamics
    natural: Equations
    own: Equations

    @property
    def redundant(self) -> bool:
        """True if rows are redundant."""
        return self.formulation.rows > self.formulation.r

    def lift(self, z: Array) -> Array:
        """Coordinates of the dynamics, with hidden vectors."""
        return lift(self.formulation.natural.topology, self.formulation.place(self.natural, z))

    def rows(self, z: Array) -> Array:
        """Residuals of the family's constraints."""
        top = self.formulation.topology
        return residual(self.own, self.own.home.at[top.unknown].set(z))[free_plan(top).rows]

    def impose(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """The state: nothing is driven."""
        return q, v

    def solve_stage(self, stage: ArrayLike, t: Array, q: Array, v: Array) -> StageSolution:
        """Solve a stage as `jaxnc.dynamics.flow.Flow` does: one system of equations with other right-hand sides."""
        z, dz, dyn = q, v, self.dyn
        q, v = jax.jvp(self.lift, (z,), (dz,))
        j, slope = jax.jacfwd(self.lift)(z), jax.jacfwd(self.rows)(z)
        mass, rows, rates = j.T @ dyn.mass @ j, self.rows(z), slope @ dz
        size = jnp.max(jnp.diagonal(mass))

        def push() -> Array:
            return j.T @ (forces(dyn, t, q, v) - dyn.mass @ _second_derivative(self.lift, z, dz)) / size

        right = select_stage(stage, push, lambda: jnp.zeros_like(z), lambda: jnp.zeros_like(z))
        wanted = select_stage(stage, lambda: -_second_derivative(self.rows, z, dz), lambda: -rows, lambda: -rates)
        change, multipliers = saddle(mass / size, slope, self.redundant)(right, wanted)
        return StageSolution(change, multipliers * size, largest(rows), largest(rates))


def _family(f: Formulation) -> _Family:
    """The motion of a formulation; refused where a family has none."""
    if isinstance(f, Independent):
        raise InputError(
            "a closed chain in independent coordinates has no map to natural ones without solving for it; use "
            "family='relative', or nc.simulate on the mechanism"
        )
    if not f.natural.topology.loads.any:
        raise InputError(f"{f.natural.name!r}: nothing in it has a mass; give bodies mass= before compile()")
    top = f.natural.topology
    acting = {top.coordinates[k] for force in top.loads.forces for at in force.scalars for k in at}
    acting |= {top.coordinates[force.at] for force in top.loads.functions if force.acts == "effort"}
    lost = sorted(acting & {*itertools.compress(top.scalars, top.angles)} - {*f.variables})
    if lost and f.family == "reference" and top.dim == 3:
        raise InputError(
            f"a force acts on the angle {lost[0]!r}, which reference points in space tell but for whole turns; let it "
            f"be a variable, keep=[{lost[0]!r}], or use family='relative'"
        )
    if f.natural.topology.loads.friction:
        raise InputError("friction needs the reactions of natural coordinates; use nc.simulate on the mechanism")
    return _Family(f, dynamics(extended(f.natural)), derive(f.natural), derive(f.system))


def _second_derivative(function, x: Array, v: Array) -> Array:
    """Second derivative of a function along a straight line."""
    return jax.jvp(lambda y: jax.jvp(function, (y,), (v,))[1], (x,), (v,))[1]


@jit
def _mass(family: _Family, z: Array) -> Array:
    j = jax.jacfwd(family.lift)(z)
    return j.T @ family.dyn.mass @ j


@jit
def _accelerations(family: _Family, t: Array, z: Array, dz: Array) -> Array:
    return family.solve_stage(ACCELERATION, t, z, dz).change


@functools.partial(jit, static_argnums=4)
def _integrate(family: _Family, times: Array, z: Array, dz: Array, steps: int) -> tuple[Array, Array, Array, Array]:
    f, eq, held = family.formulation, family.own, family.formulation.rows > 0
    zero, none = jnp.zeros(()), jnp.zeros(len(free_plan(f.topology).rows))
    first = settle(family, times[0], MotionState(z, dz, jnp.zeros_like(z), none, zero, zero))
    states, _ = equal_steps(
        lambda t, h, state: (step(family, "rk4", held, t, h, state)[0], ()),
        lambda t, state: state,
        times,
        first,
        steps,
    )
    place = functools.partial(f.place, family.natural)

    def keep(state: MotionState) -> tuple[Array, Array, Array, Array]:
        z, dz, a = state.q, state.v, state.a
        q, v = jax.jvp(place, (z,), (dz,))
        acceleration = jax.jvp(place, (z,), (a,))[1] + _second_derivative(place, z, dz)
        full = eq.home.at[f.topology.unknown].set(z)
        gap = largest(family.rows(z)) / tolerance(eq, full) if held else 0.0 * z[0]
        return q, v, acceleration, gap

    return lax.map(keep, jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, states))
