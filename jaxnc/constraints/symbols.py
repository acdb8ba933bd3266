"""Symbolic numbers: handed to the residual of a kind, they come out as equations that a person can read.

A kind is plain arithmetic on numbers, so numbers that remember what was done to them write it down, for the user's own
kinds as well as for the catalogue's. An expression is a sum of terms, a term a coefficient and powers of atoms; an
atom is a symbol, a function of an expression, or a sum in brackets. Products of sums are not multiplied out: a squared
length stays ``(x_1 - x_A)^2 + (y_1 - y_A)^2``.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Union

from jaxnc.errors import InputError

Number = int | float


@dataclass(frozen=True)
class Symbol:
    """A letter: a variable of the problem, or a constant."""

    name: str  # what it is called in plain text, "x_1"
    latex: str  # the same in LaTeX
    variable: bool = True  # whether it is solved for
    value: float | None = None  # its number where it is known; what a constant is replaced by
    axis: str = ""  # "x", "y", "z" for a component, by which sums are ordered


@dataclass(frozen=True)
class Function:
    """A function of one expression: ``sin``, ``cos``, ``sqrt``."""

    name: str
    of: "Expression"


Atom = Union[Symbol, Function, "Expression"]
Factors = tuple[tuple[Atom, int], ...]
PI = Symbol("π", r"\pi", False, math.pi)


@dataclass(frozen=True)
class Expression:
    """A sum of terms ``coefficient · atom^power · …``."""

    terms: tuple[tuple[float, Factors], ...]

    __array_ufunc__ = None  # numbers of numpy leave the arithmetic to this class

    @classmethod
    def of(cls, value: "Number | Atom") -> "Expression":
        """The expression of a number or an atom."""
        if isinstance(value, Expression):
            return value
        if isinstance(value, Symbol | Function):
            return cls(((1.0, ((value, 1),)),))
        value = float(value)  # a TypeError for what is no number
        return cls(((value, ()),) if value else ())

    @property
    def number(self) -> float | None:
        """Its value if it is a plain number."""
        if not self.terms:
            return 0.0
        return self.terms[0][0] if len(self.terms) == 1 and not self.terms[0][1] else None

    def __add__(self, other: Any) -> "Expression":
        found: dict[Factors, float] = {}
        for coefficient, factors in (*self.terms, *Expression.of(other).terms):
            found[factors] = found.get(factors, 0.0) + coefficient
        return Expression(tuple((c, f) for f, c in found.items() if c))

    __radd__ = __add__

    def __neg__(self) -> "Expression":
        return Expression(tuple((-c, f) for c, f in self.terms))

    def __sub__(self, other: Any) -> "Expression":
        return self + (-Expression.of(other))

    def __rsub__(self, other: Any) -> "Expression":
        return Expression.of(other) + (-self)

    def _term(self) -> tuple[float, Factors]:
        """Make one term of the expression: a sum of several becomes an atom in brackets."""
        return self.terms[0] if len(self.terms) == 1 else (1.0, ((self, 1),))

    def __mul__(self, other: Any) -> "Expression":
        other = Expression.of(other)
        for a, b in ((self, other), (other, self)):
            if a.number is not None:
                return Expression(tuple((a.number * c, f) for c, f in b.terms)) if a.number else ZERO
        (c, f), (d, g) = self._term(), other._term()
        powers: dict[Atom, int] = dict(f)
        for atom, power in g:
            powers[atom] = powers.get(atom, 0) + power
        return Expression(((c * d, tuple((a, p) for a, p in powers.items() if p)),))

    __rmul__ = __mul__

    def _inverse(self) -> "Expression":
        c, f = self._term()
        return Expression(((1.0 / c, tuple((a, -p) for a, p in f)),))

    def __truediv__(self, other: Any) -> "Expression":
        return self * Expression.of(other)._inverse()

    def __rtruediv__(self, other: Any) -> "Expression":
        return Expression.of(other) * self._inverse()

    def __pow__(self, power: int) -> "Expression":
        if not isinstance(power, int) or power < 0:
            raise TypeError("symbols are raised to whole powers only")
        out = Expression.of(1.0)
        for _ in range(power):
            out = out * self
        return out

    def apply(self, name: str) -> "Expression":
        """A function of it; of a plain number, its value."""
        if self.number is not None:
            return Expression.of(_FUNCTIONS[name](self.number))
        return Expression.of(Function(name, self))

    # -- what it says -------------------------------------------------------------------------------------------

    def evaluate(self, values: Mapping[str, float]) -> float:
        """Its value, from those of its symbols by name; constants that carry theirs need not be given."""

        def atom(a: Atom) -> float:
            if isinstance(a, Symbol):
                value = values.get(a.name, a.value)
                if value is None:
                    raise InputError(f"symbol {a.name!r} has no value of its own; give it by its name")
                return float(value)
            return _FUNCTIONS[a.name](a.of.evaluate(values)) if isinstance(a, Function) else a.evaluate(values)

        return sum(c * math.prod(atom(a) ** p for a, p in f) for c, f in self.terms)

    @property
    def degree(self) -> int | None:
        """Degree in the variables, sines and cosines of them counting as variables; None if it is no polynomial."""
        found = [0]
        for _, factors in self.terms:
            total = 0
            for atom, power in factors:
                size = _atom_degree(atom)
                if size is None or (size and power < 0):
                    return None
                total += size * power
            found.append(total)
        return max(found)

    @property
    def trigonometric(self) -> int:
        """How many sines and cosines of variables are written in it."""
        return sum(_trigonometric(atom) for _, factors in self.terms for atom, _ in factors)

    def map(self, change: Callable[[Symbol], "Number | Atom"]) -> "Expression":
        """The expression with its symbols replaced."""
        out = ZERO
        for c, factors in self.terms:
            term = Expression.of(c)
            for atom, power in factors:
                new = Expression.of(change(atom)) if isinstance(atom, Symbol) else _map_inside(atom, change)
                term = term * (new**power if power > 0 else Expression.of(1.0) / new**-power)
            out = out + term
        return out

    def text(self, latex: bool = False, digits: int = 6) -> str:
        """Write the expression as plain text, or in LaTeX."""
        varying = [t for t in self.terms if _varies(t)]
        if all(map(_term_axis, varying)):
            varying = sorted(varying, key=_term_axis)
        terms = varying + [t for t in self.terms if not _varies(t)]
        first = next((k for k, t in enumerate(terms) if t[0] > 0), 0)
        if first and all(isinstance(atom, Symbol) for atom, _ in terms[0][1]):
            terms.insert(0, terms.pop(first))  # "x_D - x_1" rather than "-x_1 + x_D"
        out = ""
        for coefficient, factors in terms:
            sign = "-" if coefficient < 0 else "+"
            body = _product_text(abs(coefficient), factors, latex, digits)
            out += f" {sign} {body}" if out else ("-" if sign == "-" else "") + body
        return out or "0"

    def __str__(self) -> str:
        return self.text()


ZERO = Expression(())
_FUNCTIONS: dict[str, Callable[[float], float]] = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt}


def _map_inside(atom: "Function | Expression", change: Callable) -> Expression:
    return atom.of.map(change).apply(atom.name) if isinstance(atom, Function) else atom.map(change)


def _atom_degree(atom: Atom) -> int | None:
    if isinstance(atom, Symbol):
        return int(atom.variable)
    if isinstance(atom, Expression):
        return atom.degree
    inner = atom.of.degree
    return 0 if inner == 0 else 1 if atom.name in ("sin", "cos") else None


def _trigonometric(atom: Atom) -> int:
    if isinstance(atom, Symbol):
        return 0
    if isinstance(atom, Expression):
        return atom.trigonometric
    return atom.of.trigonometric + int(atom.name in ("sin", "cos") and atom.of.degree != 0)


def _varies(term: tuple[float, Factors]) -> bool:
    return any(_atom_degree(atom) != 0 for atom, _ in term[1])


def _term_axis(term: tuple[float, Factors]) -> str:
    """The axis of a term's first component, by which sums of products are ordered as one writes them."""
    for atom, _ in term[1]:
        if isinstance(atom, Symbol) and atom.axis:
            return atom.axis
        if isinstance(atom, Expression):
            for inner in atom.terms:
                if found := _term_axis(inner):
                    return found
    return ""


