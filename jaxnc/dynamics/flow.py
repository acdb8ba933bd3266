"""Motion under forces: accelerations, and the projections that keep positions and velocities on the constraints.

Rows, their derivatives and their second rates are read from each kind as one straight-line program. A simulation
compiles it with every stage and differentiates it for a gradient, so the program is kept short: values, slopes and
second rates of a kind share what they have in common, or follow from coefficients.

The motion of a small mechanism is written out element by element. An element is a number, or a lane of numbers when the
whole is mapped. Coordinates without mass of their own (angles, further points of a body) follow from rows that are
always regular in them and are eliminated first; on the rest the mass matrix is positive definite, its inverse is made
once for a design, and ``J M⁻¹ Jᵀ`` is factorised without pivots, which is safe in every pose that is not singular.
Where a bar carries a point mass or a body none, it may be singular there; then a multiple of JᵀJ is added to it, which
changes no motion and makes it positive definite, and the sum is factorised in every pose.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc.compiling import on_device
from jaxnc.constraints import Kind
from jaxnc.dynamics.model import Dynamics, force_variables, forces, function_forces, inertia_coordinates, instance_force
from jaxnc.dynamics.wrenches import balance_friction, has_friction
from jaxnc.errors import InputError
from jaxnc.reading import Builder, function, partials, rate
from jaxnc.records import record, static, with_owner
from jaxnc.solvers import dense
from jaxnc.solvers.newton import largest
from jaxnc.solvers.plan import Plan, plan
from jaxnc.solvers.rows import Rows
from jaxnc.solvers.saddle import saddle
from jaxnc.system.equations import Equations, coefficients, slips, weights
from jaxnc.system.structure import curvature, jax_function, pattern, program, quadratic, size, time_rate
from jaxnc.system.topology import INDEX, Topology
from jaxnc.types import AnyArray, Array, ArrayLike, Coordinates, PyTree

Drive = tuple[str, Callable]
"""A coordinate that follows a function of time."""

ACCELERATION, POSITION, VELOCITY = range(3)
"""Stages that a motion solves, see `Flow.solve_stage`."""


# -- rows -------------------------------------------------------------------------------------------------------------


class RowValues(NamedTuple):
    """Constraints of a motion in a state."""

    values: Array  # what the plan's rows are off by, lengths (rows,)
    unknown: Array  # derivatives by the unknown coordinates, those of rows on velocities behind them, (m, unknowns)
    known: Array  # by the driven ones, (m, driven)
    slip: Array  # what the rates of all rows are off by, (m,)
    bent: Array  # how they accelerate without accelerations of the coordinates, d²Φ/dt² - Φ_q q̈, (m,)


_KindReading = tuple[Callable[[list[AnyArray]], AnyArray], tuple[tuple[int, int], ...]]


@functools.lru_cache(maxsize=1024)
def _read_kind(kind: Kind, dim: int) -> _KindReading:
    """Read a kind's rows, slopes and second rates at constant speed as one function, and the places of the slopes.

    Of a quadratic kind the function returns the rows only: the rest follows from coefficients. It takes variables,
    constants and the variables' rates, each with an instance in each place.
    """
    found, count = program(kind, "residual", dim), size(kind, dim)
    if found is None:
        return _read_by_jax(kind, dim)
    if quadratic(kind, dim):
        return function(found, jnp), ()
    slopes, places = partials(found, range(count))
    b = Builder(found.inputs + count)
    at = [where[k] for part in (found, slopes) for where in (b.append(part, b.first),) for k in part.outputs]
    still, bent = b.number(0.0), rate(found, range(count), 2)
    where = b.append(bent, [*b.first, *(still,) * count])
    return function(b.program([*at, *(where[k] for k in bent.outputs)]), jnp), places


def _read_by_jax(kind: Kind, dim: int) -> _KindReading:
    """Read a kind through JAX that has no program."""
    count, both = size(kind, dim), size(kind, dim) + len(kind.constants)
    places = tuple(itertools.product(range(len(kind.rows)), range(count)))
    rows = jax_function(kind, "residual", dim)

    def one(x: Array) -> Array:
        x, way = x[:both], jnp.zeros(both, x.dtype).at[:count].set(x[both:])
        slopes = jax.jacfwd(rows)(x)
        bent = jax.jvp(lambda y: jax.jvp(rows, (y,), (way,))[1], (x,), (way,))[1]
        return jnp.concatenate([rows(x), jnp.stack([slopes[r, v] for r, v in places]), bent])

    return lambda x: tuple(jax.vmap(one, out_axes=1)(jnp.stack(jnp.broadcast_arrays(*x), axis=1))), places


@with_owner
def _row_order(view: Plan) -> np.ndarray:
    """Return the places of the plan's rows among the rows of all blocks, row by row of each."""
    rows = [np.zeros(0, int), *(layout.rows.T.reshape(-1) for layout in view.topology.layout)]
    back = np.empty(len(view.topology.rows), INDEX)
    back[np.concatenate(rows)] = np.arange(len(back))
    return back[view.rows]


