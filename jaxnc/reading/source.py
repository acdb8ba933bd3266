"""A program as a Python function of NumPy arrays: operations on whole lanes at once, nothing interpreted.

The same text does for plain arrays of any shape: an input may be a number, or an array that broadcasts with the others.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxnc.reading.program import Program

_BINARY = {
    "add": "+",
    "sub": "-",
    "mul": "*",
    "div": "/",
    "lt": "<",
    "le": "<=",
    "gt": ">",
    "ge": ">=",
    "eq": "==",
    "ne": "!=",
    "and": "&",
    "or": "|",
}
_CALLED = {
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "log1p": np.log1p,
    "expm1": np.expm1,
    "pow": np.power,
    "max": np.maximum,
    "min": np.minimum,
    "floor": np.floor,
    "ceil": np.ceil,
    "round": np.rint,
    "rem": np.fmod,
    "not": np.logical_not,
    "select": np.where,
    "finite": np.isfinite,
}
NAMES = {*_BINARY, *_CALLED, "neg", "power", "float"}
"""Operations that a program may have."""


def function(program: Program, xp: Any = np) -> Callable[[Sequence[Any]], tuple[Any, ...]]:
    """The program as a function from a sequence of its inputs to a tuple of its outputs.

    Args:
        program: the program.
        xp: where its functions are found: NumPy, or ``jax.numpy`` for a program that is traced.
    """
    lines = ["def run(x):"]
    for k, (op, of, value) in enumerate(program.nodes):
        a = [f"n{i}" for i in of]
        if op == "input":
            text = f"x[{value}]"
        elif op == "number":
            text = _literal(value[1])
        elif op in _BINARY:
            text = f"{a[0]} {_BINARY[op]} {a[1]}"
        elif op == "neg":
            text = f"-{a[0]}"
        elif op == "power":
            text = _power(a[0], value)
        elif op == "float":
            text = f"where({a[0]}, 1.0, 0.0)"
        else:
            text = f"{op}({', '.join(a)})"
        lines.append(f"    n{k} = {text}")
    lines.append(f"    return ({''.join(f'n{k}, ' for k in program.outputs)})")
    called = {name: getattr(xp, f.__name__) for name, f in _CALLED.items()}
    space: dict[str, Any] = {**called, "where": xp.where, "inf": np.inf, "nan": np.nan}
    space["not_"] = space.pop("not")
    exec(compile("\n".join(lines).replace("= not(", "= not_("), "<program>", "exec"), space)
    return space["run"]


def _literal(value: Any) -> str:
    return f"({value!r})"


def _power(a: str, power: int) -> str:
    if power == 2:
        return f"{a} * {a}"
    return f"{a} ** {float(power) if power < 0 else power!r}"
