"""The view of a system that a set of inputs gives: which coordinates are solved for, with which rows.

A plan is static: it belongs to a structure and the coordinates that are driven and held, and is made once for them.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.autodiff import solve_linear
from jaxnc.errors import InputError, WrongCount, counted, nearest
from jaxnc.records import with_owner
from jaxnc.solvers import dense
from jaxnc.solvers.elimination import match_rows, pivot_sizes, strong_components
from jaxnc.solvers.sparse_matrix import Factoriser, Pattern
from jaxnc.system.equations import Equations, entries, places, residual, weights
from jaxnc.system.system import drivable
from jaxnc.system.topology import INDEX, Topology
from jaxnc.types import Array, Coordinates, Float, Numbers

LARGEST_WRITTEN = 120  # unknowns that are written out element by element under XLA
TURN = 6.283185482025146484375, -1.748455600074497e-07  # 2π in two parts, of which the first has 24 bits


class Plan:
    """Static view of a system for one set of inputs. Make it with `plan`.

    Args:
        topology: the system's structure, which has no names.
        driven: indices of the inputs, in the order of their values.
        held: indices of free coordinates that keep the value they have in the start pose.
        determined: whether inputs that do not determine the motion are refused.
        independent: what to do with more rows than unknowns: choose independent ones, instead of least squares.
    """

    def __init__(
        self, topology: Topology, driven: tuple[int, ...], held: tuple[int, ...], determined: bool, independent: bool
    ):
        self.topology, self.driven, self.held = topology, driven, held
        self.determined, self.independent = determined, independent
        self.large = topology.large  # whether the Jacobian is kept sparse, see `LargePlan`
        known, fixed = [*driven, *held], np.array(topology.fixed)
        solved, ground = ~fixed, fixed.copy()
        solved[known] = ground[known] = False
        row, column, nonzero = places(topology)
        inner, unknown = nonzero & solved[column], np.flatnonzero(solved)
        rows, r = np.unique(row[inner], return_inverse=True)
        self.known = np.array(known, INDEX)  # indices of driven and held coordinates
        self.unknown = unknown.astype(INDEX)  # indices of the coordinates that are solved for, n of them
        self.fixed = np.flatnonzero(ground).astype(INDEX)  # indices of the rest (ground), which follow the drawing
        self.rows = rows.astype(INDEX)  # indices of the rows that contain an unknown, m of them
        self.square = len(rows) == len(unknown)  # whether there are as many rows as unknowns
        # Which of the known coordinates are angles, and which of them angles that nothing else depends on.
        self.angles: list[int] = np.flatnonzero(topology.mark(topology.angles)[self.known]).tolist()
        self.periodic = topology.mark(topology.periodic)[self.known]
        # Place of every coordinate in the sequence unknown, known, fixed.
        self.inverse = np.argsort(np.concatenate([self.unknown, self.known, self.fixed])).astype(INDEX)
        # A row for every unknown that it is in, no two the same; None unless the motion is determined.
        self.matched: np.ndarray | None = None
        # Rows and columns of the diagonal blocks of the Jacobian's block-triangular form, in an order in which they can
        # be solved one after the other; empty when it is not square.
        self.sequence: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
        if determined:
            c = np.searchsorted(unknown, column[inner])
            self.matched = _match_rows(r, c, (len(rows), len(unknown)), unknown)
            if self.square:
                self.sequence = _triangular_blocks(self.matched, r, c, len(unknown))

    def __repr__(self) -> str:
        sizes = (self.unknown, "unknown"), (self.known, "known coordinate"), (self.rows, "row")
        return f"{type(self).__name__}({', '.join(counted(len(where), noun) for where, noun in sizes)})"

    @property
    def chosen_rows_suffice(self) -> bool:
        """True if the rows that are solved with give all derivatives: the others follow from them in every design."""
        special = self.topology.special
        if self.square:
            return True
        if self.independent or special is None or special.rows is None or not special.sufficient:
            return False
        return int(np.isin(self.rows, special.rows).sum()) == len(self.unknown)

    @functools.cached_property
    def blocks(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """The diagonal blocks of the `sequence`, grouped by size b: arrays ``(count, b)``."""
        sizes: dict[int, list] = {}
        for block in self.sequence:
            sizes.setdefault(len(block[1]), []).append(block)
        parts = (zip(*some, strict=True) for some in sizes.values())
        return tuple((np.array(rows, INDEX), np.array(columns, INDEX)) for rows, columns in parts)

    @functools.cached_property
    def sample(self) -> np.ndarray:
        """Sizes of the derivatives to choose pivots by, ``(m, n)``; structural zeros are zero."""
        return pivot_sizes(self.topology)[np.ix_(self.rows, self.unknown)]

    @functools.cached_property
    def choice(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """The `sequence` of rows to solve with: all or, where some are redundant, well-conditioned independent ones.

        The choice serves as long as it stays regular, which is for the caller to check, with all rows.
        """
        if self.square:
            return self.sequence
        special, n = self.topology.special, len(self.unknown)
        own = special.rows if special else None
        chosen = np.arange(len(self.rows)) if own is None else np.flatnonzero(np.isin(self.rows, own))
        if len(chosen) != n:  # not a design that was compiled: any that determine the unknowns
            r, c = np.nonzero(self.sample)
            chosen = np.sort(_match_rows(r, c, (len(self.rows), n), self.unknown))
        r, c = np.nonzero(self.sample[chosen])
        matched = _match_rows(r, c, (n, n), self.unknown)
        return tuple((chosen[rows], columns) for rows, columns in _triangular_blocks(matched, r, c, n))

    def _find_pattern(self, width: int) -> Pattern:
        """Find where the derivatives are by so many coordinates, of the unknown and then the known ones."""
        row, column, nonzero = places(self.topology)
        new_row = np.full(len(self.topology.rows), -1)
        new_row[self.rows] = np.arange(len(self.rows))
        where = np.flatnonzero(nonzero & (new_row[row] >= 0) & (self.inverse[column] < width))
        r, c = new_row[row[where]], self.inverse[column[where]]
        return Pattern(where, r, c, (len(self.rows), width), len(row))

    @functools.cached_property
    def pattern(self) -> Pattern:
        """Places of the derivatives by the unknown and, behind them, the known coordinates."""
        return self._find_pattern(len(self.unknown) + len(self.known))

    @functools.cached_property
    def gathers(self) -> tuple[np.ndarray, ...]:
        """Index arrays ``(m, n + k)`` into the entries, with a zero appended, whose sum is the Jacobian.

        It is that with respect to the unknown and the known coordinates; there is more than one array only if an
        instance names a point twice.
        """
        p, out = self.pattern, []
        for numbers in p.gathers:
            out.append(np.full(p.shape, p.pad, INDEX))
            out[-1][p.rows, p.columns] = numbers
        return tuple(out)

    def join(self, unknown: Array, known: Array, fixed: Array) -> Coordinates:
        """All coordinates from the three parts; the same for rates and tangents."""
        return jnp.concatenate([unknown, known, fixed])[self.inverse]

    def move(self, q: Coordinates, change: Array) -> Coordinates:
        """The pose with a change of the unknowns added."""
        k = len(self.known) + len(self.fixed)
        return q + jnp.concatenate([change, jnp.zeros(k)])[self.inverse]

    def residual(self, eq: Equations, q: Coordinates) -> Array:
        """Rows that the solver drives to zero, ``(m,)``."""
        return residual(eq, q)[self.rows]

    def linearise(self, eq: Equations, q: Coordinates) -> tuple[Array, Array]:
        """Rows ``(m,)`` and their derivatives with respect to the unknowns, ``(m, n)``."""
        padded = jnp.concatenate([entries(eq, q), jnp.zeros(1)])
        both = sum((padded[g] for g in self.gathers[1:]), padded[self.gathers[0]])
        return self.residual(eq, q), both[:, : len(self.unknown)]

    def solver(self, jacobian: Array, ok: Array) -> Callable[[Array], Array]:
        """Exact solves with derivatives, see `dense.solver`; of a harmless matrix where the pose is not `ok`."""
        return dense.solver(dense.well_posed(jacobian, ok), self.independent)

    def conditioning(self, eq: Equations, jacobian: Array) -> Array:
        """Estimate of the reciprocal condition number, angles measured as lengths; zero at a singular position."""
        return dense.conditioning(jacobian / weights(eq)[self.unknown])

    def same_branch(self, jacobian: Array, other: Array) -> Array:
        """Say whether two poses of one branch can have these Jacobians: no fold lies between them.

        With as many rows as unknowns the signs of the diagonal blocks' determinants tell. With more, the columns of the
        one, seen in the other's, keep their orientation, as long as the poses are not far apart.
        """
        if self.square:
            return jnp.all(self._block_signs(jacobian) == self._block_signs(other))
        return self._relative_sign(jacobian, other) > 0

    def _block_signs(self, jacobian: Array) -> Array:
        """Signs of the diagonal blocks' determinants, which a branch keeps."""
        signs = [jnp.ones(0)]
        for rows, columns in self.blocks:
            a = jacobian[rows[:, :, None], columns[:, None, :]]
            if rows.shape[1] == 1:
                signs.append(jnp.sign(a[:, 0, 0]))
            elif rows.shape[1] == 2:
                signs.append(jnp.sign(a[:, 0, 0] * a[:, 1, 1] - a[:, 0, 1] * a[:, 1, 0]))
            else:
                signs.append(jax.vmap(dense.determinant_sign)(a))
        return jnp.concatenate(signs)

    def _relative_sign(self, jacobian: Array, other: Array) -> Array:
        """Sign of det(otherᵀ · jacobian)."""
        return dense.determinant_sign(other.T @ jacobian)


