"""One Runge-Kutta step for every motion, whatever the method: each step is brought back onto the constraints.

A step is a loop over its phases: stages, then pose and rates back onto the constraints, then the accelerations there,
which are the first stage of the next step. What a motion answers in a phase is compiled once, whatever the method is.
Positions follow from accelerations alone (``q̇ = v``), so that only those are kept: ``q = q₀ + h c v₀ + h² Σ ā_j a_j``
with ``ā = a a``.
"""

import functools
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.flow import ACCELERATION, POSITION, VELOCITY, Answer
from jaxnc.solvers import linear
from jaxnc.types import Array

_NEWTON = 7  # iterations of an implicit stage


class Moving(Protocol):
    """A motion that can be integrated; coordinates are an array, or a tuple with one number for each."""

    def impose(self, t: Any, q: Any, v: Any) -> tuple[Any, Any]:
        """The state with what is driven where it has to be."""
        ...

    def answer(self, what: Any, t: Any, q: Any, v: Any) -> Answer:
        """Accelerations, or changes that bring a pose or its rates back onto the constraints."""
        ...


class State(NamedTuple):
    """A motion at one time: pose, rates, accelerations, multipliers, and how far off the constraints it was found."""

    q: Any
    v: Any
    a: Any
    multipliers: Any
    gap: Array
    slip: Array


class Method(NamedTuple):
    """A Runge-Kutta method whose last stage, explicit and on the constraints, is the first of the next step."""

    times: np.ndarray  # when each stage is, in parts of the step, (s,); the first is 0, the last (at the end) 1
    rows: np.ndarray  # what each stage takes of those before, (s, s); the last row is the step itself
    error: np.ndarray  # what the estimate of the error takes of each, (s,); zero for a method of fixed step
    order: int  # of that estimate
    implicit: float = 0.0  # what every stage but the first and the last takes of itself; 0 for an explicit method

    @property
    def chained(self) -> bool:
        """Whether every stage looks at the one before only."""
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
def _phases(method: str, settled: bool) -> dict[str, np.ndarray]:
    """What is done in each phase of a step: one row of every table."""
    found = METHODS[method]
    s = len(found.times)
    stages = np.arange(1, s - 1)  # the first is known, the last comes after the corrections
    ends = [POSITION, VELOCITY, ACCELERATION] if settled else [ACCELERATION]
    stage = np.array([*stages, *(s - 1,) * len(ends)])
    return {
        "what": np.array([*(ACCELERATION,) * len(stages), *ends], np.int32),
        "stage": stage.astype(np.int32),
        "fresh": np.arange(len(stage)) <= len(stages),  # where the state is put together from the stages
        "last": stage == s - 1,
        "time": found.times[stage],
        "speed": found.rows[stage],
        "place": (found.rows @ found.rows)[stage],
        "share": found.rows[-1][np.minimum(stage, s - 1)] * (stage < s - 1),
    }


def step(moving: Moving, method: str, settled: bool, t: Any, h: Any, state: State) -> tuple[State, tuple[Any, Any]]:
    """One step of a method: where it ends, and estimates of the errors of pose and rates.

    `settled` says whether the step ends on the constraints.
    """
    return noted(moving, method, settled, t, h, state)[:2]


def noted(
    moving: Any, method: str, settled: bool, t: Any, h: Any, state: State, before: Answer | None = None
) -> tuple[State, tuple[Any, Any], Answer]:
    """A step, and what the motion answered in each of its phases."""
    found = METHODS[method]
    q0, v0, a0 = state.q, state.v, state.a
    kept = _Chain(method, h, q0, v0, a0) if found.chained else _Table(method, h, q0, v0, a0)
    ask: Any = _implicit(moving, found.implicit * h, t, state) if found.implicit else None

    def phase(carry, xs):
        row, known = xs
        q, v, memory, last, miss = carry
        at = t + row["time"] * h
        x, dx = kept.point(memory, row)
        q, v = (jax.tree.map(lambda a, b: jnp.where(row["fresh"], a, b), *pair) for pair in ((x, q), (dx, v)))
        q, v = moving.impose(at, q, v)
        if ask is None:
            answer = moving.answer(row["what"] if settled else ACCELERATION, at, q, v, *known)
        else:
            answer, more = jax.lax.cond(
                row["last"], lambda: (moving.answer(row["what"], at, q, v), miss), lambda: ask(at, q, v, last)
            )
            miss = jnp.maximum(miss, more)
        if settled:
            q, v = _corrected(row["what"], q, v, answer.change)
        return (q, v, kept.add(memory, row, v, answer.change), answer, miss), answer

    start = (q0, v0, kept.begin(), Answer(a0, state.multipliers, state.gap, state.slip), jnp.zeros(()))
    xs = _phases(method, settled), () if before is None else (before,)
    (q, v, memory, last, miss), answers = jax.lax.scan(phase, start, xs)
    return State(q, v, *last), kept.errors(memory, miss), answers


