"""One step of each method of integration.

A Runge-Kutta step is a loop over its phases: stages, then pose and rates back onto the constraints, then the
accelerations there, which are the first stage of the next step. The solution of a phase is compiled once, whatever the
method is. Positions follow from accelerations alone (``q̇ = v``), so that only those are kept:
``q = q₀ + h c v₀ + h² Σ ā_j a_j`` with ``ā = a a``.

The generalised-α method is implicit and of fixed step, on index 3, for stiff mechanisms.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.autodiff import attach
from jaxnc.dynamics.flow import ACCELERATION, POSITION, VELOCITY, Flow, StageSolution
from jaxnc.dynamics.model import forces
from jaxnc.errors import InputError
from jaxnc.records import record
from jaxnc.solvers import dense
from jaxnc.solvers.saddle import saddle
from jaxnc.system.precision import WIDE, active, limits
from jaxnc.types import AnyArray, Array, ArrayLike, PyTree


class Moving(Protocol):
    """A motion that can be integrated; coordinates are an array, or a tuple with one number for each."""

    @property
    def redundant(self) -> bool:
        """True if rows are redundant, or may become so."""
        ...

    def impose(self, t: AnyArray, q: AnyArray, v: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Put driven coordinates of a state where the drives have them."""
        ...

    def solve_stage(self, stage: AnyArray, t: AnyArray, q: AnyArray, v: AnyArray) -> StageSolution:
        """Solve for accelerations, or for changes that bring a pose or its rates back onto the constraints."""
        ...


class MotionState(NamedTuple):
    """A motion at one time."""

    q: AnyArray  # pose
    v: AnyArray  # rates
    a: AnyArray  # accelerations
    multipliers: AnyArray
    gap: Array  # how far off the constraints the pose was found
    slip: Array  # how far off the rates


class Method(NamedTuple):
    """A Runge-Kutta method whose last stage, explicit and on the constraints, is the first of the next step."""

    times: np.ndarray  # when each stage is, in parts of the step, (s,); the first is 0, the last (at the end) 1
    rows: np.ndarray  # what each stage takes of those before, (s, s); the last row is the step itself
    error: np.ndarray  # what the estimate of the error takes of each, (s,); zero for a method of fixed step
    order: int  # of that estimate
    implicit: float = 0.0  # what every stage but the first and the last takes of itself; 0 for an explicit method

    @property
    def chained(self) -> bool:
        """True if every stage looks at the one before only."""
        return not np.tril(self.rows[:-1], -2).any() and not self.implicit


def _method(rows: list[list[float]], error: list[float], order: int, implicit: float = 0.0) -> Method:
    s = len(rows) + 1
    a = np.zeros((s, s))
    for k, row in enumerate(rows, start=1):
        a[k, : len(row)] = row
        a[k, k] = implicit if k < s - 1 else 0.0
    return Method(
        np.array([*a[:-1].sum(axis=1), 1.0]), a, np.array([*error, *(0.0,) * (s - len(error))]), order, implicit
    )


def _difference(of: list[float], other: list[float]) -> list[float]:
    return [a - b for a, b in zip(of, other, strict=True)]


# fmt: off
_EIGHTH = [
    14005451 / 335480064, 0, 0, 0, 0, -59238493 / 1068277825, 181606767 / 758867731, 561292985 / 797845732,
    -1041891430 / 1371343529, 760417239 / 1151165299, 118820643 / 751138087, -528747749 / 2220607170, 1 / 4,
]
_SEVENTH = [
    13451932 / 455176623, 0, 0, 0, 0, -808719846 / 976000145, 1757004468 / 5645159321, 656045339 / 265891186,
    -3867574721 / 1518517206, 465885868 / 322736535, 53011238 / 667516719, 2 / 45, 0,
]
_FOURTH = [0.13855640231268224, 0, -0.04245337201752043, 0.02446657898003141, 0.61943039072480676, 0.26]
_STIFF = [
    0.13659751177640291, 0, -0.05496908796538376, -0.04118626728321046, 0.62993304899016403, 0.06962479448202728, 0.26,
]

