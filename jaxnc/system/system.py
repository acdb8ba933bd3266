"""The compiled mechanism as an immutable pytree: topology (static) and parameters (arrays)."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc import validate
from jaxnc.calls import public
from jaxnc.compiling import on_device
from jaxnc.constraints import UNIT
from jaxnc.errors import InputError, JaxncError, counted, list_first, nearest
from jaxnc.notebooks import Drawn
from jaxnc.records import record, static
from jaxnc.system.identity import Quantity
from jaxnc.system.precision import NARROW, chosen, numbers, to_width
from jaxnc.system.topology import Topology
from jaxnc.types import Array, ArrayLike, Float, Numbers, PyTree


@record
class Parameters:
    """The numbers a designer may change. Every leaf is a float array; nothing else is.

    Attributes:
        points: coordinates of all points as drawn, ground included, ``(points, dim)``, lengths.
        vectors: components of all vectors as drawn, ground included, ``(vectors, dim)``; only their direction counts.
        markers: coordinates of the markers (components, for directions) as drawn, ``(markers, dim)``.
        dimensions: explicit dimensions (lengths, radii, factors, constants), ``(dimensions,)``.
        physical: masses, inertias, stiffnesses, gravity, …, ``(physical,)``.
        own: the parameters of the user's own forces, a pytree of float arrays for each.
        near: of samples of another design its angles as drawn, ``(scalars,)``: their own are measured in the turn that
            is nearest to these, so that what counts turns does not jump where an angle is drawn at half a turn.
        rounded: whether 64-bit numbers were 32-bit ones before: redundant rows contradict each other by that rounding.
    """

    points: Float[Array, "points dim"]
    vectors: Float[Array, "vectors dim"]
    markers: Float[Array, "markers dim"]
    dimensions: Float[Array, " dimensions"]
    physical: Float[Array, " physical"] = dataclasses.field(default_factory=lambda: jnp.zeros(0))
    own: tuple[Any, ...] = ()
    near: Float[Array, " scalars"] | None = None
    rounded: bool = static(default=False)

    def in_numpy(self) -> "Parameters":
        """Make NumPy arrays of the numbers; those of a user's own forces stay as they are."""
        near = None if self.near is None else np.asarray(self.near)
        return dataclasses.replace(self, **{leaf: np.asarray(getattr(self, leaf)) for leaf in _LEAVES}, near=near)


_LEAVES = "points", "vectors", "markers", "dimensions", "physical"
"""The parameters that are arrays, one number or row for each name."""
_NUMBERS = "dimensions", "physical"  # one number


