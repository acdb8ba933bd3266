"""From a JAX function to a program: its jaxpr, read number by number.

Arrays fall apart into their numbers: what is moved about is an index, what is calculated becomes operations on single
numbers. Loops and branches that depend on data cannot be read, and neither can what has no operation of its own here;
`Unreadable` names it.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from jaxnc.reading.program import Builder, Program

Nodes = np.ndarray
"""Places of nodes, an array of integers with the shape of the array that they make up."""


class Unreadable(Exception):
    """A function that uses an operation which cannot be read."""

    def __init__(self, primitive: str):
        super().__init__(primitive)
        self.primitive = primitive


_SAME = {
    "add": "add",
    "add_any": "add",
    "sub": "sub",
    "mul": "mul",
    "div": "div",
    "neg": "neg",
    "sqrt": "sqrt",
    "abs": "abs",
    "sign": "sign",
    "sin": "sin",
    "cos": "cos",
    "tan": "tan",
    "asin": "asin",
    "acos": "acos",
    "atan": "atan",
    "atan2": "atan2",
    "sinh": "sinh",
    "cosh": "cosh",
    "tanh": "tanh",
    "exp": "exp",
    "log": "log",
    "log1p": "log1p",
    "expm1": "expm1",
    "pow": "pow",
    "max": "max",
    "min": "min",
    "floor": "floor",
    "ceil": "ceil",
    "rem": "rem",
    "lt": "lt",
    "le": "le",
    "gt": "gt",
    "ge": "ge",
    "eq": "eq",
    "ne": "ne",
    "and": "and",
    "or": "or",
    "not": "not",
    "is_finite": "finite",
}
_THROUGH = {"copy", "copy_p", "stop_gradient", "reduce_precision", "optimization_barrier", "pvary"}
_INNER = {
    "pjit": "jaxpr",
    "jit": "jaxpr",
    "closed_call": "call_jaxpr",
    "core_call": "call_jaxpr",
    "remat": "jaxpr",
    "checkpoint": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}
_REDUCED = {"reduce_sum": "add", "reduce_max": "max", "reduce_min": "min", "reduce_prod": "mul", "reduce_and": "and"}
_MOVED = {"gather", "dynamic_slice", "pad", "scatter", "dynamic_update_slice", "rev"}


def trace(f: Callable, *shapes: tuple[int, ...]) -> Program:
    """The program of a function of arrays of floats, one number after the other; or it is `Unreadable`."""
    dtype = jax.dtypes.canonicalize_dtype(np.float64)
    closed = jax.make_jaxpr(lambda *x: tuple(f(*x)))(*(jax.ShapeDtypeStruct(s, dtype) for s in shapes))
    sizes = [math.prod(s) for s in shapes]
    b = Builder(sum(sizes))
    ends = np.cumsum([0, *sizes])
    places = np.array(b.first, dtype=int)
    arguments = [places[ends[k] : ends[k + 1]].reshape(s) for k, s in enumerate(shapes)]
    out = _read(b, closed.jaxpr, closed.consts, arguments)
    return b.program([int(i) for x in out for i in x.reshape(-1)])


def _numbers(b: Builder, value: Any) -> Nodes:
    value = np.asarray(value)
    return np.array([b.number(x) for x in value.reshape(-1)], dtype=int).reshape(value.shape)


def _read(b: Builder, jaxpr: Any, consts: Sequence[Any], arguments: Sequence[Nodes]) -> list[Nodes]:
    space: dict[Any, Nodes] = dict(zip(jaxpr.constvars, (_numbers(b, c) for c in consts), strict=True))
    space.update(zip(jaxpr.invars, arguments, strict=True))

    def at(v: Any) -> Nodes:
        return _numbers(b, v.val) if hasattr(v, "val") else space[v]  # jax.extend.core.Literal, without its import

    for eqn in jaxpr.eqns:
        out = _equation(b, eqn, [at(v) for v in eqn.invars])
        space.update(zip(eqn.outvars, out, strict=True))
    return [at(v) for v in jaxpr.outvars]


def _equation(b: Builder, eqn: Any, x: list[Nodes]) -> list[Nodes]:
    name, p = eqn.primitive.name, eqn.params
    if name in _SAME:
        return [_each(b, _SAME[name], *x)]
    if name in _THROUGH:
        return x
    if name in _INNER:
        inner = p[_INNER[name]]
        return _read(b, getattr(inner, "jaxpr", inner), getattr(inner, "consts", ()), x)
    if name == "select_n" and len(x) == 3:
        return [_each(b, "select", x[0], x[2], x[1])]
    if name == "integer_pow":
        power = int(p["y"])
        return [_each(b, "power", x[0], value=power) if power != 1 else x[0]]
    if name == "square":
        return [_each(b, "mul", x[0], x[0])]
    if name == "rsqrt":
        return [_each(b, "div", _numbers(b, np.ones(x[0].shape)), _each(b, "sqrt", x[0]))]
    if name == "clamp":
        return [_each(b, "min", _each(b, "max", x[1], x[0]), x[2])]
    if name == "round" and int(p["rounding_method"]) == 1:
        return [_each(b, "round", x[0])]
    if name == "convert_element_type":
        return [_converted(b, eqn, x[0])]
    if name in _REDUCED:
        return [_reduced(b, _REDUCED[name], x[0], p["axes"])]
    if name == "dot_general":
        return [_product(b, p["dimension_numbers"], *x)]
    return _moved(b, eqn, x)


def _each(b: Builder, op: str, *x: Nodes, value: Any = None) -> Nodes:
    parts = np.broadcast_arrays(*x)
    flat = zip(*(a.reshape(-1).tolist() for a in parts), strict=True)
    return np.array([b.op(op, *i, value=value) for i in flat], dtype=int).reshape(parts[0].shape)


def _converted(b: Builder, eqn: Any, x: Nodes) -> Nodes:
    before, after = eqn.invars[0].aval.dtype, eqn.params["new_dtype"]
    if np.issubdtype(before, np.floating) and np.issubdtype(after, np.floating):
        return x
    known = [b.known(int(i)) for i in x.reshape(-1)]
    if all(k is not None for k in known):
        return _numbers(b, np.array(known, dtype=before).reshape(x.shape).astype(after))
    if before == np.bool_ and np.issubdtype(after, np.floating):
        return _each(b, "float", x)
    if np.issubdtype(before, np.integer) and np.issubdtype(after, np.floating):
        return x
    raise Unreadable(f"convert_element_type from {before} to {after}")


def _reduced(b: Builder, op: str, x: Nodes, axes: Sequence[int]) -> Nodes:
    rest = [k for k in range(x.ndim) if k not in axes]
    size = math.prod(x.shape[k] for k in axes)
    rows = x.transpose(*rest, *axes).reshape(-1, size)
    if not size:
        raise Unreadable(f"{op} of nothing")
    out = []
    for row in rows.tolist():
        total = row[0]
        for i in row[1:]:
            total = b.op(op, total, i)
        out.append(total)
    return np.array(out, dtype=int).reshape([x.shape[k] for k in rest])


def _product(b: Builder, dimensions: Any, x: Nodes, y: Nodes) -> Nodes:
    (cx, cy), (bx, by) = dimensions
    free_x = [k for k in range(x.ndim) if k not in (*cx, *bx)]
    free_y = [k for k in range(y.ndim) if k not in (*cy, *by)]
    shape = [*(x.shape[k] for k in (*bx, *free_x)), *(y.shape[k] for k in free_y)]
    many, size = math.prod(x.shape[k] for k in bx), math.prod(x.shape[k] for k in cx)
    left = x.transpose(*bx, *free_x, *cx).reshape(many, -1, size).tolist()
    right = y.transpose(*by, *free_y, *cy).reshape(many, -1, size).tolist()
    out = [
        b.total(b.op("mul", i, j) for i, j in zip(row, column, strict=True))
        for rows, columns in zip(left, right, strict=True)
        for row in rows
        for column in columns
    ]
    return np.array(out, dtype=int).reshape(shape)


def _moved(b: Builder, eqn: Any, x: list[Nodes]) -> list[Nodes]:
    """What only moves numbers about."""
    name, p = eqn.primitive.name, eqn.params
    if name == "broadcast_in_dim":
        shape = [1] * len(p["shape"])
        for k, d in enumerate(p["broadcast_dimensions"]):
            shape[d] = x[0].shape[k]
        return [np.broadcast_to(x[0].reshape(shape), p["shape"])]
    if name in ("reshape", "squeeze", "expand_dims"):
        return [x[0].reshape(eqn.outvars[0].aval.shape)]
    if name == "transpose":
        return [x[0].transpose(p["permutation"])]
    if name == "concatenate":
        return [np.concatenate(x, axis=p["dimension"])]
    if name == "stack":
        return [np.stack(x, axis=p.get("axis", p.get("dimension", 0)))]
    if name == "split":
        return np.split(x[0], np.cumsum(p["sizes"])[:-1], axis=p["axis"])
    if name == "unstack":
        return list(np.moveaxis(x[0], p["axis"], 0))
    if name == "slice":
        strides = p["strides"] or (1,) * x[0].ndim
        at = zip(p["start_indices"], p["limit_indices"], strides, strict=True)
        return [x[0][tuple(slice(*s) for s in at)]]
    if name == "iota":
        grid = np.indices(p["shape"])[p["dimension"]]
        return [_numbers(b, grid.astype(p["dtype"]))]
    if name in _MOVED:
        return _by_itself(b, eqn, x)
    if name in ("scatter-add", "scatter_add"):
        return [_added(b, eqn, *x)]
    raise Unreadable(name)


def _added(b: Builder, eqn: Any, x: Nodes, indices: Nodes, updates: Nodes) -> Nodes:
    """Numbers added to places that are known: which place each goes to, the gradient of the operation tells."""
    where = [b.known(int(i)) for i in indices.reshape(-1)]
    if any(k is None for k in where) or not np.issubdtype(eqn.invars[0].aval.dtype, np.floating):
        raise Unreadable(eqn.primitive.name)
    at = np.array(where, dtype=eqn.invars[1].aval.dtype).reshape(indices.shape)
    zero, none = np.zeros(x.shape), np.zeros(updates.shape)
    with jax.ensure_compile_time_eval():
        back = jax.vjp(lambda u: eqn.primitive.bind(zero, at, u, **eqn.params), none)[1]
        places = np.asarray(back(1.0 + np.arange(x.size, dtype=float).reshape(x.shape))[0]).astype(int)
    out = x.reshape(-1).copy()
    for place, node in zip(places.reshape(-1).tolist(), updates.reshape(-1).tolist(), strict=True):
        if place:  # none of what falls outside
            out[place - 1] = b.op("add", int(out[place - 1]), node)
    return out.reshape(x.shape)


def _by_itself(b: Builder, eqn: Any, x: list[Nodes]) -> list[Nodes]:
    """An operation that moves numbers by indices which are known: done to the places of the nodes."""
    given = []
    for v, a in zip(eqn.invars, x, strict=True):
        if np.issubdtype(v.aval.dtype, np.floating):
            given.append(a.astype(np.int32))
            continue
        known = [b.known(int(i)) for i in a.reshape(-1)]
        if any(k is None for k in known):
            raise Unreadable(eqn.primitive.name)
        given.append(np.array(known, dtype=v.aval.dtype).reshape(a.shape))
    params = dict(eqn.params)
    if params.get("fill_value") is not None:
        raise Unreadable(eqn.primitive.name)
    with jax.ensure_compile_time_eval():
        out = eqn.primitive.bind(*given, **params)
    out = out if eqn.primitive.multiple_results else [out]
    return [np.asarray(o).astype(int) for o in out]
