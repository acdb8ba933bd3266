"""A mechanism in any family of coordinates, with the maps to natural ones and back; independent ones.

Independent coordinates are as many as there are freedoms (source text §1). Of an open chain they are its relative
coordinates, and every pose follows from them directly. Of a closed one they are inputs of the position problem, which
may have several solutions: these are found from many starts, in which bodies as rigid as they are have been thrown into
the mechanism's space.

Source of the rule by which starts are enough: I. J. Good, "The population frequencies of species and the estimation of
population parameters", Biometrika 40, 1953: species that were seen once tell of those that were not seen.
"""

import copy
import dataclasses
import functools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.constraints.elementary import Small
from jaxnc.constraints.symbols import PI, Expression, Symbol
from jaxnc.errors import InputError, brief, nearest
from jaxnc.families.bodies import Parts
from jaxnc.families.planner import Atlas, Planner, Reference, Variable, fit_parameters
from jaxnc.families.program import Evaluator, Program
from jaxnc.families.relative import Relative, SpatialRelative
from jaxnc.families.shapes import PARAMETERS, Recipe, values
from jaxnc.kinematics.inputs import make_plan
from jaxnc.kinematics.modes import modes
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.traced import analyse_traced
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.mechanism.model import Place as Spot
from jaxnc.records import record as recorded
from jaxnc.records import static
from jaxnc.solvers.assembly import derive, settle
from jaxnc.status import Status
from jaxnc.system.design import design, design_numbers
from jaxnc.system.equations import Equations as Numbered
from jaxnc.system.equations import measured
from jaxnc.system.frames import along, over, spread
from jaxnc.system.system import System
from jaxnc.system.topology import Block, Topology
from jaxnc.types import AnyArray, Array, ArrayLike, Numbers
from jaxnc.validate import as_shape

# -- equations that a person can read: the residuals of a system, handed symbols -------------------------------------

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
    return Symbol(text, latex + (f"_{{{below}}}" if below else ""), variable, value, axis)


class _EquationWriter:
    """Symbols of one system."""

    def __init__(self, top: Topology, eq: Numbered, names: dict[str, str]):
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


# -- formulations -----------------------------------------------------------------------------------------------------