def evaluate_rows(view: Plan, eq: Equations, q: Coordinates, v: Coordinates) -> tuple[Array, Array, Array, Array]:
    """Return rows of a plan as lengths, slopes by unknown and known coordinates, and unaccelerated second rates."""
    top = view.topology
    values, slopes, bent = [jnp.zeros(0)], [], [jnp.zeros(0)]
    for b, (block, layout) in enumerate(zip(top.blocks, top.layout, strict=True)):
        if block.kind.rows:
            found = _evaluate_block(top, b, eq, q[layout.variables], v[layout.variables])
            values.append(found[0].reshape(-1))
            slopes.append(found[1].reshape(-1))
            bent.append(found[2].reshape(-1))
    padded = jnp.concatenate([*slopes, jnp.zeros(1)])
    both = sum((padded[g] for g in view.gathers[1:]), padded[view.gathers[0]])
    n, at = len(view.unknown), _row_order(view)
    return jnp.concatenate(values)[at], both[:, :n], both[:, n:], jnp.concatenate(bent)[at]


def _evaluate_block(top: Topology, b: int, eq: Equations, x: Array, dx: Array) -> tuple[Array, Array, Array]:
    """Return a block's rows ``(rows, instances)``, slopes ``(instances, rows, variables)`` and second rates."""
    block, g, h = top.blocks[b], eq.linear[b], eq.quadratic[b]
    count, width = len(block.kind.rows), x.shape[1]
    run, places = _read_kind(block.kind, top.dim)
    found = run([*x.T, *eq.constants[b].T, *dx.T])
    found = jnp.stack([jnp.broadcast_to(f, (block.count,)) for f in found])
    scale = eq.scales[b].T
    values = found[:count] * scale
    if not places and g is not None and h is not None:
        curved = jnp.sum(h * (dx[:, :, None] * dx[:, None, :])[:, None], axis=(2, 3))
        return values, g + jnp.sum(h * x[:, None, None, :], axis=-1), curved.T
    own = np.full((count, width), len(places))  # a zero stands behind the slopes
    own[tuple(np.array(places, int).reshape(-1, 2).T)] = np.arange(len(places))
    local = found[count : count + len(places)] * scale[np.array([r for r, _ in places], int)]
    local = jnp.concatenate([local, jnp.zeros((1, block.count), local.dtype)])
    return values, jnp.moveaxis(local[own], 2, 0), found[count + len(places) :] * scale


# -- motion -----------------------------------------------------------------------------------------------------------


class StageSolution(NamedTuple):
    """The solution of a stage in a state."""

    change: AnyArray  # the accelerations, or by how much the coordinates or rates change, (N,)
    multipliers: AnyArray  # those of the rows that are solved with, (m,)
    gap: Array  # largest residual of the rows in the state, a length
    slip: Array  # the largest of their rates


def select_stage(stage: ArrayLike, *options: Callable[[], PyTree]) -> PyTree:
    """Return the option of a stage, a pytree; of a stage that is known only this option is calculated."""
    if isinstance(stage, int):
        return options[stage]()
    return jax.tree.map(
        lambda *values: jax.lax.select_n(stage, *(jnp.asarray(x, float) for x in values)), *(f() for f in options)
    )


