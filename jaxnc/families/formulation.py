"""`Formulation`: a mechanism in one family of coordinates, with the maps to natural ones and back."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.errors import InputError, brief
from jaxnc.families.planner import Atlas, Variable, fit_parameters
from jaxnc.families.program import Evaluator
from jaxnc.families.shapes import values
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record, static
from jaxnc.solvers.assembly import derive
from jaxnc.system.design import design, design_numbers
from jaxnc.system.equations import Equations as Numbered
from jaxnc.system.equations import measured
from jaxnc.system.frames import along, over, spread
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, ArrayLike, Numbers
from jaxnc.validate import as_shape

if TYPE_CHECKING:
    from jaxnc.families.written import Equations


@public
@record
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
        return self._place_all(z)

    def _place_all(self, z: Array) -> Array:
        """All coordinates of `natural`, from variables ``(..., n)``."""
        return _place_poses(self, derive(self.natural), z)

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
        z = _readings(self, derive(self.system), q)
        if self.atlas is None or z.ndim < 2 or not continuous:
            return z
        turning = np.array([v.angle and v.name not in top.scalars for v in self.listed])
        return jnp.where(turning, jnp.unwrap(z, axis=-2), z)

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
        from jaxnc.families.written import write_equations

        return write_equations(self, numbers, names or {})

    def __repr__(self) -> str:
        return (
            f"Formulation({self.natural.name!r} in {self.family} coordinates: n = {self.n}, r = {self.r}, g = {self.g})"
        )

    def __str__(self) -> str:
        lines = [f"{self.natural.name}: {self.family} coordinates, n = {self.n}, r = {self.r}, g = {self.g}"]
        width = max((len(n) for n in self.variables), default=0)
        return "\n".join([*lines, *(f"  {name:{width}}  {what}" for name, what in self.variables.items())])


@jit
def _place_poses(formulation: Formulation, eq: Numbered, z: Array) -> Array:
    return over(lambda x: formulation.place(eq, x), z)


@jit
def _readings(formulation: Formulation, eq: Numbered, q: Array) -> Array:
    return over(lambda x: formulation._read(eq, x), q)


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
