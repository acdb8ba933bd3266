"""A program as the body of a JavaScript function, for pages that calculate by themselves.

What is used once stands where it is used, so that the text is short; everything else has a name.
"""

import itertools
import math
import string
from collections import Counter
from collections.abc import Callable, Iterator

from jaxnc.reading.program import Program

FUNCTIONS = (
    "const {sqrt,abs,sign,sin,cos,tan,asin,acos,atan,atan2,sinh,cosh,tanh,exp,log,log1p,expm1,pow,max,min,floor,ceil}="
    "Math,rint=x=>{const f=floor(x),d=x-f;return d<.5||d===.5&&f%2===0?f:f+1};"
)
"""What the bodies need in front of them."""

_BINARY = {
    "add": ("+", 11), "sub": ("-", 11), "mul": ("*", 12), "div": ("/", 12), "rem": ("%", 12), "lt": ("<", 9),
    "le": ("<=", 9), "gt": (">", 9), "ge": (">=", 9), "eq": ("===", 8), "ne": ("!==", 8), "and": ("&&", 4),
    "or": ("||", 3),
}  # fmt: skip
"""Signs, and how strongly they bind; all of them from the left."""
_WHOLE, _NOT, _POWER, _TIMES, _PLUS, _CHOICE = 20, 14, 13, 12, 11, 2
_NAMED = {"round": "rint", "finite": "isFinite"}


def javascript(program: Program, given: Callable[[int], str], into: Callable[[int], str]) -> str:
    """Write statements that calculate a program's outputs; in front of them belongs `FUNCTIONS`.

    `given` is what stands for each input, `into` what each output is assigned to; neither begins with a capital letter.
    """
    uses = Counter(i for node in program.nodes for i in node.of) + Counter(program.outputs)
    text: list[tuple[str, int]] = []  # of each node, and how strongly it is bound
    named: list[str] = []
    names = _short_names()

    def bracket(i: int, least: int) -> str:
        shown, strength = text[i]
        return shown if strength >= least else f"({shown})"

    for k, (op, of, value) in enumerate(program.nodes):
        strength = _WHOLE
        if op == "input":
            term = given(value)
        elif op == "number":
            term = _script_literal(value[1])
        elif op in _BINARY:
            sign, strength = _BINARY[op]
            term = f"{bracket(of[0], strength)}{sign}{bracket(of[1], strength + 1)}"
        elif op == "neg":
            term, strength = f"-{bracket(of[0], _WHOLE)}", _PLUS
        elif op == "not":
            term, strength = f"!{bracket(of[0], _WHOLE)}", _NOT
        elif op == "power":
            term, strength = f"{bracket(of[0], _WHOLE)}**{abs(value)}", _POWER
            if value < 0:
                term, strength = f"1/{term}", _TIMES
        elif op == "float":
            term, strength = f"{bracket(of[0], _CHOICE + 1)}?1:0", _CHOICE
        elif op == "select":
            term, strength = "{}?{}:{}".format(*(bracket(i, _CHOICE + 1) for i in of)), _CHOICE
        else:
            term = f"{_NAMED.get(op, op)}({','.join(text[i][0] for i in of)})"
        if uses[k] > 1 and op not in ("input", "number"):
            name = next(names)
            named.append(f"{name}={term}")
            term, strength = name, _WHOLE
        text.append((term, strength))
    lines = [f"const {','.join(named)}"] if named else []
    lines += [f"{into(r)}={text[k][0]}" for r, k in enumerate(program.outputs)]
    return ";".join(lines)


def _short_names() -> Iterator[str]:
    """Yield short names that begin with a capital letter, and are none of the language's."""
    letters = string.ascii_uppercase + string.ascii_lowercase + string.digits
    for size in itertools.count(1):
        for first in string.ascii_uppercase:
            for rest in itertools.product(letters, repeat=size - 1):
                name = first + "".join(rest)
                if name != "NaN":
                    yield name


def _script_literal(value: float | bool) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "(1/0)" if value > 0 else "(-1/0)"
    shown = repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)
    return shown.removeprefix("0") or "0" if math.copysign(1.0, value) > 0 else f"({shown if value else '-0'})"
