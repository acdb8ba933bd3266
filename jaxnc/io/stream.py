"""Batches larger than memory: solved chunk by chunk, and written to disk as they come."""

import dataclasses
import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import jax
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, counted, nearest
from jaxnc.io.tables import Table, arrays_of, load_npz, select_quantities, table_arrays, table_head
from jaxnc.io.target import PartialTable, checksums, file_name
from jaxnc.kinematics.inputs import angle_unit, array, check_system, doubt_degrees, in_radians, make_plan, whole
from jaxnc.kinematics.motion import Motion, drawn_motion
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.spread import Devices
from jaxnc.progress import bar as progress_bar
from jaxnc.status import Status
from jaxnc.system.precision import on_host
from jaxnc.system.system import System
from jaxnc.types import Inputs, Numbers

if TYPE_CHECKING:
    from tqdm import tqdm

Block: TypeAlias = dict[str, np.ndarray]
"""As many lanes each of inputs, rates and accelerations: ``"0/phi"``, ``"1/phi"``, ``"2/phi"``."""

_NOUNS = ("inputs", "rates", "accelerations")
_HOW = "such as {'phi': values}"
_OTHER = (
    "the inputs {what} of the call that was interrupted, which has written {rows} poses in {parts}; give the same "
    "again, or pass resume=False to begin anew"
)


@public
@dataclass(frozen=True)
class Streamed:
    """A batch that was written to disk, and what became of its poses.

    Attributes:
        name: the mechanism.
        path: the file, a table that `jaxnc.io.load_npz` and ``numpy.load`` read.
        lanes: how many poses are in it.
        statuses: how many of them have each `jaxnc.Status`.
        resumed: how many of them an earlier call that was interrupted had written.
    """

    name: str
    path: Path
    lanes: int
    statuses: dict[Status, int]
    resumed: int

    @property
    def failures(self) -> int:
        """How many poses failed."""
        return self.lanes - self.statuses.get(Status.CONVERGED, 0)

    def table(self) -> Table:
        """Open the table, its arrays mapped into memory; only what is looked at is read."""
        return load_npz(self.path, mmap=True)

    def __repr__(self) -> str:
        bad = [f"{n} {s.name.lower().replace('_', ' ')}" for s, n in sorted(self.statuses.items()) if s]
        poses = counted(self.lanes, "pose")
        return f"Streamed({self.name!r}: {poses} in {self.path}, {', '.join(bad) or 'all converged'})"