METHODS: dict[str, Method] = {
    "rk4": _method([[1 / 2], [0, 1 / 2], [0, 0, 1], [1 / 6, 1 / 3, 1 / 3, 1 / 6]], [], 4),
    # P. J. Prince, J. R. Dormand, J. Comput. Appl. Math. 7 (1981) 67-75, the pair 8(7)13M.
    "dopri8": _method(
        [
            [1 / 18],
            [1 / 48, 1 / 16],
            [1 / 32, 0, 3 / 32],
            [5 / 16, 0, -75 / 64, 75 / 64],
            [3 / 80, 0, 0, 3 / 16, 3 / 20],
            [29443841 / 614563906, 0, 0, 77736538 / 692538347, -28693883 / 1125000000, 23124283 / 1800000000],
            [
                16016141 / 946692911, 0, 0, 61564180 / 158732637, 22789713 / 633445777, 545815736 / 2771057229,
                -180193667 / 1043307555,
            ],
            [
                39632708 / 573591083, 0, 0, -433636366 / 683701615, -421739975 / 2616292301, 100302831 / 723423059,
                790204164 / 839813087, 800635310 / 3783071287,
            ],
            [
                246121993 / 1340847787, 0, 0, -37695042795 / 15268766246, -309121744 / 1061227803,
                -12992083 / 490766935, 6005943493 / 2108947869, 393006217 / 1396673457, 123872331 / 1001029789,
            ],
            [
                -1028468189 / 846180014, 0, 0, 8478235783 / 508512852, 1311729495 / 1432422823,
                -10304129995 / 1701304382, -48777925059 / 3047939560, 15336726248 / 1032824649,
                -45442868181 / 3398467696, 3065993473 / 597172653,
            ],
            [
                185892177 / 718116043, 0, 0, -3185094517 / 667107341, -477755414 / 1098053517, -703635378 / 230739211,
                5731566787 / 1027545527, 5232866602 / 850066563, -4093664535 / 808688257, 3962137247 / 1805957418,
                65686358 / 487910083,
            ],
            [
                403863854 / 491063109, 0, 0, -5068492393 / 434740067, -411421997 / 543043805, 652783627 / 914296604,
                11173962825 / 925320556, -13158990841 / 6184727034, 3936647629 / 1978049680, -160528059 / 685178525,
                248638103 / 1413531060, 0,
            ],
            _EIGHTH,
        ],
        _difference(_EIGHTH, _SEVENTH),
        8,
    ),
    # A. Kværnø, BIT Numer. Math. 44 (2004) 489-502, the pair 5/4 with an explicit first stage, stiffly accurate.
    "kvaerno5": _method(
        [
            [0.26],
            [0.13, 0.84033320996790809],
            [0.22371961478320505, 0.47675532319799699, -0.06470895363112615],
            [0.16648564323248321, 0.10450018841591720, 0.03631482272098715, -0.13090704451073998],
            _FOURTH[:5],
            _STIFF[:6],
            _STIFF,
        ],
        _difference(_STIFF, [*_FOURTH, 0]),
        5,
        0.26,
    ),
}
# fmt: on


@functools.cache
def phases_of(method: str, settled: bool, dtype: np.dtype = WIDE) -> dict[str, np.ndarray]:
    """Tabulate the phases of a step, a row of every table for each phase.

    There is a table for each width of numbers: JAX remembers what it made of an array, whatever its setting was then.
    """
    found = METHODS[method]
    s = len(found.times)
    stages = np.arange(1, s - 1)  # the first is known, the last comes after the corrections
    ends = [POSITION, VELOCITY, ACCELERATION] if settled else [ACCELERATION]
    number = np.array([*stages, *(s - 1,) * len(ends)])
    tables = {
        "stage": np.array([*(ACCELERATION,) * len(stages), *ends], np.int32),
        "number": number.astype(np.int32),
        "fresh": np.arange(len(number)) <= len(stages),  # where the state is put together from the stages
        "last": number == s - 1,
        "time": found.times[number],
        "speed": found.rows[number],
        "place": (found.rows @ found.rows)[number],
        "share": found.rows[-1][np.minimum(number, s - 1)] * (number < s - 1),
    }
    return {name: x.astype(dtype) if x.dtype == WIDE else x for name, x in tables.items()}


class Phase(NamedTuple):
    """A phase of a step; of all phases, with one more axis in front."""

    t: Array  # its time
    q: Array  # the pose that it is solved at
    v: Array  # the rates
    solution: StageSolution