@record
class Flow:
    """The motion of one design under its forces and drives."""

    dyn: Dynamics  # its equations of motion
    view: Plan = static()  # which coordinates are solved for
    drives: tuple[Drive, ...] = static()  # the driven coordinates, functions of time
    redundant: bool = static()  # whether rows are redundant, or may become so at a singular position
    ready: tuple[Array, Array, Array] | None = None  # what `prepare` has put together
    # Further arguments of the drives' functions, arrays for each; none if it is empty.
    drive_args: tuple[tuple[Array, ...], ...] = ()

    @classmethod
    def of(cls, dyn: Dynamics, freedom: int, drives: Sequence[Drive] = (), singular: bool = False) -> "Flow":
        """Return the motion of a design with some coordinates driven."""
        top = dyn.topology
        if top.large:
            raise InputError(
                f"{top.name!r} has {len(top.unknown)} unknowns and is kept sparse; dynamics works with dense matrices: "
                f"compile(sparse=False)"
            )
        view = plan(top, tuple(name for name, _ in drives))  # what is neither fixed nor driven is solved for
        rank = len(top.unknown) - freedom
        many = len(view.rows) > rank or bool(drives) or bool(top.rates)
        return cls(dyn, view, tuple(drives), singular or many)

    # -- what is driven -------------------------------------------------------------------------------------------

    def drive_values(self, t: Array) -> tuple[Array, Array, Array]:
        """Return values, rates and accelerations of the driven coordinates, each ``(k,)``."""
        if not self.drives:
            none = jnp.zeros(0)
            return none, none, none
        out = []
        for k, (_, f) in enumerate(self.drives):
            g = functools.partial(_call_drive, f, self.drive_args[k] if self.drive_args else ())
            dg = functools.partial(time_rate, g)
            out.append((g(t), dg(t), time_rate(dg, t)))
        values, rates, accelerations = (jnp.stack(x) for x in zip(*out, strict=True))
        return values, rates, accelerations

    def impose(self, t: Array, q: Coordinates, v: Coordinates) -> tuple[Coordinates, Coordinates]:
        """Put driven coordinates of a state on their functions of time, and the ground at rest."""
        u, du, _ = self.drive_values(t)
        fixed = self.view.fixed
        q = q.at[self.view.known].set(u)
        return q, v.at[self.view.known].set(du).at[fixed].set(0.0)

    # -- scaled matrices ------------------------------------------------------------------------------------------

    def scale(self) -> tuple[Array, Array, Array]:
        """Return weights of the unknowns as lengths, the size of the mass matrix, and that matrix in both."""
        if self.ready is not None:
            return self.ready
        u = self.view.unknown
        weight = weights(self.dyn.eq)[u]
        mass = self.dyn.mass[u[:, None], u[None]] / (weight[:, None] * weight[None])
        size = jax.lax.stop_gradient(jnp.max(jnp.diagonal(mass), initial=0.0))
        size = jnp.where(size > 0, size, 1.0)
        return weight, size, mass / size

    def prepare(self) -> "Flow":
        """Keep the scaled matrices, which do not depend on the state: XLA would put them together in every step."""
        return dataclasses.replace(self, ready=self.scale())

    # -- rows -----------------------------------------------------------------------------------------------------

    def rows(self, q: Coordinates, v: Coordinates) -> RowValues:
        """Evaluate in a state the plan's rows and, behind them, the rows on velocities alone."""
        top, u, known = self.dyn.topology, self.view.unknown, self.view.known
        found = evaluate_rows(self.view, self.dyn.eq, q, v)
        if top.rates:
            b = coefficients(top, self.dyn.rates, q)
            rest, bent = jax.jvp(lambda x: slips(top, self.dyn.rates, x, v), (q,), (v,))
            by_unknown, by_known = (jnp.concatenate(x) for x in ((found[1], b[:, u]), (found[2], b[:, known])))
            slip = jnp.concatenate([found[1] @ v[u] + found[2] @ v[known], rest])
            return RowValues(found[0], by_unknown, by_known, slip, jnp.concatenate([found[3], bent]))
        return RowValues(*found[:3], found[1] @ v[u] + found[2] @ v[known], found[3])

    def place_multipliers(self, multipliers: Array) -> Array:
        """Put multipliers ``(m,)`` in their places among all rows, rows on velocities last."""
        top = self.dyn.topology
        count = len(top.rows)
        at = np.concatenate([self.view.rows, count + np.arange(len(top.rate_rows), dtype=self.view.rows.dtype)])
        return jnp.zeros(count + len(top.rate_rows)).at[at].set(multipliers)

    def zero_multipliers(self) -> Array:
        """Return zeros in place of the multipliers of `solve_stage`."""
        return jnp.zeros(len(self.view.rows) + len(self.dyn.topology.rate_rows))

    # -- motion ---------------------------------------------------------------------------------------------------

    def solve_stage(self, stage: ArrayLike, t: Array | float, q: Coordinates, v: Coordinates) -> StageSolution:
        """Solve a stage as `solve_frictionless`, for accelerations with friction if there is any."""

        def respond(total: Array) -> tuple[Array, Array, StageSolution]:
            found = self.solve_frictionless(ACCELERATION, t, q, v, total)
            return found.change, self.place_multipliers(found.multipliers), found

        def accelerate() -> StageSolution:
            _, found, slides = balance_friction(self.dyn, t, q, v, respond)
            return found._replace(gap=jnp.where(slides, found.gap, jnp.inf))

        def project() -> StageSolution:
            return self.solve_frictionless(stage, t, q, v)

        if not has_friction(self.dyn):
            return project()
        if isinstance(stage, int):
            return accelerate() if stage == ACCELERATION else project()
        return jax.lax.cond(stage == ACCELERATION, accelerate, project)

    def solve_frictionless(
        self, stage: ArrayLike, t: Array | float, q: Coordinates, v: Coordinates, extra: Array | None = None
    ) -> StageSolution:
        """Solve for accelerations, or for the changes that bring a pose or rates back onto the constraints.

        All three stages are one system of equations with other right-hand sides, ``M q̈ + Φ_qᵀ λ + Bᵀ μ = Q`` with
        forces or without. A program that solves them in turn, with a traced `stage`, contains the system once.

        Args:
            stage: `ACCELERATION`; `POSITION`, the nearest pose that meets the constraints to first order, by the
                masses; or `VELOCITY`, the rates that meet them, least changed in kinetic energy.
            t: time.
            q: pose.
            v: rates.
            extra: further generalised forces ``(N,)``.
        """
        u = self.view.unknown
        j, f, g, base, rows = self.stage_equations(stage, t, q, v, extra)
        weight, size, inner = self.scale()
        x, y = saddle(inner, j, self.redundant)(f, g)
        return StageSolution(base.at[u].set(x / weight), y * size, largest(rows.values), largest(rows.slip))

    def stage_equations(
        self, stage: ArrayLike, t: Array | float, q: Coordinates, v: Coordinates, extra: Array | None = None
    ) -> tuple[Array, Array, Array, Array, RowValues]:
        """Return the scaled system of a stage: its jacobian ``(m, n)``, and right-hand sides ``(n,)`` and ``(m,)``.

        Behind these come the change of the driven coordinates ``(N,)``, and the rows in the state.
        Arguments are those of `solve_frictionless`.
        """
        view, dyn, u = self.view, self.dyn, self.view.unknown
        rows = self.rows(q, v)
        r, j, known, slip, bent = rows
        gaps, still = jnp.concatenate([r, jnp.zeros(len(slip) - len(r))]), jnp.zeros_like(q)
        weight, size, _ = self.scale()

        @functools.cache
        def drive() -> Array:
            return still.at[view.known].set(self.drive_values(jnp.asarray(t, float))[2])

        def push() -> Array:
            right = forces(dyn, jnp.asarray(t, float), q, v) - dyn.mass @ drive()
            return (right if extra is None else right + extra)[u] / (weight * size)

        def bend() -> Array:
            return -bent - known @ drive()[view.known]

        f = select_stage(stage, push, lambda: still[u], lambda: still[u])
        g = select_stage(stage, bend, lambda: -gaps, lambda: -slip)
        if len(slip) > len(r):  # rows on velocities say nothing of where a pose belongs
            j = j.at[len(r) :].multiply(select_stage(stage, lambda: 1.0, lambda: 0.0, lambda: 1.0))
        base = select_stage(stage, drive, lambda: still, lambda: still)
        return j / weight, f, g, base, rows

    def accelerate(
        self, t: Array | float, q: Coordinates, v: Coordinates, extra: Array | None = None
    ) -> tuple[Coordinates, Array]:
        """Solve for accelerations without friction ``(N,)``, and multipliers of the rows, those on velocities last."""
        return self.solve_frictionless(ACCELERATION, t, q, v, extra)[:2]

    def project_position(self, q: Coordinates, iterations: int) -> Coordinates:
        """Project a pose on the constraints: to the nearest one by the masses, from one close by."""
        still = jnp.zeros_like(q)

        def closer(q, _):
            return q + self.solve_stage(POSITION, 0.0, q, still).change, None

        return jax.lax.scan(closer, q, None, length=iterations)[0]

    def project_velocity(self, q: Coordinates, v: Coordinates) -> Coordinates:
        """Project rates on the constraints, with the least change in kinetic energy."""
        return v + self.solve_stage(VELOCITY, 0.0, q, v).change


