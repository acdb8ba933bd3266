"""Straight-line programs over single numbers: what a pure JAX function of a few numbers comes down to.

A constraint kind is one function; whatever has to be known of it is a *reading* of its program, never a second
statement: values of NumPy lanes, derivatives, degree and sparsity. A program is a list of nodes, each an operation on
earlier ones; equal nodes are one, and what is known beforehand is computed beforehand.
"""

import math
import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple


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
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "neg": operator.neg,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "abs": abs,
    "lt": operator.lt,
    "le": operator.le,
    "gt": operator.gt,
    "ge": operator.ge,
    "eq": operator.eq,
    "ne": operator.ne,
    "and": operator.and_,
    "or": operator.or_,
    "not": operator.not_,
    "max": max,
    "min": min,
    "float": float,
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