def step(
    moving: Moving, method: str, settled: bool, t: ArrayLike, h: Array, state: MotionState, known: tuple = ()
) -> tuple[MotionState, tuple[AnyArray, AnyArray], Phase]:
    """Step by a Runge-Kutta method; return the end, estimates of the errors of pose and rates, and all phases.

    `settled` says whether the step ends on the constraints. What is `known` of all phases the motion takes as further
    arguments, its own in each.
    """
    way = METHODS[method]
    stages = (_ChainedStages if way.chained else _StoredStages)(way, h, state)
    solve: Any = _implicit_stage(moving, way.implicit * h, t, state) if way.implicit else None

    def phase(carry, xs):
        row, more = xs
        q, v, memory, last, miss = carry
        at = t + row["time"] * h
        x, dx = stages.point(memory, row)
        q, v = (jax.tree.map(lambda a, b: jnp.where(row["fresh"], a, b), *pair) for pair in ((x, q), (dx, v)))
        q, v = moving.impose(at, q, v)
        if solve is None:
            solution = moving.solve_stage(row["stage"] if settled else ACCELERATION, at, q, v, *more)
        else:
            solution, move = jax.lax.cond(
                row["last"], lambda: (moving.solve_stage(row["stage"], at, q, v), miss), lambda: solve(at, q, v, last)
            )
            miss = jnp.maximum(miss, move)
        found = Phase(at, q, v, solution)
        if settled:
            q, v = _correct(row["stage"], q, v, solution.change)
        return (q, v, stages.add(memory, row, v, solution.change), solution, miss), found

    first = StageSolution(state.a, state.multipliers, state.gap, state.slip)
    start = (state.q, state.v, stages.begin(), first, jnp.zeros(()))
    (q, v, memory, last, miss), each = jax.lax.scan(phase, start, (phases_of(method, settled, active()), known))
    last, errors = MotionState(q, v, *last), stages.errors(memory, miss)
    if settled and not moving.redundant:
        # Corrections are smaller than the estimate, but at singular positions, where they would take energy.
        place, rate = (jax.tree.map(lambda x, k=k: x[k], each.solution.change) for k in (-3, -2))
        if way.error.any():
            errors = errors[0] + jnp.abs(place), errors[1] + jnp.abs(rate)
        else:
            last = last._replace(gap=jnp.where(_tears(h, state, last, rate), jnp.inf, last.gap))
    # What has broken off, also by friction that locks, stays so.
    return last._replace(gap=jnp.where(jnp.isinf(state.gap), jnp.inf, last.gap)), errors, each


def _tears(h: Array, old: MotionState, new: MotionState, correction: AnyArray) -> Array:
    """Tell whether the rates were corrected by so much that the motion behind a step is another one."""

    def most(x: AnyArray) -> Array:
        return functools.reduce(jnp.maximum, [jnp.max(jnp.abs(e)) for e in jax.tree.leaves(x)])

    much, rates, places = jax.lax.stop_gradient((most(correction), most((old.v, new.v)), most(new.q)))
    # Steps that are worth something err by less than a hundredth; what is rounding tears nothing.
    return (much > 0.01 * rates) & (h * much > limits(much).close * 1e-3 * places)


def settle(moving: Moving, t: Array, state: MotionState) -> MotionState:
    """Bring a state's pose and rates onto the constraints, and solve for its accelerations."""
    stages = np.array([*(POSITION,) * 3, VELOCITY, ACCELERATION], np.int32)

    def phase(state, stage):
        q, v = moving.impose(t, state.q, state.v)
        found = moving.solve_stage(stage, t, q, v)
        return MotionState(*_correct(stage, q, v, found.change), *found), None

    return jax.lax.scan(phase, state, stages)[0]


def _correct(stage: Array, q: object, v: Array, change: object) -> tuple[Array, Array]:
    """Add a stage's change to the pose or to the rates."""
    return tuple(
        jax.tree.map(lambda a, b, k=kind: a + jnp.where(stage == k, b, 0.0), x, change)
        for x, kind in ((q, POSITION), (v, VELOCITY))
    )


def _implicit_stage(moving: Moving, part: Array, t: ArrayLike, state: MotionState) -> Callable:
    """Prepare the implicit stages of a step: Newton's method with the matrix of the step's start.

    Returns:
        A function of time, pose and rates without the stage's own part, and a solution near by: the stage's solution,
        and the size of the last correction.
    """

    def there(at, q, v, a):
        return moving.solve_stage(ACCELERATION, at, q + part * part * a, v + part * a)

    slope = jax.jacfwd(lambda a: there(t, state.q, state.v, a).change)(jnp.zeros_like(state.a))
    solve = dense.solver(jnp.eye(len(state.a)) - slope)

    def iterate(at, q, v, near):
        def closer(a, _):
            move = solve(there(at, q, v, a).change - a)
            return a + move, jnp.max(jnp.abs(move))

        a, moves = jax.lax.scan(closer, near.change, None, length=7)  # of Newton's method in an implicit stage
        return near._replace(change=a), moves[-1]

    return iterate


