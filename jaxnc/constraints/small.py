"""Points and vectors as tuples of numbers that calculate like small arrays.

A kind is written for arrays. Given these instead, its arithmetic falls apart into that of single numbers, of which
nothing has to be put together and taken apart again: lanes of them are plain arithmetic on long vectors.
"""

import operator
from collections.abc import Iterator
from typing import Any

from jaxnc.reading import OutOfRange


class Small:
    """A few numbers (or rows of such) that can be indexed, added, subtracted, and multiplied, item by item."""

    __slots__ = ("items",)

    def __init__(self, items: Any):
        self.items = tuple(items)

    @property
    def shape(self) -> tuple[int, ...]:
        """As of an array."""
        inner = self.items[0].shape if self.items and isinstance(self.items[0], Small) else ()
        return (len(self.items), *inner)

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Any]:
        return iter(self.items)

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, tuple):
            first, *rest = at
            if not rest:
                return self[first]
            rest = tuple(rest) if len(rest) > 1 else rest[0]
            return Small(row[rest] for row in self[first]) if isinstance(first, slice) else self[first][rest]
        if isinstance(at, slice):
            for end in (at.start, at.stop):
                self._check(end, 1)
            return Small(self.items[at])
        if isinstance(at, bool):
            raise TypeError("True and False are no places")  # of an array they make another one
        self._check(at, 0)
        return self.items[at]

    def _check(self, at: Any, beyond: int) -> None:
        """Refuse a place that is not there, which an array of JAX's would move to its end in silence."""
        size = len(self.items)
        if isinstance(at, int) and not -size <= at < size + beyond:
            raise OutOfRange(f"index {at} in an array of {size}")

    def _with(self, f: Any, other: Any) -> "Small":
        shape = getattr(other, "shape", (len(other),) if isinstance(other, tuple) else ())
        if not shape:
            return Small(f(a, other) for a in self.items)
        if shape != self.shape:
            raise TypeError(f"shapes {self.shape} and {shape} do not fit")
        return Small(f(a, b) for a, b in zip(self.items, other, strict=True))

    __hash__ = object.__hash__

    def __eq__(self, other: Any) -> bool:
        raise TypeError("items are compared by arrays")

    def __add__(self, other: Any) -> "Small":
        return self._with(operator.add, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> "Small":
        return self._with(operator.sub, other)

    def __rsub__(self, other: Any) -> "Small":
        return self._with(lambda a, b: b - a, other)

    def __mul__(self, other: Any) -> "Small":
        return self._with(operator.mul, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Small":
        return self._with(operator.truediv, other)

    def __neg__(self) -> "Small":
        return Small(-a for a in self.items)
