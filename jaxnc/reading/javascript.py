"""A program as the body of a JavaScript function, for pages that calculate by themselves.

What is used once stands where it is used, so that the text is short; everything else has a name.
"""

import math
from collections import Counter
from collections.abc import Callable

from jaxnc.reading.program import Program

FUNCTIONS = (
    "const {sqrt,abs,sign,sin,cos,tan,asin,acos,atan,atan2,sinh,cosh,tanh,exp,log,log1p,expm1,pow,max,min,floor,ceil}="
    "Math,rint=x=>{const f=floor(x),d=x-f;return d<.5||d===.5&&f%2===0?f:f+1};"
)
"""What the bodies need in front of them."""

_BINARY = {
    "add": "+", "sub": "-", "mul": "*", "div": "/", "rem": "%", "lt": "<", "le": "<=", "gt": ">", "ge": ">=",
    "eq": "===", "ne": "!==", "and": "&&", "or": "||",
}  # fmt: skip
_NAMED = {"round": "rint", "finite": "isFinite"}


def javascript(program: Program, given: Callable[[int], str], into: Callable[[int], str]) -> str:
    """Statements that calculate a program's outputs.

    Args:
        program: the program.
        given: what stands for each of its inputs, by its place.
        into: what each output is assigned to, by its place.

    Returns:
        The statements; in front of them belongs `FUNCTIONS`.
    """
    uses = Counter(i for node in program.nodes for i in node.of) + Counter(program.outputs)
    text: list[str] = []
    lines: list[str] = []
    for k, (op, of, value) in enumerate(program.nodes):
        a = [text[i] for i in of]
        if op == "input":
            written = given(value)
        elif op == "number":
            written = _literal(value[1])
        elif op in _BINARY:
            written = f"({a[0]}{_BINARY[op]}{a[1]})"
        elif op == "neg":
            written = f"(-{a[0]})"
        elif op == "not":
            written = f"(!{a[0]})"
        elif op == "power":
            written = f"({a[0]}**{value})" if value >= 0 else f"(1/{a[0]}**{-value})"
        elif op == "float":
            written = f"({a[0]}?1:0)"
        elif op == "select":
            written = f"({a[0]}?{a[1]}:{a[2]})"
        else:
            written = f"{_NAMED.get(op, op)}({','.join(a)})"
        if uses[k] > 1 and op not in ("input", "number"):
            lines.append(f"const n{k}={written}")
            written = f"n{k}"
        text.append(written)
    lines += [f"{into(r)}={text[k]}" for r, k in enumerate(program.outputs)]
    return ";".join(lines)


def _literal(value: float | bool) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "(1/0)" if value > 0 else "(-1/0)"
    shown = repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)
    return shown if math.copysign(1.0, value) > 0 else f"({shown if value else '-0'})"