def _call_drive(f: Callable, args: Sequence[Array], t: Array) -> Array:
    return jnp.asarray(f(t, *args), float)


# -- small mechanisms, written out ------------------------------------------------------------------------------------


Elements = Sequence[AnyArray]


class WrittenRows:
    """The rows of a plan, and the order in which its massless coordinates follow. Make it with `write_out`."""

    def __init__(self, view: Plan, massless: tuple[tuple[int, int], ...]):
        top = view.topology
        self.top, self.view = top, view
        self.rows = Rows(top, [int(r) for r in view.rows], [int(c) for c in view.unknown])
        self.place = {int(c): k for k, c in enumerate(view.unknown)}
        # Pairs (coordinate, row) in the order in which they are eliminated; rows by place in `rows`.
        self.massless = massless
        gone = {c for c, _ in massless}
        # Coordinates with mass that are solved for.
        self.massed = tuple(int(c) for c in view.unknown if int(c) not in gone)
        # Places of the rows that are left.
        self.kept = tuple(r for r in range(len(view.rows)) if r not in {r for _, r in massless})

    def rates(self, eq: Equations, x: Elements, v: Elements) -> tuple[list[AnyArray], list[AnyArray], list[AnyArray]]:
        """Return Φ, dΦ/dt, and d²Φ/dt² without accelerations, row by row."""

        def first(*x):
            return jax.jvp(lambda *y: tuple(self.rows.values(eq, y)), x, tuple(v))

        (values, rates), (_, bias) = jax.jvp(first, tuple(x), tuple(v))
        return list(values), list(rates), list(bias)

    def correct(
        self,
        eq: Equations,
        mass: Array,
        inverse: Array | None,
        x: Elements,
        miss: Sequence[Array],
        push: dict[int, Array] | None,
    ) -> tuple[dict[int, AnyArray], list[AnyArray]]:
        """Solve ``M δ + Jᵀ λ = push, J δ = -miss`` for changes of the unknowns and multipliers of the `kept` rows.

        The changes take the rows' `miss` away, as the rows change by their derivatives. M is the `mass` of the massed
        coordinates. Without its `inverse` a multiple of ``JᵀJ δ = -Jᵀ miss`` is added to the first equation: M may be
        singular then.
        """
        slopes = self.rows.slopes(eq, x)
        local = {c: k for k, c in enumerate(self.massed)}

        def row(r: int) -> dict[int, Array]:
            return {c: slopes[r, k] for c, k in self.place.items() if (r, k) in slopes}

        follow: dict[int, tuple[dict[int, AnyArray], AnyArray]] = {}

        def reduce_row(r: int, skip: int = -1) -> tuple[dict[int, Array], Array]:
            """A row in the massed coordinates alone, and its miss."""
            out: dict[int, AnyArray] = {}
            rest = miss[r]
            for c, e in row(r).items():
                if c == skip:
                    continue
                if c in local:
                    out[c] = out[c] + e if c in out else e
                    continue
                terms, constant = follow[c]
                rest = rest + e * constant
                for d, f in terms.items():
                    out[d] = out[d] + e * f if d in out else e * f
            return out, rest

        for c, r in self.massless:
            back = -1.0 / slopes[r, self.place[c]]
            terms, rest = reduce_row(r, c)
            follow[c] = {d: back * f for d, f in terms.items()}, back * rest
        rows = [reduce_row(r) for r in self.kept]
        n, m = len(self.massed), len(rows)
        pushed: list[AnyArray] = [0.0] * n
        if push is not None:
            total = {c: push.get(c, 0.0) for c in self.massed}
            for c, (terms, _) in follow.items():
                if c in push:
                    for d, f in terms.items():
                        total[d] = total[d] + f * push[c]
            pushed = [total[c] for c in self.massed]
        if inverse is None:
            size = lax.stop_gradient(functools.reduce(jnp.maximum, [mass[i][i] for i in range(n)]))
            whole = [[mass[i][k] for k in range(i + 1)] for i in range(n)]
            for terms, rest in rows:
                for c, e in terms.items():
                    i, heavy = local[c], size * e
                    pushed[i] = pushed[i] - heavy * rest
                    for d, f in terms.items():
                        if local[d] <= i:
                            whole[i][local[d]] = whole[i][local[d]] + heavy * f
            solve = _factorise(whole)
        else:
            solve = functools.partial(_multiply_elements, inverse)
        free = solve(pushed)
        spread = [solve([terms.get(c, 0.0) for c in self.massed]) for terms, _ in rows]
        right = []
        for terms, rest in rows:
            for c, e in terms.items():
                rest = rest + e * free[local[c]]
            right.append(rest)
        square = [[sum(e * spread[j][local[c]] for c, e in rows[i][0].items()) for j in range(i + 1)] for i in range(m)]
        y = _factorise(square)(right)
        moved = [free[i] - sum(y[j] * spread[j][i] for j in range(m)) for i in range(n)]
        out: dict[int, AnyArray] = {c: moved[k] for c, k in local.items()}
        for c, (terms, constant) in follow.items():
            out[c] = constant + sum(f * out[d] for d, f in terms.items())
        return out, y