def _fraction(value: float, latex: bool, digits: int) -> tuple[str, str]:
    """A coefficient as numerator and denominator, "" for one."""
    from fractions import Fraction

    near = Fraction(value).limit_denominator(12)
    if value and abs(float(near) - value) <= 1e-15 * abs(value):
        top, bottom = str(near.numerator), str(near.denominator)
        return "" if top == "1" else top, "" if bottom == "1" else bottom
    shown = f"{value:.{digits}g}"
    if "e" in shown and latex:
        mantissa, _, power = shown.partition("e")
        shown = rf"{mantissa} \cdot 10^{{{int(power)}}}"
    return shown, ""


def _product_text(coefficient: float, factors: Factors, latex: bool, digits: int) -> str:
    top, bottom = _fraction(coefficient, latex, digits)
    # Numbers and constants first, then variables, then functions, as one writes them.
    ordered = sorted(factors, key=lambda f: (isinstance(f[0], Function), _atom_degree(f[0]) != 0))
    above = [_power_text(a, p, latex, digits) for a, p in ordered if p > 0]
    below = [_power_text(a, -p, latex, digits) for a, p in ordered if p < 0]
    if not above and not top:
        top = "1"
    if latex and (bottom or below):
        first = above[:1] if bottom and above and not isinstance(ordered[0][0], Function) else []
        numerator = " ".join(([top] if top else []) + first) or "1"
        denominator = " ".join(([bottom] if bottom else []) + below)
        return " ".join([rf"\frac{{{numerator}}}{{{denominator}}}", *above[len(first) :]])
    words = [*([top] if top else []), *above]
    number, last = [bottom] if bottom else [], len(words) - 1
    for at, over in ((0, number), (last, below)) if last else ((0, number + below),):
        if over and " " in words[at] and words[at][0] != "(" and words[at][-1] != ")":
            words[at] = f"({words[at]})"  # cos φ/2 would be read as cos(φ/2)
        words[at] += "".join(f"/{b}" for b in over)
    return " ".join(words)


def _power_text(atom: Atom, power: int, latex: bool, digits: int) -> str:
    exponent = "" if power == 1 else f"^{{{power}}}" if latex else f"^{power}"
    if isinstance(atom, Symbol):
        return (atom.latex if latex else atom.name) + exponent
    if isinstance(atom, Expression):
        inner = atom.text(latex, digits)
        return (rf"\left({inner}\right)" if latex else f"({inner})") + exponent
    inner = atom.of.text(latex, digits)
    if latex and atom.name == "sqrt":
        return rf"\sqrt{{{inner}}}" + exponent
    simple = len(atom.of.terms) == 1 and atom.name != "sqrt" and len(atom.of.terms[0][1]) == 1
    name = rf"\{atom.name}" if latex else atom.name
    if simple and abs(atom.of.terms[0][0]) == 1.0 and atom.of.terms[0][0] > 0:
        return f"{name}{exponent} {inner}"
    return f"{name}{exponent}" + (rf"\left({inner}\right)" if latex else f"({inner})")
