"""Long inputs, wherever they come from, as blocks of lanes that are read one after the other."""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import jax
import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.inputs import array
from jaxnc.types import Inputs

Block: TypeAlias = dict[str, np.ndarray]
"""As many lanes each of inputs, rates and accelerations: ``"0/phi"``, ``"1/phi"``, ``"2/phi"``."""

_NOUNS = ("inputs", "rates", "accelerations")
_HOW = "such as {'phi': values}"


def count(block: Block) -> int:
    """How many lanes a block has."""
    return len(next(iter(block.values())))


def part(columns: Mapping[str, Any], start: int, stop: int) -> Block:
    """Some lanes of columns, of which at least one is an array; numbers are repeated. What is in a file is read."""
    lanes = {name: v[start:stop] if np.ndim(v) else v for name, v in columns.items()}
    size = max(len(v) for v in lanes.values() if np.ndim(v))
    return {name: np.broadcast_to(array(v, f"input {name[2:]!r}"), (size,)) for name, v in lanes.items()}


def blocks_of(
    inputs: Inputs | Iterable[Inputs], rates: Sequence[Inputs | None], size: int
) -> tuple[tuple[str, ...], Iterator[Block], int | None]:
    """Cut inputs into blocks.

    Args:
        inputs: arrays ``(L,)`` by name, or an iterable of such mappings, pieces of any length.
        rates: rates and accelerations by name, or None: numbers, beside whole inputs also arrays ``(L,)``.
        size: how many lanes a block has; the last one may be shorter.

    Returns:
        Names of the inputs, the blocks, and how many lanes there are, if that is known.
    """
    if isinstance(inputs, Mapping):
        names = tuple(map(str, inputs))
        columns, total = _columns(inputs, rates, "inputs")  # pyright: ignore[reportArgumentType]
        return names, (part(columns, i, i + size) for i in range(0, total, size)), total
    if isinstance(inputs, str) or not isinstance(inputs, Iterable):
        kind = type(inputs).__name__
        raise InputError(f"inputs are arrays by name, {_HOW}, or an iterable of such mappings; got {kind}")
    pieces = iter(inputs)
    first = next(pieces, {})
    if not isinstance(first, Mapping) or not first:
        raise InputError(f"inputs: the first piece must be arrays by name, {_HOW}; got {first!r}")
    names = tuple(map(str, first))
    return names, _joined(_pieces(names, itertools.chain([first], pieces), rates), size), None


def _columns(
    inputs: Inputs, rates: Sequence[Inputs | None], what: str, whole: bool = True
) -> tuple[dict[str, Any], int]:
    """Arrays of one length or single numbers of everything that is given by name, and that length."""
    if not inputs:
        raise InputError(f"{what}: nothing is driven; give arrays by name, {_HOW}")
    columns = {f"0/{name}": _unread(value, f"input {name!r}") for name, value in inputs.items()}
    lengths = {v.shape[0] for v in columns.values() if v.ndim == 1}
    if len(lengths) != 1 or any(v.ndim > 1 for v in columns.values()):
        shapes = ", ".join(f"{name[2:]}: {v.shape}" for name, v in columns.items())
        raise InputError(f"{what} need one shape (L,) together, with or without single numbers beside; got {shapes}")
    total = lengths.pop()
    for order, given in enumerate(rates, start=1):
        noun = _NOUNS[order]
        if given is not None and not isinstance(given, Mapping):
            raise InputError(f"{noun} are given by name, such as {{'phi': 10.0}}; got {given!r}")
        for name, value in (given or {}).items():
            if name not in inputs:
                raise InputError(f"{noun}: {name!r} is not one of the inputs; {nearest(name, inputs)}")
            value = columns[f"{order}/{name}"] = _unread(value, f"{noun} of {name!r}")
            if value.shape not in ((), (total,) if whole else ()):
                want = f"shape {(total,)} or a single number" if whole else "a number, as the inputs come in pieces"
                raise InputError(f"{noun} of {name!r} has shape {value.shape}; give {want}")
    return columns, total


def _unread(value: Any, what: str) -> Any:
    """An array; one that lies in a file stays there, and its numbers are checked when they are read."""
    return value if isinstance(value, np.ndarray | jax.Array) else array(value, what)


def _pieces(names: tuple[str, ...], pieces: Iterable[Inputs], rates: Sequence[Inputs | None]) -> Iterator[Block]:
    for k, piece in enumerate(pieces):
        if not isinstance(piece, Mapping) or set(piece) != set(names):
            got = ", ".join(map(str, piece)) if isinstance(piece, Mapping) else type(piece).__name__
            raise InputError(f"inputs: every piece must give {', '.join(names)} by name; piece {k} gives {got}")
        columns, total = _columns({n: piece[n] for n in names}, rates, f"inputs, piece {k},", whole=False)
        if total:
            yield part(columns, 0, total)


def _joined(pieces: Iterator[Block], size: int) -> Iterator[Block]:
    """Pieces of any length as blocks of one length, but for the last."""
    waiting: Block = {}
    for piece in pieces:
        waiting = {name: np.concatenate([waiting[name], v]) if waiting else v for name, v in piece.items()}
        there = count(waiting)
        for start in range(0, there - size + 1, size):
            yield part(waiting, start, start + size)
        waiting = part(waiting, there - there % size, there) if there % size else {}
    if waiting:
        yield waiting
