"""From a function of plain numbers to a program: numbers that write down what is done to them.

What is arithmetic and the functions of `jaxnc.constraints.elementary` is read so in a small part of the time that JAX
takes to trace it. What these numbers are not made for (functions of jax.numpy, branches that depend on them) raises a
TypeError, and is read from its jaxpr instead.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from jaxnc.reading.program import Builder, Program
from jaxnc.types import Scalar

_Plain = bool | int | float | np.bool_ | np.integer | np.floating


_LOGICAL = {"and", "or", "not"}
_TRUTHS = {"lt", "le", "gt", "ge", "eq", "ne", "finite", *_LOGICAL}


def _operator(op: str, turned: bool = False) -> Callable:
    return lambda number, other: number._with(op, other, turned)


class Number:
    """A node of a program that is being written."""

    __slots__ = ("_at", "_builder")
    __array_ufunc__ = None  # numbers of NumPy leave the arithmetic to this class
    __hash__ = object.__hash__

    def __init__(self, builder: Builder, at: int):
        self._builder, self._at = builder, at

    @property
    def at(self) -> int:
        """The place of the number among the nodes of the program."""
        return self._at

    @property
    def truth(self) -> bool:
        """True if the node is a truth value, and no number."""
        return _truth(self._builder, self._at)

    def apply(self, op: str, *others: object, value: Any = None) -> "Number":
        """Apply an operation to the number and others, by the name that programs have for it."""
        b = self._builder
        at = (self._at, *(_node_of(b, x) for x in others))
        first, *rest = (_truth(b, i) for i in at)
        fits = first and rest[0] == rest[1] if op == "select" else {first, *rest} == {op in _LOGICAL}
        if not fits:  # for which JAX has rules of its own
            raise TypeError(f"{op} of numbers and truth values")
        return Number(b, b.op(op, *at, value=value))

    def _with(self, op: str, other: object, turned: bool = False) -> Any:
        if not isinstance(other, Number | _Plain):
            return NotImplemented
        if turned:
            return Number(self._builder, _node_of(self._builder, other)).apply(op, self)
        return self.apply(op, other)

    __add__, __radd__ = _operator("add"), _operator("add", True)
    __sub__, __rsub__ = _operator("sub"), _operator("sub", True)
    __mul__, __rmul__ = _operator("mul"), _operator("mul", True)
    __truediv__, __rtruediv__ = _operator("div"), _operator("div", True)
    __lt__, __le__, __gt__, __ge__ = map(_operator, ("lt", "le", "gt", "ge"))
    __eq__, __ne__ = map(_operator, ("eq", "ne"))
    __and__ = __rand__ = _operator("and")
    __or__ = __ror__ = _operator("or")

    def __pow__(self, power: int) -> Scalar:
        if isinstance(power, bool) or not isinstance(power, int):
            return self._with("pow", power)
        if power in (0, 1):
            return self if power else 1.0
        return self * self if power == 2 else self.apply("power", value=power)

    def __neg__(self) -> "Number":
        return self.apply("neg")

    def __abs__(self) -> "Number":
        return self.apply("abs")

    def __invert__(self) -> "Number":
        return self.apply("not")

    def __bool__(self) -> bool:
        raise TypeError("whether a number that is not known yet is true cannot be told")


def _truth(builder: Builder, at: int) -> bool:
    op, of, value = builder.nodes[at]
    if op == "select":
        return _truth(builder, of[1])
    return op in _TRUTHS or (op == "number" and isinstance(value[1], bool))


def _node_of(builder: Builder, value: object) -> int:
    if isinstance(value, Number):
        return value._at
    if not isinstance(value, _Plain):
        raise TypeError(f"{type(value).__name__} is no plain number")
    return builder.number(bool(value) if isinstance(value, bool | np.bool_) else float(value))


def write(f: Callable, count: int) -> Program:
    """Write the program of a function of plain numbers that gets by with arithmetic; a TypeError for what does not."""
    b = Builder(count)
    found = f(*(Number(b, at) for at in b.first))
    return b.program([_node_of(b, x) for x in _flatten(found)])


def _flatten(x: Any) -> Iterator[Any]:
    if hasattr(x, "__iter__"):
        for y in x:
            yield from _flatten(y)
    else:
        yield x