class _ChainedStages:
    """The stages of a method that look at the one before only: sums are carried along, and the last slopes."""

    def __init__(self, method: Method, h: Array, start: MotionState):
        self.method, self.h, self.start = method, h, start

    def begin(self) -> PyTree:
        """Return the memory before the first stage, whose accelerations are known."""
        _, v, a, *_ = self.start
        return (v, a), self._ahead(self.method.rows[-1, 0] * self.h, self.start, (v, a))

    def point(self, memory: PyTree, row: PyTree) -> tuple[PyTree, PyTree]:
        """Return pose and rates of a stage, or of the end."""
        slopes, sums = memory
        ahead = self._ahead(row["time"] * self.h, self.start, slopes)
        return jax.tree.map(lambda x, y: jnp.where(row["last"], x, y), sums, ahead)

    def add(self, memory: PyTree, row: PyTree, v: object, a: object) -> PyTree:
        """Return the memory with the solution of a stage."""
        return (v, a), self._ahead(row["share"] * self.h, memory[1], (v, a))

    def errors(self, memory: PyTree, miss: Array) -> tuple[Array, Array]:
        """Estimate nothing."""
        return jnp.zeros(()), jnp.zeros(())

    def _ahead(self, reach: Array, start: Sequence[Array], slopes: PyTree) -> tuple[Array, Array]:
        """Move pose and rates along their slopes."""
        q, v = (jax.tree.map(lambda x, dx: x + reach * dx, *pair) for pair in zip(start[:2], slopes, strict=True))
        return q, v


class _StoredStages:
    """The stages of any method: the accelerations of all of them are kept."""

    def __init__(self, method: Method, h: Array, start: MotionState):
        self.method, self.h, self.start = method, h, start

    def begin(self) -> Array:
        """Return the memory before the first stage, whose accelerations are known."""
        a = self.start.a
        return jnp.zeros((len(self.method.times), *a.shape), a.dtype).at[0].set(a)

    def point(self, memory: Array, row: PyTree) -> tuple[Array, Array]:
        """Return pose and rates of a stage, or of the end."""
        h, (q, v, *_) = self.h, self.start
        return q + row["time"] * h * v + h * h * (row["place"] @ memory), v + h * (row["speed"] @ memory)

    def add(self, memory: Array, row: PyTree, v: Array, a: Array) -> Array:
        """Return the memory with the solution of a stage."""
        return jnp.where(row["stage"] == ACCELERATION, memory.at[row["number"]].set(a), memory)

    def errors(self, memory: Array, miss: Array) -> tuple[Array, Array]:
        """Estimate the errors of pose and rates; what the stages were not solved to is added."""
        h, weights = self.h, self.method.error.astype(memory.dtype)
        q, v = h * h * ((weights @ self.method.rows) @ memory), h * (weights @ memory)
        return jnp.abs(q) + h * h * miss, jnp.abs(v) + h * miss


# -- generalised alpha ------------------------------------------------------------------------------------------------

_FACTORISATIONS = 3, 3  # in a step, and iterations with each; all are made, so that a step is differentiable


class AlphaState(NamedTuple):
    """A motion between two steps of the generalised-α method."""

    q: Array  # pose
    v: Array  # rates
    a: Array  # the method's own mean of accelerations
    real: Array  # accelerations that the forces and rows balance
    multipliers: Array  # of the plan's rows


def start_alpha(flow: Flow, t: Array, q: Array, v: Array) -> AlphaState:
    """Begin at a state that meets the constraints."""
    a, multipliers = flow.accelerate(t, q, v)
    return AlphaState(q, v, a, a, multipliers)


def alpha_step(flow: Flow, t: Array, h: Array, old: AlphaState) -> AlphaState:
    """Step by generalised-α on index 3, then project the velocities.

    Source: J. Chung, G. Hulbert, J. Appl. Mech. 60 (1993); M. Arnold, O. Brüls, Multibody System Dynamics 18 (2007).
    """
    step = AlphaStep(flow, t + h, h, old)
    # The iterations are not differentiated: derivatives are those of the equations that they have solved.
    real, lam = attach(_change_alpha, None, lax.stop_gradient(step).solve(), step)
    q, v, a = step.state(real)
    return AlphaState(q, flow.project_velocity(q, v), a, real, lam)


def _change_alpha(_: None, value: tuple[Array, Array], args: tuple, changes: tuple) -> tuple[Array, Array]:
    """Change the solution of a step with all that it depends on, by as many iterations as have found it."""
    step: AlphaStep = args[0]
    _, change = jax.linearize(lambda step, z: step.miss(*z), step, value)
    still = jax.tree.map(jnp.zeros_like, value)
    begin = jax.jvp(lambda step: step.drive(still[0]), args, changes)[1], still[1]
    correct = step.corrector(value[0])
    iterations = math.prod(_FACTORISATIONS)
    return lax.scan(lambda dz, _: (correct(dz, change(changes[0], dz)), None), begin, None, length=iterations)[0]