@public
@recorded
class Formulation:
    """A mechanism in one family of coordinates.

    The system is an ordinary one, so that `solve_position`, `sweep`, velocities, gradients, `vmap` and `diagnose` work
    on it as on any. It has the parameters of the natural one: moving points of the drawing are there as fixed points,
    called ``"B drawn"``.

    Attributes:
        family: its name.
        natural: the same mechanism as it compiles, in natural (mixed) coordinates; its parameters are the design.
        topology: the family's variables and rows.
        listed: the variables with what they mean.
        atlas: where all points and vectors are.
        freedom: degrees of freedom.
        independent: variables from which the others follow; see `System`.
    """

    natural: System
    family: str = static()
    topology: Topology = static()
    listed: tuple[Variable, ...] = static()
    atlas: Atlas | None = static()
    freedom: int = static()
    independent: tuple[str, ...] = static(default=())

    @property
    def system(self) -> System:
        """The compiled system of this family."""
        parameters = fit_parameters(self.natural.parameters, self.topology)
        return System(self.topology, parameters, self.freedom, self.independent)

    @property
    def variables(self) -> dict[str, str]:
        """The variables with what they mean, in order."""
        return {v.name: v.meaning for v in self.listed}

    @property
    def n(self) -> int:
        """Number of variables."""
        return len(self.topology.unknown)

    @property
    def g(self) -> int:
        """Degrees of freedom."""
        return self.freedom

    @property
    def r(self) -> int:
        """Number of independent constraint equations, ``n - g`` (1)."""
        return self.n - self.g

    @property
    def rows(self) -> int:
        """Number of constraint equations as written, redundant ones too."""
        return len(self.topology.rows)

    def replace(self, *values: Any, **more: Any) -> "Formulation":
        """Take another design; see `System.replace`."""
        return self.of(self.natural.replace(*values, **more))

    def of(self, natural: System) -> "Formulation":
        """Take another design of the compiled mechanism. Nothing recompiles."""
        if not isinstance(natural, System) or natural.topology != self.natural.topology:
            raise InputError(f"{self.natural.name!r}: of() takes a design of the same compiled mechanism")
        return dataclasses.replace(self, natural=natural)

    # -- maps ---------------------------------------------------------------------------------------------------

    def to_natural(self, z: ArrayLike) -> Array:
        """Natural coordinates from those of the family, exact and differentiable.

        Args:
            z: the variables, ``(..., n)``, or a motion of `system`.

        Returns:
            All coordinates of `natural`, ground included, ``(..., N)``, in the order of its ``topology.coordinates``.
        """
        z = z.q[..., self.topology.unknown] if isinstance(z, Motion) else self._numbers(z, "to_natural(): z")
        self._check(z.shape, len(self.listed), "variables of the family")
        return self._place_all(derive(self.natural), z)

    @jit
    def _place_all(self, eq: Numbered, z: Array) -> Array:
        """All coordinates of `natural`, from variables ``(..., n)``."""
        return over(lambda x: self.place(eq, x), z)

    def place(self, eq: Numbered, z: Array) -> Array:
        """`to_natural` of one pose, ``(n,)``, with the equations of `natural` at hand."""
        top, par = self.natural.topology, self.natural.parameters
        if self.atlas is None:
            q = eq.home.at[np.array([top.position[v.name] for v in self.listed], int)].set(z)
            return measure_scalars(top, eq, q, [n for n in top.scalars if n not in self.variables])
        at = self.atlas
        drawing = design_numbers(top, par, 1)[design(top).drawing]
        p, v = spread(top, eq.home)
        p_drawn, v_drawn = drawing[np.array(at.drawn, int)], v[np.array(at.vectors, int)]
        c = [x for r in at.recipes for x in values(r, p_drawn, v_drawn)]
        numbers = Evaluator(p[np.array(at.points, int)], v_drawn, z[np.array(at.variables, int)], c)
        found = [x for place in at.places for x in numbers.place(place)]
        found += [x for arm in at.directions for x in numbers.arm(arm)]
        scalars = [jnp.zeros(()) if s is None else numbers.scalar(s) for s in at.scalars]
        q = jnp.stack([jnp.asarray(x) for x in (*found, *scalars)])
        return measure_scalars(top, eq, q, [n for n, s in zip(top.scalars, at.scalars, strict=True) if s is None])

    def from_natural(self, q: Numbers, continuous: bool = True) -> Array:
        """Coordinates of the family from natural ones, exact and differentiable.

        Args:
            q: all coordinates of `natural`, ``(..., N)``, or a motion of it.
            continuous: whether angles, which a pose tells but for whole turns, go on along the last leading axis; they
                are in (-π, π] otherwise. Those that are coordinates of the mechanism count their turns in any case.

        Returns:
            The variables, ``(..., n)``.
        """
        q = q.q if isinstance(q, Motion) else self._numbers(q, "from_natural(): q")
        top = self.natural.topology
        self._check(q.shape, len(top.coordinates), "coordinates of the mechanism")
        z = self._read_all(derive(self.system), q)
        if self.atlas is None or z.ndim < 2 or not continuous:
            return z
        turning = np.array([v.angle and v.name not in top.scalars for v in self.listed])
        return jnp.where(turning, jnp.unwrap(z, axis=-2), z)

    @jit
    def _read_all(self, eq: Numbered, q: Array) -> Array:
        return over(lambda x: self._read(eq, x), q)

    def _read(self, eq: Numbered, q: Array) -> Array:
        top = self.natural.topology
        if self.atlas is None:
            return q[np.array([top.position[v.name] for v in self.listed], int)]
        (p, v), (home, directions), out = spread(top, q), spread(top, eq.home), []
        for one in self.listed:
            if one.reading is None or one.name in top.scalars:
                out.append(q[top.position[one.name]])
                continue
            reading, at, along = one.reading
            points, vectors = np.array(at, int), np.array(along, int)
            out.append(reading.evaluate(p[points], v[vectors], home[points], directions[vectors]))
        return jnp.stack([jnp.asarray(x) for x in out])

    def _numbers(self, x: ArrayLike, what: str) -> Array:
        return jnp.asarray(as_shape(x, what, ..., None, dtype=self.natural.dtype))

    def _check(self, shape: tuple, size: int, what: str) -> None:
        if not shape or shape[-1] != size:
            raise InputError(f"{self.family}: there are {size} {what}, shape (..., {size}); got shape {shape}")

    def motion(self, found: Motion) -> Motion:
        """A motion of `system` as one of the natural mechanism, with its points and rates by name.

        Args:
            found: what `solve_position` or `sweep` returned for `system`.

        Returns:
            The same poses, rates and statuses in natural coordinates.
        """
        if not isinstance(found, Motion):
            raise InputError(f"motion() takes one that solve_position or sweep made of .system, got {brief(found)}")
        z, place = found.q[..., self.topology.unknown], functools.partial(self.place, derive(self.natural))
        rates = tuple(
            along(place, z, tuple(x[..., self.topology.unknown] for x in found.rates[: k + 1]))
            for k in range(len(found.rates))
        )
        return Motion(
            self.natural, found.driven, found.held, self.to_natural(z), rates, found.asked, found.status,
            found.residual, found.conditioning, found.time,
        )  # fmt: skip

    def equations(self, numbers: bool = False, names: dict[str, str] | None = None) -> "Equations":
        """The constraint equations, to be read: ``print(f.equations())``, ``.markdown()``, ``.latex()``.

        Args:
            numbers: put numbers in the place of lengths and other constants.
            names: other names of symbols, by the names that they have without, such as ``{"L_A1": "L_1"}``.

        Returns:
            The equations, one for each row.
        """
        names = names or {}
        writer = _EquationWriter(self.topology, derive(self.system), names)
        lines = list(writer.lines())
        for name in names:
            if name not in writer.used:
                raise InputError(f"names={{{name!r}: …}}: there is no such symbol; {nearest(name, writer.used)}")

        def put_number(letter: Symbol) -> float | Symbol:
            return letter if letter.variable or letter.value is None or letter == PI else letter.value

        if numbers:
            lines = [EquationLine(x.row, x.expression and x.expression.map(put_number), x.otherwise) for x in lines]
        return Equations(lines)

    def __repr__(self) -> str:
        return (
            f"Formulation({self.natural.name!r} in {self.family} coordinates: n = {self.n}, r = {self.r}, g = {self.g})"
        )

    def __str__(self) -> str:
        lines = [f"{self.natural.name}: {self.family} coordinates, n = {self.n}, r = {self.r}, g = {self.g}"]
        width = max((len(n) for n in self.variables), default=0)
        return "\n".join([*lines, *(f"  {name:{width}}  {what}" for name, what in self.variables.items())])