@public
@on_host
def stream(
    system: System,
    inputs: Inputs | Iterable[Inputs],
    path: str | Path,
    rates: Inputs | None = None,
    accelerations: Inputs | None = None,
    quantities: Sequence[str] | None = None,
    chunk: int = 65_536,
    hold: Sequence[str] = (),
    start: Motion | Inputs | None = None,
    branch: Motion | None = None,
    devices: Devices = None,
    progress: bool | None = None,
    resume: bool = True,
    unit: str | None = None,
) -> Streamed:
    """Find any number of poses, as `jaxnc.solve_position` does, and write them to a file instead of holding them.

    Memory for two chunks is needed, whatever their number. What is done is in a folder beside the file, ``path.part``,
    until the file is complete: call again with the same arguments after an interruption, and it goes on where it was.
    The disk holds both for a moment at the end.

    Args:
        system: the system, one design.
        inputs: array ``(L,)`` of each driven coordinate, by name, which may be a ``numpy.memmap``; or an iterable of
            such mappings with pieces of any length, for instance a generator. Lengths, and angles in `unit`.
        path: the npz file; one that is there is replaced when the new one is complete. Missing folders are created.
        rates: time derivatives of the inputs, numbers or, beside inputs that are arrays, arrays ``(L,)``.
        accelerations: second time derivatives of the inputs, in the same way.
        quantities: points, vectors, markers and coordinates to write besides the inputs; if not given everything that
            moves.
        chunk: how many poses are solved at a time; compiled once, the last chunk is filled up.
        hold: as for `jaxnc.solve_position`.
        start: as for `jaxnc.solve_position`.
        branch: as for `jaxnc.solve_position`.
        devices: as for `jaxnc.solve_position`. With ``jax.distributed`` every process writes its part, to its own path.
        progress: show a bar; if not given, where stderr is a terminal, and in a notebook.
        resume: go on with what an interrupted call has left; False begins anew.
        unit: what angles and their rates (of a `start` by name, too) are given in, ``"rad"`` or ``"deg"``; what is
            written is in radians.

    Returns:
        How many poses were found and what became of the others. In the file a failed pose is NaN and has its status.

    Raises:
        InputError: as for `jaxnc.solve_position`; also inputs of different lengths or none, an unknown quantity, inputs
            that differ from those of the call that was interrupted.
        ModelFileError: what an interrupted call has left is damaged.
        OutputError: the file cannot be written.
    """
    check_system(system, "stream()")
    chunk = whole(chunk, "chunk=, how many poses are solved at a time (65536),", 1, 10**8)
    if rates is None and accelerations is not None:
        raise InputError("accelerations follow from rates: give rates={...} as well")
    doubt_degrees(system, unit, inputs, start)
    (start,) = in_radians(system, unit, start)
    names, blocks, total = cut_blocks(inputs, (rates, accelerations), chunk)
    if angle_unit(unit) == "deg":
        blocks = _in_radians(system, blocks)
    view = make_plan(system, names, hold)
    held = system.topology.named(view.held)
    drawn = drawn_motion(system, names, held)
    shown = select_quantities(drawn, quantities)
    arrays_of(drawn, shown)  # complains of unknown names before anything is solved
    settings = {"hold": hold, "start": start, "branch": branch, "devices": devices}
    question = {
        "mechanism": system.name,
        "design": _digest(system.parameters, system.topology.rows, system.topology.coordinates),
        "inputs": names,
        "rates": rates is not None,
        "quantities": shown,
        "hold": held,
        "start": _digest(start),
        "branch": _digest(branch),
    }
    path = file_name(path)
    parts = PartialTable(path, question, resume)
    resumed = parts.index.rows
    with progress_bar(total, system.name, " poses", progress, initial=resumed, unit_scale=True) as bar:
        _solve_blocks(parts, bar, blocks, lambda block: _solve_block(system, block, chunk, settings), shown)
    if not parts.index.rows:
        raise InputError("the inputs are empty; give at least one pose")
    parts.finish(table_head(drawn, shown))
    statuses = {Status[name]: count for name, count in parts.index.counts.items()}
    return Streamed(system.name, path, parts.index.rows, statuses, resumed)


def _in_radians(system: System, blocks: Iterator[Block]) -> Iterator[Block]:
    """Turn blocks whose angles are in degrees into radians."""
    for block in blocks:
        names = {key: key.partition("/")[2] for key in block}
        turned = in_radians(system, "deg", *({names[key]: values} for key, values in block.items()))
        yield {key: np.asarray(one[names[key]]) for key, one in zip(block, turned, strict=True)}


def _solve_blocks(
    parts: PartialTable, bar: "tqdm", blocks: Iterator[Block], solve: Callable, shown: Sequence[str]
) -> None:
    """Solve block by block; while one is being solved, the one before is written."""
    seen, solved = parts.index.inputs, None
    for block in _not_done(blocks, parts):
        first = parts.index.rows + (solved[1] if solved else 0)
        try:
            motion = solve(block)
        except InputError as error:
            raise InputError(f"poses {first} to {first + count_lanes(block) - 1}: {error}") from None
        if solved:
            _write_block(parts, bar, *solved, shown)
        seen = checksums(block, seen)
        solved = motion, count_lanes(block), seen
    if solved:
        _write_block(parts, bar, *solved, shown)


def _write_block(
    parts: PartialTable, bar: "tqdm", motion: Motion, lanes: int, seen: dict[str, int], shown: Sequence[str]
) -> None:
    # Numbers of the host from here on, so that picking a quantity out of them compiles nothing.
    fields = ("q", "rates", "status", "residual", "conditioning")
    got = {name: jax.tree.map(lambda x: np.asarray(x)[:lanes], getattr(motion, name)) for name in fields}
    motion = dataclasses.replace(motion, poses=got.pop("q"), **got)
    counts = dict(parts.index.counts)
    for kind, number in zip(*np.unique(got["status"], return_counts=True), strict=True):
        name = Status(int(kind)).name
        counts[name] = counts.get(name, 0) + int(number)
    parts.append(table_arrays(motion, shown), seen, counts)
    bar.update(lanes)


def _solve_block(system: System, block: Block, chunk: int, settings: Mapping[str, object]) -> Motion:
    """Find the poses of a block, which is filled up with its last lane: one shape is compiled."""
    lanes = np.minimum(np.arange(chunk), count_lanes(block) - 1)
    by_order = [{key[2:]: v[lanes] for key, v in block.items() if key[0] == k} for k in "012"]
    moving = {"rates": by_order[1], "accelerations": by_order[2]} if by_order[1] else {}
    return solve_position(system, by_order[0], throw=False, unit="rad", **moving, **settings)


