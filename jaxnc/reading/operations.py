"""Readings of JAX's operations: one table, for which types of numbers each is read, and how."""

import functools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from jaxnc.types import Array

if TYPE_CHECKING:
    from jax.extend.core import JaxprEqn

    from jaxnc.reading.trace import Reader

Nodes = np.ndarray
"""Places of nodes, an array of integers with the shape of the array that they make up."""


class Unreadable(Exception):
    """A function that uses an operation which cannot be read."""

    def __init__(self, primitive: str):
        super().__init__(primitive)
        self.primitive = primitive


class OutOfRange(IndexError):
    """An index beyond an array, which JAX would move to the array's end in silence."""


def evaluate_equation(eqn: "JaxprEqn", values: Sequence[np.ndarray]) -> list[Array]:
    """Results of an equation whose arguments are known, as JAX has them."""
    with jax.ensure_compile_time_eval():
        out = eqn.primitive.bind(*values, **eqn.params)
    return list(out) if eqn.primitive.multiple_results else [out]


# A reading takes the reader, the equation and the nodes of its arguments, and says where the results are.


def _integer_power(r: "Reader", x: Nodes, power: int) -> Nodes:
    if power in (0, 1):
        return x if power else np.broadcast_to(r.numbers(1.0), x.shape)
    return r.each("power", x, value=power)


def _pow(r: "Reader", eqn: "JaxprEqn", x: Nodes, y: Nodes) -> Nodes:
    """A power; an exponent that is an integer must be known."""
    base, exponent = eqn.invars
    if r.type_of(exponent) == "f":
        return r.each("pow", x, y)
    powers = r.known(y, exponent)
    if powers is None or r.type_of(base) != "f":
        raise Unreadable("pow of integers")
    x, powers = np.broadcast_arrays(x, powers)
    each = zip(x.reshape(-1), powers.reshape(-1).tolist(), strict=True)
    return np.array([int(_integer_power(r, i[None], n)[0]) for i, n in each], dtype=int).reshape(x.shape)


def _round_number(r: "Reader", eqn: "JaxprEqn", x: Nodes) -> Nodes:
    if int(eqn.params["rounding_method"]) == 1:  # to the nearest even number
        return r.each("round", x)
    size = r.each("abs", x)
    down, half = r.each("floor", size), r.numbers(0.5)
    up = r.each("add", down, r.numbers(1.0))
    away = r.each("select", r.each("ge", r.each("sub", size, down), half), up, down)
    return r.each("mul", r.each("sign", x), away)


def _convert(r: "Reader", eqn: "JaxprEqn", x: Nodes) -> Nodes:
    before, after = r.type_of(eqn.invars[0]), r.type_of(eqn.outvars[0])
    if before == "f" and after == "i":  # of any size, or none
        raise Unreadable("convert_element_type from a float to an integer")
    if after == "b" and before != "b":
        return r.each("ne", x, r.numbers(0.0))
    return r.each("float", x) if before == "b" and after != "b" else x


def _select(r: "Reader", eqn: "JaxprEqn", which: Nodes, *cases: Nodes) -> Nodes:
    if r.type_of(eqn.invars[0]) == "b" and len(cases) > 1:
        return r.each("select", which, *cases[::-1])
    return _by_number(r, which, cases)


def _by_number(r: "Reader", which: Nodes, cases: Sequence[Nodes]) -> Nodes:
    """Choose one of several arrays by an integer."""
    out = cases[-1]
    for k in range(len(cases) - 2, -1, -1):
        out = r.each("select", r.each("le", which, r.numbers(k)), cases[k], out)
    return out


def _branches(r: "Reader", eqn: "JaxprEqn", index: Nodes, *x: Nodes) -> list[Nodes]:
    """All branches, of which one is selected: they have no effects."""
    known, branches = r.known(index, eqn.invars[0]), eqn.params["branches"]
    if known is not None:
        branches = branches[int(np.clip(known, 0, len(branches) - 1)) :][:1]
    found = [r.read(branch.jaxpr, branch.consts, x) for branch in branches]
    return [_by_number(r, index, cases) for cases in zip(*found, strict=True)]


