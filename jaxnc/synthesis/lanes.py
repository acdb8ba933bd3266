"""Designs under way down a gradient, all in one compiled step; what they have done, and what they have come to."""

import functools
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import jit, on_device
from jaxnc.errors import InputError
from jaxnc.synthesis.bounds import Walls
from jaxnc.synthesis.descent import LARGE, LOST, MEETS, NO_SLOPE, Descent, Lane, begun, stepped
from jaxnc.synthesis.optimiser import Optimiser
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.search.sqp import Ended
from jaxnc.synthesis.steps import Steps
from jaxnc.types import Array

_ROOM = 64  # steps that compiled code takes at once, at most
_LASTING = 0.2  # seconds that they should last: so often is a descent looked at, and can be stopped
_GAIN = 1e-3  # of the value: less in `patience` steps is no progress
_AVERAGED = 20  # steps over which values that are samples are averaged, to be compared with `enough`
_SAMPLES = 64  # of a value that is drawn anew at every step, to rank designs
_LATER = 1 << 30  # number of the first of these samples


class Lanes:
    """Designs under way, and their history."""

    def __init__(self, descent: Descent, key: Array, patience: int | None):
        self.descent, self.patience = descent, patience
        self.problem, self.key = descent.problem, key
        self.leaves, self.structure = jax.tree.flatten(self.problem)
        self.leaves = on_device(self.leaves)
        self.equal = tuple(bool(e) for e in descent.equal)
        self.rows: list[np.ndarray] = []
        self.times: list[float] = []
        self.done = self.broken = self.count = 0
        self.each = np.inf
        self.first = True
        self.idle = np.zeros(0, bool)

    def begin(self, x: np.ndarray, lanes: int) -> None:
        """Put designs into so many lanes; what they do not fill has come to its end."""
        self.count = len(x)
        at = np.minimum(np.arange(lanes), len(x) - 1)
        lane = _begun(self.descent.optimiser, len(self.equal), self.descent.walls, on_device(x[at]))
        self.lanes = _with(lane, over=np.arange(lanes) >= len(x))
        self.idle = np.zeros(lanes, bool)

    @property
    def busy(self) -> bool:
        """Whether a design is still under way."""
        return not bool(np.asarray(self.lanes.over).all())

    def go(self, most: int) -> None:
        """Take some steps, not more than `most` altogether."""
        count = 1 if not np.isfinite(self.each) else int(np.clip(_LASTING / self.each, 1, _ROOM))
        count = min(count, most - self.done)
        if self.patience is not None:
            count = min(count, self.patience - self.done % self.patience)
        begin = time.perf_counter()
        new = self._taken(self.done, count)
        if not self.first:  # the first of them was compiled
            self.each = (time.perf_counter() - begin) / count
        elif self.done:
            self.each = _LASTING
        self.first, self.done = False, self.done + count
        self.rows.append(new)
        self.broken += int((new[:, : self.count, 3] == NO_SLOPE).sum())
        if self.done == count:
            self._see(new[0, : self.count, 3])
        if self.patience is not None and self.done % self.patience == 0:
            self._tire()

    def told(self, seconds: float) -> None:
        """Say when the last steps were taken."""
        before, count = (self.times[-1] if self.times else 0.0), len(self.rows[-1])
        self.times += [before + (seconds - before) * (k + 1) / count for k in range(count)]

    def best(self) -> float:
        """The least value of a design that meets its conditions; of samples their average over some steps."""
        if self.descent.random:
            few = np.concatenate(self.rows[-_AVERAGED:])[-_AVERAGED:, : self.count]
            return float(np.min(np.mean(few[..., 0], axis=0)))
        lanes = self.lanes
        meets = np.asarray(lanes.best_violation) <= MEETS
        return float(np.min(np.asarray(lanes.best_value)[meets], initial=np.inf))

    def ends(self, stopped: str) -> list[Ended]:
        """What designs have come to, those that assemble."""
        lanes, random = self.lanes, self.descent.random
        y = np.asarray(lanes.y if random else lanes.best) * np.asarray(self.descent.walls.scale)
        value, far = (np.asarray(a) for a in (lanes.best_value, lanes.best_violation))
        left, steps, over = (np.asarray(a) for a in (lanes.gradient, lanes.steps, lanes.over))
        lost = np.asarray(lanes.merit if random else lanes.best_value) >= LARGE
        if random and self.rows:
            self.lanes = _with(lanes, over=np.ones(len(y), bool))
            parts = [self._taken(_LATER + k, min(_ROOM, _SAMPLES - k)) for k in range(0, _SAMPLES, _ROOM)]
            self.lanes, samples = lanes, np.concatenate(parts)
            value, far = np.mean(samples[..., 0], axis=0), np.asarray(lanes.violation)
        out = []
        for k in range(self.count):
            if lost[k]:
                continue
            level = left[k] <= self.descent.tolerance and far[k] <= MEETS and not random
            end = "" if level else f"{steps[k]} steps"
            if end and self.idle[k]:
                end = f"no progress in {self.patience} steps"
            elif end and over[k]:
                end = "no step is possible"
            elif end and stopped:
                end = stopped
            out.append(Ended(y[k], float(value[k]), float(left[k]), np.nan, float(far[k]), int(steps[k]), end))
        return out

    def steps(self) -> Steps:
        """The history so far."""
        rows = np.concatenate(self.rows)[:, : self.count] if self.rows else np.zeros((0, self.count, 5))
        under = rows[..., 4] > 0.0
        value, left, far = (np.where(under & (rows[..., k] < LARGE), rows[..., k], np.nan) for k in range(3))
        shown = (np.sqrt(value) if self.problem.minimax else value) * self.problem.shown(1.0)
        times = np.array([*self.times, *(self.times[-1:] or [0.0]) * (len(rows) - len(self.times))])
        return Steps(shown, left, far, under & (rows[..., 3] == 0), times, self.descent.random)

    # -- keeping ----------------------------------------------------------------------------------------------------

    def saved(self) -> dict[str, np.ndarray]:
        """Everything that decides how it goes on, as arrays by name."""
        leaves = [_data(a) for a in jax.tree.leaves(self.lanes)]
        rows = np.concatenate(self.rows) if self.rows else np.zeros((0, len(self.idle), 5))
        own = {"rows": rows, "times": np.array(self.times), "idle": self.idle, "broken": np.array(self.broken)}
        return own | {f"lane.{k}": a for k, a in enumerate(leaves)}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go back to what `saved` returned."""
        old, structure = jax.tree.flatten(self.lanes)
        new = [_like(arrays[f"lane.{k}"], a) for k, a in enumerate(old)]
        self.lanes = jax.tree.unflatten(structure, new)
        self.rows, self.times = [arrays["rows"]], arrays["times"].tolist()
        self.idle, self.broken, self.done = arrays["idle"].copy(), int(arrays["broken"]), len(arrays["rows"])

    # -- inside -----------------------------------------------------------------------------------------------------

    def _taken(self, first: int, count: int) -> np.ndarray:
        """So many steps from the one with this number on; what was seen, ``(count, lanes, 5)``."""
        d = self.descent
        lanes, seen = _steps(
            self.structure, d.optimiser, self.equal, d.batch, self.leaves, d.walls, d.tolerance, self.lanes, self.key,
            np.int32(first), np.int32(count),
        )  # fmt: skip
        seen = np.asarray(seen)[:count]
        self.lanes = lanes
        return seen

    def _see(self, outcome: np.ndarray) -> None:
        if (outcome == LOST).any() or (outcome == 0).any():
            return
        of = "gradient" if (outcome == NO_SLOPE).any() else "value"
        raise InputError(
            f"{self.problem.name}: the {of} of all {self.count} starts, the idea among them, is not finite; keep "
            f"divisions, roots and logarithms of your own functions away from where they, or their derivatives, are "
            f"not defined"
        )

    def _tire(self) -> None:
        """Leave designs alone that have become no better of late."""
        assert self.patience is not None
        rows = np.concatenate(self.rows)[..., 0]
        late, early = rows[-self.patience :], rows[: -self.patience]
        if not len(early):
            return
        if self.descent.random:
            now, before = np.mean(late, axis=0), np.mean(early[-self.patience :], axis=0)
        else:
            now, before = np.min(late, axis=0), np.min(early, axis=0)
        over = np.asarray(self.lanes.over)
        tired = ~over & ~(now < before - _GAIN * np.abs(before))
        self.idle |= tired
        self.lanes = _with(self.lanes, over=over | tired)


@functools.partial(jit, static_argnums=(0, 1))
def _begun(optimiser: Optimiser, conditions: int, walls: Walls, x: Array) -> Lane:
    return jax.vmap(lambda x: begun(optimiser, walls, conditions, x))(x)


@functools.partial(jit, static_argnums=(0, 1, 2, 3))
def _steps(
    structure: Any,
    optimiser: Optimiser,
    equal: tuple[bool, ...],
    batch: int | None,
    leaves: list[Any],
    walls: Walls,
    tolerance: Any,
    lanes: Lane,
    key: Array,
    first: Array,
    count: Array,
) -> tuple[Lane, Array]:
    problem: Problem = jax.tree.unflatten(structure, leaves)
    which, random = np.array(equal, bool), batch is not None or problem.random

    def step(k: Array, state: tuple[Lane, Array]) -> tuple[Lane, Array]:
        lanes, seen = state
        own = jax.random.fold_in(key, first + k) if random else None
        under = ~lanes.over
        new = jax.vmap(lambda lane: stepped(problem, optimiser, walls, which, batch, tolerance, lane, own))(lanes)
        row = jnp.stack([new.value, new.gradient, new.violation, new.outcome, under], axis=1)
        return new, seen.at[k].set(row.astype(seen.dtype))

    seen = jnp.zeros((_ROOM, lanes.y.shape[0], 5), lanes.y.dtype)
    return lax.fori_loop(0, count, step, (lanes, seen))


def _with(lanes: Lane, over: np.ndarray) -> Lane:
    parts = {name: getattr(lanes, name) for name in Lane.__dataclass_fields__}  # pyright: ignore[reportAttributeAccessIssue]
    return Lane(**{**parts, "over": on_device(over)})


def _data(a: Any) -> np.ndarray:
    return np.asarray(jax.random.key_data(a) if jnp.issubdtype(a.dtype, jax.dtypes.prng_key) else a)


def _like(a: np.ndarray, old: Any) -> Any:
    if jnp.issubdtype(old.dtype, jax.dtypes.prng_key):
        return jax.random.wrap_key_data(on_device(a), impl=jax.random.key_impl(old))
    return on_device(a)