def measure_all(system: System, q: np.ndarray) -> Array:
    """Poses ``(B, N)`` with their angles and distances measured anew from their points."""
    return _measure_poses(system.topology, derive(system), q)


@functools.partial(jit, static_argnums=0)
def _measure_poses(top: Topology, eq: Numbered, q: Array) -> Array:
    return jax.vmap(lambda x: measure_scalars(top, eq, x, top.scalars))(q)


def measure_scalars(top: Topology, eq: Numbered, q: Array, names: Sequence[str]) -> Array:
    """A pose ``(N,)`` with some of its angles and distances measured from its points."""
    at = np.array([top.position[n] for n in names], int)
    return q.at[at].set(measured(top, eq.constants, q)[at - len(top.coordinates)]) if names else q


# -- formulating ------------------------------------------------------------------------------------------------------

FAMILIES = ("independent", "relative", "reference", "natural", "mixed")

_LANES = 512  # starts that are solved together
_SPREADS = (1.0, 2.0, 4.0)  # of the drawing's box, batch by batch: legs may be longer than they are drawn


@public
def formulate(
    mechanism: Mechanism,
    family: str = "natural",
    keep: Sequence[str] = (),
    orientation: str = "euler parameters",
    closed: str = "joint",
    reference: str | Mapping[str, str | Spot] = "mass",
) -> Formulation:
    """Formulate a mechanism in a family of coordinates.

    Args:
        mechanism: the description.
        family: ``"relative"``, ``"reference"`` (reference points), ``"natural"``, ``"mixed"`` (natural coordinates with
            the mechanism's angles and distances) or ``"independent"``.
        keep: angles and distances of the mechanism that are to be variables, each with its own equation. Those that
            are a variable of the family anyway need not be named, and joints may keep some (docs/families.md).
        orientation: in space, of every body by its reference point, and in relative coordinates of ball joints:
            ``"euler parameters"``, ``"euler angles"``, ``"bryant angles"``, ``"rotation matrix"``.
        closed: how relative coordinates in space close a loop: by a ``"joint"`` that is left out with its variables, or
            through a ``"body"``, in six equations: then every joint has its variables.

        reference: reference points of bodies: ``"mass"``, the centre of mass of each (the middle of its points without
            mass), ``"middle"``, or for some bodies any point: ``{"coupler": "P"}`` by the name of one of its points or
            markers, ``{"coupler": (0.1, 0.2)}`` where it is drawn, lengths; the others have their centres of mass.

    Raises:
        InputError: unknown family or coordinate, something that the family cannot express.
        MechanismError: as in `Mechanism.compile`.

    Source: source text, §1 and §2, (1)-(17).
    """
    if not isinstance(mechanism, Mechanism):
        raise InputError(
            f"formulate() takes the Mechanism, got {type(mechanism).__name__}: a compiled System no longer knows its "
            f"bodies and joints as they were described; keep the Mechanism that it was compiled from"
        )
    if family not in FAMILIES:
        raise InputError(f"family={family!r}; {nearest(family, FAMILIES)}")
    if orientation not in PARAMETERS:
        raise InputError(f"orientation={orientation!r}; {nearest(orientation, PARAMETERS)}")
    if closed not in ("joint", "body"):
        raise InputError(f"closed={closed!r}; use 'joint' or 'body'")
    if closed == "body" and (family != "relative" or mechanism.model.dim == 2):
        raise InputError("closed='body' is for relative coordinates in space; in the plane a joint closes a loop")
    keep = (keep,) if isinstance(keep, str) else tuple(keep)
    if rolling := [n for n, j in mechanism.model.joints.items() if isinstance(j, record.Skate | record.RollingDisc)]:
        raise InputError(
            f"formulate: {mechanism.name!r} has rows on velocities ({', '.join(rolling)}), which no family of "
            f"coordinates writes; leave them out, or compile() and simulate() the mechanism"
        )
    if family in ("natural", "mixed"):
        return _formulate_natural(
            mechanism, _without_scalars(mechanism, keep) if family == "natural" else mechanism, family
        )
    system = mechanism.compile()
    parts = Parts(mechanism)
    if family == "reference":
        planner = Reference(parts, system, keep, orientation)
        planner.refer(reference)
        planner.plan()
        return compile_family(planner, system, family)
    if family == "relative":
        return compile_family(plan_relative(parts, system, keep, orientation, closed), system, family)
    return _formulate_independent(parts, system, keep)