def _rows_along(x: Nodes, axes: Sequence[int]) -> tuple[list[list[int]], list[int]]:
    """Rows along axes that go away, and the shape of what is left."""
    rest = [k for k in range(x.ndim) if k not in axes]
    left = [x.shape[k] for k in rest]
    return x.transpose(*rest, *axes).reshape(math.prod(left), -1).tolist(), left


def _reduction(op: str) -> Callable[..., Nodes]:
    def read(r: "Reader", eqn: "JaxprEqn", x: Nodes) -> Nodes:
        if not x.size:
            raise Unreadable(f"{op} of nothing")
        rows, left = _rows_along(x, eqn.params["axes"])
        return np.array([functools.reduce(functools.partial(r.b.op, op), row) for row in rows], dtype=int).reshape(left)

    return read


def _cumulation(op: str) -> Callable[..., Nodes]:
    def read(r: "Reader", eqn: "JaxprEqn", x: Nodes) -> Nodes:
        axis, back = eqn.params["axis"], slice(None, None, -1 if eqn.params["reverse"] else 1)
        out = np.moveaxis(np.array(x), axis, 0)[back]
        for k in range(1, len(out)):
            out[k] = r.each(op, out[k - 1], out[k])
        return np.moveaxis(out[back], 0, axis)

    return read


def _extreme(op: str) -> Callable[..., Nodes]:
    """The first place of the largest number, or of the smallest."""

    def read(r: "Reader", eqn: "JaxprEqn", x: Nodes) -> Nodes:
        rows, left = _rows_along(x, eqn.params["axes"])
        out = []
        for best, *rest in rows:
            place = r.b.number(0)
            for k, i in enumerate(rest, 1):
                better = r.b.op(op, i, best)
                best, place = r.b.op("select", better, i, best), r.b.op("select", better, r.b.number(k), place)
            out.append(place)
        return np.array(out, dtype=int).reshape(left)

    return read


def _sort(r: "Reader", eqn: "JaxprEqn", *x: Nodes) -> list[Nodes]:
    """Exchange neighbours where the later one comes first; all arrays go with the keys, which are the first."""
    axis, keys = eqn.params["dimension"], eqn.params["num_keys"]
    out = [list(np.moveaxis(a, axis, 0)) for a in x]
    for last in range(len(out[0]) - 1, 0, -1):
        for k in range(last):
            first = r.each("lt", out[keys - 1][k + 1], out[keys - 1][k])
            for key in range(keys - 2, -1, -1):
                lower, same = (r.each(op, out[key][k + 1], out[key][k]) for op in ("lt", "eq"))
                first = r.each("or", lower, r.each("and", same, first))
            for a in out:
                a[k], a[k + 1] = (r.each("select", first, *pair) for pair in ((a[k + 1], a[k]), (a[k], a[k + 1])))
    return [np.moveaxis(np.stack(a), 0, axis) if a else b for a, b in zip(out, x, strict=True)]


def _dot_general(r: "Reader", eqn: "JaxprEqn", x: Nodes, y: Nodes) -> Nodes:
    (cx, cy), (bx, by) = eqn.params["dimension_numbers"]
    free_x = [k for k in range(x.ndim) if k not in (*cx, *bx)]
    free_y = [k for k in range(y.ndim) if k not in (*cy, *by)]
    shape = [*(x.shape[k] for k in (*bx, *free_x)), *(y.shape[k] for k in free_y)]
    many, size = math.prod(x.shape[k] for k in bx), math.prod(x.shape[k] for k in cx)
    left = x.transpose(*bx, *free_x, *cx).reshape(many, -1, size).tolist()
    right = y.transpose(*by, *free_y, *cy).reshape(many, -1, size).tolist()
    out = [
        r.b.total(r.b.op("mul", i, j) for i, j in zip(row, column, strict=True))
        for rows, columns in zip(left, right, strict=True)
        for row in rows
        for column in columns
    ]
    return np.array(out, dtype=int).reshape(shape)