@record
class AlphaStep:
    """The equations of a step of the generalised-α method for accelerations and multipliers at its end."""

    flow: Flow
    end: Array  # time
    h: Array
    old: AlphaState

    def drive(self, real: Array) -> Array:
        """Put in the accelerations of driven coordinates."""
        return real.at[self.flow.view.known].set(self.flow.drive_values(self.end)[2])

    @property
    def shares(self) -> tuple[float, float, float, float]:
        """The method's αm, αf, β and γ."""
        radius = 0.7  # spectral radius at infinity: what is left of the stiffest motions after a step
        am, af = (2.0 * radius - 1.0) / (radius + 1.0), radius / (radius + 1.0)
        gamma = 0.5 + af - am
        return am, af, 0.25 * (gamma + 0.5) ** 2, gamma

    @property
    def weights(self) -> tuple[Array, Array]:
        """How much an acceleration at the end changes the pose and the rates there."""
        am, af, beta, gamma = self.shares
        return self.h**2 * beta * (1.0 - af) / (1.0 - am), self.h * gamma * (1.0 - af) / (1.0 - am)

    def state(self, real: Array) -> tuple[Array, Array, Array]:
        """Return pose, rates and the method's mean of accelerations at the end."""
        (am, af, beta, gamma), h, old = self.shares, self.h, self.old
        a = ((1.0 - af) * real + af * old.real - am * old.a) / (1.0 - am)
        q = old.q + h * old.v + h * h * ((0.5 - beta) * old.a + beta * a)
        v = old.v + h * ((1.0 - gamma) * old.a + gamma * a)
        return (*self.flow.impose(self.end, q, v), a)

    def miss(self, real: Array, lam: Array) -> tuple[Array, Array]:
        """Return by how much forces are out of balance, and rows are not met, in parts of size one."""
        flow, u = self.flow, self.flow.view.unknown
        q, v, _ = self.state(real)
        r, j, *_ = flow.rows(q, v)
        f = (flow.dyn.mass @ real - forces(flow.dyn, self.end, q, v))[u] + j.T @ lam
        weight, size, _ = flow.scale()
        # Rows are divided by h² where they meet accelerations, or the matrix would be badly scaled.
        return f / (weight * size), r / self.weights[0]

    def corrector(self, real: Array) -> Callable[[tuple[Array, Array], tuple[Array, Array]], tuple]:
        """Factorise at a solution; return what takes the next iteration from a solution and its `miss`."""
        flow, u = self.flow, self.flow.view.unknown
        weight, size, inner = flow.scale()
        q, v, _ = self.state(real)
        j = flow.rows(q, v).unknown
        to_q, to_v = self.weights

        def push(x: Array, dx: Array) -> Array:
            return forces(flow.dyn, self.end, q.at[u].set(x), v.at[u].set(dx))[u]

        k, c = jax.jacfwd(push, argnums=(0, 1))(q[u], v[u])
        tangent = inner - (to_v * c + to_q * k) / (weight[:, None] * weight[None] * size)
        matrix = lax.stop_gradient((0.5 * (tangent + tangent.T), j / weight))
        solve = saddle(*matrix, flow.redundant)

        def correct(z: tuple[Array, Array], miss: tuple[Array, Array]) -> tuple[Array, Array]:
            x, y = solve(-miss[0], -miss[1])
            return z[0].at[u].add(x / weight), z[1] + y * size

        return correct

    def solve(self) -> tuple[Array, Array]:
        """Find accelerations and multipliers by Newton's iterations, some with each factorisation."""
        outer, inner = _FACTORISATIONS

        def iterate(z: tuple[Array, Array], _: None) -> tuple:
            correct = self.corrector(z[0])
            return lax.scan(lambda z, _: (correct(z, self.miss(*z)), None), z, None, length=inner)[0], None

        return lax.scan(iterate, (self.drive(self.old.real), self.old.multipliers), None, length=outer)[0]


def count_steps(t: np.ndarray, longest_step: float) -> int:
    """Count the equal steps between two times that keep every step no longer than wanted; too many are refused."""
    longest = float(np.max(np.abs(np.diff(t)), initial=0.0))
    count, most = max(1.0, np.ceil(longest / longest_step * (1 - 1e-12))), 1_000_000_000  # int32 counts twice as many
    if count * (len(t) - 1) > most:
        raise InputError(f"step={longest_step:g}: {count * (len(t) - 1):.3g} steps; at most {most} fit in one run")
    return int(count)
