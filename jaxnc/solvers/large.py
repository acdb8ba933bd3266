"""The plan of a large system: the same view as `Plan`, with a sparse Jacobian.

Where a dense plan handles a matrix ``(m, n)``, this one handles the vector of its non-zeros. Square systems whose
block-triangular form has small diagonal blocks are eliminated by `Reduction`, in JAX; any other by LU on the host; more
rows than unknowns, and freedoms that are left, by LU of the symmetric system [I J; Jᵀ -λ].
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers import dense, linear
from jaxnc.solvers.lu import Factoriser
from jaxnc.solvers.pattern import Columns, Pattern
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.reduction import Reduction, reduction
from jaxnc.system.equations import Equations, entries, weights
from jaxnc.types import Array, Coordinates, Float


@dataclass(frozen=True, eq=False)
class LargePlan(Plan):
    """A plan with a sparse Jacobian; the methods are those of `Plan`, a Jacobian is a vector ``(nnz,)``.

    Attributes:
        pattern: where the non-zeros are.
        matched: place in them of a number in every column, no two in one row; empty if no inputs are given.
    """

    pattern: Pattern | None = None
    matched: np.ndarray | None = None

    @property
    def numbers(self) -> Pattern:
        """The pattern, which every large plan has."""
        assert self.pattern is not None
        return self.pattern

    @functools.cached_property
    def reduction(self) -> Reduction | None:
        """The elimination by blocks, if there is one."""
        return reduction(self.sequence, self.numbers) if self.square else None

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
        if self.square and self.reduction is not None:
            return self.numbers.count + self.reduction.stored
        factors = self.lu if self.square else self.augmented
        return self.numbers.count + factors.stored

    def blank(self) -> Array:
        """A Jacobian of zeros."""
        return jnp.zeros(self.numbers.count)

    def linearise(self, eq: Equations, q: Coordinates) -> tuple[Array, Array, Columns]:
        """Rows ``(m,)``, the non-zeros of their derivatives ``(nnz,)``, and the columns of known coordinates."""
        data, known = self.numbers.numbers(entries(eq, q))
        return self.residual(eq, q), data, known

    def as_lengths(self, jacobian: Array, inner: Array) -> Array:
        """The Jacobian with respect to coordinates as lengths."""
        return jacobian / inner[self.numbers.columns]

    def steps(self, eq: Equations, jacobian: Array, right: Array) -> Array:
        """Newton or Gauss-Newton steps of the unknowns for right-hand sides ``(m, k)``."""
        m, n = self.numbers.shape
        if n == 0:
            return jnp.zeros((0, right.shape[1]))
        if not self.square:
            inner = weights(eq)[self.unknown]
            scaled = self.as_lengths(jacobian, inner)
            padded = jnp.concatenate([right, jnp.zeros((n, right.shape[1]))])
            return self.augmented.solve(self._symmetric(scaled, 0.0), padded)[m:] / inner[:, None]
        if self.reduction is None:
            return self.lu.solve(jacobian, right)
        factors = self.reduction.factorise(jacobian)
        solve = functools.partial(self.reduction.solve, factors)
        return jax.vmap(solve, in_axes=1, out_axes=1)(right)

    def _symmetric(self, data: Array, damping: Array | float, other: Array | None = None) -> Array:
        m, n = self.numbers.shape
        return jnp.concatenate([jnp.ones(m), data, data if other is None else other, jnp.full(n, -1.0) * damping])

    def damped_step(self, jacobian: Array, inner: Array, r: Array, damping: Array) -> Array:
        """Levenberg-Marquardt step, coordinates as lengths by `inner`; damping relative to the mean diagonal."""
        m, n = self.numbers.shape
        data = self.as_lengths(jacobian, inner)
        amount = damping * jnp.sum(data * data) / n + 1e-300
        right = jnp.concatenate([r, jnp.zeros(n)])[:, None]
        return self.augmented.solve(self._symmetric(data, amount), right)[m:, 0] / inner

    def _determinants(self, jacobian: Array) -> tuple[Array, Array, Array]:
        """Of the diagonal blocks of a block elimination: pivots, signs and logarithms of the determinants."""
        assert self.reduction is not None
        blocks = self.reduction.blocks(jacobian)
        b = len(blocks)
        if b == 1:
            return jnp.abs(blocks[0]), jnp.sign(blocks[0, 0]), linear.logarithm(blocks[0, 0])
        if b == 2:
            determinant = blocks[0, 0] * blocks[1, 1] - blocks[0, 1] * blocks[1, 0]
            first = jnp.maximum(jnp.abs(blocks[0, 0]), jnp.abs(blocks[1, 0]))
            first = jnp.where(first > 0, first, 1.0)
            # A block of one unknown is filled up with a one, which is no pivot of the mechanism's.
            second = jnp.where(self.reduction.sizes == 1, first, jnp.abs(determinant) / first)
            return jnp.stack([first, second]), jnp.sign(determinant), linear.logarithm(determinant)
        _, pivots, sign = jax.vmap(lambda x: dense.eliminate(x, jnp.zeros((b, 0))), in_axes=2)(blocks)
        real = np.arange(b)[None, :] < self.reduction.sizes[:, None]
        sizes = jnp.where(real, jnp.abs(pivots), jnp.abs(pivots[:, :1]))
        return sizes.T, sign * jnp.prod(jnp.sign(pivots), axis=1), jnp.sum(linear.logarithm(pivots), axis=1)

    def conditioning(self, eq: Equations, jacobian: Array) -> Array:
        """Smallest pivot over the largest, angles measured as lengths; zero at a singular position."""
        if not len(self.unknown):
            return jnp.ones(())
        data = self.as_lengths(jacobian, weights(eq)[self.unknown])
        if not self.square:
            m = self.numbers.shape[0]
            pivots = self.augmented.evaluate(self._symmetric(data, 0.0))[0][m:]
        elif self.reduction is None:
            pivots = self.lu.evaluate(data)[0]
        else:
            pivots = self._determinants(data)[0]
        return jnp.min(pivots) / jnp.maximum(jnp.max(pivots), 1e-300)

    def orientation(self, jacobian: Array) -> tuple[Array, Array]:
        """As `Plan.orientation`; where there is one factorisation of everything, sizes count as one."""
        if not self.square or not len(self.unknown):
            return jnp.ones(1), jnp.zeros(1)
        if self.reduction is None:
            signs = self.lu.evaluate(jacobian)[1]
            sizes = jnp.zeros_like(signs)
        else:
            _, signs, sizes = self._determinants(jacobian)
        # Blocks of one size stand together there, in the order of the sequence here.
        unknowns = np.array([len(columns) for _, columns in self.sequence])
        order = np.concatenate([np.flatnonzero(unknowns == size) for size in dict.fromkeys(unknowns.tolist())])
        return jnp.concatenate([jnp.ones(1), signs[order]]), jnp.concatenate([jnp.zeros(1), sizes[order]])

    def relative(self, jacobian: Array, other: Array) -> Array:
        """Sign of det(other ᵀ · jacobian), 0 if singular."""
        symmetric = self._symmetric(jacobian, 0.0, other)
        return (-1.0) ** self.numbers.shape[1] * self.augmented.evaluate(symmetric)[2]

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
            matrix = self._symmetric(fixed, 0.0)

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
        if self.reduction is not None:
            # Eliminated here, once, and not within each of the solves.
            forward = functools.partial(self.reduction.solve, self.reduction.factorise(fixed))
            reverse = jax.linear_transpose(forward, jax.ShapeDtypeStruct((m,), jacobian.dtype))
        else:
            forward = reverse = None

        def once(y, trans):
            if forward is None or reverse is None:
                return self.lu.solve(fixed, y[:, None], trans)[:, 0]
            return reverse(y)[0] if trans else forward(y)

        def direct(_, y, trans=False):
            product = back if trans else times
            x = once(y, trans)
            return x + once(y - product(fixed, x), trans)

        return lambda b: lax.custom_linear_solve(
            lambda x: times(jacobian, x), b, direct, transpose_solve=lambda v, y: direct(v, y, True)
        )