def _broadcast_array(r: "Reader", eqn: "JaxprEqn", x: Nodes) -> Nodes:
    shape = [1] * len(eqn.params["shape"])
    for k, d in enumerate(eqn.params["broadcast_dimensions"]):
        shape[d] = x.shape[k]
    return np.broadcast_to(x.reshape(shape), eqn.params["shape"])


def _slice(r: "Reader", eqn: "JaxprEqn", x: Nodes) -> Nodes:
    p = eqn.params
    strides = p["strides"] or (1,) * x.ndim
    return x[tuple(slice(*s) for s in zip(p["start_indices"], p["limit_indices"], strides, strict=True))]


def _windows(
    x: Nodes, indices: np.ndarray, sizes: Sequence[int], dims: Sequence[Sequence[int]], clip: bool, fill: int
) -> Nodes:
    """Parts of an array that begin at indices ``(..., index)``, as XLA gathers them; `fill` for one that leaves it.

    `dims` are the axes of an index's part in the result, those of the array that the result does not have, those that
    an index counts, and those of array and indices that go together.
    """
    offset, dropped, counted, together, beside = dims
    lead, room = indices.shape[:-1], np.subtract(x.shape, sizes)
    kept = [n for d, n in enumerate(sizes) if d not in dropped and d not in together]
    out = np.full((*lead, *kept), fill)
    for at in np.ndindex(*lead):
        start = np.zeros(x.ndim, int)
        start[list(counted)] = indices[at]
        start = np.clip(start, 0, room) if clip else start
        start[list(together)] = [at[k] for k in beside]
        if ((start >= 0) & (start <= room)).all():
            out[at] = x[tuple(slice(s, s + n) for s, n in zip(start, sizes, strict=True))].reshape(kept)
    return np.moveaxis(out, range(len(lead), out.ndim), offset)


def _gather(x: Nodes, indices: np.ndarray, **params: Any) -> Nodes:
    d, clip = params["dimension_numbers"], params["mode"] == jax.lax.GatherScatterMode.CLIP
    dims = d.offset_dims, d.collapsed_slice_dims, d.start_index_map, d.operand_batching_dims
    return _windows(x, indices, params["slice_sizes"], (*dims, d.start_indices_batching_dims), clip, -1)


def _dynamic_slice(x: Nodes, *start: np.ndarray, **params: Any) -> Nodes:
    return x[tuple(slice(int(s), int(s) + n) for s, n in zip(start, params["slice_sizes"], strict=True))]


def _dynamic_update(x: Nodes, update: Nodes, *start: np.ndarray, **_: object) -> Nodes:
    begin = [int(np.clip(s, 0, n - m)) for s, n, m in zip(start, x.shape, update.shape, strict=True)]
    out = np.array(x)
    out[tuple(slice(s, s + m) for s, m in zip(begin, update.shape, strict=True))] = update
    return out


def _pad_array(x: Nodes, value: Nodes, **params: Any) -> Nodes:
    """With numbers before, after and between; fewer than none are cut off."""
    shape, where = [], []
    for n, (low, high, between) in zip(x.shape, params["padding_config"], strict=True):
        place = low + np.arange(n) * (1 + between)
        shape.append(low + high + n + max(n - 1, 0) * between)
        where.append((place, (place >= 0) & (place < shape[-1])))
    out = np.full(shape, int(value))
    out[np.ix_(*(place[fits] for place, fits in where))] = x[np.ix_(*(fits for _, fits in where))]
    return out