def _factorise(a: list[list[AnyArray]]) -> Callable[[list], list]:
    """Factorise a symmetric positive definite matrix given by its lower half, L D Lᵀ; return what solves with it."""
    m = len(a)
    low: list[list[AnyArray]] = [[None] * m for _ in range(m)]
    inverse: list[AnyArray] = []
    scaled: list[list[AnyArray]] = [[None] * m for _ in range(m)]
    for i in range(m):
        for j in range(i):
            e = a[i][j]
            for k in range(j):
                e = e - scaled[i][k] * low[j][k]
            scaled[i][j] = e
            low[i][j] = e * inverse[j]
        d = a[i][i]
        for k in range(i):
            d = d - scaled[i][k] * low[i][k]
        inverse.append(1.0 / d)

    def solve(b: list) -> list:
        z = list(b)
        for i in range(m):
            for k in range(i):
                if not _is_none(z[k]):
                    z[i] = z[i] - low[i][k] * z[k]
        z = [v * d for v, d in zip(z, inverse, strict=True)]
        for i in reversed(range(m)):
            for k in range(i + 1, m):
                z[i] = z[i] - low[k][i] * z[k]
        return z

    return solve


def _multiply_elements(matrix: Array, x: list) -> list:
    """Multiply a symmetric matrix with elements."""
    n = len(x)
    return [sum((x[k] * matrix[k][i] for k in range(n) if not _is_none(x[k])), 0.0) for i in range(n)]


