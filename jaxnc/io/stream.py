"""Batches larger than memory: solved chunk by chunk, and written to disk as they come."""

import dataclasses
import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, counted
from jaxnc.io.blocks import Block, blocks_of, count, part
from jaxnc.io.parts import Parts, checksums
from jaxnc.io.tables import ORDERS, Table, arrays_of, chosen, load_npz
from jaxnc.io.target import file_name
from jaxnc.kinematics.inputs import angle_unit, check_system, doubt_degrees, in_radians, make_plan, whole
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.spread import Devices
from jaxnc.progress import bar as progress_bar
from jaxnc.solvers.assembly import derive
from jaxnc.status import Status
from jaxnc.system.precision import on_host
from jaxnc.system.system import System
from jaxnc.types import Inputs

if TYPE_CHECKING:
    from tqdm import tqdm

_OTHER = (
    "the inputs {what} of the call that was interrupted, which has written {rows} poses in {parts}; give the same "
    "again, or pass resume=False to begin anew"
)


@public
@dataclass(frozen=True)
class Streamed:
    """What became of a batch that was written to disk.

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
        """The table, its arrays mapped into memory; only what is looked at is read."""
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
    start: Mapping[str, Any] | Motion | None = None,
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
    names, blocks, total = blocks_of(inputs, (rates, accelerations), chunk)
    if angle_unit(unit) == "deg":
        blocks = _turned(system, blocks)
    view = make_plan(system, names, hold)
    held = system.topology.named(view.held)
    drawn = _drawn(system, names, held)
    shown = chosen(drawn, quantities)
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
    parts = Parts(path, question, resume)
    resumed = parts.rows
    with progress_bar(total, system.name, " poses", progress, initial=resumed, unit_scale=True) as bar:
        _run(parts, bar, blocks, lambda block: _solve(system, block, chunk, settings), shown)
    if not parts.rows:
        raise InputError("the inputs are empty; give at least one pose")
    units = np.array([drawn.system.topology.unit(name) for name in shown], dtype=np.str_)
    driven, words = np.array(names, dtype=np.str_), np.array(shown, dtype=np.str_)
    parts.finish({"name": np.array(system.name), "driven": driven, "names": words, "units": units})
    statuses = {Status[name]: count for name, count in parts.counts.items()}
    return Streamed(system.name, path, parts.rows, statuses, resumed)


def _turned(system: System, blocks: Iterator[Block]) -> Iterator[Block]:
    """Blocks whose angles are in degrees, in radians."""
    for block in blocks:
        names = {key: key.partition("/")[2] for key in block}
        turned = in_radians(system, "deg", *({names[key]: values} for key, values in block.items()))
        yield {key: np.asarray(one[names[key]]) for key, one in zip(block, turned, strict=True)}


def _run(parts: Parts, bar: "tqdm", blocks: Iterator[Block], solve: Callable, shown: Sequence[str]) -> None:
    """Solve block by block; while one is being solved, the one before is written."""
    seen, solved = parts.inputs, None
    for block in _not_done(blocks, parts):
        first = parts.rows + (solved[1] if solved else 0)
        try:
            motion = solve(block)
        except InputError as error:
            raise InputError(f"poses {first} to {first + count(block) - 1}: {error}") from None
        if solved:
            _write(parts, bar, *solved, shown)
        seen = checksums(block, seen)
        solved = motion, count(block), seen
    if solved:
        _write(parts, bar, *solved, shown)


def _write(parts: Parts, bar: "tqdm", motion: Motion, lanes: int, seen: dict[str, int], shown: Sequence[str]) -> None:
    # Numbers of the host from here on, so that picking a quantity out of them compiles nothing.
    fields = ("q", "rates", "status", "residual", "conditioning")
    got = {name: jax.tree.map(lambda x: np.asarray(x)[:lanes], getattr(motion, name)) for name in fields}
    motion = dataclasses.replace(motion, poses=got.pop("q"), **got)
    status = got["status"]
    arrays = {name: got[name] for name in ("status", "residual", "conditioning")}
    for order, entries in zip(ORDERS, arrays_of(motion, shown), strict=False):
        for name, numbers in entries.items():
            numbers[status != 0] = np.nan
            arrays[f"{order}/{name}"] = numbers
    counts = dict(parts.counts)
    for kind, number in zip(*np.unique(status, return_counts=True), strict=True):
        name = Status(int(kind)).name
        counts[name] = counts.get(name, 0) + int(number)
    parts.append(arrays, seen, counts)
    bar.update(lanes)


def _solve(system: System, block: Block, chunk: int, settings: Mapping[str, Any]) -> Motion:
    """The poses of a block, which is filled up with its last lane: one shape is compiled."""
    lanes = np.minimum(np.arange(chunk), count(block) - 1)
    by_order = [{key[2:]: v[lanes] for key, v in block.items() if key[0] == k} for k in "012"]
    moving = {"rates": by_order[1], "accelerations": by_order[2]} if by_order[1] else {}
    return solve_position(system, by_order[0], throw=False, unit="rad", **moving, **settings)


def _not_done(blocks: Iterator[Block], parts: Parts) -> Iterator[Block]:
    """The blocks without the poses that an earlier call has written, whose inputs must be the same."""
    left, seen = parts.rows, {}
    for block in blocks:
        done = min(left, count(block))
        if done:
            seen = checksums(part(block, 0, done), seen)
            left -= done
            if not left and seen != parts.inputs:
                raise InputError(_OTHER.format(parts=parts.folder, what="differ from those", rows=parts.rows))
        if done < count(block):
            yield part(block, done, count(block))
    if left:
        raise InputError(_OTHER.format(parts=parts.folder, what="are fewer than those", rows=parts.rows))


def _drawn(system: System, driven: tuple[str, ...], held: tuple[str, ...]) -> Motion:
    """The drawing as a motion: what can be asked of poses can be asked of it."""
    home, good = derive(system).home, jnp.asarray(int(Status.CONVERGED))
    asked = home[np.array([system.topology.position[name] for name in driven], int)]
    return Motion(system, driven, held, home, (), asked, good, None, None)


def _digest(*things: Any) -> str:
    """A checksum of numbers and words, the same in every process."""
    found = hashlib.sha256()
    for leaf in jax.tree.leaves(things):
        found.update(np.asarray(leaf).tobytes())
    names = [sorted(map(str, thing)) for thing in things if isinstance(thing, Mapping)]
    return hashlib.sha256(found.digest() + repr(names).encode()).hexdigest()
