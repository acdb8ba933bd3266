"""Straight-line programs over single numbers: what a pure JAX function of a few numbers comes down to.

A constraint kind is one function; whatever has to be known of it is a *reading* of its program, never a second
statement: values of NumPy lanes, derivatives, degree and sparsity. A program is a list of nodes, each an operation on
earlier ones; equal nodes are one, and what is known beforehand is computed beforehand.

Numbers that write down what is done to them make a program of a function of plain numbers: of what is arithmetic and
the functions of `jaxnc.constraints.elementary`, in a small part of the time that JAX takes to trace it. What they are
not made for (functions of jax.numpy, branches that depend on them) raises a TypeError, and is read from its jaxpr
instead (`jaxnc.reading.trace`).

As a function of Python a program does its operations on whole lanes at once, nothing interpreted. The same text does
for arrays of any shape (an input may be a number, or an array that broadcasts with the others) and for Python's own
numbers, with the functions of `math`.
"""

import math
import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jaxnc.types import Scalar

if TYPE_CHECKING:
    from jaxnc.solvers.rows import Numerics


class Node(NamedTuple):
    """An operation: its name, the nodes it takes, and a number where it needs one (an input's place, a power)."""

    op: str
    of: tuple[int, ...]
    value: Any = None


@dataclass(frozen=True, eq=False)
class Program:
    """Operations in the order in which they can be done."""

    inputs: int  # how many numbers it takes
    nodes: tuple[Node, ...]  # the operations
    outputs: tuple[int, ...]  # which of them are returned

    def wanted(self, outputs: Sequence[int]) -> "Program":
        """Return the program with some of its outputs only, and nothing that these do not need."""
        keep = set(outputs)
        for k in range(len(self.nodes) - 1, -1, -1):
            if k in keep:
                keep.update(self.nodes[k].of)
        place = {old: new for new, old in enumerate(sorted(keep))}
        nodes = tuple(
            Node(n.op, tuple(place[i] for i in n.of), n.value) for k, n in enumerate(self.nodes) if k in place
        )
        return Program(self.inputs, nodes, tuple(place[k] for k in outputs))


_FOLDED: dict[str, Callable] = {
    **{f.__name__: f for f in (operator.add, operator.sub, operator.mul, operator.neg, abs, max, min, float)},
    **{f.__name__: f for f in (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne)},
    **{"and": operator.and_, "or": operator.or_, "not": operator.not_},
    **{f.__name__: f for f in (math.sqrt, math.sin, math.cos)},
    "sign": lambda x: (x > 0) - (x < 0) if x == x and x else x,
}


class Builder:
    """A program that is being written."""

    def __init__(self, inputs: int):
        self.inputs = inputs
        self.nodes: list[Node] = []
        self._known: dict[Node, int] = {}
        self.first = [self._node(Node("input", (), k)) for k in range(inputs)]

    def _node(self, node: Node) -> int:
        found = self._known.get(node)
        if found is None:
            found = self._known[node] = len(self.nodes)
            self.nodes.append(node)
        return found

    def number(self, value: Any) -> int:
        """A number that is known."""
        value = value.item() if hasattr(value, "item") else value
        # 0 and -0, 1 and True are equal, but not the same.
        return self._node(Node("number", (), (repr(value), value)))

    def opaque(self, op: str, why: str) -> int:
        """A node that is like no other one, for what has no operation."""
        return self._node(Node(op, (), (why, len(self.nodes))))

    def known(self, at: int) -> Any:
        """Return the value of a node, if it is a number that is known; None otherwise."""
        node = self.nodes[at]
        return node.value[1] if node.op == "number" else None

    def op(self, name: str, *of: int, value: int | None = None) -> int:
        """The result of an operation."""
        numbers = [self.known(i) for i in of]
        known = name in _FOLDED and all(n is not None for n in numbers)
        if known and not (name == "sqrt" and numbers[0] < 0):
            return self.number(_FOLDED[name](*numbers))
        if name in ("add", "sub", "mul", "div"):
            simple = self._simple(name, *of, *numbers)
            if simple is not None:
                return simple
        if name == "neg" and self.nodes[of[0]].op == "neg":
            return self.nodes[of[0]].of[0]
        if name == "select" and numbers[0] is not None:
            return of[1] if numbers[0] else of[2]
        if name == "select" and of[1] == of[2]:
            return of[1]
        return self._node(Node(name, of, value))

    def _simple(self, name: str, a: int, b: int, x: float | None, y: float | None) -> int | None:
        if name == "add":
            return b if x == 0 else a if y == 0 else None
        if name == "sub":
            return a if y == 0 else self.op("neg", b) if x == 0 else None
        if name == "mul":
            if x == 0 or y == 0:
                return self.number(0.0)
            if x == 1 or y == 1:
                return b if x == 1 else a
            return self.op("neg", b) if x == -1 else self.op("neg", a) if y == -1 else None
        if x == 0:
            return self.number(0.0)
        return a if y == 1 else None

    def total(self, terms: Iterable[int]) -> int:
        """A sum."""
        out = None
        for term in terms:
            out = term if out is None else self.op("add", out, term)
        return self.number(0.0) if out is None else out

    def append(self, program: Program, inputs: Sequence[int]) -> list[int]:
        """Write another program's operations behind, with nodes of this one for its inputs; where each of them is."""
        at: list[int] = []
        for node in program.nodes:
            if node.op == "input":
                at.append(inputs[node.value])
            elif node.op == "number":
                at.append(self._node(node))
            else:
                at.append(self.op(node.op, *(at[i] for i in node.of), value=node.value))
        return at

    def program(self, outputs: Sequence[int]) -> Program:
        """The finished program, without what its outputs do not need."""
        return Program(self.inputs, tuple(self.nodes), ()).wanted(outputs)