@public
@record
class System(Drawn):
    """A compiled mechanism: immutable, hashable topology plus differentiable parameters.

    ``jax.grad`` of a function of a system is again a system, whose ``grad["B"]`` is the gradient with respect to the
    drawn place of point B.

    Attributes:
        topology: the static part.
        parameters: the numbers.
        degrees_of_freedom: how many there are.
        independent: as many coordinates, from which all others follow where it was compiled.
    """

    topology: Topology = static()
    parameters: Parameters
    degrees_of_freedom: int = static(default=0)
    independent: tuple[str, ...] = static(default=())

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.topology.name

    @property
    def design_variables(self) -> tuple[str, ...]:
        """Names that `__getitem__` and `replace` understand: points, vectors, markers, explicit dimensions."""
        return tuple(name for names in self._variables.values() for name in names)

    @property
    def _variables(self) -> dict[str, tuple[str, ...]]:
        """Names of the design variables, by the parameters that they are."""
        top = self.topology
        markers, own = tuple(m.name for m in top.markers), tuple(f.address for f in top.loads.functions)
        arrays = zip(_LEAVES, (top.points, top.vectors, markers, top.dimensions, top.loads.physical), strict=True)
        return dict(arrays) | {"own": own}

    def _locate(self, name: str) -> tuple[str, int]:
        if not isinstance(name, str):
            raise InputError(f"design variables are named by strings, as {self.design_variables[0]!r} is; got {name!r}")
        for leaf, names in self._variables.items():
            if name in names:
                return leaf, names.index(name)
        either = [v for v in self.design_variables if v.partition(" ")[2] == name]
        if len(either) > 1:
            raise InputError(f"{name!r} may be {' or '.join(map(repr, either))}; say which")
        hint = nearest(name, self.design_variables)
        if "-" in name.rpartition(".")[2]:
            hint += "; a length is read off the drawing unless the body gives it with lengths="
        elif "." in name:
            hint += "; what is read off the drawing is none: give it where the joint or constraint is added"
        raise InputError(f"{self.name!r} has no design variable {name!r}; {hint}")

    __iter__ = None  # what is got by name is not gone through by numbers

    def __getitem__(self, name: str) -> Array:
        """The drawn place of a point or marker, the drawn vector, the value of a dimension, a mass, a stiffness.

        Of stacked designs, and of a Jacobian that has a system's form, it has their leading axes. Of a Hessian it is a
        row, again a system: ``jax.hessian(f)(system)["B"]["C"]``.
        """
        leaf, i = self._locate(name)
        values = getattr(self.parameters, leaf)
        if isinstance(values, System):
            lead = values._designs("points")[: -1 if leaf in _NUMBERS else -2]  # before the axes of this row
            return jax.tree.map(lambda x: x[(*lead, i)], values)
        return values[i] if leaf == "own" else values[(*self._designs(leaf), i)]

    def _designs(self, leaf: str) -> tuple[slice, ...]:
        """Leading axes of an array of parameters: of stacked designs, or of the numbers that a Jacobian is of."""
        return (slice(None),) * (np.ndim(getattr(self.parameters, leaf)) - (1 if leaf in _NUMBERS else 2))

    def replace(self, values: Mapping[str, ArrayLike] | None = None, **more: ArrayLike) -> "System":
        """A system of the same topology with some design variables changed. Nothing recompiles.

        Args:
            values: new values by name, ``(dim,)`` for points, vectors and markers, a number for dimensions; of stacked
                designs one for each, as `__getitem__` has them.
            **more: the same as keywords, for names that are Python identifiers.

        Returns:
            The new system.

        Raises:
            InputError: for a name that is not a design variable, or a value of the wrong shape.
        """
        leaves = {leaf: getattr(self.parameters, leaf) for leaf in _LEAVES}
        own = list(self.parameters.own)
        changed: dict[str, dict[int, Any]] = {}
        for name, value in {**(values or {}), **more}.items():
            leaf, i = self._locate(name)
            if leaf == "own":
                own[i] = _alike(own[i], value, name)
                continue
            lead, shape = len(self._designs(leaf)), leaves[leaf].shape
            want = (*shape[:lead], *shape[lead + 1 :])
            new = validate.as_traceable(value, f"design variable {name!r}", leaves[leaf].dtype)
            if new.shape != want:
                raise InputError(f"design variable {name!r} has shape {want}, got {new.shape}")
            positive = leaf == "dimensions" and self.topology.given[i].quantity is Quantity.LENGTH
            if positive and not isinstance(new, Tracer) and not np.all(new > 0):
                raise InputError(f"design variable {name!r} is a length and must be positive, got {value!r}")
            if leaf == "vectors" and not isinstance(new, Tracer) and not np.any(new, axis=-1).all():
                raise InputError(f"design variable {name!r} is a direction and cannot be the zero vector")
            changed.setdefault(leaf, {})[i] = new
        for leaf, items in changed.items():
            at, old, lead = np.array(list(items)), leaves[leaf], self._designs(leaf)
            if any(isinstance(x, Tracer) for x in (old, *items.values())):
                new = jnp.stack([*items.values()], axis=len(lead))
                leaves[leaf] = old.at[(*lead, at)].set(new)
            else:  # nothing to compile
                new = np.array(old)
                new[(*lead, at)] = np.stack([*items.values()], axis=len(lead))
                with numbers(old):
                    leaves[leaf] = on_device(new)
        parameters = dataclasses.replace(self.parameters, **leaves, own=tuple(own))
        return dataclasses.replace(self, parameters=parameters)

    def named(self) -> dict[str, object]:
        """Take all design variables by name: what a recipe of optax or equinox takes by name.

        A plain dict, so JAX takes it apart and puts it together, with names as its keys: a place ``(dim,)`` of each
        point and marker, components ``(dim,)`` of each vector, a number for each explicit dimension (lengths, angles,
        ratios), mass, stiffness and so on, and a pytree for each force that is a function with parameters. Inside of
        traced code the values are traced. `from_named` is the way back.

        Returns:
            The values, in the order of `design_variables`.

        Raises:
            InputError: the system stands for several designs.
        """
        if np.ndim(self.parameters.points) != 2:
            raise InputError(
                f"named() is of one design, and this {self.name!r} is several: map it, jax.vmap(lambda s: s.named())"
            )
        out: dict[str, Any] = {}
        for leaf, names in self._variables.items():
            values = getattr(self.parameters, leaf)
            if leaf != "own" and not isinstance(values, Tracer):  # nothing to compile
                with numbers(values):
                    values = on_device([*np.asarray(values)])
            out.update(zip(names, values, strict=True))
        return out

    def from_named(self, values: Mapping[str, Any]) -> "System":
        """Put design variables by name back into a system, with every name that `named` gives; `replace` takes some.

        Args:
            values: the values, as `named` gives them; traced ones too.

        Returns:
            The system with them, of the same topology. Nothing recompiles.

        Raises:
            InputError: a name that is no design variable, one that is missing, or a value that `replace` refuses.
        """
        known = self.design_variables
        if not isinstance(values, Mapping):
            raise InputError(f"{self.name!r}: values= takes a number or array for each name, as named() gives them")
        for name in values:
            if name not in known:
                self._locate(name)  # a name that is short for another one is none here
                raise InputError(f"{self.name!r}: from_named() takes whole names; {nearest(name, known)}")
        missing = [name for name in known if name not in values]
        if missing:
            told = f"{list_first([*map(repr, missing)], 14)} {'is' if len(missing) == 1 else 'are'} missing"
            raise InputError(
                f"{self.name!r}: from_named() takes all {len(known)} design variables, and {told}; replace() takes some"
            )
        return self.replace(values)

    @property
    def dtype(self) -> np.dtype:
        """Type of its numbers, with which everything is calculated for it: float64 or float32."""
        return np.dtype(self.parameters.points.dtype)

    def astype(self, dtype: str | type | np.dtype) -> "System":
        """Make a system with numbers of another width; solving, rates and gradients then have it too.

        Args:
            dtype: ``"float32"`` (about 6 digits of a pose) or ``"float64"``.

        Returns:
            The system; differentiable with respect to this one.

        Raises:
            InputError: for another type; 32 bits for a large mechanism.
            JaxncError: 64 bits where JAX has them switched off.
        """
        wanted = chosen(dtype)
        if wanted == self.dtype:
            return self
        if wanted == NARROW and self.topology.large:
            raise InputError(
                f"{self.name!r} is kept sparse, and large systems need 64-bit numbers: leave dtype= out, or make its "
                f"matrices dense by compile(sparse=False)"
            )
        return to_width(self, wanted)

    def __reduce__(self):
        width = str(getattr(self.parameters.points, "dtype", ""))
        return _again, (width, self.topology, self.parameters, self.degrees_of_freedom, self.independent)

    def __repr__(self) -> str:
        top = self.topology
        return (
            f"System({top.name!r}: n = {len(top.unknown)}, rows = {len(top.rows)}, "
            f"degrees of freedom = {self.degrees_of_freedom})"
        )

    def __str__(self) -> str:
        top = self.topology
        n = len(top.unknown)
        rank = n - self.degrees_of_freedom
        counts = f"n = {n} coordinates, {len(top.rows)} constraint rows, rank {rank}, "
        lines = [
            f"{top.name}: {counts}{counted(self.degrees_of_freedom, 'degree')} of freedom",
            *([f"  inputs may be    {list_first(drivable(top), 14)}"] if self.degrees_of_freedom else []),
            f"  design variables {list_first(self.design_variables, 14)}",
            *(f"  {said}" for said in unheld(top)),
        ]
        return "\n".join(lines)