def plan_relative(
    parts: Parts,
    natural: System,
    keep: tuple[str, ...] = (),
    orientation: str = "euler parameters",
    closed: str = "joint",
) -> Relative | SpatialRelative:
    """Plan relative coordinates, in the plane or in space."""
    if parts.dim == 2:
        planner = Relative(parts, natural, keep)
    else:
        parts.drop_rods()
        planner = SpatialRelative(parts, natural, keep, orientation)
        planner.closed = closed
    planner.plan()
    return planner


def compile_family(planner: Planner, natural: System, family: str) -> Formulation:
    """The formulation of a planner that has noted its variables and rows."""
    atlas, system, listed = planner.atlas(), planner.system(), tuple(planner.variables.values())
    return Formulation(natural, family, system.topology, listed, atlas, system.degrees_of_freedom, system.independent)


def _formulate_natural(mechanism: Mechanism, chosen: Mechanism, family: str) -> Formulation:
    whole = mechanism.compile()
    system = whole if chosen is mechanism else chosen.compile()
    top = system.topology
    first = len(top.coordinates) - len(top.scalars)
    listed = []
    for i in map(int, top.unknown):
        name = top.coordinates[i]
        angle = i >= first and top.angles[i - first]
        meaning = f"the {'angle' if angle else 'distance'} {name}" if i >= first else f"coordinate {name}"
        listed.append(Variable(name, meaning, angle, angle))
    return Formulation(whole, family, top, tuple(listed), None, system.degrees_of_freedom, system.independent)


