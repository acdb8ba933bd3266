"""What a kind is, read from its functions: programs, sparsity and degree. Nothing is sampled and nothing declared."""

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnc.asking import ask, listed
from jaxnc.constraints import Kind
from jaxnc.constraints.elementary import Small, by_name
from jaxnc.errors import InputError
from jaxnc.reading import Node, Number, OutOfRange, Polynomial, Program, Unreadable, polynomials, trace, write
from jaxnc.system.precision import WIDE, numbers

Pairs = tuple[tuple[int, int], ...]

_NOT_PLAIN = (TypeError, AttributeError, ValueError, IndexError, NotImplementedError)


def size(kind: Kind, dim: int) -> int:
    """Number of variables of one instance: components of points and vectors, then scalars."""
    return (kind.points + kind.vectors) * dim + kind.scalars


@functools.lru_cache(maxsize=1024)
def program(kind: Kind, which: str, dim: int) -> Program | None:
    """The program of one of a kind's functions.

    Args:
        kind: the kind.
        which: ``"residual"``, ``"drawn"``, ``"guard"`` (of variables and constants), ``"measure"`` or ``"misfit"`` (the
            same inputs; scalars are not looked at).
        dim: 2 in the plane, 3 in space.

    Returns:
        A program of the variables followed by the constants; None if the function cannot be read.

    Raises:
        InputError: it returns something else than real numbers, or asks for a point, vector, scalar or constant that
            the kind does not have.
    """
    if getattr(kind, which) is None:
        return None
    try:
        return _read(kind, which, dim)
    except OutOfRange as error:
        raise InputError(
            f"kind {kind.name!r}: {which}= asks for {error}: the kind declares points={kind.points}, "
            f"vectors={kind.vectors}, scalars={kind.scalars}, constants={kind.constants}, and a point or vector has "
            f"{dim} components; declare as many as it uses"
        ) from None


def _read(kind: Kind, which: str, dim: int) -> Program | None:
    f = getattr(kind, which)
    single, what = which in ("measure", "misfit"), f"kind {kind.name!r}: {which}="
    many = {"residual": len(kind.rows), "drawn": len(kind.constants)}.get(which)

    def called(p: Any, v: Any, s: Any, c: Any) -> Sequence[Any]:
        if single:
            return listed((ask(f, what, "p, v, c", p, v, c),), what)
        rows = listed(ask(f, what, "p, v, s, c", p, v, s, c), what, many)
        if which == "residual" and any(map(_true_or_false, rows)):
            raise InputError(
                f"{what} returned true or false, of which nothing is known but that: return a number instead that "
                f"says by how much, such as b - a in place of a <= b"
            )
        return rows

    count = size(kind, dim) + len(kind.constants)
    try:
        return write(lambda *x: called(*_small(kind, dim, x)), count)
    except OutOfRange:
        raise
    except _NOT_PLAIN:
        pass  # it wants numbers of JAX's
    with numbers(WIDE), by_name():
        try:
            return trace(lambda *x: called(*_small(kind, dim, x)), *[()] * count)
        except Unreadable:
            return None
        except OutOfRange:
            raise
        except _NOT_PLAIN:
            pass  # it wants arrays; a mistake in it is raised here again
        try:
            return trace(lambda x: called(*arrays(kind, dim, x)), (count,))
        except Unreadable:
            return None


def _true_or_false(row: Any) -> bool:
    return (
        isinstance(row, bool)
        or (isinstance(row, Number) and row.truth)
        or getattr(getattr(row, "dtype", None), "kind", "") == "b"
    )


def _small(kind: Kind, dim: int, x: Sequence[Any]) -> tuple[Small, Small, Small, Small]:
    ends = kind.points, kind.points + kind.vectors
    spread = [Small(x[k * dim : (k + 1) * dim]) for k in range(ends[1])]
    first = ends[1] * dim
    scalars, constants = x[first : first + kind.scalars], x[first + kind.scalars :]
    return Small(spread[: ends[0]]), Small(spread[ends[0] :]), Small(scalars), Small(constants)


