"""Accelerations and projections of small mechanisms, written out element by element.

An element is a number, or a lane of numbers when the whole is mapped. Coordinates without mass of their own (angles,
further points of a body) follow from rows that are always regular in them and are eliminated first; on the rest the
mass matrix is positive definite, its inverse is made once for a design, and ``J M⁻¹ Jᵀ`` is factorised without pivots,
which is safe in every pose that is not singular.
"""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc.compiling import on_device
from jaxnc.dynamics.flow import Flow, StageSolution
from jaxnc.dynamics.mass import inertia_coordinates
from jaxnc.dynamics.model import Dynamics, force_variables, function_forces, instance_force
from jaxnc.records import record, static
from jaxnc.remembered import with_owner
from jaxnc.solvers import dense
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.rows import Rows
from jaxnc.system.structure import curvature, pattern, quadratic
from jaxnc.system.topology import Topology
from jaxnc.types import AnyArray, Array

if TYPE_CHECKING:
    from jaxnc.system.equations import Equations


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

    def rates(self, eq: "Equations", x: Elements, v: Elements) -> tuple[list[AnyArray], list[AnyArray], list[AnyArray]]:
        """Return Φ, dΦ/dt, and d²Φ/dt² without accelerations, row by row."""

        def first(*x):
            return jax.jvp(lambda *y: tuple(self.rows.values(eq, y)), x, tuple(v))

        (values, rates), (_, bias) = jax.jvp(first, tuple(x), tuple(v))
        return list(values), list(rates), list(bias)

    def correct(
        self, eq: "Equations", inverse: Array, x: Elements, miss: Sequence[Array], push: dict[int, Array] | None
    ) -> tuple[dict[int, AnyArray], list[AnyArray]]:
        """Solve ``M δ + Jᵀ λ = push, J δ = -miss`` for changes of the unknowns and multipliers of the `kept` rows.

        The changes take the rows' `miss` away, as the rows change by their derivatives.
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
        out: dict[int, AnyArray] = {c: moved[k] for c, k in local.items()}
        for c, (terms, constant) in follow.items():
            out[c] = constant + sum(f * out[d] for d, f in terms.items())
        return out, y


def _solve(a: list[list[AnyArray]], b: list[Array]) -> list[Array]:
    """Solve with a symmetric positive definite matrix given by its lower half: L D Lᵀ."""
    m = len(b)
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
    z = list(b)
    for i in range(m):
        for k in range(i):
            z[i] = z[i] - low[i][k] * z[k]
    z = [v * d for v, d in zip(z, inverse, strict=True)]
    for i in reversed(range(m)):
        for k in range(i + 1, m):
            z[i] = z[i] - low[k][i] * z[k]
    return z


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
    inverse: Array  # inverse of the mass matrix on the massed unknowns
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
        if not isinstance(flow.dyn.mass, Tracer):
            return cls(flow, on_device(np.linalg.inv(np.asarray(flow.dyn.mass)[np.ix_(at, at)])), form)
        solve = dense.solver(flow.dyn.mass[at[:, None], at[None]])
        return cls(flow, jax.vmap(solve, out_axes=1)(jnp.eye(len(at))), form)

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
        change, _ = form.correct(eq, self.inverse, x, miss, None)
        none = jnp.zeros(len(form.view.rows), zero.dtype)
        return StageSolution(tuple(change.get(c, zero) for c in range(len(x))), none, zero, zero)

    def _accelerate(self, t: Array, x: Elements, v: Elements) -> StageSolution:
        form, dyn, zero = self.form, self.flow.dyn, jnp.zeros_like(x[0])
        values, rates, bias = form.rates(dyn.eq, x, v)
        push = force_elements(dyn, t, x, v, form.place)
        change, kept = form.correct(dyn.eq, self.inverse, x, bias, push)
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
