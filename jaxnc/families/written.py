"""Constraint equations that a person can read: the residuals of a system, handed symbols."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.constraints.elementary import Small
from jaxnc.constraints.symbols import PI, Expression, Symbol
from jaxnc.errors import InputError, nearest
from jaxnc.families.program import Program
from jaxnc.families.shapes import Recipe
from jaxnc.solvers.assembly import derive
from jaxnc.system.equations import Equations as Numbers
from jaxnc.system.topology import Block, Topology

if TYPE_CHECKING:
    from jaxnc.families.formulation import Formulation

_GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "rho": "ρ", "sigma": "σ", "tau": "τ", "phi": "φ",
    "chi": "χ", "psi": "ψ", "omega": "ω",
}  # fmt: skip
_LETTERS = {
    "length": "L", "length1": "L", "length2": "L", "line": "L", "radius": "R", "radius1": "R1", "radius2": "R2",
    "along": "a", "across": "b", "constant": "c", "product": "c", "ratio": "k", "side": "σ", "distance": "d",
    "offset": "d", "normal": "γ", "angle": "α", "x": "ξ", "y": "η", "z": "ζ",
}  # fmt: skip
_PURE = ("k", "σ", "ξ", "η", "ζ", "x", "y", "z", "x1", "y1", "z1", "x2", "y2", "z2", "λ", "μ", "β")
_NEAR = 1e-12  # constants closer than this, relative, to a plain number are written as that number


@dataclass(frozen=True)
class EquationLine:
    """One equation."""

    row: str  # name of the row
    expression: Expression | None  # what vanishes; None where the kind does not take symbols
    otherwise: str = ""  # what is said of it then

    def text(self, latex: bool, digits: int) -> str:
        """The equation."""
        if self.expression is None:
            return rf"\text{{{self.otherwise}}}" if latex else self.otherwise
        return f"{self.expression.text(latex, digits)} = 0"


class Equations(tuple[EquationLine, ...]):
    """The equations of a formulation, to be printed, typeset, or looked into."""

    digits = 6

    def __str__(self) -> str:
        return "\n".join(line.text(False, self.digits) for line in self)

    __repr__ = __str__

    def markdown(self) -> str:
        """A Markdown table: number, row, equation."""
        rows = [f"| {k} | {line.row} | ${line.text(True, self.digits)}$ |" for k, line in enumerate(self, start=1)]
        return "\n".join(["| | row | equation |", "|---|---|---|", *rows])

    def latex(self) -> str:
        """A LaTeX ``align`` environment."""
        body = " \\\\\n".join(line.text(True, self.digits).replace(" = 0", " &= 0") for line in self)
        return f"\\begin{{align}}\n{body}\n\\end{{align}}"

    @property
    def degree(self) -> int | None:
        """Largest degree in the variables, sines and cosines counting as variables; None if one is no polynomial."""
        found = [None if line.expression is None else line.expression.degree for line in self]
        return None if None in found else max((d for d in found if d is not None), default=0)

    @property
    def trigonometric(self) -> int:
        """The number of sines and cosines that are written."""
        return sum(line.expression.trigonometric for line in self if line.expression is not None)


def as_symbol(name: str, variable: bool = True, value: float | None = None) -> Symbol:
    """The symbol of a coordinate: ``psi1`` is ψ with the index 1, ``crank.x`` is x with the index crank."""
    owner, _, letter = name.rpartition(".")
    found = re.fullmatch(r"([A-Za-zΑ-ω]+?)_?(\d*)(?:_(.+))?", letter)
    base, digit, more = found.groups() if found else (letter, "", None)
    if base not in _GREEK and "_" in letter:
        base, _, more = letter.partition("_")
        digit = ""
    index = [x for x in (more, owner) if x]
    return _symbol(base, digit, index, variable, value, letter if letter in ("x", "y", "z") else "")


def _symbol(base: str, digit: str, index: list[str], variable: bool, value: float | None, axis: str = "") -> Symbol:
    words = [w for w in (digit, *index) if w]
    latex = rf"\{base}" if base in _GREEK else base if len(base) == 1 else rf"\mathrm{{{base}}}"
    for name, letter in _GREEK.items():
        latex = rf"\{name}" if latex == letter else latex
    below = ",".join(w if len(w) == 1 or w.isdigit() else rf"\mathrm{{{w}}}" for w in words)
    text = _GREEK.get(base, base) + ("_" + ",".join(words) if words else "")
    latex += f"_{{{below}}}" if below else ""
    # Names may have spaces, which stand for products in plain text and for nothing in LaTeX.
    return Symbol(text.replace(" ", "_"), latex.replace(" ", "~"), variable, value, axis)


class _EquationWriter:
    """Symbols of one system."""

    def __init__(self, top: Topology, eq: Numbers, names: dict[str, str]):
        self.top, self.eq, self.names = top, eq, names
        self.variables = set(map(int, top.unknown))
        self.home = np.asarray(eq.home)
        self.known: dict[str, float] = {}
        self.used: set[str] = set()
        self.size = float(eq.length)

    def called(self, i: int) -> str:
        """Name of a point."""
        return self.top.points[i].removesuffix(" drawn")

    def final(self, made: Symbol) -> Expression:
        """A symbol under the name that the user gave it."""
        self.used.add(made.name)
        given = self.names.get(made.name)
        if given is None:
            return Expression.of(made)
        sign, given = (-1.0, given[1:]) if given.startswith("-") else (1.0, given)
        new = as_symbol(given, made.variable, None if made.value is None else sign * made.value)
        return sign * Expression.of(Symbol(new.name, new.latex, made.variable, new.value, made.axis))

    def coordinate(self, at: int) -> Expression:
        """A coordinate of the topology."""
        name = self.top.coordinates[at].replace(" drawn", "")
        if at in self.variables:
            return self.final(as_symbol(name))
        return self.final(as_symbol(name, False, float(self.home[at])))

    def constant(self, letter: str, index: list[str], value: float, angle: bool = False) -> Expression:
        """A constant of the drawing; a plain number where it is one."""
        if angle and (count := _right_angles(value)) is not None:
            return Expression.of(PI) * (count / 2)
        near = round(value)
        plain = (-1, 0, 1) if letter in _PURE else () if letter == "L" else (0,)
        if near in plain and abs(value - near) < _NEAR * (1.0 if letter in _PURE else self.size):
            return Expression.of(float(near))
        base, digit = (letter[0], letter[1:]) if letter[1:].isdigit() else (letter, "")
        made = _symbol(base, digit, index, False, value)
        while self.known.setdefault(made.name, value) != value and abs(self.known[made.name] - value) > 1e-14:
            made = Symbol(made.name + "'", made.latex + "'", False, value)
        return self.final(made)

    def length(self, i: int, j: int, value: float) -> Expression:
        """A length between two points, by their names."""
        drawn = [self.called(k) for k in range(len(self.top.points))]
        ends = sorted((self.called(i), self.called(j)), key=drawn.index)
        return self.constant("L", ["".join(ends)], value)

    def read(
        self, recipe: Recipe, points: tuple[int, ...], vectors: tuple[int, ...], c: np.ndarray
    ) -> list[Expression]:
        """Symbols of what a recipe reads."""
        at = [points[i] for i in recipe.points]
        who = [self.called(i) for i in at]
        if recipe.how == "length":
            return [self.length(at[0], at[1], c[0])]
        if recipe.how in ("between", "direction"):
            return [self.constant("α", ["".join(who)], c[0], True)]
        if recipe.how in ("local", "sliding"):
            origin = at[3:] if recipe.how == "local" else at[1:2]
            size = float(np.hypot(*c))
            if len(origin) == 1 and min(abs(c)) < _NEAR * self.size:
                length = self.length(origin[0], at[0], size)
                return [Expression.of(0.0) if abs(x) < _NEAR * self.size else float(np.sign(x)) * length for x in c]
            return [self.constant(letter, [who[0]], x) for letter, x in zip("ab", c, strict=True)]
        if recipe.how == "prismatic":
            span = float(np.linalg.norm(self.place(at[1]) - self.place(at[0])))
            length = self.length(at[0], at[1], span)
            part = c[1] / span if span else 0.0
            plain = abs(part) > _NEAR and abs(2 * part - round(2 * part)) < _NEAR and abs(part) <= 1
            offset = length * (round(2 * part) / 2) if plain else self.constant("d", [who[4] + who[5]], c[1])
            return [self.constant("γ", [who[4] + who[5]], c[0], True), offset]
        if recipe.how == "normal":
            line = [who[0] + who[1]]
            return [self.constant("γ", line, c[0], True), self.constant("d", line, c[1])]
        named = who[:1]
        if recipe.how not in ("from", "signed"):
            named = [self.top.vectors[vectors[v]] for v in recipe.vectors]
        named = [w.removesuffix(" drawn") for w in named] or ["".join(who[:2])]
        letters = recipe.names if recipe.how in ("across", "unit") else [_LETTERS[n] for n in recipe.names]
        return [self.constant(letter, named, x) for letter, x in zip(letters, c, strict=True)]

    def place(self, point: int) -> np.ndarray:
        """Where a point is drawn."""
        return self.home[point * self.top.dim : (point + 1) * self.top.dim]

    def constants(self, block: Block, i: int, b: int) -> list[Expression]:
        """The constants of one instance."""
        kind, c = block.kind, np.asarray(self.eq.constants[b][i])
        out: list[Expression] = []
        owned = self.top.called(*block.owners[i])
        first, own = 0, block.points[i]
        if isinstance(kind.residual, Program):
            for recipe in kind.residual.recipes:
                out += self.read(recipe, block.points[i], block.vectors[i], c[first : first + recipe.count])
                first += recipe.count
            own = tuple(block.points[i][k] for k in kind.residual.own)
        names = kind.constants[first:]
        if names == ("cosine", "sine"):
            angle = float(np.arctan2(c[first + 1], c[first]))
            if _right_angles(angle) is not None:
                return [*out, *(Expression.of(float(round(x))) for x in c[first:])]
            turn = self.constant("α", [owned], angle, True)
            return [*out, turn.apply("cos"), turn.apply("sin")]
        for k, name in enumerate(names):
            value = float(c[first + k])
            if (name.startswith("length") or name == "line") and len(own) in (2, 4):
                pair = own[:2] if name not in ("length2", "line") else own[2:]
                out.append(self.length(pair[0], pair[1], value))
            elif name.startswith("factor"):
                out.append(self.constant("k" + name[6:], [owned], value))
            else:
                index = [self.called(own[-1])] if name in ("along", "across") and own else [owned]
                out.append(self.constant(_LETTERS.get(name, _GREEK.get(name, name)), index, value))
        return out

    def lines(self) -> Iterator[EquationLine]:
        """All equations, in the order of the rows."""
        row = iter(self.top.rows)
        for b, block in enumerate(self.top.blocks):
            kind = block.kind
            for i in range(block.count if kind.rows else 0):
                labels = [next(row).replace(" drawn", "") for _ in kind.rows]
                try:
                    found = self.rows(block, b, i)
                except (TypeError, AttributeError, ValueError, IndexError):
                    at = [self.called(p) for p in block.points[i]] + [self.top.coordinates[s] for s in block.scalars[i]]
                    said = f"{kind.name}({', '.join(dict.fromkeys(at))}) = 0"
                    yield from (EquationLine(label, None, said) for label in labels)
                    continue
                yield from (EquationLine(label, e) for label, e in zip(labels, found, strict=True))

    def rows(self, block: Block, b: int, i: int) -> list[Expression]:
        """The rows of one instance."""
        dim, vectors = self.top.dim, len(self.top.points)

        def spread(k: int) -> Small:
            return Small(self.coordinate(k * dim + axis) for axis in range(dim))

        p, v = Small(map(spread, block.points[i])), Small(spread(vectors + k) for k in block.vectors[i])
        s = Small(map(self.coordinate, block.scalars[i]))
        rows = block.kind.residual(p, v, s, Small(self.constants(block, i, b)))
        return [Expression.of(r) for r in rows]


def _right_angles(angle: float) -> int | None:
    """The number of right angles that an angle is; None for any other."""
    count = round(angle / (np.pi / 2))
    return count if abs(angle - count * np.pi / 2) < _NEAR else None


def write_equations(formulation: "Formulation", numbers: bool, names: dict[str, str]) -> Equations:
    """The equations of a formulation; see `Formulation.equations`."""
    system = formulation.system
    writer = _EquationWriter(system.topology, derive(system), names)
    lines = list(writer.lines())
    for name in names:
        if name not in writer.used:
            raise InputError(f"names={{{name!r}: …}}: there is no such symbol; {nearest(name, writer.used)}")
    if numbers:
        lines = [EquationLine(x.row, x.expression and x.expression.map(_put_number), x.otherwise) for x in lines]
    return Equations(lines)


def _put_number(letter: Symbol) -> float | Symbol:
    return letter if letter.variable or letter.value is None or letter == PI else letter.value