def arrays(kind: Kind, dim: int, x: Any) -> tuple[Any, Any, Any, Any]:
    """Points, vectors, scalars and constants from an array of variables and constants."""
    a, b = kind.points * dim, (kind.points + kind.vectors) * dim
    p, v = x[:a].reshape(kind.points, dim), x[a:b].reshape(kind.vectors, dim)
    return p, v, x[b : b + kind.scalars], x[b + kind.scalars :]


@functools.lru_cache(maxsize=1024)
def rows_in(kind: Kind, dim: int, moving: tuple[int, ...] | None = None) -> tuple[Polynomial, ...]:
    """The rows of a kind as polynomials in some of its variables (in all if not given), by their places there."""
    found = program(kind, "residual", dim)
    every = tuple(range(size(kind, dim))) if moving is None else moving
    if found is None:  # all that can be said of what cannot be read
        return (Polynomial(frozenset(range(len(every))), None),) * len(kind.rows)
    return polynomials(found, every)


@functools.lru_cache(maxsize=1024)
def pattern(kind: Kind, dim: int) -> np.ndarray:
    """Structural non-zeros of one instance's Jacobian, ``(rows, variables)`` of booleans."""
    found = np.zeros((len(kind.rows), size(kind, dim)), dtype=bool)
    for r, row in enumerate(rows_in(kind, dim)):
        found[r, list(row.depends)] = True
    return found


@functools.lru_cache(maxsize=1024)
def quadratic(kind: Kind, dim: int) -> bool:
    """Whether a kind has rows, each a polynomial of degree two at most, so that its Jacobian is affine."""
    return bool(kind.rows) and all(_degree(row) <= 2 for row in rows_in(kind, dim))


_STEEP = {"sqrt", "tan", "asin", "acos", "atan2", "log", "log1p", "pow", "power"}
_JUMPS = {"tan", "atan2", "log", "log1p", "pow", "power", "select", "sign", "floor", "ceil", "round", "rem", "float"}


@functools.lru_cache(maxsize=1024)
def steep(kind: Kind, dim: int) -> bool:
    """Whether rows of a kind may have values where their derivatives are not finite."""
    return _has(kind, dim, _STEEP)


@functools.lru_cache(maxsize=1024)
def jumps(kind: Kind, dim: int) -> bool:
    """Whether rows of a kind of a user's own may jump, or have poles; the library's own do neither."""
    return not getattr(kind.residual, "__module__", "").startswith("jaxnc.") and _has(kind, dim, _JUMPS)


def _has(kind: Kind, dim: int, operations: set[str]) -> bool:
    """Whether rows use some operations, or divide by, what depends on the variables; of what is not read, yes."""
    found = program(kind, "residual", dim)
    if found is None:
        return True
    moving: set[int] = set()
    for k, node in enumerate(found.nodes):
        if any(i in moving for i in node.of) or (node.op == "input" and node.value < size(kind, dim)):
            moving.add(k)

    def is_one(k: int, node: Node) -> bool:
        if node.op == "div":
            return node.of[1] in moving
        return k in moving and node.op in operations and not (node.op == "power" and node.value > 0)

    return any(is_one(k, node) for k, node in enumerate(found.nodes))


def _degree(row: Polynomial) -> float:
    return np.inf if row.terms is None else max(map(len, row.terms), default=0)


@functools.lru_cache(maxsize=1024)
def curvature(kind: Kind, dim: int, moving: tuple[int, ...]) -> tuple[Pairs | None, ...]:
    """How the rows of an instance curve in some of its variables, whatever the others are.

    Returns:
        Per row the ordered pairs of them whose second derivative can differ from zero, where all second derivatives are
        constant; None for a row of higher degree.
    """
    out: list[Pairs | None] = []
    for row in rows_in(kind, dim, moving):
        if _degree(row) > 2:
            out.append(None)
            continue
        squares = [m for m in row.terms or () if len(m) == 2]
        pairs = {(moving[i], moving[j]) for a, b in squares for i, j in ((a, b), (b, a))}
        out.append(tuple(sorted(pairs)))
    return tuple(out)
