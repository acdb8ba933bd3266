"""The closed square residual of a mechanism: what someone's own solver makes zero."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.errors import InputError, counted, nearest
from jaxnc.kinematics.inputs import REDUNDANCY, check_inputs, dense_only
from jaxnc.kinematics.motion import Motion, motion_of
from jaxnc.kinematics.position import begin_at
from jaxnc.records import record, static
from jaxnc.solvers.assembly import derive, settle
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations, derived
from jaxnc.system.precision import as_its_system, numbers
from jaxnc.system.system import System
from jaxnc.types import Array, Float, Inputs
from jaxnc.validate import as_shape


@public
@record
class ClosedEquations:
    """As many equations as unknowns for one set of inputs, for any root finder; a pytree, so it may be `args`.

    ``x`` stands for the unknowns everywhere: all coordinates that are neither driven nor held nor ground, in the order
    of `unknowns`, ``(n,)``; lengths and radians.

    Attributes:
        system: the system.
        known: values of the driven coordinates and, behind them, of the held ones, ``(k,)``.
        start: the unknowns of the pose to start from, ``(n,)``: the assembled drawing, if no `start` was given. It has
            no derivative.
    """

    system: System
    known: Float[Array, "... k"]
    start: Float[Array, "... n"]
    _equations: Equations
    _plan: Plan = static()
    # Places of the rows that are solved, in those of the plan; None for least squares of all of them.
    _chosen: tuple[int, ...] | None = static()

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns, in their order."""
        return self.system.topology.named(self._plan.unknown)

    @property
    def rows(self) -> tuple[str, ...]:
        """Names of the constraint rows that are solved."""
        rows = self._plan.rows if self._chosen is None else self._plan.rows[list(self._chosen)]
        return tuple(self.system.topology.rows[i] for i in rows)

    def residual(self, x: Float[Array, " n"]) -> Float[Array, " n"]:
        """Evaluate the equations.

        Args:
            x: the unknowns, ``(n,)``.

        Returns:
            Constraint rows, as lengths, ``(n,)``; with least squares the gradient by the unknowns of half their sum of
            squares. Zero at a pose that closes. Differentiable by the unknowns, the inputs and the design.

        Raises:
            InputError: `x` is no array of n numbers.
        """
        x = self._checked(x)
        with numbers(self.known):
            if self._chosen is not None:
                return self._all_rows(x)[np.array(self._chosen, int)]
            rows, back = jax.vjp(self._all_rows, x)
            return back(rows)[0]

    def jacobian(self, x: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Differentiate the equations by the unknowns.

        Args:
            x: the unknowns, ``(n,)``.

        Returns:
            The Jacobian ``(n, n)``.

        Raises:
            InputError: `x` is no array of n numbers; the system is a large one, whose matrices are kept sparse.
        """
        dense_only(self.system.topology, "jacobian()")
        x = self._checked(x)
        with numbers(self.known):
            if self._chosen is None:
                return jax.jacfwd(self.residual)(x)
            return self._plan.linearise(self._equations, self._scattered(x))[1][np.array(self._chosen, int)]

    def pose(self, x: Float[Array, " n"]) -> Motion:
        """Put the unknowns back among all coordinates.

        Args:
            x: the unknowns, ``(n,)``.

        Returns:
            The pose. All constraint rows are looked at, also those that are not solved: `Motion.residual` is what the
            largest is off by, and the status is `Status.CONVERGED` where that counts as zero.

        Raises:
            InputError: `x` is no array of n numbers.
        """
        x = self._checked(x)
        with numbers(self.known):
            q, gap = self._scattered(x), largest(self._all_rows(x))
            met = gap <= tolerance(self._equations, q)
            status = jnp.where(met, int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE))
            return motion_of(self.system, self._plan, q, self.known[: len(self._plan.driven)], status, gap, None)

    def _checked(self, x: Any) -> Array:
        count = len(self._plan.unknown)
        what = f"x, the unknowns of {self.system.name!r},"
        return jnp.asarray(as_shape(x, what, count, dtype=self.system.dtype))

    def _scattered(self, x: Array) -> Array:
        return self._plan.join(x, self.known, self._equations.home[self._plan.fixed])

    def _all_rows(self, x: Array) -> Array:
        return self._plan.residual(self._equations, self._scattered(x))

    def __repr__(self) -> str:
        how = counted(len(self._plan.rows), "row") + (" by least squares" if self._chosen is None else "")
        if self._chosen is not None and len(self._chosen) < len(self._plan.rows):
            how = f"{len(self._chosen)} of {how}"
        return f"ClosedEquations({self.system.name!r}: {counted(len(self._plan.unknown), 'unknown')}, {how})"


@public
@as_its_system
def closed(
    system: System,
    inputs: Inputs,
    hold: Sequence[str] = (),
    start: Mapping[str, Any] | Motion | None = None,
    redundancy: str = REDUNDANCY[1],
    unit: str | None = None,
) -> ClosedEquations:
    """Close a mechanism for one set of inputs: as many equations as unknowns, for a solver of your own.

    The result is a pytree of arrays. It is made and used inside of ``jit``, ``vmap`` and ``grad`` alike, with inputs,
    design or both traced; by the implicit function theorem its roots have the derivatives that `jaxnc.solve_position`
    gives.

    Where a mechanism has redundant rows, those are solved that the library itself eliminates with: rows that are
    independent in the drawing that was compiled. Where no such choice is known (large systems with redundant rows), or
    if you ask for it, all rows are solved in the sense of least squares: the residual is then ``Jᵀ r``.

    Args:
        system: the system.
        inputs: one value of each driven coordinate, by name; radians and lengths.
        hold: free coordinates that keep the value they have in the start pose.
        start: where the unknowns start: an earlier pose, or places and values by name. The assembled drawing if not
            given: a solver that is not led there may end on another branch, or nowhere, when the inputs are far from
            the drawing's.
        redundancy: ``"independent rows"`` or ``"least squares"``; the same where no row is redundant. The second
            follows changes of the design that contradict redundant rows as `jaxnc.solve_position` does.
        unit: what angles of `inputs` and `start` are given in, ``"rad"`` or ``"deg"``.

    Returns:
        The equations.

    Raises:
        InputError: unknown, too many or too few inputs, values that are not finite, several values of one input.
    """
    if redundancy not in REDUNDANCY:
        raise InputError(f"redundancy={redundancy!r}; {nearest(redundancy, REDUNDANCY)}")
    view, values, start = check_inputs(system, inputs, hold, unit, start)
    if shape := values.shape[:-1]:
        raise InputError(
            f"closed() is of one pose, and its inputs have the shape {shape}: map it over them, such as "
            f"jax.vmap(lambda x: nc.system.closed(system, {{{next(iter(inputs))!r}: x}}))(values)"
        )
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(system))
    eq = derived(system, differentiate_scales=True) if traced else derive(system)
    drawn = settle(eq, np.zeros(len(system.topology.coordinates))).q
    q = jnp.asarray(begin_at(system, view, eq, drawn, start, values))
    known = jnp.concatenate([jnp.asarray(values, q.dtype), q[np.array(view.held, int)]])
    chosen = None if redundancy == REDUNDANCY[0] and not view.square else _solved_rows(view)
    return ClosedEquations(system, known, lax.stop_gradient(q[view.unknown]), eq, view, chosen)


def _solved_rows(view: Plan) -> tuple[int, ...] | None:
    """Places of the rows to solve a plan with; None where nobody knows which are independent."""
    if view.square:
        return tuple(range(len(view.rows)))
    if view.topology.special is None:
        return None
    return tuple(sorted(int(row) for rows, _ in view.choice for row in rows))