def _is_none(x: AnyArray | float) -> bool:
    """Tell whether an element is zero whatever the numbers are, so that nothing is calculated with it."""
    return isinstance(x, float) and x == 0.0


@with_owner
def write_out(view: Plan, massed: tuple[int, ...], freedom: int) -> WrittenRows | None:
    """Write out the motion of a plan.

    Returns:
        The form; None in space, where rows are redundant, of a large plan, or where a massless coordinate does not
        follow from a row that is regular in every pose.
    """
    top = view.topology
    unknown = [int(c) for c in view.unknown]
    # more than 16 unknowns and rows are not written out: compiling would take too long
    if top.dim == 3 or len(unknown) + len(view.rows) > 16 or len(view.rows) != len(unknown) - freedom:
        return None
    pairs = _eliminate_massless(top, view, [c for c in unknown if c not in massed])
    return None if pairs is None else WrittenRows(view, pairs)


def _eliminate_massless(top: Topology, view: Plan, wanted: list[int]) -> tuple[tuple[int, int], ...] | None:
    """Choose a row for every massless coordinate, in an order in which each row needs only earlier ones."""
    place = {int(r): k for k, r in enumerate(view.rows)}
    options: dict[int, list[tuple[int, set[int]]]] = {c: [] for c in wanted}
    for block, layout in zip(top.blocks, top.layout, strict=True):
        kind, sparse = block.kind, pattern(block.kind, top.dim)
        every = tuple(range(layout.variables.shape[1]))
        bent = curvature(kind, top.dim, every) if quadratic(kind, top.dim) else None
        for i in range(block.count):
            at = [int(c) for c in layout.variables[i]]
            for k, r in enumerate(layout.rows[i]):
                if int(r) not in place:
                    continue
                needs = {c for v, c in enumerate(at) if sparse[k, v] and c in options}
                for v, c in enumerate(at):
                    if c not in options or not sparse[k, v] or at.count(c) > 1:
                        continue
                    measured = kind.measure is not None and len(kind.rows) == 1 and v == len(at) - 1
                    pairs = None if bent is None else bent[k]
                    constant = pairs is not None and all(v not in pair for pair in pairs)
                    if measured or constant:
                        options[c].append((place[int(r)], needs - {c}))
    done: list[tuple[int, int]] = []
    used: set[int] = set()
    left = set(wanted)
    while left:
        found = next(
            ((c, r) for c in sorted(left) for r, needs in options[c] if r not in used and not needs & left), None
        )
        if found is None:
            return None
        done.append(found)
        used.add(found[1])
        left.discard(found[0])
    return tuple(done)


