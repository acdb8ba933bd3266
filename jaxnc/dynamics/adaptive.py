"""Adaptive integration by diffrax, its steps brought back onto the constraints."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import optimistix

from jaxnc.compiling import filter_jit
from jaxnc.dynamics.friction import settled_forces
from jaxnc.dynamics.state import State
from jaxnc.dynamics.written import Way, each
from jaxnc.status import Status
from jaxnc.types import Array

SOLVERS: dict[str, Callable[[], Any]] = {
    "dopri5": diffrax.Dopri5,
    "dopri8": diffrax.Dopri8,
    "tsit5": diffrax.Tsit5,
    "kvaerno5": diffrax.Kvaerno5,
}
SMALL = 7  # unknowns and rows that are written out here, where much more is compiled with them than in a fixed step


class OnConstraints(diffrax.AbstractWrappedSolver):
    """A solver whose every step ends on the constraints, positions and velocities."""

    solver: diffrax.AbstractSolver

    @property
    def term_structure(self):
        """That of the solver."""
        return self.solver.term_structure

    @property
    def interpolation_cls(self):  # pyright: ignore
        """That of the solver."""
        return self.solver.interpolation_cls

    @property
    def term_compatible_contr_kwargs(self):
        """That of the solver."""
        return self.solver.term_compatible_contr_kwargs

    def order(self, terms):
        """Order of the solver."""
        return self.solver.order(terms)

    def strong_order(self, terms):
        """Order of the solver."""
        return self.solver.strong_order(terms)

    def error_order(self, terms):
        """Order of the solver."""
        return self.solver.error_order(terms)

    def init(self, terms, t0, t1, y0, args):
        """Begin."""
        return self.solver.init(terms, t0, t1, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        """One step of the solver, and the projections."""
        y1, error, dense, state, result = self.solver.step(terms, t0, t1, y0, args, solver_state, made_jump)
        y1 = _settle(args, t1, y1)
        if isinstance(dense, dict) and "y1" in dense:
            dense = {**dense, "y1": y1}
        return y1, error, dense, state, result

    def func(self, terms, t0, y0, args):
        """The right-hand side."""
        return self.solver.func(terms, t0, y0, args)


def _settle(way: Way, t: Any, y: tuple[Array, Array], iterations: int = 1) -> tuple[Array, Array]:
    flow, fast = way
    if fast is not None:
        return fast.project(*y, iterations)
    q, v = flow.impose(t, *y)
    q = flow.project_position(q, iterations)
    return q, flow.project_velocity(q, v)


def _field(t, y, way):
    flow, fast = way
    if fast is not None:
        return y[1], fast.accelerate(t, *y)
    q, v = flow.impose(t, *y)
    return v, settled_forces(flow, t, q, v)[0]


def short(way: Way) -> Way:
    """A motion, written out only where it is very small."""
    view = way[0].view
    return way if len(view.unknown) + len(view.rows) <= SMALL else (way[0], None)


class Adapted(NamedTuple):
    """States at all times, what became of each, steps made, where it ended, and the last state."""

    q: Array
    v: Array
    status: Array
    steps: Array
    rejected: Array
    end: Array


@filter_jit
def adapt(
    way: Way,
    method: str,
    t: Array,
    q: Array,
    v: Array,
    rtol: Array,
    atol: Array,
    first: Array | None,
    event: Callable | None,
    parameters: Any,
    forward: bool,
    most: int,
) -> Adapted:
    """Integrate from the first time, and give the states at all times.

    Args:
        way: the motion.
        method: a key of `SOLVERS`.
        t: times, ``(T,)``.
        q: first pose.
        v: first rates.
        rtol: relative tolerance of a step.
        atol: absolute tolerance, a length (an angle, a rate).
        first: first step; chosen if None.
        event: ``(t, state, parameters) -> number`` whose sign change ends the motion, or None.
        parameters: what the event is given.
        forward: derivatives are taken forward; otherwise in reverse.
        most: the most steps.
    """

    def norm(y):
        return jnp.max(jnp.stack([jnp.sqrt(jnp.mean(x * x)) for x in jax.tree.leaves(y)]))

    span = t[-1] - t[0]
    controller = diffrax.PIDController(rtol=rtol, atol=atol, norm=norm, dtmin=jnp.abs(span) * 1e-13, force_dtmin=False)
    happening = None
    if event is not None:

        def crossing(t, y, args, **_):
            return event(t, State(way[0].dyn.topology, t, *y), parameters)

        happening = diffrax.Event(crossing, optimistix.Bisection(rtol=1e-12, atol=1e-13))
    # An implicit solver is told its tolerances by diffrax and cannot be wrapped: its states are projected where they
    # are kept, and drift by no more than its tolerance in between.
    solver = SOLVERS[method]()
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(_field),
        solver if isinstance(solver, diffrax.AbstractImplicitSolver) else OnConstraints(solver),
        t[0],
        t[-1],
        first,
        (q, v),
        args=way,
        saveat=diffrax.SaveAt(subs=[diffrax.SubSaveAt(ts=t), diffrax.SubSaveAt(t1=True)]),
        stepsize_controller=controller,
        adjoint=diffrax.ForwardMode() if forward else diffrax.RecursiveCheckpointAdjoint(),
        event=happening,
        max_steps=most,
        throw=False,
    )
    assert solution.ys is not None and solution.ts is not None
    (qs, vs), (q_end, v_end) = solution.ys
    end = solution.ts[1][0]
    there = jnp.isfinite(qs).all(axis=1) & jnp.isfinite(vs).all(axis=1)
    good = solution.result == diffrax.RESULTS.successful
    stopped = solution.result == diffrax.RESULTS.event_occurred
    few = solution.result == diffrax.RESULTS.max_steps_reached
    failed = jnp.where(
        stopped, int(Status.STOPPED), jnp.where(few, int(Status.TOO_MANY_STEPS), int(Status.STEP_UNDERFLOW))
    )
    status = jnp.where(there & (good | stopped | (t <= end)), 0, failed)
    last = jnp.where(jnp.isfinite(q_end[0]).all(), 1.0, 0.0) > 0

    def held(all_of, end_of, start):
        end_of = jnp.where(last, jnp.where(jnp.isfinite(end_of), end_of, 0.0), start)
        return jnp.where(there[:, None], jnp.where(jnp.isfinite(all_of), all_of, 0.0), end_of[None])

    qs, vs = held(qs, q_end[0], q), held(vs, v_end[0], v)
    q2, v2 = each(way, lambda t, q, v: _settle(way, t, (q, v), 2), t, qs, vs)
    ok = (status == 0)[:, None]
    qs, vs = jnp.where(ok, q2, qs), jnp.where(ok, v2, vs)
    accepted, rejected = solution.stats["num_accepted_steps"], solution.stats["num_rejected_steps"]
    return Adapted(qs, vs, status, accepted, rejected, end)
