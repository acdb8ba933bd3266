"""Rows that are linear in velocities (nonholonomic constraints), on all coordinates of a mechanism."""

from typing import Any

import jax
import jax.numpy as jnp

from jaxnc.errors import InputError
from jaxnc.system.design import design, design_numbers
from jaxnc.system.system import System
from jaxnc.system.topology import Block, Topology
from jaxnc.types import Array, Coordinates, Float
from jaxnc.validate import as_scalars, call_user


def refuse_rates(top: Topology, what: str, remedy: str) -> None:
    """Refuse a mechanism with rows on velocities where they have no meaning."""
    if top.rates:
        rows = "; ".join(dict.fromkeys(top.rate_rows))
        raise InputError(f"{what}: {top.name!r} has rows on velocities that positions do not see ({rows}); {remedy}")


def rate_constants(system: System) -> tuple[Array, ...]:
    """Constants of the rows on velocities, per block ``(instances, constants)``: NumPy's of NumPy parameters."""
    top = system.topology
    if not top.rates:
        return ()
    x = design_numbers(top, system.parameters)
    return tuple(x[places] for places in design(top).constants[len(top.blocks) :])


def slips(top: Topology, constants: tuple[Array, ...], q: Coordinates, v: Coordinates) -> Float[Array, " rates"]:
    """What the rows on velocities are off by, ``B q̇ - b``, m/s."""
    out = [jnp.zeros(0)]
    for block, layout, c in zip(top.rates, top.rate_layout, constants, strict=True):
        out.append(_rows(top, block, q[layout.variables], v[layout.variables], c).reshape(-1))
    return jnp.concatenate(out)


def coefficients(top: Topology, constants: tuple[Array, ...], q: Coordinates) -> Float[Array, "rates N"]:
    """B: the coefficients of the rows on velocities on all coordinates."""
    out = jnp.zeros((len(top.rate_rows), len(top.coordinates)))
    for block, layout, c in zip(top.rates, top.rate_layout, constants, strict=True):
        x = q[layout.variables]

        def row(y, dy, c, block=block):
            return _rows(top, block, y[None], dy[None], c[None])[0]

        local = jax.vmap(jax.jacfwd(row, argnums=1))(x, jnp.zeros_like(x), c)
        out = out.at[layout.rows[:, :, None], layout.variables[:, None, :]].add(local)
    return out


def _rows(top: Topology, block: Block, x: Array, dx: Array, c: Array) -> Array:
    """Rows of all instances of a block, ``(instances, rows)``."""
    kind: Any = block.kind
    dim, what = top.dim, f"kind {kind.name!r}: rate="
    a, b = kind.points * dim, (kind.points + kind.vectors) * dim

    def one(x, dx, c):
        def parts(y):
            return y[:a].reshape(kind.points, dim), y[a:b].reshape(kind.vectors, dim), y[b:]

        found = as_scalars(
            call_user(kind.rate, what, "p, v, s, dp, dv, ds, c", *parts(x), *parts(dx), c), what, len(kind.rows)
        )
        return jnp.stack([jnp.asarray(r, float) for r in found])

    return jax.vmap(one)(x, dx, c)