def massed_coordinates(top: Topology) -> tuple[int, ...]:
    """List the coordinates that some inertia lives on."""
    return tuple(sorted({int(c) for group in top.loads.inertias for c in inertia_coordinates(top, group).reshape(-1)}))


@record
class WrittenFlow:
    """The motion of one design in written-out form: a `Flow` that works element by element."""

    flow: Flow  # the motion
    mass: Array  # the mass matrix on the massed unknowns
    inverse: Array | None  # its inverse, which is not needed where it may be singular
    form: WrittenRows = static()  # the rows, and what follows from which

    @classmethod
    def of(cls, flow: Flow, freedom: int) -> "WrittenFlow | None":
        """Return the written-out form of a motion, or None where there is none."""
        top = flow.dyn.topology
        if flow.drives or flow.redundant or top.loads.friction or not len(flow.view.unknown):
            return None
        form = write_out(flow.view, massed_coordinates(top), freedom)
        if form is None or not form.massed:
            return None
        at = np.array(form.massed)
        mass = flow.dyn.mass[at[:, None], at[None]]
        if not isinstance(mass, Tracer):
            known = np.asarray(mass)
            try:
                inverse = np.linalg.inv(known)
            except np.linalg.LinAlgError:
                return cls(flow, mass, None, form)
            return cls(flow, mass, on_device(inverse) if _is_fit_inverse(known, inverse) else None, form)
        if any(inertia.singular for group in top.loads.inertias for inertia in group):
            return cls(flow, mass, None, form)
        return cls(flow, mass, jax.vmap(dense.solver(mass), out_axes=1)(jnp.eye(len(at))), form)

    def break_off(self, state: Any) -> Any:
        """Break a motion off whose design has lost mass or inertia since it was compiled, so that M has no inverse."""
        if self.inverse is None:
            return state
        regular = _is_fit_inverse(*lax.stop_gradient((self.mass, self.inverse)))
        return state._replace(gap=jnp.where(regular, state.gap, jnp.inf))

    @property
    def redundant(self) -> bool:
        """True if rows are redundant, which are not written out."""
        return False

    def impose(self, t: Array, q: object, v: object) -> tuple[AnyArray, AnyArray]:
        """Return the state as it is: nothing is driven."""
        return q, v

    def solve_stage(self, stage: Array, t: Array, q: AnyArray, v: AnyArray) -> StageSolution:
        """Solve a stage as `Flow.solve_stage`; of arrays ``(N,)``, or of tuples of their elements."""
        if not isinstance(q, tuple):
            found = self.solve_stage(stage, t, tuple(q), tuple(v))
            return found._replace(change=jnp.stack(found.change))
        solvers = (self._accelerate, self._correct, functools.partial(self._correct, rates=True))
        return solvers[stage](t, q, v) if isinstance(stage, int) else lax.switch(stage, solvers, t, q, v)

    def _correct(self, t: Array, x: Elements, v: Elements, rates: bool = False) -> StageSolution:
        """Bring a pose, or its rates, back onto the constraints."""
        form, eq, zero = self.form, self.flow.dyn.eq, jnp.zeros_like(x[0])
        miss = form.rates(eq, x, v)[1] if rates else form.rows.values(eq, x)
        change, _ = form.correct(eq, self.mass, self.inverse, x, miss, None)
        none = jnp.zeros(len(form.view.rows), zero.dtype)
        return StageSolution(tuple(change.get(c, zero) for c in range(len(x))), none, zero, zero)

    def _accelerate(self, t: Array, x: Elements, v: Elements) -> StageSolution:
        form, dyn, zero = self.form, self.flow.dyn, jnp.zeros_like(x[0])
        values, rates, bias = form.rates(dyn.eq, x, v)
        push = force_elements(dyn, t, x, v, form.place)
        change, kept = form.correct(dyn.eq, self.mass, self.inverse, x, bias, push)
        lam: dict[int, AnyArray] = dict(zip(form.kept, kept, strict=True))
        slopes = form.rows.slopes(dyn.eq, x)
        for c, r in reversed(form.massless):
            k = form.place[c]
            rest = push.get(c, 0.0)
            for (row, column), e in slopes.items():
                if column == k and row != r:
                    rest = rest - e * lam[row]
            lam[r] = rest / slopes[r, k]
        gap, slip = (functools.reduce(jnp.maximum, map(jnp.abs, rows), zero) for rows in (values, rates))
        multipliers = jnp.stack([lam[r] for r in range(len(lam))]) if lam else jnp.zeros(0)
        return StageSolution(tuple(change.get(c, zero) for c in range(len(x))), multipliers, gap, slip)


