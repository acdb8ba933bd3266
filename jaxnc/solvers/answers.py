"""The one way in which compiled code asks the host: what is handed over, errors that say where they come from, Ctrl-C.

A question is made of arrays, and so is its answer, of shapes that are known beforehand. It is put by `ask_host`.
"""

import _thread
import dataclasses
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
PIECE = 12_000
"""Numbers that are handed over in one array, 96 KB.

What is larger than 100 KB JAX copies in a thread of the pool that the call itself waits in: on a machine with one core
it would wait for ever.
"""
_PIECES = 32  # of one array, at most: each takes its time to compile


def ask_host(
    doing: str,
    like: Any,
    f: Callable[..., Any],
    *given: Any,
    given_up: Callable[..., Any],
    remedy: str = "; repair=False does without it",
) -> Any:
    """Put a question to the host from traced code; mapped, questions go one by one.

    Args:
        doing: what the host does, for messages.
        like: what it answers, arrays by `jax.ShapeDtypeStruct`.
        f: the answer, a function of what is given as NumPy arrays. It runs inside of compiled code and may not call
            JAX; nor may `given_up`.
        given: pytrees of arrays; equations are made `short` before.
        given_up: the answer where the user has interrupted it, a function of the same.
        remedy: what else the user may do, for messages.
    """
    leaves, structure = jax.tree.flatten(given)
    shapes, counts = [jnp.shape(a) for a in leaves], [min(-(-jnp.size(a) // PIECE), _PIECES) for a in leaves]
    pieces = []
    for leaf, count in zip(leaves, counts, strict=True):
        pieces += jnp.array_split(jnp.reshape(leaf, -1), count) if count > 1 else [leaf]

    def answer(*pieces: Any) -> Any:
        rest, arrays = iter(pieces), []
        for shape, count in zip(shapes, counts, strict=True):
            parts = [np.asarray(next(rest)) for _ in range(max(count, 1))]
            arrays.append(parts[0] if len(parts) == 1 else np.concatenate(parts).reshape(shape))
        question = jax.tree.unflatten(structure, arrays)
        try:
            return f(*question)
        except KeyboardInterrupt:
            # Compiled code would make an error of its own of it. It is raised again when that has returned.
            later = threading.Timer(_AFTERWARDS, _thread.interrupt_main)
            later.daemon = True
            later.start()
            return given_up(*question)
        except Exception as error:
            raise JaxncError(f"the host failed while it {doing} ({type(error).__name__}: {error}){remedy}") from error

    return jax.pure_callback(answer, like, *pieces, vmap_method="sequential")


def short(eq: Equations) -> Equations:
    """Return the equations without the coefficients that the host makes itself."""
    none = (None,) * len(eq.linear)
    return dataclasses.replace(eq, linear=none, quadratic=none)


def ask_of_equations(
    doing: str, f: Callable[..., np.ndarray], shape: tuple[int, ...], eq: Equations, *arrays: Array
) -> Array:
    """Put a question about equations that only the host can answer, as of a large system; see `ask_host`.

    `f` takes `HostEquations` and NumPy arrays, and returns one of the shape. The equations are of one design, or of
    many by a first axis.
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

    def answer(eq: Any, *given: np.ndarray) -> np.ndarray:
        return np.asarray(f(from_jax(eq), *given), eq.home.dtype)

    def nothing(eq: Any, *_: np.ndarray) -> np.ndarray:
        return np.full(shape, np.nan, eq.home.dtype)

    like = jax.ShapeDtypeStruct(shape, eq.home.dtype)
    return ask_host(doing, like, answer, short(eq), *arrays, given_up=nothing, remedy="")
