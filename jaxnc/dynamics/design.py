"""What changes of a motion's numbers mean for its design: the host knows, also where compiled code asks for it."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics import redesign
from jaxnc.dynamics.adjoint import Law
from jaxnc.dynamics.asked import Asked
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.traced import PIECE, ask_host, shorten_equations
from jaxnc.system.equations import Equations
from jaxnc.system.system import Parameters
from jaxnc.types import Array, Float

_GEOMETRY = "points", "vectors", "markers", "dimensions", "physical"
Origin = Plan | tuple[int, ...] | None
"""What a start follows from: the known coordinates of a plan, the drawing but for some coordinates, or nothing."""


def of_design(
    asked: Asked,
    origin: Origin,
    parameters: Parameters,
    eq: Any,
    at: np.ndarray,
    pose_bar: np.ndarray,
    law_bar: Law,
) -> np.ndarray:
    """The same of all parameters, and of the known coordinates of an assembled start, one after the other.

    The start follows from its `origin`. `pose_bar` and `law_bar` are what changes of the start and of the numbers of
    the motion mean.
    """
    with np.errstate(all="ignore"):
        carried = redesign.Carried(asked.system(parameters), eq)
        found, law = np.zeros(carried.count), carried.law()
        for name in redesign.DERIVED:
            for bar, value in zip(*(jax.tree.leaves(getattr(x, name)) for x in (law_bar, law)), strict=True):
                found = found + np.tensordot(bar, value[..., 1:], bar.ndim)
        if origin is None:
            return found
        if not isinstance(origin, Plan):
            return found + pose_bar @ carried.start(at, origin)
        through = pose_bar @ carried.pose(origin, at)
    return np.concatenate([found + through[: carried.count], through[carried.count :]])


def asked_back(
    asked: Asked,
    origin: Origin,
    parameters: Parameters,
    eq: Equations,
    at: Array,
    pose_bar: Any,
    law_bar: Law,
) -> Float[Array, " changes"] | None:
    """`of_design` from traced code; None where the host is not to be asked: what it would be given is large."""
    known = len(origin.known) if isinstance(origin, Plan) else 0
    par = tuple(getattr(parameters, name) for name in _GEOMETRY)
    law = tuple(getattr(law_bar, name) for name in redesign.DERIVED)
    given = (par, shorten_equations(eq), at, jnp.zeros(0) if origin is None else pose_bar, law)
    if max(x.size for x in jax.tree.leaves(given)) > PIECE:
        return None
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), given)
    leaves, structure = jax.tree.flatten(shapes)
    _ready(asked, origin, tuple((x.shape, x.dtype.name) for x in leaves), structure)
    like = jax.ShapeDtypeStruct((sum(x.size for x in par) + known,), at.dtype)
    answer, nothing = (functools.partial(f, asked, origin) for f in (_called, _nothing))
    return ask_host("differentiated a design", like, answer, *given, given_up=nothing)


def _called(asked: Asked, origin: Origin, par: Any, eq: Any, at: Any, pose: Any, law: Any) -> Any:
    whole = Law(**dict.fromkeys(Law._fields, ()) | dict(zip(redesign.DERIVED, law, strict=True)))
    return of_design(asked, origin, Parameters(*par), eq, at, pose, whole).astype(at.dtype)


def _nothing(asked: Asked, origin: Origin, par: Any, eq: Any, at: Any, *rest: Any) -> np.ndarray:
    return np.zeros(sum(x.size for x in par) + (len(origin.known) if isinstance(origin, Plan) else 0), at.dtype)


@functools.lru_cache(maxsize=256)
def _ready(asked: Asked, origin: Origin, shapes: tuple, structure: Any) -> None:
    """Have the host read all programs that it needs, on any numbers: inside of compiled code it may not trace."""
    rng = np.random.default_rng(0)
    numbers = [rng.uniform(0.5, 1.5, shape).astype(dtype) for shape, dtype in shapes]
    _called(asked, origin, *jax.tree.unflatten(structure, numbers))


def taken_apart(parameters: Parameters, found: Any, own: Any) -> Parameters:
    """Changes of all parameters, ``(changes,)``, and those of the functions' own, as parameters."""
    parts, start = [], 0
    for name in _GEOMETRY:
        shape = np.shape(getattr(parameters, name))
        end = start + int(np.prod(shape, dtype=int))
        parts.append(found[start:end].reshape(shape))
        start = end
    return Parameters(*parts, own=own)
