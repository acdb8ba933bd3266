"""Functions of lanes, applied to some at a time."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax


def in_chunks(f: Callable, chunk: int, *arguments: Any) -> Any:
    """A function whose arguments and results have lanes as their first axis, some of these at a time.

    What they need then stays in the cache, and few wait for the slowest.

    Up to twice as many as a `chunk` go at once.
    """
    count = jax.tree.leaves(arguments)[0].shape[0]
    if count <= 2 * chunk:
        return f(*arguments)
    size = next((k for k in range(chunk, chunk // 2, -1) if count % k == 0), chunk)
    if count % size:
        # The last chunk is filled up with its last lane, so that there is one shape to compile.
        fill = -count % size
        arguments = jax.tree.map(lambda x: jnp.concatenate([x, jnp.repeat(x[-1:], fill, axis=0)]), arguments)
    # No axis is left to be found out: arrays without numbers, such as the inputs of a structure, do not tell.
    pieces = jax.tree.map(lambda x: x.reshape(x.shape[0] // size, size, *x.shape[1:]), arguments)
    out = lax.map(lambda some: f(*some), pieces)
    return jax.tree.map(lambda x: x.reshape(x.shape[0] * size, *x.shape[2:])[:count], out)
