"""What a program's outputs are as polynomials in some of its inputs: degree and sparsity, derived and never sampled."""

from collections.abc import Sequence
from typing import NamedTuple

from jaxnc.reading.program import Program

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
