"""A program as a Python function of NumPy arrays: operations on whole lanes at once, nothing interpreted.

The same text does for plain arrays of any shape: an input may be a number, or an array that broadcasts with the others;
and for Python's own numbers, with the functions of `math`.
"""

import math
import operator
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.reading.program import Program

if TYPE_CHECKING:
    from jaxnc.solvers.rows import Numerics

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
