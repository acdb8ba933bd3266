"""Rigid bodies in space (source text §4.1): bases of segments, and further segments expressed in them.

A segment is a unit vector or the line between two points. A body is fixed by a base: one segment (all others along it;
the body then has five freedoms), two segments, or three of them in the text's own form.
"""

import functools
from typing import Any

import jax.numpy as jnp

from jaxnc.constraints.directions import counts, cross3, power, reader, triple
from jaxnc.constraints.kind import Kind, dot, norm, ratio

UNIT = Kind(
    "unit vector",
    lambda p, v, s, c: (dot(v[0], v[0]) - 1.0,),
    rows=("unit length",),
    powers=(0,),
    vectors=1,
    quadratic=True,
    source="(80), (91), (93), (105), (106), (111), (118)",
)


@functools.cache
def product(forms: str) -> Kind:
    """Constant scalar product of two directions: keeps their angle (77), (92), (107)-(109), (119)-(121), (142)."""
    read = reader(forms)

    def value(p, v):
        a, b = read(p, v)
        return dot(a, b)

    return Kind(
        "scalar product" if forms == "pp" else f"scalar product {forms}",
        lambda p, v, s, c: (value(p, v) - c[0],),
        rows=("scalar product",),
        powers=(power(forms),),
        **counts(forms),
        constants=("product",),
        drawn=lambda p, v, s, c: (value(p, v),),
        quadratic=True,
        source="(36), (70); (77), (92), (107)-(109), (119)-(121), (142)",
    )


SCALAR_PRODUCT = product("pp")


def _three(rows: str, item: str) -> dict[str, Any]:
    return {"rows": tuple(rows), "powers": (power(item),) * 3}


@functools.cache
def carried(forms: str) -> Kind:
    """A segment w fixed to a base of two segments a, b: ``w = α a + β b + γ a × b`` (forms of a, b, w).

    Replaces (104)-(109), (110)-(115) and (122)-(127): as many rows, no coplanar class, no mirrored twin.
    """
    read = reader(forms)

    def residual(p, v, s, c):
        a, b, w = read(p, v)
        n = cross3(a, b)
        return tuple(w[i] - c[0] * a[i] - c[1] * b[i] - c[2] * n[i] for i in range(3))

    def drawn(p, v, s, c):
        a, b, w = read(p, v)
        aa, bb, ab, wa, wb = dot(a, a), dot(b, b), dot(a, b), dot(w, a), dot(w, b)
        area = aa * bb - ab * ab
        return (
            ratio(wa * bb - wb * ab, area),
            ratio(wb * aa - wa * ab, area),
            ratio(triple(w, a, b), area),
        )

    return Kind(
        f"carried {forms}",
        residual,
        **_three("xyz", forms[2]),
        **counts(forms),
        constants=("alpha", "beta", "gamma"),
        drawn=drawn,
        quadratic=True,
        source="instead of (104)-(115) and (122)-(127): same number of rows, never degenerate, no mirrored twin",
    )


@functools.cache
def combined(forms: str) -> Kind:
    """A segment w as a linear combination of a base of three segments (forms of a, b, c, w), (122)-(127)."""
    read = reader(forms)

    def residual(p, v, s, k):
        a, b, c, w = read(p, v)
        return tuple(w[i] - k[0] * a[i] - k[1] * b[i] - k[2] * c[i] for i in range(3))

    def drawn(p, v, s, k):
        a, b, c, w = read(p, v)
        volume = triple(a, b, c)
        return (ratio(triple(w, b, c), volume), ratio(triple(a, w, c), volume), ratio(triple(a, b, w), volume))

    return Kind(
        f"combination of {forms}",
        residual,
        **_three("xyz", forms[3]),
        **counts(forms),
        constants=("alpha", "beta", "gamma"),
        drawn=drawn,
        quadratic=True,
        source="(122)-(127) with erratum 4, (166)-(171)",
    )


@functools.cache
def coplanar(forms: str) -> Kind:
    """A segment w in the plane of a base of two segments (forms of a, b, w), (113)-(115)."""
    read = reader(forms)

    def residual(p, v, s, c):
        a, b, w = read(p, v)
        return tuple(w[i] - c[0] * a[i] - c[1] * b[i] for i in range(3))

    return Kind(
        f"coplanar {forms}",
        residual,
        **_three("xyz", forms[2]),
        **counts(forms),
        constants=("lambda", "mu"),
        drawn=lambda p, v, s, c: carried(forms).drawn(p, v, s, c)[:2],  # pyright: ignore[reportOptionalCall]
        quadratic=True,
        misfit=lambda p, v, c: _off(residual(p, v, None, c), read(p, v)[2]),
        source="(113)-(115)",
    )


@functools.cache
def collinear(forms: str) -> Kind:
    """A segment w along a base of one segment (forms of a, w), (94)-(96), (101)-(103) with erratum 1."""
    read = reader(forms)

    def residual(p, v, s, c):
        a, w = read(p, v)
        return tuple(w[i] - c[0] * a[i] for i in range(3))

    def drawn(p, v, s, c):
        a, w = read(p, v)
        return (ratio(dot(a, w), dot(a, a)),)

    return Kind(
        f"collinear {forms}",
        residual,
        **_three("xyz", forms[1]),
        **counts(forms),
        constants=("ratio",),
        drawn=drawn,
        quadratic=True,
        misfit=lambda p, v, c: _off(residual(p, v, None, c), read(p, v)[1]),
        source="(94)-(96), (101)-(103), all three of them (erratum 1)",
    )


def _off(rest, w):
    """How far a segment is from where its class has it, as a part of its own length."""
    return ratio(norm(jnp.stack(rest)), norm(w))


@functools.cache
def handed(forms: str) -> Kind:
    """No equation: three segments of a body keep their handedness, which its rows (116)-(121) do not tell."""
    read = reader(forms)

    def volume(p, v):
        return triple(*read(p, v))

    return Kind(
        f"handed {forms}",
        lambda p, v, s, c: (),
        rows=(),
        powers=(),
        **counts(forms),
        constants=("side",),
        drawn=lambda p, v, s, c: (jnp.where(volume(p, v) < 0, -1.0, 1.0),),
        quadratic=False,
        guard=lambda p, v, s, c: (c[0] * volume(p, v),),
        mirror=True,
        source="erratum 10",
    )