def _again(
    width: str, topology: Topology, parameters: Parameters, freedoms: int, independent: tuple[str, ...]
) -> System:
    """A system that was pickled or copied; JAX makes 64-bit numbers narrow where it has them switched off."""
    if width != str(getattr(parameters.points, "dtype", "")):
        raise JaxncError(
            f"{topology.name!r} was pickled with {width} numbers, and where it is loaded JAX has them switched off: "
            f'there too write jax.config.update("jax_enable_x64", True) at the top, or set JAX_ENABLE_X64=1'
        )
    return System(topology, parameters, freedoms, independent)


def drivable(topology: Topology) -> tuple[str, ...]:
    """Names of the coordinates that can be driven, angles and distances first."""
    spread = topology.coordinates[: len(topology.coordinates) - len(topology.scalars)]
    free = tuple(name for name, fixed in zip(spread, topology.fixed, strict=False) if not fixed)
    return (*topology.scalars, *free)


def unheld(top: Topology) -> list[str]:
    """Points and vectors that no body, joint, coordinate, mass or force holds, each in a phrase with a remedy."""
    tied = {i for block in (*top.blocks, *top.rates) for points in block.points for i in points}
    tied |= {i for body in top.bodies for i in body.points}
    tied |= {i for block in top.loads.forces for points in block.points for i in points}
    tied |= {one.origin for group in top.loads.inertias for one in group}
    related = {
        k // top.dim for block in top.blocks for some in block.scalars for k in some
    }  # a coordinate in a relation
    tied |= related
    held = {i for b in top.bodies for i in b.vectors}
    held |= {i for block in top.blocks if block.kind is not UNIT for some in block.vectors for i in some}
    held |= {i - len(top.points) for i in related}
    count = len(top.points)
    loose = [(f"point {n!r}", i) for i, n in enumerate(top.points) if i not in tied]
    loose += [(f"vector {n!r}", count + i) for i, n in enumerate(top.vectors) if i not in held]
    free = [n for n, i in loose if not all(top.fixed[top.dim * i : top.dim * (i + 1)])]
    return [f"{name} belongs to no body and nothing holds it: remove it, or add it to a body" for name in free]


