"""What compiled code asks of the host: errors that say where they come from, and Ctrl-C that is not lost."""

import _thread
import dataclasses
import functools
import threading
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.errors import InputError, JaxncError
from jaxnc.system.equations import Equations
from jaxnc.system.host import from_jax
from jaxnc.system.structure import program
from jaxnc.types import Array

_AFTERWARDS = 0.05  # seconds after which an interrupted program has returned
_PIECE = 8192  # numbers, 64 KB


def answered(
    doing: str,
    given_up: Callable[..., np.ndarray],
    f: Callable[..., np.ndarray],
    *args: object,
    remedy: str = "; repair=False does without it",
) -> np.ndarray:
    """Call a function for compiled code; neither it nor `given_up` may call JAX.

    Where the user has interrupted it, `given_up` is returned of the same arguments. What it is `doing`, and a `remedy`,
    are told in messages.
    """
    try:
        return f(*args)
    except KeyboardInterrupt:
        # Compiled code would make an error of its own of it. It is raised again when that has returned.
        later = threading.Timer(_AFTERWARDS, _thread.interrupt_main)
        later.daemon = True
        later.start()
        return given_up(*args)
    except Exception as error:
        raise JaxncError(f"the host failed while it {doing} ({type(error).__name__}: {error}){remedy}") from error


def short(eq: Equations) -> Equations:
    """The equations without the coefficients that the host makes itself."""
    none = (None,) * len(eq.linear)
    return dataclasses.replace(eq, linear=none, quadratic=none)


def called_back(f: Callable, shapes: Any, *arrays: Array) -> Any:
    """Call a function of NumPy arrays from traced code; mapped, it goes one by one.

    The arrays are handed over in pieces. What is larger than 100 KB JAX copies in a thread of the pool that the call
    itself waits in: on a machine with one core it would wait for ever.
    """
    given, ends = [jnp.shape(a) for a in arrays], np.cumsum([jnp.size(a) for a in arrays])
    flat = jnp.concatenate([jnp.reshape(a, -1) for a in arrays])
    pieces = jnp.split(flat, list(range(_PIECE, flat.size, _PIECE)))

    def whole(*parts: Any) -> Any:
        together = np.split(np.concatenate([np.asarray(part) for part in parts]), ends[:-1])
        return f(*(x.reshape(shape) for x, shape in zip(together, given, strict=True)))

    return jax.pure_callback(whole, shapes, *pieces, vmap_method="sequential")


def of_equations(
    doing: str, f: Callable[..., np.ndarray], shape: tuple[int, ...], eq: Equations, *arrays: Array
) -> Array:
    """Call a function of equations and arrays, on the host and in NumPy, from traced code; see `answered`.

    `f` takes `HostEquations` and NumPy arrays, and returns one of the shape; it may not call JAX. The equations are of
    one design, or of many by a first axis.
    """
    top = eq.topology
    for kind in dict.fromkeys(block.kind for block in top.blocks):
        for which in ("residual", "guard"):
            if getattr(kind, which) is not None and program(kind, which, top.dim) is None:
                raise InputError(
                    f"constraint kind {kind.name!r} cannot be read as a straight line of NumPy's operations, and large "
                    f"systems are solved by NumPy: outside of jit, vmap and grad that works; in them compile the "
                    f"mechanism with compile(sparse=False), or write the kind without loops and jax.numpy.linalg"
                )
    leaves, structure = jax.tree.flatten(short(eq))

    def run(*given: np.ndarray) -> np.ndarray:
        made = from_jax(jax.tree.unflatten(structure, given[len(arrays) :]))
        return np.asarray(f(made, *given[: len(arrays)]), eq.home.dtype)

    def none(*given: np.ndarray) -> np.ndarray:
        return np.full(shape, np.nan, eq.home.dtype)

    ask = functools.partial(answered, doing, none, run, remedy="")
    return called_back(ask, jax.ShapeDtypeStruct(shape, eq.home.dtype), *arrays, *leaves)
