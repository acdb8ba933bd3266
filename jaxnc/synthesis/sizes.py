"""Dimensions that come in sizes only: lengths of a list of stock sizes, multiples of a step, whole numbers."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.inputs import positive
from jaxnc.kinematics.redesign import components, flattened
from jaxnc.synthesis.conditions import Condition, Seen
from jaxnc.system.system import System
from jaxnc.types import Array


@public
@dataclasses.dataclass(frozen=True)
class Stock(Condition):
    """A length between two points, or a design variable, that has one of certain sizes.

    Attributes:
        what: two points, or the name of a design variable.
        sizes: ascending; empty if they are the multiples of `step`.
        step: between sizes.
        place: of the variable in the flat parameters.
    """

    what: tuple[str, str] | str
    sizes: tuple[float, ...] = ()
    step: float = 1.0
    place: int | None = None
    equality = True

    @property
    def name(self) -> str:
        return f"{self.label} in stock" if self.sizes else f"{self.label} a multiple of {self.step:g}"

    @property
    def spans(self) -> tuple[tuple[str, str], ...]:
        return (self.what,) if isinstance(self.what, tuple) else ()

    @property
    def label(self) -> str:
        """What has the size."""
        return self.what if isinstance(self.what, str) else "-".join(self.what)

    def prepared(self, system: System, driven: str) -> "Stock":
        top = system.topology
        points = (*top.points, *(m.name for m in top.markers))
        every = [part for _, part, _ in components(system)]
        if isinstance(self.what, str) and self.what in every:
            return dataclasses.replace(self, place=every.index(self.what))
        ends = self.what.partition("-")[::2] if isinstance(self.what, str) else self.what
        if isinstance(self.what, str) and not ends[1]:
            raise InputError(f"{self.name}: {top.name!r} has no design variable {self.what!r}; "
                             f"{nearest(self.what, every)}")  # fmt: skip
        for name in ends:
            if name not in points:
                raise InputError(f"{self.name}: {top.name!r} has no point {name!r}; {nearest(name, points)}")
        return dataclasses.replace(self, what=tuple(ends))

    def value(self, seen: Seen) -> Array:
        """What the length or variable is."""
        if self.place is not None:
            return flattened(seen.system)[self.place]
        a, b = self.what
        return jnp.linalg.norm(seen.motion[a][0] - seen.motion[b][0])

    def values(self, seen: Seen) -> Array:
        value = self.value(seen)
        if not self.sizes:
            return ((value - self.step * jnp.round(value / self.step)) / seen.size)[None]
        far = value - jnp.stack([jnp.asarray(size) for size in self.sizes])
        return (far[jnp.argmin(jnp.abs(far))] / seen.size)[None]

    def number(self, value: float) -> int:
        """Number of the largest size that is not above a value, of the smallest one if all are."""
        if not self.sizes:
            return int(np.floor(value / self.step + 1e-9))
        return max(int(np.searchsorted(self.sizes, value + 1e-9 * abs(value), side="right")) - 1, 0)

    def valid(self, number: int) -> bool:
        """Whether there is a size of this number; a length is not zero or less."""
        if self.sizes:
            return 0 <= number < len(self.sizes)
        return self.place is not None or number > 0

    def size(self, number: int) -> float:
        """The size of a number."""
        return self.sizes[number] if self.sizes else self.step * number


@dataclasses.dataclass(frozen=True)
class Measure(Condition):
    """What a stock condition looks at, as it is, to be compared with a size."""

    stock: Stock
    equality = True

    def values(self, seen: Seen) -> Array:
        return (self.stock.value(seen) / seen.size)[None]


@dataclasses.dataclass(frozen=True)
class Range(Condition):
    """What a stock condition looks at lies between its smallest and its largest size."""

    stock: Stock

    @property
    def name(self) -> str:
        return f"{self.stock.label} in the range of its sizes"

    def values(self, seen: Seen) -> Array:
        value = self.stock.value(seen)
        if not self.stock.sizes:  # a length of at least one step
            return ((value - self.stock.step) / seen.size)[None]
        return jnp.stack([value - self.stock.sizes[0], self.stock.sizes[-1] - value]) / seen.size


@public
def stock(what: tuple[str, str] | str, sizes: Sequence[float]) -> Stock:
    """A length, or a design variable, has one of the sizes of a list.

    Args:
        what: two points of one body, or the name of a component of the design: ``("B", "C")``, ``"coupler.B-C"``.
        sizes: that there are, in any order.

    Raises:
        InputError: no sizes, or sizes that are not finite or, of a length, not positive.
    """
    try:
        found = np.unique(np.asarray(sizes, dtype=float))
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.ndim != 1 or not found.size or not np.isfinite(found).all():
        raise InputError(f"stock({what!r}): sizes must be a list of finite numbers, got {sizes!r}")
    _checked(what, "stock")
    if not isinstance(what, str) and found[0] <= 0:
        raise InputError(f"stock({what!r}): a length is positive, got the size {found[0]:g}")
    return Stock(what, tuple(found.tolist()))


@public
def integer(what: tuple[str, str] | str, step: float = 1.0) -> Stock:
    """A length, or a design variable, is a whole number of steps.

    Args:
        what: two points of one body, or the name of a component of the design.
        step: in its unit.

    Raises:
        InputError: a step that is not positive.
    """
    positive(step, f"integer({what!r}): step")
    _checked(what, "integer")
    return Stock(what, (), float(step))


def _checked(what: Any, caller: str) -> None:
    pair = isinstance(what, tuple) and len(what) == 2 and all(isinstance(w, str) for w in what)
    if not (pair or isinstance(what, str)):
        raise InputError(f"{caller}: give two points, or the name of a design variable; got {what!r}")