def characteristic_length(points: Float[Array, "points dim"]) -> Numbers:
    """Size of the drawing: twice the largest distance from its centre, 1 if all points coincide."""
    if not isinstance(points, Tracer):  # nothing to compile; a NumPy number does for an array
        drawing = np.asarray(points)  # NumPy's mean of a JAX array is JAX's, and traced where anything is
        spread = drawing - np.mean(drawing, axis=0)
        return 2.0 * np.sqrt(np.max(np.sum(spread * spread, axis=1))) or np.ones(())
    spread = points - jnp.mean(points, axis=0)
    square = jnp.max(jnp.sum(spread * spread, axis=1))
    return jnp.where(square > 0, 2.0 * jnp.sqrt(jnp.where(square > 0, square, 1.0)), 1.0)


def floats(tree: object, name: str) -> PyTree:
    """The parameters of a user's own force as float arrays."""
    try:
        return jax.tree.map(lambda x: jnp.asarray(x, float), tree)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"force {name!r}: its parameters must be numbers, arrays or a pytree of them") from None


def _alike(old: PyTree, new: PyTree, name: str) -> PyTree:
    new = floats(new, name)
    if jax.tree.structure(old) != jax.tree.structure(new):
        raise InputError(f"parameters of {name!r} have the structure {jax.tree.structure(old)}; keep it")
    return jax.tree.map(lambda x, like: jnp.asarray(x, like.dtype), new, old)
