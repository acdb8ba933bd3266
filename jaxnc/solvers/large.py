"""The plan of a large system: the same view as `Plan`, with a sparse Jacobian.

Where a dense plan handles a matrix ``(m, n)``, this one handles the vector of its non-zeros. Branches are followed on
the host (`jaxnc.solvers.host.sparse`); here is what derivatives and rates in traced code need of it. Everything is
solved by sparse LU on the host: of the Jacobian where it is square, of the symmetric system [I J; Jᵀ -λ] where there
are more rows than unknowns, or freedoms that are left.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.remembered import with_owner
from jaxnc.solvers.lu import Factoriser
from jaxnc.solvers.pattern import Columns, Pattern, pattern
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations, entries, places, weights
from jaxnc.types import Array, Coordinates, Float

LU = 48  # unknowns of a dense plan beyond which the host solves it by sparse LU: about as many as are written out


@dataclass(frozen=True, eq=False, repr=False)
class LargePlan(Plan):
    """A plan with a sparse Jacobian; the methods are those of `Plan`, a Jacobian is a vector ``(nnz,)``."""

    pattern: Pattern | None = None  # where the non-zeros are
    # Place in them of a number in every column, no two in one row; empty if no inputs are given.
    matched: np.ndarray | None = None

    @property
    def numbers(self) -> Pattern:
        """The pattern, which every large plan has."""
        assert self.pattern is not None
        return self.pattern

    @functools.cached_property
    def lu(self) -> Factoriser:
        """The factorisation of the square Jacobian itself."""
        p = self.numbers
        return Factoriser(p.shape[1], p.rows, p.columns, self.sequence)

    @functools.cached_property
    def augmented(self) -> Factoriser:
        """The factorisation of [I J; Jᵀ -λ], unknowns behind the rows."""
        p, (m, n) = self.numbers, self.numbers.shape
        rows = np.concatenate([np.arange(m), p.rows, m + p.columns, m + np.arange(n)])
        columns = np.concatenate([np.arange(m), m + p.columns, p.rows, m + np.arange(n)])
        return Factoriser(m + n, rows, columns)

    @property
    def stored(self) -> int:
        """Numbers kept for one factorisation of the Jacobian, itself included."""
        factors = self.lu if self.square else self.augmented
        return self.numbers.count + factors.stored

    def linearise(self, eq: Equations, q: Coordinates) -> tuple[Array, Array, Columns]:
        """Rows ``(m,)``, the non-zeros of their derivatives ``(nnz,)``, and the columns of known coordinates."""
        data, known = self.numbers.numbers(entries(eq, q))
        return self.residual(eq, q), data, known

    def symmetric(self, data: Any, damping: Any = 0.0, other: Any = None) -> Any:
        """The numbers of the augmented matrix, for JAX or for NumPy, with another Jacobian in place of the Jᵀ."""
        (m, n), numeric = self.numbers.shape, np if isinstance(data, np.ndarray) else jnp
        below = data if other is None else other
        return numeric.concatenate([np.ones(m), data, below, np.full(n, -1.0) * damping])

    def conditioning(self, eq: Equations, jacobian: Array) -> Array:
        """Smallest pivot over the largest, angles measured as lengths; zero at a singular position."""
        if not len(self.unknown):
            return jnp.ones(())
        data = jacobian / weights(eq)[self.unknown][self.numbers.columns]
        factors = (self.lu, data) if self.square else (self.augmented, self.symmetric(data))
        pivots = factors[0].evaluate(factors[1])[0][-len(self.unknown) :]
        return jnp.min(pivots) / jnp.maximum(jnp.max(pivots), 1e-300)

    def orientation(self, jacobian: Array) -> tuple[Array, Array]:
        """As `Plan.orientation`; what the determinants' sizes are is not told."""
        if not self.square or not len(self.unknown):
            return jnp.ones(1), jnp.zeros(1)
        signs = self.lu.evaluate(jacobian)[1]
        return signs, jnp.zeros_like(signs)

    def relative(self, jacobian: Array, other: Array) -> Array:
        """Sign of det(other ᵀ · jacobian), 0 if singular."""
        signs = self.augmented.evaluate(self.symmetric(jacobian, 0.0, other))[1]
        return (-1.0) ** self.numbers.shape[1] * signs[0]

    def solver(self, jacobian: Array, ok: Array) -> Callable[[Float[Array, " m"]], Float[Array, " n"]]:
        """As `Plan.solver`: exact solves with derivatives; one factorisation forward, one transposed in reverse."""
        m, n = self.numbers.shape
        if n == 0:
            return lambda b: jnp.zeros(0)
        assert self.matched is not None
        spare = np.zeros(self.numbers.count)
        spare[self.matched] = 1.0
        jacobian = jnp.where(ok, jacobian, spare)
        fixed = lax.stop_gradient(jacobian)
        times, back = self.numbers.times, self.numbers.transposed
        if not self.square:
            matrix = self.symmetric(fixed)

            def symmetric(pair):
                y, x = pair
                return y + times(jacobian, x), back(jacobian, y)

            def least_squares(_, pair):
                right = jnp.concatenate(pair)
                both = self.augmented.solve(matrix, right[:, None])[:, 0]
                rest = right - jnp.concatenate([both[:m] + times(fixed, both[m:]), back(fixed, both[:m])])
                both = both + self.augmented.solve(matrix, rest[:, None])[:, 0]
                return both[:m], both[m:]

            return lambda b: lax.custom_linear_solve(
                symmetric, (b, jnp.zeros(n) + 0.0 * jnp.sum(b)), least_squares, symmetric=True
            )[1]

        def direct(_, y, trans=False):
            product = back if trans else times
            x = self.lu.solve(fixed, y[:, None], trans)[:, 0]
            return x + self.lu.solve(fixed, (y - product(fixed, x))[:, None], trans)[:, 0]

        return lambda b: lax.custom_linear_solve(
            lambda x: times(jacobian, x), b, direct, transpose_solve=lambda v, y: direct(v, y, True)
        )


def by_lu(plan: Plan) -> bool:
    """Whether the host solves a plan by sparse LU."""
    return plan.large or (len(plan.unknown) > LU and len(plan.sequence) > 0)


@with_owner
def sparse(plan: Plan) -> LargePlan:
    """The same plan with a sparse Jacobian."""
    if isinstance(plan, LargePlan):
        return plan
    row, column, nonzero = places(plan.topology)
    m, n, known = len(plan.rows), len(plan.unknown), len(plan.known)
    new_row = np.full(len(plan.topology.rows), -1)
    new_row[plan.rows] = np.arange(m)
    where = np.flatnonzero(nonzero & (new_row[row] >= 0) & (plan.inverse[column] < n + known))
    numbers = pattern(where, new_row[row[where]], plan.inverse[column[where]], (m, n), len(row))
    return LargePlan(**{field.name: getattr(plan, field.name) for field in fields(Plan)}, pattern=numbers)