def on_constraints(moving: Moving, t: Any, state: State) -> State:
    """The state with its pose and rates on the constraints, and its accelerations."""
    what = np.array([*(POSITION,) * 3, VELOCITY, ACCELERATION], np.int32)

    def phase(state, what):
        q, v = moving.impose(t, state.q, state.v)
        found = moving.answer(what, t, q, v)
        return State(*_corrected(what, q, v, found.change), *found), None

    return jax.lax.scan(phase, state, what)[0]


def _corrected(what: Any, q: Any, v: Any, change: Any) -> tuple[Any, Any]:
    """Pose and rates with a change of one of them."""
    return tuple(
        jax.tree.map(lambda a, b, k=kind: a + jnp.where(what == k, b, 0.0), x, change)
        for x, kind in ((q, POSITION), (v, VELOCITY))
    )  # pyright: ignore[reportReturnType]


def _implicit(moving: Moving, part: Any, t: Any, state: State) -> Any:
    """How the implicit stages of a step are solved: by Newton's method with the matrix of the step's start.

    Returns:
        A function of time, what a stage takes of those before, and what is near: the answer there, and the size of
        the last correction.
    """

    def there(at, q, v, a):
        return moving.answer(ACCELERATION, at, q + part * part * a, v + part * a)

    slope = jax.jacfwd(lambda a: there(t, state.q, state.v, a).change)(jnp.zeros_like(state.a))
    solve = linear.solver(jnp.eye(len(state.a)) - slope)

    def ask(at, q, v, near):
        def closer(a, _):
            move = solve(there(at, q, v, a).change - a)
            return a + move, jnp.max(jnp.abs(move))

        a, moves = jax.lax.scan(closer, near.change, None, length=_NEWTON)
        return near._replace(change=a), moves[-1]

    return ask


class _Chain:
    """A method whose stages look at the one before only: sums are carried along, and the last slopes."""

    def __init__(self, method: str, h: Any, q: Any, v: Any, a: Any):
        self.found, self.h, self.q, self.v, self.a = METHODS[method], h, q, v, a

    def begin(self) -> Any:
        """Before the first stage, which is known."""
        share = self.found.rows[-1, 0] * self.h
        return (self.v, self.a), (_ahead(self.q, share, self.v), _ahead(self.v, share, self.a))

    def point(self, memory: Any, row: Any) -> tuple[Any, Any]:
        """Pose and rates of a stage, or of the end."""
        (v, a), (sum_q, sum_v) = memory
        reach = row["time"] * self.h
        ahead = _ahead(self.q, reach, v), _ahead(self.v, reach, a)
        return jax.tree.map(lambda x, y: jnp.where(row["last"], x, y), (sum_q, sum_v), ahead)

    def add(self, memory: Any, row: Any, v: Any, a: Any) -> Any:
        """With what a stage found."""
        _, (sum_q, sum_v) = memory
        share = row["share"] * self.h
        return (v, a), (_ahead(sum_q, share, v), _ahead(sum_v, share, a))

    def errors(self, memory: Any, miss: Any) -> tuple[Any, Any]:
        """None are estimated."""
        return jnp.zeros(()), jnp.zeros(())


class _Table:
    """Any explicit method: the accelerations of all stages."""

    def __init__(self, method: str, h: Any, q: Any, v: Any, a: Any):
        self.found, self.h, self.q, self.v, self.a = METHODS[method], h, q, v, a

    def begin(self) -> Array:
        """Before the first stage, which is known."""
        return jnp.zeros((len(self.found.times), *self.a.shape), self.a.dtype).at[0].set(self.a)

    def point(self, memory: Array, row: Any) -> tuple[Array, Array]:
        """Pose and rates of a stage, or of the end."""
        h = self.h
        q = self.q + row["time"] * h * self.v + h * h * (row["place"] @ memory)
        return q, self.v + h * (row["speed"] @ memory)

    def add(self, memory: Array, row: Any, v: Array, a: Array) -> Array:
        """With what a stage found."""
        return jnp.where(row["what"] == ACCELERATION, memory.at[row["stage"]].set(a), memory)

    def errors(self, memory: Array, miss: Array) -> tuple[Array, Array]:
        """Estimates for pose and rates; to them comes what the stages were not solved to."""
        h, weights = self.h, self.found.error
        q, v = h * h * ((weights @ self.found.rows) @ memory), h * (weights @ memory)
        return jnp.abs(q) + h * h * miss, jnp.abs(v) + h * miss


def _ahead(x: Any, factor: Any, rate: Any) -> Any:
    return jax.tree.map(lambda a, b: a + factor * b, x, rate)