def _formulate_independent(parts: Parts, natural: System, keep: tuple[str, ...]) -> Formulation:
    if not keep:
        direct = plan_relative(parts, natural)
        if not direct.rows:
            return compile_family(direct, natural, "independent")
    freedom = natural.degrees_of_freedom
    names = keep or tuple(natural.topology.scalars)[:freedom]
    if len(names) != freedom:
        raise InputError(
            f"{natural.name!r} has {freedom} degrees of freedom; name as many of its angles, distances or coordinates "
            f"of points as independent coordinates, keep=[…]; got {len(names)}"
        )
    chosen = Reference(parts, natural, names)
    chosen.choose("independent")
    system, listed = chosen.system(), tuple(chosen.variables.values())
    return Independent(natural, "independent", system.topology, listed, None, freedom, system.independent)


def _without_scalars(mechanism: Mechanism, keep: tuple[str, ...]) -> Mechanism:
    """The description without its angles and distances, but for some."""
    m = mechanism.model
    for name in keep:
        if name not in mechanism.scalar_names:
            raise InputError(f"keep={name!r}: {m.name!r} has no angle or distance of that name")
    gone = set(mechanism.scalar_names) - set(keep)
    used: list[tuple[str, Sequence[str]]] = []
    for name, joint in m.joints.items():
        if isinstance(joint, record.Wheels):
            used.append((f"the {joint.noun} {name!r}", joint.angles))
        elif isinstance(joint, record.Rolling | record.Screw | record.RackAndPinion):
            used.append((f"the {joint.noun} {name!r}", (joint.angle, joint.distance)))
    used += [(f"the relation {n!r}", [s for s in x.terms if s in gone]) for n, x in m.relations.items()]
    for noun, table in (("constraint", m.constraints), ("force", m.forces)):
        used += [(f"the {noun} {n!r}", [s for s in x.scalars if s in gone]) for n, x in table.items()]
    for what, names in used:
        if gone & set(names):
            raise InputError(
                f"{what} is an equation between {' and '.join(names)}, and natural coordinates have no angles and "
                f"distances; use family='mixed', or keep={list(names)!r}"
            )
    other = copy.copy(mechanism)
    other.model = copy.deepcopy(m)
    other.model.angles = {n: a for n, a in m.angles.items() if n not in gone}
    other.model.distances = {n: d for n, d in m.distances.items() if n not in gone}
    return other