class LargePlan(Plan):
    """A plan with a sparse Jacobian; the methods are those of `Plan`, a Jacobian is a vector ``(nnz,)``."""

    @functools.cached_property
    def numbers(self) -> Pattern:
        """Places of the non-zeros."""
        return self._find_pattern(len(self.unknown))

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

    def linearise(self, eq: Equations, q: Coordinates) -> tuple[Array, Array]:
        """Rows ``(m,)`` and the non-zeros of their derivatives, ``(nnz,)``."""
        padded = jnp.concatenate([entries(eq, q), jnp.zeros(1)])
        first, *more = self.numbers.gathers
        return self.residual(eq, q), sum((padded[g] for g in more), padded[first])

    def symmetric(self, data: Numbers, damping: Any = 0.0, other: Any = None) -> Any:
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

    def _block_signs(self, jacobian: Array) -> Array:
        return self.lu.evaluate(jacobian)[1] if len(self.unknown) else jnp.ones(0)

    def _relative_sign(self, jacobian: Array, other: Array) -> Array:
        """See `Plan._relative_sign`; 0 if singular."""
        signs = self.augmented.evaluate(self.symmetric(jacobian, 0.0, other))[1]
        return (-1.0) ** self.numbers.shape[1] * signs[0]

    def least_norm(self, eq: Equations, q: Coordinates) -> Callable[[Float[Array, " m"]], Float[Array, " n"]]:
        """Make the changes of the unknowns that move points least of those that change the rows by what is given."""
        (m, n), inner = self.numbers.shape, weights(eq)[self.unknown]
        jacobian = self.linearise(eq, q)[1] / inner[self.numbers.columns]
        damping = 1e-11 * jnp.sum(lax.stop_gradient(jacobian) ** 2) / m
        fixed = self.symmetric(lax.stop_gradient(jacobian), damping)

        def product(pair):
            y, x = pair
            return y + self.numbers.times(jacobian, x), self.numbers.times_transposed(jacobian, y) - damping * x

        def solve(pair):
            both = self.augmented.solve(fixed, jnp.concatenate(pair)[:, None])[:, 0]
            return both[:m], both[m:]

        return lambda b: solve_linear(product, (b, jnp.zeros(n)), solve)[1] / inner

    def solver(self, jacobian: Array, ok: Array) -> Callable[[Float[Array, " m"]], Float[Array, " n"]]:
        """See `Plan.solver`: exact solves with derivatives; one factorisation forward, one transposed in reverse."""
        m, n = self.numbers.shape
        if n == 0:
            return lambda b: jnp.zeros(0)
        assert self.matched is not None
        spare = np.zeros(self.numbers.count)
        spare[self.numbers.place(self.matched, np.arange(n))] = 1.0
        jacobian = jnp.where(ok, jacobian, spare)
        fixed = lax.stop_gradient(jacobian)
        times, back = self.numbers.times, self.numbers.times_transposed
        if not self.square:
            matrix = self.symmetric(fixed)

            def symmetric(pair):
                y, x = pair
                return y + times(jacobian, x), back(jacobian, y)

            def least_squares(pair):
                right = jnp.concatenate(pair)
                both = self.augmented.solve(matrix, right[:, None])[:, 0]
                rest = right - jnp.concatenate([both[:m] + times(fixed, both[m:]), back(fixed, both[:m])])
                both = both + self.augmented.solve(matrix, rest[:, None])[:, 0]
                return both[:m], both[m:]

            return lambda b: solve_linear(symmetric, (b, jnp.zeros(n)), least_squares)[1]

        def direct(_, y, trans=False):
            product = back if trans else times
            x = self.lu.solve(fixed, y[:, None], trans)[:, 0]
            return x + self.lu.solve(fixed, (y - product(fixed, x))[:, None], trans)[:, 0]

        return lambda b: lax.custom_linear_solve(
            lambda x: times(jacobian, x), b, direct, transpose_solve=lambda v, y: direct(v, y, True)
        )