_MOVES: dict[str, Callable[..., Nodes]] = {
    "gather": _gather,
    "dynamic_slice": _dynamic_slice,
    "dynamic_update_slice": _dynamic_update,
    "pad": _pad_array,
}
"""Done by NumPy: JAX would compile a program for each."""


def _movement(*arrays: int) -> Callable[..., Nodes]:
    """An operation that moves numbers of some arrays by indices, which are known: done to places of nodes."""

    def read(r: "Reader", eqn: "JaxprEqn", *x: Nodes) -> Nodes:
        given, params = [], eqn.params
        for k, (v, a) in enumerate(zip(eqn.invars, x, strict=True)):
            index = a.astype(np.int32) if k in arrays else r.known(a, v)
            if index is None:
                raise Unreadable(f"{eqn.primitive.name} by an index that is not known")
            given.append(index)
        if eqn.primitive.name == "dynamic_slice":
            for start, size, width in zip(given[1:], params["slice_sizes"], x[0].shape, strict=True):
                if not 0 <= start <= width - size:
                    raise OutOfRange(f"index {start} in an array of {width}")
        promised = params.get("mode") == jax.lax.GatherScatterMode.PROMISE_IN_BOUNDS
        move = _MOVES.get(eqn.primitive.name)
        out = move(*given, **params) if move else np.asarray(evaluate_equation(eqn, given)[0])
        out = out.astype(int)
        if (out < 0).any():  # beyond the array
            if promised:
                raise OutOfRange(f"indices {given[1].reshape(-1).tolist()} in an array of shape {x[0].shape}")
            fill = eqn.params["fill_value"]
            if fill is None and r.type_of(eqn.invars[0]) != "f":
                raise Unreadable(f"{eqn.primitive.name} beyond an array of integers")
            out[out < 0] = r.b.number(math.nan if fill is None else float(fill))
        return out

    return read


def _scatter_add(r: "Reader", eqn: "JaxprEqn", x: Nodes, indices: Nodes, updates: Nodes) -> Nodes:
    """Numbers added to places that are known, each to that which would be gathered for it."""
    at = r.known(indices, eqn.invars[1])
    if at is None or r.type_of(eqn.invars[0]) != "f":
        raise Unreadable(eqn.primitive.name)
    d, clip = eqn.params["dimension_numbers"], eqn.params["mode"] == jax.lax.GatherScatterMode.CLIP
    dropped, together = d.inserted_window_dims, d.operand_batching_dims
    window = iter(updates.shape[k] for k in d.update_window_dims)
    sizes = [1 if k in dropped or k in together else next(window) for k in range(x.ndim)]
    dims = d.update_window_dims, dropped, d.scatter_dims_to_operand_dims, together, d.scatter_indices_batching_dims
    places = _windows(1 + np.arange(x.size).reshape(x.shape), at, sizes, dims, clip, 0)
    out = x.reshape(-1).copy()
    for place, node in zip(places.reshape(-1).tolist(), updates.reshape(-1).tolist(), strict=True):
        if place:  # none of what falls outside
            out[place - 1] = r.b.op("add", int(out[place - 1]), node)
    return out.reshape(x.shape)


def _by_name(types: str, names: str) -> dict[str, tuple[str, str]]:
    return {name: (types, _NAMES.get(name, name)) for name in names.split()}