@recorded
class Independent(Formulation):
    """A closed chain in independent coordinates: poses follow by the position problem, on the drawing's assembly."""

    def _place_all(self, eq: Numbered, z: Array) -> Array:
        flat = z.reshape(-1, z.shape[-1])
        found = solve_position(self.natural, {v.name: flat[:, k] for k, v in enumerate(self.listed)}, throw=False)
        return found.q.reshape(*z.shape[:-1], -1)

    def place(self, eq: Numbered, z: Array) -> Array:
        """`to_natural` of one pose."""
        return self._place_all(eq, z)

    def assemblies(self, values: dict[str, float], starts: int | None = None, seed: int = 0) -> Motion:
        """All poses with these values of the independent coordinates: those of `jaxnc.modes`, which has the proof too.

        A mechanism that it refuses is solved from many starts. That list is observed, not proved: a pose that hardly
        any start leads to may be missing.

        Args:
            values: a number for every independent coordinate.
            starts: how many random starts, in each of which every body is whole and somewhere else, if it is to be
                random starts. Where it has to be and this is not given, so many that the list is stable: 2048 at least,
                four times as many as the last new pose took, and every pose found five times; 16,384 at most.
            seed: another number gives other ways, or other starts.

        Returns:
            The poses of the natural mechanism, ``(assemblies,)``; the one nearest to the drawing first. Each is a
            solution to rounding, and no two are the same.

        Raises:
            InputError: coordinates that are missing, or not of this formulation.
        """
        names = [v.name for v in self.listed]
        if set(values) != set(names):
            raise InputError(f"assemblies() takes a value of each of {', '.join(names)}; got {', '.join(values)}")
        values = {name: float(values[name]) for name in names}
        if starts is None:
            try:
                return modes(self.natural, values, seed=seed).poses
            except InputError:  # no polynomials, or not isolated; what is wrong with the values is told below
                pass
        system, top, eq = self.natural, self.natural.topology, derive(self.natural)
        view = make_plan(system, tuple(values), (), "least squares")
        home = np.asarray(settle(eq, np.zeros(len(top.coordinates))).q)
        rng, lanes = np.random.default_rng(seed), min(_LANES, starts or _LANES)
        asked = jnp.broadcast_to(jnp.array(list(values.values())), (lanes, len(values)))
        found = _Poses(home, len(top.coordinates) - len(top.scalars))
        while found.starts < starts if starts else not found.stable:
            begun = _rigid_starts(system, home, lanes, rng, _SPREADS[found.starts // lanes % len(_SPREADS)])
            one = analyse_traced(view, "guess", eq, jnp.array(begun), asked, ())
            count = lanes if starts is None else min(lanes, starts - found.starts)
            found.add(*(np.asarray(a)[:count] for a in (one.q, one.status, one.size, one.conditioning)))
        q, status, residual, conditioning = found.sort()
        return Motion(
            system, tuple(values), (), jnp.array(q), (), jnp.broadcast_to(asked[0], (len(q), len(values))),
            jnp.array(status), jnp.array(residual), jnp.array(conditioning),
        )  # fmt: skip


class _Poses:
    """Distinct poses, each as well as it is known so far, and how often it was found."""

    def __init__(self, home: np.ndarray, spread: int):
        self.home, self.spread, self.size = home, spread, max(float(np.ptp(home[:spread])), 1e-300)
        self.starts = self.newest = 0  # how many there were, and how many when the last new pose was found
        self.seen = np.zeros(0, int)
        # Coordinates, statuses, residuals and conditionings.
        self.known = np.zeros((0, len(home))), np.zeros(0, int), np.zeros(0), np.zeros(0)

    def add(self, *ends: np.ndarray) -> None:
        """Sort the ends of some starts into the list: coordinates, statuses, residuals and conditionings."""
        self.starts += len(ends[0])
        q, status, residual, conditioning = (np.concatenate(a) for a in zip(self.known, ends, strict=True))
        often = np.append(self.seen, np.ones(len(ends[0]), int))
        good = np.flatnonzero((status == int(Status.CONVERGED)) | (status == int(Status.SINGULAR)))
        kept, seen, places = [], [], np.zeros((0, self.spread))
        # Of one assembly the pose that is known best is kept.
        for i in good[np.argsort(residual[good] / np.maximum(conditioning[good], 1e-300), kind="stable")]:
            # Poses closer than 1e-6 of the size are one assembly, or than Newton may be off at this conditioning.
            same = self.size * min(1e-3, max(1e-6, 1e-10 / max(conditioning[i], 1e-300)))
            like = np.flatnonzero(np.abs(places - q[i, : self.spread]).max(axis=1) <= same)
            if len(like):
                seen[like[0]] += often[i]
            else:
                kept, seen = [*kept, i], [*seen, often[i]]
                places = np.concatenate([places, q[i : i + 1, : self.spread]])
        if len(kept) > len(self.seen):
            self.newest = self.starts
        self.known, self.seen = (q[kept], status[kept], residual[kept], conditioning[kept]), np.array(seen, int)

    @property
    def stable(self) -> bool:
        """True if many more starts than the last new pose took brought none, and every pose came several times."""
        # Four times as many starts as the last new pose took; a pose that came five times was missed once in 150. A
        # list is returned as it is after 32 batches.
        quiet = self.starts >= 4 * max(_LANES, self.newest) and bool((self.seen >= 5).all())
        return quiet or self.starts >= 32 * _LANES

    def sort(self) -> tuple[np.ndarray, ...]:
        """Coordinates, statuses, residuals and conditionings, those of the pose nearest to the drawing first."""
        away = np.abs(self.known[0][:, : self.spread] - self.home[: self.spread]).sum(axis=1)
        return tuple(a[np.argsort(away, kind="stable")] for a in self.known)


def _rigid_starts(system: System, home: AnyArray, starts: int, rng: np.random.Generator, width: float) -> np.ndarray:
    """Poses ``(starts, N)`` in which every body is as long and wide as it is, turned and placed at random.

    A body that shares a point with the ground, or with a body before it, hangs on that point; others lie in a box that
    is `width` times as wide as the drawing's.
    """
    top = system.topology
    points, vectors = spread(top, home)
    fixed: AnyArray = np.array(top.fixed)
    placed, directed = (np.asarray(x.all(axis=1)) for x in spread(top, fixed))
    size, middle = width * float(np.ptp(points, axis=0).max()), points.mean(axis=0)
    out = np.broadcast_to(home, (starts, len(home))).copy()
    p = middle + size * rng.uniform(-1.0, 1.0, (starts, *points.shape))
    v = np.broadcast_to(vectors, (starts, *vectors.shape)).copy()
    p[:, placed] = points[placed]
    waiting = list(top.bodies)
    while waiting:
        # Bodies that hang on something come first.
        body = next((b for b in waiting if placed[list(b.points)].any()), waiting[0])
        waiting.remove(body)
        own, axes = list(body.points), list(body.vectors)
        turn = _draw_rotations(rng, starts, top.dim)
        hung = [k for k in own if placed[k]][:1]
        if own:
            pivot, where = (points[hung[0]], p[:, hung[0]]) if hung else (points[own].mean(axis=0), p[:, own[0]])
            free = [k for k in own if not placed[k]]
            p[:, free] = where[:, None] + np.einsum("sij,kj->ski", turn, points[free] - pivot)
            placed[own] = True
        free = [k for k in axes if not directed[k]]
        v[:, free] = np.einsum("sij,kj->ski", turn, vectors[free])
        directed[axes] = True
    thrown = np.concatenate([p.reshape(starts, -1), v.reshape(starts, -1)], axis=1)
    out[:, : thrown.shape[1]] = np.where(fixed[: thrown.shape[1]], home[: thrown.shape[1]], thrown)
    if top.scalars:
        out = np.asarray(measure_all(system, out))
    return out


def _draw_rotations(rng: np.random.Generator, count: int, dim: int) -> np.ndarray:
    """Rotations ``(count, dim, dim)``, uniform over all of them."""
    q, r = np.linalg.qr(rng.normal(size=(count, dim, dim)))
    q = q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]
    q[np.linalg.det(q) < 0.0, :, 0] *= -1.0
    return q
