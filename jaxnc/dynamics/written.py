"""Accelerations and projections of small mechanisms, written out element by element.

An element is a number, or a lane of numbers when the whole is mapped. Coordinates without mass of their own (angles,
further points of a body) follow from rows that are always regular in them and are eliminated first; on the rest the
mass matrix is positive definite, its inverse is made once for a design, and ``J M⁻¹ Jᵀ`` is factorised without pivots,
which is safe in every pose that is not singular.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import Dynamics, _force, _functions, variables
from jaxnc.records import record, static
from jaxnc.solvers import linear
from jaxnc.solvers.lanes import Rows
from jaxnc.solvers.plan import Plan
from jaxnc.system.structure import curvature, pattern, quadratic
from jaxnc.system.topology import Topology
from jaxnc.types import Array

LARGEST = 16  # unknowns and rows that are written out: beyond, compiling takes too long

RUNGE_KUTTA = np.array([0.0, 0.5, 0.5, 1.0]), np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
"""The classical method of fourth order: how far ahead a stage looks, by the rates of the one before, and its share."""

Elements = Sequence[Any]


class Written:
    """The rows of a view, and the order in which its massless coordinates follow. Make it with `written`.

    Attributes:
        massed: coordinates with mass that are solved for.
        massless: pairs (coordinate, row) in the order in which they are eliminated; rows by place in `rows`.
        kept: places of the rows that are left.
    """

    def __init__(self, view: Plan, massless: tuple[tuple[int, int], ...]):
        top = view.topology
        self.top, self.view = top, view
        self.rows = Rows(top, [int(r) for r in view.rows], [int(c) for c in view.unknown])
        self.place = {int(c): k for k, c in enumerate(view.unknown)}
        self.massless = massless
        gone = {c for c, _ in massless}
        self.massed = tuple(int(c) for c in view.unknown if int(c) not in gone)
        self.kept = tuple(r for r in range(len(view.rows)) if r not in {r for _, r in massless})

    def bias(self, eq: Any, x: Elements, v: Elements) -> list[Any]:
        """d²Φ/dt² without accelerations, row by row."""

        def first(*x):
            return jax.jvp(lambda *y: tuple(self.rows.values(eq, y)), x, tuple(v))[1]

        return list(jax.jvp(first, tuple(x), tuple(v))[1])

    def rates(self, eq: Any, x: Elements, v: Elements) -> list[Any]:
        """dΦ/dt, row by row."""
        return list(jax.jvp(lambda *y: tuple(self.rows.values(eq, y)), tuple(x), tuple(v))[1])

    def correct(
        self, eq: Any, inverse: Array, x: Elements, miss: Sequence[Any], push: dict[int, Any] | None
    ) -> tuple[dict[int, Any], list[Any]]:
        """Changes of the unknowns that take the rows' `miss` away and answer the forces `push` on them.

        The rows change by their derivatives; ``M δ + Jᵀ λ = push, J δ = -miss``.

        Returns:
            The changes by coordinate, and the multipliers of `kept` rows.
        """
        slopes = self.rows.slopes(eq, x)
        local = {c: k for k, c in enumerate(self.massed)}

        def row(r: int) -> dict[int, Any]:
            return {c: slopes[r, k] for c, k in self.place.items() if (r, k) in slopes}

        follow: dict[int, tuple[dict[int, Any], Any]] = {}

        def reduced(r: int, skip: int = -1) -> tuple[dict[int, Any], Any]:
            """A row in the massed coordinates alone, and its miss."""
            out: dict[int, Any] = {}
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
            terms, rest = reduced(r, c)
            follow[c] = {d: back * f for d, f in terms.items()}, back * rest
        rows = [reduced(r) for r in self.kept]
        n, m = len(self.massed), len(rows)
        w = [[inverse[i, k] for k in range(n)] for i in range(n)]
        pushed = [0.0] * n
        if push is not None:
            total = {c: push.get(c, 0.0) for c in self.massed}
            for c, (terms, _) in follow.items():
                if c in push:
                    for d, f in terms.items():
                        total[d] = total[d] + f * push[c]
            pushed = [sum(w[i][k] * total[c] for c, k in local.items()) for i in range(n)]
        spread = [[sum(e * w[local[c]][i] for c, e in terms.items()) for i in range(n)] for terms, _ in rows]
        right = []
        for terms, rest in rows:
            for c, e in terms.items():
                rest = rest + e * pushed[local[c]]
            right.append(rest)
        square = [[sum(e * spread[j][local[c]] for c, e in rows[i][0].items()) for j in range(i + 1)] for i in range(m)]
        y = _solve(square, right)
        moved = [pushed[i] - sum(y[j] * spread[j][i] for j in range(m)) for i in range(n)]
        out: dict[int, Any] = {c: moved[k] for c, k in local.items()}
        for c, (terms, constant) in follow.items():
            out[c] = constant + sum(f * out[d] for d, f in terms.items())
        return out, y


def _solve(a: list[list[Any]], b: list[Any]) -> list[Any]:
    """Solve with a symmetric positive definite matrix given by its lower half: L D Lᵀ."""
    m = len(b)
    low: list[list[Any]] = [[None] * m for _ in range(m)]
    inverse: list[Any] = []
    scaled: list[list[Any]] = [[None] * m for _ in range(m)]
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
    z = list(b)
    for i in range(m):
        for k in range(i):
            z[i] = z[i] - low[i][k] * z[k]
    z = [v * d for v, d in zip(z, inverse, strict=True)]
    for i in reversed(range(m)):
        for k in range(i + 1, m):
            z[i] = z[i] - low[k][i] * z[k]
    return z


@functools.lru_cache(maxsize=256)
def written(view: Plan, massed: tuple[int, ...], freedom: int) -> Written | None:
    """The written-out form of a view.

    None in space, where rows are redundant, where it is large, or where a massless coordinate does not follow from a
    row that is regular in every pose.
    """
    top = view.topology
    unknown = [int(c) for c in view.unknown]
    if top.dim == 3 or len(unknown) + len(view.rows) > LARGEST or len(view.rows) != len(unknown) - freedom:
        return None
    pairs = _order(top, view, [c for c in unknown if c not in massed])
    return None if pairs is None else Written(view, pairs)


def _order(top: Topology, view: Plan, wanted: list[int]) -> tuple[tuple[int, int], ...] | None:
    """A row for every massless coordinate, in an order in which each row needs only earlier ones."""
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
    """Coordinates that some inertia lives on."""
    from jaxnc.dynamics.inertia import nodes

    out = set()
    for group in top.loads.inertias:
        for index in group:
            for node in nodes(index):
                at = node if node >= 0 else len(top.points) + ~node
                out |= set(range(at * top.dim, (at + 1) * top.dim))
    return tuple(sorted(out))


@record
class Fast:
    """The motion of one design in written-out form: the same questions as to a `Flow`, asked element by element.

    Attributes:
        flow: the motion.
        inverse: inverse of the mass matrix on the massed unknowns.
        freedom: degrees of freedom.
    """

    flow: Flow
    inverse: Array
    freedom: int = static()

    @classmethod
    def of(cls, flow: Flow, freedom: int) -> "Fast | None":
        """The written-out form, or None where there is none."""
        top = flow.dyn.topology
        if flow.drives or flow.redundant or top.loads.friction or not len(flow.view.unknown):
            return None
        form = written(flow.view, massed_coordinates(top), freedom)
        if form is None or not form.massed:
            return None
        at = np.array(form.massed)
        solve = linear.solver(flow.dyn.mass[at[:, None], at[None]])
        return cls(flow, jax.vmap(solve, out_axes=1)(jnp.eye(len(at))), freedom)

    @property
    def form(self) -> Written:
        """The static part."""
        found = written(self.flow.view, massed_coordinates(self.flow.dyn.topology), self.freedom)
        assert found is not None
        return found

    def accelerations(self, t: Any, x: Elements, v: Elements) -> list[Any]:
        """Accelerations of all coordinates."""
        form, dyn = self.form, self.flow.dyn
        push = pushes(dyn, t, x, v, form.place)
        change, _ = form.correct(dyn.eq, self.inverse, x, form.bias(dyn.eq, x, v), push)
        zero = jnp.zeros_like(x[0] * 0.0)
        return [change.get(c, zero) for c in range(len(x))]

    def both(self, t: Any, x: Elements, v: Elements) -> tuple[list[Any], list[Any]]:
        """Accelerations of all coordinates, and multipliers of all rows of the view."""
        form, dyn = self.form, self.flow.dyn
        push = pushes(dyn, t, x, v, form.place)
        change, kept = form.correct(dyn.eq, self.inverse, x, form.bias(dyn.eq, x, v), push)
        lam: dict[int, Any] = dict(zip(form.kept, kept, strict=True))
        slopes = form.rows.slopes(dyn.eq, x)
        for c, r in reversed(form.massless):
            k = form.place[c]
            rest = push.get(c, 0.0)
            for (row, column), e in slopes.items():
                if column == k and row != r:
                    rest = rest - e * lam[row]
            lam[r] = rest / slopes[r, k]
        zero = jnp.zeros_like(x[0] * 0.0)
        return [change.get(c, zero) for c in range(len(x))], [lam[r] for r in range(len(lam))]

    def accelerate(self, t: Any, q: Array, v: Array) -> Array:
        """Accelerations ``(N,)``."""
        return jnp.stack(self.accelerations(t, list(q), list(v)))

    def project(self, q: Array, v: Array, iterations: int = 1) -> tuple[Array, Array]:
        """Pose and rates ``(N,)`` on the constraints."""
        x, dx = list(q), list(v)
        for _ in range(iterations):
            x = self.on_positions(x)
        return jnp.stack(x), jnp.stack(self.on_velocities(x, dx))

    def on_positions(self, x: Elements) -> list[Any]:
        """A pose close by that meets the constraints."""
        form, eq = self.form, self.flow.dyn.eq
        change, _ = form.correct(eq, self.inverse, x, form.rows.values(eq, x), None)
        return [x[c] + change[c] if c in change else x[c] for c in range(len(x))]

    def on_velocities(self, x: Elements, v: Elements) -> list[Any]:
        """Rates that meet the constraints, least changed in kinetic energy."""
        form, eq = self.form, self.flow.dyn.eq
        change, _ = form.correct(eq, self.inverse, x, form.rates(eq, x, v), None)
        return [v[c] + change[c] if c in change else v[c] for c in range(len(v))]


def pushes(dyn: Dynamics, t: Any, x: Elements, v: Elements, wanted: dict[int, int]) -> dict[int, Any]:
    """Generalised forces by coordinate; what has none is left out."""
    top, out = dyn.topology, {}
    if top.loads.gravity:
        weight = dyn.gravity @ dyn.moments
        out = {c: weight[c] for c in massed_coordinates(top) if c in wanted}
    for number, block in enumerate(top.loads.forces):
        for i, at in enumerate(variables(top, number)):
            local = _force(
                top, block, t, jnp.stack([x[c] for c in at]), jnp.stack([v[c] for c in at]), dyn.constants[number][i]
            )
            for k, c in enumerate(map(int, at)):
                if c in wanted:
                    out[c] = out[c] + local[k] if c in out else local[k]
    if top.loads.functions:
        total = sum(_functions(dyn, t, jnp.stack(list(x)), jnp.stack(list(v))), jnp.zeros(len(x)))
        for c in wanted:
            out[c] = out[c] + total[c] if c in out else total[c]
    return out


def runge_kutta(fast: Fast, t: Any, h: Any, x: Elements, v: Elements) -> tuple[list[Any], list[Any]]:
    """A step of the classical method of fourth order, element by element, then the projections."""

    def ahead(x, factor, rate):
        return tuple(a + factor * b for a, b in zip(x, rate, strict=True))

    def stage(state, at):
        (dx, dv), (sum_x, sum_v) = state
        reach, share = at
        dx, dv = (
            ahead(v, reach * h, dv),
            fast.accelerations(t + reach * h, ahead(x, reach * h, dx), ahead(v, reach * h, dv)),
        )
        return ((dx, tuple(dv)), (ahead(sum_x, share * h, dx), ahead(sum_v, share * h, dv))), None

    rest = tuple(jnp.zeros_like(a) for a in x)
    state = ((rest, rest), (tuple(x), tuple(v)))
    (_, (x, v)), _ = jax.lax.scan(stage, state, RUNGE_KUTTA)
    x = fast.on_positions(x)
    return x, fast.on_velocities(x, v)


def march_written(fast: Fast, t: Array, q: Array, v: Array, steps: int) -> tuple[Array, Array]:
    """States at all times ``(T, N)``, with as many equal steps between two times.

    The state is carried coordinate by coordinate, so that mapped over a batch every one of them is one long array.
    """

    def interval(carry, ends):
        t0, t1 = ends
        h = (t1 - t0) / steps

        def one(carry, k):
            x, v = runge_kutta(fast, t0 + k * h, h, *carry)
            return (tuple(x), tuple(v)), None

        carry, _ = jax.lax.scan(one, carry, jnp.arange(steps, dtype=float))
        return carry, carry

    first = tuple(q), tuple(v)
    _, (x, dx) = jax.lax.scan(jax.checkpoint(interval), first, (t[:-1], t[1:]))
    return jnp.concatenate([q[None], jnp.stack(x, axis=1)]), jnp.concatenate([v[None], jnp.stack(dx, axis=1)])


Way = tuple[Flow, Fast | None]
"""A motion, and its written-out form if it has one."""


def each(way: Way, f: Callable, t: Array, qs: Array, vs: Array) -> Any:
    """A function of time, pose and rates at all times: at once where it is written out, else in turn.

    In turn each matrix is factorised by LAPACK; all at once a loop of our own would eliminate them, and fill memory.
    """
    if way[1] is not None:
        return jax.vmap(f)(t, qs, vs)
    return jax.lax.map(lambda at: f(*at), (t, qs, vs))