_NAMES = {"add_any": "add", "xor": "ne", "is_finite": "finite"}
_FOLDS = {"sum": "add", "prod": "mul", "max": "max", "min": "min"}
READINGS: dict[str, tuple[str, str | Callable[..., Any]]] = {
    # number by number
    **_by_name("f", "div sqrt sin cos tan asin acos atan atan2 sinh cosh tanh exp log log1p expm1"),
    **_by_name("f", "floor ceil rem is_finite"),
    **_by_name("fi", "add add_any sub mul neg abs sign max min"),
    **_by_name("fib", "lt le gt ge eq ne"),
    **_by_name("b", "and or not xor"),
    "square": ("fi", lambda r, eqn, x: r.each("mul", x, x)),
    "rsqrt": ("f", lambda r, eqn, x: r.each("div", r.numbers(1.0), r.each("sqrt", x))),
    "integer_pow": ("f", lambda r, eqn, x: _integer_power(r, x, int(eqn.params["y"]))),
    "pow": ("fi", _pow),
    "clamp": ("fi", lambda r, eqn, least, x, most: r.each("min", r.each("max", x, least), most)),
    "round": ("f", _round_number),
    "convert_element_type": ("fib", _convert),
    "select_n": ("fib", _select),
    "cond": ("fib", _branches),
    # along axes
    **{f"reduce_{name}": ("fi", _reduction(op)) for name, op in _FOLDS.items()},
    **{f"reduce_{name}": ("b", _reduction(_NAMES.get(name, name))) for name in ("and", "or", "xor")},
    **{f"cum{name}": ("fi", _cumulation(op)) for name, op in _FOLDS.items()},
    "argmax": ("fib", _extreme("gt")),
    "argmin": ("fib", _extreme("lt")),
    "sort": ("fib", _sort),
    "dot_general": ("fi", _dot_general),
    "scatter-add": ("fi", _scatter_add),
    "scatter_add": ("fi", _scatter_add),
    # what only moves numbers
    "broadcast_in_dim": ("fib", _broadcast_array),
    **dict.fromkeys(("reshape", "squeeze"), ("fib", lambda r, eqn, x: x.reshape(eqn.outvars[0].aval.shape))),
    **dict.fromkeys(("copy", "copy_p", "optimization_barrier", "pvary"), ("fib", lambda r, eqn, *x: x)),
    "transpose": ("fib", lambda r, eqn, x: x.transpose(eqn.params["permutation"])),
    "concatenate": ("fib", lambda r, eqn, *x: np.concatenate(x, axis=eqn.params["dimension"])),
    "stack": ("fib", lambda r, eqn, *x: np.stack(x, axis=eqn.params["axis"])),
    "unstack": ("fib", lambda r, eqn, x: list(np.moveaxis(x, eqn.params["axis"], 0))),
    "split": ("fib", lambda r, eqn, x: np.split(x, np.cumsum(eqn.params["sizes"])[:-1], axis=eqn.params["axis"])),
    "slice": ("fib", _slice),
    "rev": ("fib", lambda r, eqn, x: np.asarray(np.flip(x, eqn.params["dimensions"]))),  # of one number, too
    "iota": ("", lambda r, eqn: r.numbers(np.indices(eqn.params["shape"])[eqn.params["dimension"]])),
    "gather": ("fib", _movement(0)),
    "dynamic_slice": ("fib", _movement(0)),
    "dynamic_update_slice": ("fib", _movement(0, 1)),
    "pad": ("fib", _movement(0, 1)),
    "scatter": ("fib", _movement(0, 2)),
}
"""Types of numbers that an operation is read for (f: floats, i: integers, b: truth values), and its reading.

A reading is the name that programs have for it, done number by number, or a function. Integers that depend on inputs
are floats in a program, as long as they are sure not to overflow.
"""

CALLED = {
    "pjit": "jaxpr",
    "jit": "jaxpr",
    "closed_call": "call_jaxpr",
    "core_call": "call_jaxpr",
    "remat": "jaxpr",
    "checkpoint": "jaxpr",
}
RULED = {"custom_jvp_call": "call_jaxpr", "custom_vjp_call": "call_jaxpr", "custom_vjp_call_jaxpr": "fun_jaxpr"}
"""Functions with a rule of their own for derivatives."""

PLAIN = {"_hypot"}
"""Such functions of JAX, by name, whose rule gives the derivatives of what they calculate; since JAX 0.12."""

WRITTEN_OUT = {"sine_in_full": "sin", "cosine_in_full": "cos"}
"""Compiled functions by name that write an operation out for XLA, see `jaxnc.constraints.elementary`."""
