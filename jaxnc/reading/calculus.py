"""Derivatives of programs, written as programs, and what outputs are as polynomials in some of the inputs.

Degree and sparsity are derived and never sampled.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

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


# -- degree --------------------------------------------------------------------------------------------------------

_MOST = 400  # terms that are kept: what has more is treated as no polynomial
_HIGHEST = 4  # degree that is kept


class Polynomial(NamedTuple):
    """An output as a function of the variables."""

    depends: frozenset[int]  # which variables it depends on, by their places
    # Coefficients by their monomials, or None where it is no polynomial (or one too long to be of use). A monomial is
    # the places of its variables, ascending, one named twice for a square; a coefficient is again a sum, of numbers
    # times what does not depend on the variables, whose nodes are named.
    terms: "dict[tuple[int, ...], Coefficient] | None"


Coefficient = dict[tuple[int, ...], float]

_ONE: Coefficient = {(): 1.0}
_NEVER = frozenset[int]()


def polynomials(program: Program, variables: Sequence[int]) -> tuple[Polynomial, ...]:
    """Find the polynomial that each output of a program is in its inputs `variables`; all others are constants."""
    place = {v: k for k, v in enumerate(variables)}
    found: list[Polynomial] = []
    for at, node in enumerate(program.nodes):
        if node.op == "input":
            k = place.get(node.value)
            found.append(_constant(at) if k is None else Polynomial(frozenset((k,)), {(k,): _ONE}))
            continue
        if node.op == "number":
            value = node.value[1]
            found.append(Polynomial(_NEVER, {(): {(): float(value)}} if value else {}))
            continue
        of = [found[i] for i in node.of]
        depends = _NEVER.union(*(p.depends for p in of))
        terms = _terms(node.op, node.value, of)
        if terms is None:
            found.append(Polynomial(depends, None) if depends else _constant(at))
            continue
        terms = {m: c for m, c in terms.items() if c}
        if len(terms) > _MOST or any(len(m) > _HIGHEST for m in terms):
            found.append(Polynomial(depends, None))
        elif depends and not any(terms):
            found.append(Polynomial(_NEVER, terms))
        else:
            found.append(Polynomial(_NEVER.union(*terms), terms) if depends else _constant(at))
    return tuple(found[k] for k in program.outputs)


def _constant(at: int) -> Polynomial:
    return Polynomial(_NEVER, {(): {(at,): 1.0}})


def _terms(op: str, value: int | None, of: Sequence[Polynomial]) -> dict[tuple[int, ...], Coefficient] | None:
    if any(p.terms is None for p in of):
        return None
    if op in ("add", "sub"):
        return _add_polynomials(of[0].terms, of[1].terms, -1.0 if op == "sub" else 1.0)
    if op == "neg":
        return _add_polynomials({}, of[0].terms, -1.0)
    if op == "mul":
        return _multiply(of[0].terms, of[1].terms)
    if op == "power" and value is not None and 0 < value <= _HIGHEST:
        out = of[0].terms
        for _ in range(value - 1):
            out = None if out is None else _multiply(out, of[0].terms)
        return out
    if op == "div" and not of[1].depends:
        below = of[1].terms
        # Divided by a constant: by a number, or by one node, which is named by its complement.
        only = next(iter(below[()].items())) if below and len(below.get((), ())) == 1 else None
        if only is None:
            return None
        (names, factor), inverse = only, {}
        inverse[tuple(~n for n in names)] = 1.0 / factor
        return _multiply(of[0].terms, {(): inverse})
    return None


def _add_polynomials(a, b, factor: float) -> dict[tuple[int, ...], Coefficient]:
    out = {m: dict(c) for m, c in a.items()}
    for m, c in b.items():
        mine = out.setdefault(m, {})
        for name, x in c.items():
            total = mine.get(name, 0.0) + factor * x
            if total:
                mine[name] = total
            else:
                mine.pop(name, None)
    return out


def _multiply(a, b) -> dict[tuple[int, ...], Coefficient] | None:
    if len(a) * len(b) > _MOST:
        return None
    out: dict[tuple[int, ...], Coefficient] = {}
    for m, c in a.items():
        for n, d in b.items():
            product = {tuple(sorted((*p, *q))): 0.0 for p in c for q in d}
            for p, x in c.items():
                for q, y in d.items():
                    product[tuple(sorted((*p, *q)))] += x * y
            out = _add_polynomials(out, {tuple(sorted((*m, *n))): product}, 1.0)
    return out