def _not_done(blocks: Iterator[Block], parts: PartialTable) -> Iterator[Block]:
    """Leave out of blocks the poses that an earlier call has written, whose inputs must be the same."""
    left, seen = parts.index.rows, {}
    for block in blocks:
        done = min(left, count_lanes(block))
        if done:
            seen = checksums(take_lanes(block, 0, done), seen)
            left -= done
            if not left and seen != parts.index.inputs:
                raise InputError(_OTHER.format(parts=parts.folder, what="differ from those", rows=parts.index.rows))
        if done < count_lanes(block):
            yield take_lanes(block, done, count_lanes(block))
    if left:
        raise InputError(_OTHER.format(parts=parts.folder, what="are fewer than those", rows=parts.index.rows))


def _digest(*things: object) -> str:
    """Return a checksum of numbers and words, the same in every process."""
    found = hashlib.sha256()
    for leaf in jax.tree.leaves(things):
        found.update(np.asarray(leaf).tobytes())
    names = [sorted(map(str, thing)) for thing in things if isinstance(thing, Mapping)]
    return hashlib.sha256(found.digest() + repr(names).encode()).hexdigest()


def count_lanes(block: Block) -> int:
    """Count the lanes of a block."""
    return len(next(iter(block.values())))


def take_lanes(columns: Mapping[str, Numbers], start: int, stop: int) -> Block:
    """Take some lanes of columns, one an array at least; numbers are repeated, and what is in a file is read."""
    lanes = {name: v[start:stop] if np.ndim(v) else v for name, v in columns.items()}
    size = max(len(v) for v in lanes.values() if np.ndim(v))
    return {name: np.broadcast_to(array(v, f"input {name[2:]!r}"), (size,)) for name, v in lanes.items()}


def cut_blocks(
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
        columns, total = _read_columns(dict(zip(names, inputs.values(), strict=True)), rates, "inputs")
        return names, (take_lanes(columns, i, i + size) for i in range(0, total, size)), total
    if isinstance(inputs, str) or not isinstance(inputs, Iterable):
        kind = type(inputs).__name__
        raise InputError(f"inputs are arrays by name, {_HOW}, or an iterable of such mappings; got {kind}")
    pieces = iter(inputs)
    first = next(pieces, {})
    if not isinstance(first, Mapping) or not first:
        raise InputError(f"inputs: the first piece must be arrays by name, {_HOW}; got {first!r}")
    names = tuple(map(str, first))
    return names, _join_read_pieces(_read_pieces(names, itertools.chain([first], pieces), rates), size), None


def _read_columns(
    inputs: Inputs, rates: Sequence[Inputs | None], what: str, whole: bool = True
) -> tuple[dict[str, Numbers], int]:
    """Return arrays of one length or single numbers of everything that is given by name, and that length."""
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


def _unread(value: object, what: str) -> Numbers:
    """Return an array; one that lies in a file stays there, and its numbers are checked when they are read."""
    return value if isinstance(value, np.ndarray | jax.Array) else array(value, what)


def _read_pieces(names: tuple[str, ...], pieces: Iterable[Inputs], rates: Sequence[Inputs | None]) -> Iterator[Block]:
    for k, piece in enumerate(pieces):
        if not isinstance(piece, Mapping) or set(piece) != set(names):
            got = ", ".join(map(str, piece)) if isinstance(piece, Mapping) else type(piece).__name__
            raise InputError(f"inputs: every piece must give {', '.join(names)} by name; piece {k} gives {got}")
        columns, total = _read_columns({n: piece[n] for n in names}, rates, f"inputs, piece {k},", whole=False)
        if total:
            yield take_lanes(columns, 0, total)


def _join_read_pieces(pieces: Iterator[Block], size: int) -> Iterator[Block]:
    """Cut pieces of any length into blocks of one length, but for the last."""
    waiting: Block = {}
    for piece in pieces:
        waiting = {name: np.concatenate([waiting[name], v]) if waiting else v for name, v in piece.items()}
        there = count_lanes(waiting)
        for start in range(0, there - size + 1, size):
            yield take_lanes(waiting, start, start + size)
        rest = take_lanes(waiting, there - there % size, there) if there % size else {}
        waiting = {name: np.array(v) for name, v in rest.items()}  # the next piece may come in the same memory
    if waiting:
        yield waiting