@with_owner
def plan(
    topology: Topology,
    driven: tuple[str, ...],
    held: tuple[str, ...] = (),
    freedom: int | None = None,
    independent: bool = False,
) -> Plan:
    """Make the plan for a set of inputs.

    Args:
        topology: the system's topology.
        driven: names of the driven coordinates.
        held: names of coordinates that keep their start value.
        freedom: degrees of freedom that the inputs must take away; None to let some stay (assembly of the drawing).
        independent: whether to choose independent rows where there are more than unknowns.

    Returns:
        The plan; the same object for arguments that mean the same of one structure, whatever it is called.

    Raises:
        InputError: an unknown name, a name given twice, too few or too many inputs, or inputs that leave a
            coordinate undetermined.
    """
    known = _find_known(topology, driven, held)
    if freedom is not None:
        _check_count(topology, driven, held, sum(not topology.fixed[i] for i in known), freedom)
    try:
        count = len(driven)
        return _plan(topology.structure, tuple(known[:count]), tuple(known[count:]), freedom is not None, independent)
    except _Undetermined as error:
        raise InputError(error.say(topology, driven)) from None


class _Undetermined(InputError):
    """Inputs that a structure cannot be solved with; `say` tells it of a topology and the names of its inputs."""

    def __init__(self, say: Callable[[Topology, tuple[str, ...]], str]):
        super().__init__("these inputs do not determine the motion")
        self.say = say