def _is_fit_inverse(mass: AnyArray, inverse: AnyArray) -> Any:
    """Tell whether the inverse of a mass matrix is good for something: it errs by the square of what this looks at."""
    return abs(mass.diagonal() * inverse.diagonal()).max() < float(np.finfo(mass.dtype).eps) ** -0.3


def force_elements(dyn: Dynamics, t: Array, x: Elements, v: Elements, wanted: dict[int, int]) -> dict[int, AnyArray]:
    """Evaluate generalised forces by coordinate; a coordinate without forces is left out."""
    top, out = dyn.topology, {}
    if top.loads.gravity:
        weight = dyn.gravity @ dyn.moments
        out = {c: weight[c] for c in massed_coordinates(top) if c in wanted}
    for number, block in enumerate(top.loads.forces):
        for i, at in enumerate(force_variables(top, number)):
            own, rates = (jnp.stack([array[c] for c in at]) for array in (x, v))
            local = instance_force(top.dim, block.kind, t, own, rates, dyn.constants[number][i])
            for k, c in enumerate(map(int, at)):
                if c in wanted:
                    out[c] = out[c] + local[k] if c in out else local[k]
    if top.loads.functions:
        total = sum(function_forces(dyn, t, jnp.stack(list(x)), jnp.stack(list(v))), jnp.zeros(len(x)))
        for c in wanted:
            out[c] = out[c] + total[c] if c in out else total[c]
    return out