_Plain = bool | int | float | np.bool_ | np.integer | np.floating


_LOGICAL = {"and", "or", "not"}
_TRUTHS = {"lt", "le", "gt", "ge", "eq", "ne", "finite", *_LOGICAL}


def _operator(op: str, turned: bool = False) -> Callable:
    return lambda number, other: number._with(op, other, turned)


class Number:
    """A node of a program that is being written."""

    __slots__ = ("_builder", "at")
    __array_ufunc__ = None  # numbers of NumPy leave the arithmetic to this class
    __hash__ = object.__hash__

    def __init__(self, builder: Builder, at: int):
        self._builder, self.at = builder, at  # its place among the nodes of the program

    @property
    def truth(self) -> bool:
        """True if the node is a truth value, and no number."""
        return _truth(self._builder, self.at)

    def apply(self, op: str, *others: object, value: Any = None) -> "Number":
        """Apply an operation to the number and others, by the name that programs have for it."""
        b = self._builder
        at = (self.at, *(_node_of(b, x) for x in others))
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
        return value.at
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


# -- as a function of Python -----------------------------------------------------------------------------------------

_BINARY = {
    "add": "+", "sub": "-", "mul": "*", "div": "/", "lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==",
    "ne": "!=", "and": "&", "or": "|",
}  # fmt: skip
_ALIKE = ("sqrt", "sign", "sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "log1p", "expm1", "floor", "ceil")
_CALLED = {name: name for name in _ALIKE} | {
    "abs": "absolute",
    "asin": "arcsin",
    "acos": "arccos",
    "atan": "arctan",
    "atan2": "arctan2",
    "pow": "power",
    "max": "maximum",
    "min": "minimum",
    "round": "rint",
    "rem": "fmod",
    "not": "logical_not",
    "select": "where",
    "finite": "isfinite",
}
"""Operations and their names in NumPy."""
_OF_NUMBERS: dict[str, Callable] = {
    "abs": abs,
    "sign": lambda x: x if x == 0.0 or x != x else math.copysign(1.0, x),
    "pow": math.pow,
    "max": lambda x, y: x if x >= y or x != x else y,
    "min": lambda x, y: x if x <= y or x != x else y,
    "floor": lambda x: float(math.floor(x)),
    "ceil": lambda x: float(math.ceil(x)),
    "round": lambda x: float(round(x)),
    "rem": math.fmod,
    "not": operator.not_,
    "select": lambda c, x, y: x if c else y,
    "finite": math.isfinite,
}
_OF_NUMBERS |= {name: getattr(math, name) for name in _CALLED if name not in _OF_NUMBERS}


def function(program: Program, xp: "Numerics" = np) -> Callable[[Sequence[Any]], tuple[Any, ...]]:
    """Compile the program to a function from a sequence of its inputs to a tuple of its outputs.

    `xp` is where its functions are found: NumPy, ``jax.numpy`` for a program that is traced, or `math` for numbers of
    Python's own (what is not finite is then an error of arithmetic).
    """
    lines = ["def run(x):"]
    for k, (op, of, value) in enumerate(program.nodes):
        a = [f"n{i}" for i in of]
        if op == "input":
            text = f"x[{value}]"
        elif op == "number":
            text = f"({value[1]!r})"
        elif op in _BINARY:
            text = f"{a[0]} {_BINARY[op]} {a[1]}"
        elif op == "neg":
            text = f"-{a[0]}"
        elif op == "power":
            text = _power_text(a[0], value)
        elif op == "float":
            text = f"where({a[0]}, 1.0, 0.0)"
        else:
            text = f"{op}({', '.join(a)})"
        lines.append(f"    n{k} = {text}")
    lines.append(f"    return ({''.join(f'n{k}, ' for k in program.outputs)})")
    called = _OF_NUMBERS if xp is math else {name: getattr(xp, f) for name, f in _CALLED.items()}
    space: dict[str, Any] = {**called, "where": called["select"], "inf": np.inf, "nan": np.nan}
    space["not_"] = space.pop("not")
    exec(compile("\n".join(lines).replace("= not(", "= not_("), "<program>", "exec"), space)
    return space["run"]


def _power_text(a: str, power: int) -> str:
    if power == 2:
        return f"{a} * {a}"
    return f"{a} ** {float(power) if power < 0 else power!r}"