@with_owner
def _plan(
    topology: Topology, driven: tuple[int, ...], held: tuple[int, ...], determined: bool, independent: bool
) -> Plan:
    made = (LargePlan if topology.large else Plan)(topology, driven, held, determined, independent)
    more = len(made.rows) - len(made.unknown)
    if topology.large and independent and more > 0:
        raise _Undetermined(
            lambda top, _: (
                f"{top.name!r} has {more} more rows than unknowns and is kept sparse; independent rows are "
                f"chosen for dense matrices only: leave redundancy= at 'least squares', or compile(sparse=False)"
            )
        )
    return made


def _find_known(topology: Topology, driven: tuple[str, ...], held: tuple[str, ...]) -> list[int]:
    known = []
    for name in (*driven, *held):
        if name not in topology.position:
            use = "drive" if name in driven else "hold"
            raise InputError(
                f"{topology.name!r} has no coordinate {name!r} to {use}; {nearest(name, drivable(topology))}"
            )
        known.append(topology.position[name])
    if len(set(known)) != len(known):
        both = [name for name in driven if name in held]
        if both:
            raise InputError(f"{both[0]!r} is both driven and held; leave it out of one of them")
        raise InputError(f"an input is given twice: {', '.join((*driven, *held))}")
    return known


def _check_count(topology: Topology, driven: tuple[str, ...], held: tuple[str, ...], given: int, need: int) -> None:
    if given == need:
        return
    grounded = [n for n in (*driven, *held) if topology.fixed[topology.position[n]]]
    names = ", ".join(n for n in (*driven, *held) if n not in grounded) or "none"
    if grounded:
        names += f"; {', '.join(grounded)} of the ground may move too, but takes no freedom"
    free = [n for n in drivable(topology) if n not in (*driven, *held)]
    shown = ", ".join(free[:12]) + (", …" if len(free) > 12 else "")
    freedom = f"{need} degree{'s' if need != 1 else ''} of freedom"
    inputs = f"{given} input{'s were' if given != 1 else ' was'} given ({names})"
    if given < need:
        raise WrongCount(
            f"too few inputs: {topology.name!r} has {freedom}, {inputs}. Drive or hold {need - given} more of the "
            f"free coordinates: {shown}; if it should have fewer freedoms, a joint, a body or fixed= is missing, "
            f"or a row holds nothing: `nc.mobility(system)` says so"
        )
    if not need:
        raise WrongCount(f"too many inputs: {topology.name!r} has {freedom}, so nothing in it can be driven; {inputs}")
    raise WrongCount(
        f"too many inputs: {topology.name!r} has {freedom}, {inputs}. Leave {given - need} of them out; "
        f"the free coordinates are {', '.join(drivable(topology)[:12])}"
    )


