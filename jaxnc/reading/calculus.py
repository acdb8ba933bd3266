"""Derivatives of programs, written as programs."""

from collections.abc import Callable, Mapping, Sequence

from jaxnc.reading.program import Builder, Node, Program

_Rule = Callable[[Builder, tuple[int, ...], int, int], int]


def _over_square(b: Builder, at: int) -> int:
    return b.op("mul", at, at)


def _one(b: Builder) -> int:
    return b.number(1.0)


# Derivative with respect to argument k, from the arguments, the result and k.
_RULES: dict[str, _Rule] = {
    "sqrt": lambda b, a, y, k: b.op("div", b.number(0.5), y),
    "abs": lambda b, a, y, k: b.op("sign", a[0]),
    "sin": lambda b, a, y, k: b.op("cos", a[0]),
    "cos": lambda b, a, y, k: b.op("neg", b.op("sin", a[0])),
    "tan": lambda b, a, y, k: b.op("add", _one(b), _over_square(b, y)),
    "asin": lambda b, a, y, k: b.op("div", _one(b), b.op("sqrt", b.op("sub", _one(b), _over_square(b, a[0])))),
    "acos": lambda b, a, y, k: b.op(
        "neg", b.op("div", _one(b), b.op("sqrt", b.op("sub", _one(b), _over_square(b, a[0]))))
    ),
    "atan": lambda b, a, y, k: b.op("div", _one(b), b.op("add", _one(b), _over_square(b, a[0]))),
    "sinh": lambda b, a, y, k: b.op("cosh", a[0]),
    "cosh": lambda b, a, y, k: b.op("sinh", a[0]),
    "tanh": lambda b, a, y, k: b.op("sub", _one(b), _over_square(b, y)),
    "exp": lambda b, a, y, k: y,
    "log": lambda b, a, y, k: b.op("div", _one(b), a[0]),
    "log1p": lambda b, a, y, k: b.op("div", _one(b), b.op("add", _one(b), a[0])),
    "expm1": lambda b, a, y, k: b.op("add", y, _one(b)),
}
_FLAT = {
    *("sign", "floor", "ceil", "round", "finite", "not", "and", "or", "lt", "le", "gt", "ge", "eq", "ne", "float"),
    *("input", "number"),
}


def along(b: Builder, program: Program, at: Sequence[int], change: Mapping[int, int]) -> dict[int, int]:
    """Write how the nodes of a program change when some of them do; where the changes of all are that have one.

    The program's operations are there already (see `Builder.append`), at `at`; `change` are nodes of it that change,
    and where their changes are.
    """
    out = dict(change)
    for k, node in enumerate(program.nodes):
        if k in out or node.op in _FLAT:
            continue
        moved = [(j, out[i]) for j, i in enumerate(node.of) if i in out]
        if moved:
            found = _change_of(b, node, tuple(at[i] for i in node.of), at[k], moved)
            if b.known(found) != 0:
                out[k] = found
    return out


def _change_of(b: Builder, node: Node, a: tuple[int, ...], y: int, moved: list[tuple[int, int]]) -> int:
    op, change = node.op, dict(moved)
    zero = b.number(0.0)
    if op in ("add", "sub"):
        return b.op(op, change.get(0, zero), change.get(1, zero))
    if op == "neg":
        return b.op("neg", change[0])
    if op == "mul":
        return b.total(b.op("mul", d, a[1 - j]) for j, d in moved)
    if op == "div":
        top = b.op("sub", change.get(0, zero), b.op("mul", y, change.get(1, zero)))
        return b.op("div", top, a[1])
    if op == "power":
        lower = b.number(1.0) if node.value == 1 else b.op("power", a[0], value=node.value - 1)
        lower = a[0] if node.value == 2 else lower
        return b.op("mul", b.op("mul", b.number(float(node.value)), lower), change[0])
    if op == "pow":
        terms = []
        if 0 in change:
            lower = b.op("pow", a[0], b.op("sub", a[1], b.number(1.0)))
            terms.append(b.op("mul", b.op("mul", a[1], lower), change[0]))
        if 1 in change:
            base = b.op("select", b.op("eq", a[0], zero), b.number(1.0), a[0])
            terms.append(b.op("mul", b.op("mul", y, b.op("log", base)), change[1]))
        return b.total(terms)
    if op == "atan2":
        square = b.op("add", b.op("mul", a[0], a[0]), b.op("mul", a[1], a[1]))
        top = b.op("sub", b.op("mul", a[1], change.get(0, zero)), b.op("mul", a[0], change.get(1, zero)))
        return b.op("div", top, square)
    if op == "select":
        return b.op("select", a[0], change.get(1, zero), change.get(2, zero))
    if op in ("max", "min"):
        first = b.op("gt" if op == "max" else "lt", a[0], a[1])
        both = change.get(0, zero), change.get(1, zero)
        mean = b.op("mul", b.number(0.5), b.op("add", *both))  # where they meet, as JAX has it
        return b.op("select", first, both[0], b.op("select", b.op("eq", a[0], a[1]), mean, both[1]))
    if op == "rem":
        if 1 not in change:
            return change[0]
        times = b.op("round", b.op("div", b.op("sub", a[0], y), a[1]))
        return b.op("sub", change.get(0, zero), b.op("mul", times, change[1]))
    return b.op("mul", _RULES[op](b, a, y, 0), change[0])


def partials(program: Program, variables: Sequence[int]) -> tuple[Program, tuple[tuple[int, int], ...]]:
    """Derivatives of the outputs with respect to some of the inputs.

    Outputs are those derivatives that can differ from zero, each with the output it belongs to and its place among
    `variables`.
    """
    b = Builder(program.inputs)
    at = b.append(program, b.first)
    inputs = {node.value: k for k, node in enumerate(program.nodes) if node.op == "input"}
    outputs, which = [], []
    for place, v in enumerate(variables):
        if v not in inputs:
            continue
        change = along(b, program, at, {inputs[v]: b.number(1.0)})
        for r, k in enumerate(program.outputs):
            if k in change:
                outputs.append(change[k])
                which.append((r, place))
    order = sorted(range(len(which)), key=which.__getitem__)
    return b.program([outputs[i] for i in order]), tuple(which[i] for i in order)


def rate(program: Program, variables: Sequence[int], order: int) -> Program:
    """The time derivative of some order of the outputs, while some of the inputs change.

    Its inputs are the n of the program, then the first derivatives of the m variables, the second ones and so on.
    """
    m, n = len(variables), program.inputs
    current = program
    for k in range(order):
        b = Builder(n + (k + 1) * m)
        at = b.append(current, b.first)
        moving = [*variables, *range(n, n + k * m)]
        to = [*range(n, n + m), *range(n + m, n + (k + 1) * m)]
        inputs = {node.value: i for i, node in enumerate(current.nodes) if node.op == "input"}
        change = {inputs[v]: b.first[t] for v, t in zip(moving, to, strict=True) if v in inputs}
        found = along(b, current, at, change)
        zero = b.number(0.0)
        current = b.program([found.get(i, zero) for i in current.outputs])
    return current