def _match_rows(r: np.ndarray, c: np.ndarray, shape: tuple[int, int], unknown: np.ndarray) -> np.ndarray:
    """A row for every unknown; if there is none for some, the inputs do not determine them."""
    columns: list[list[int]] = [[] for _ in range(shape[1])]
    for row, column in sorted(zip(r.tolist(), c.tolist(), strict=True)):
        columns[column].append(row)
    matched = np.array(match_rows(columns, shape[0]), dtype=int)
    lost = [int(unknown[k]) for k in np.flatnonzero(matched < 0)]
    if lost:

        def say(top: Topology, driven: tuple[str, ...]) -> str:
            return (
                f"driving {', '.join(driven) or 'nothing'} does not determine the motion of {top.name!r}: "
                f"{', '.join(top.coordinates[k] for k in lost[:8])} {'stays' if len(lost) == 1 else 'stay'} free while "
                f"other inputs are tied to each other; choose other inputs"
            )

        raise _Undetermined(say)
    return matched


def _triangular_blocks(matched: np.ndarray, r: np.ndarray, c: np.ndarray, n: int) -> tuple:
    """Diagonal blocks ``(rows, columns)`` of the block-triangular form, in an order in which they can be solved.

    They are the strong components of the graph that leads from each unknown, by its matched row, to the others in it.
    """
    owner = np.zeros(n, dtype=int)
    owner[matched] = np.arange(n)
    leads: list[list[int]] = [[] for _ in range(n)]
    for row, column in zip(owner[r].tolist(), c.tolist(), strict=True):
        leads[row].append(column)
    return tuple((matched[k], np.array(k)) for k in strong_components(leads))


def unwind(angles: Numbers, turns: Numbers) -> Any:
    """Take whole turns off angles, of NumPy or JAX: exact to rounding of what is left, however many turns there are.

    One product with 2π would be rounded at the size of the angle: after a thousand turns, 4e-13 were lost.
    """
    return (angles - turns * TURN[0]) - turns * TURN[1]


def by_lu(plan: Plan) -> bool:
    """Say whether the host solves a plan by sparse LU."""
    # As many unknowns as are written out; beyond, sparse LU is sooner done.
    return plan.large or (len(plan.unknown) > 48 and len(plan.sequence) > 0)


@with_owner
def sparse(plan: Plan) -> LargePlan:
    """Return the plan with a sparse Jacobian."""
    if isinstance(plan, LargePlan):
        return plan
    return LargePlan(plan.topology, plan.driven, plan.held, plan.determined, plan.independent)
