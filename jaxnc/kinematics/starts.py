"""Start sets: all solutions of a generic member of a structure's family, found once and kept in the user's cache."""

import contextlib
import dataclasses
import functools
import hashlib
import os
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxnc.continuation.monodromy import Found, is_new, run_loops, solve_by_degree, trace_solutions
from jaxnc.continuation.tracker import QuadraticPaths
from jaxnc.errors import counted
from jaxnc.kinematics.polynomial import Design, Member, Reading, by_structure
from jaxnc.kinematics.reduction import WAYS, Placed, Reduction
from jaxnc.process import cache_folder
from jaxnc.system.identity import Thing

_BY_PATHS, _BY_TRACE = "total degree", "trace test"
_PART = "-part"  # of the key of a start set that is not complete


@dataclasses.dataclass(frozen=True)
class StartSet:
    """All solutions that were found of a generic member."""

    member: Member
    x: np.ndarray  # all unknowns of each, (unknowns, solutions)
    way: str  # of the elimination
    loops: int  # of monodromy
    quiet: int  # of them, at the end, without a new solution
    proof: str  # that there are no others, "total degree" or "trace test"; empty if that was observed only

    def __len__(self) -> int:
        return self.x.shape[1]


class PositiveDimension(Exception):
    """Solutions that are not isolated, with how many freedoms."""


class NoMember(Exception):
    """No generic member moves: rows contradict each other but for special dimensions. With an argument: none drawn."""


class TooMany(Exception):
    """More solutions than were allowed: how many are known and expected, seconds for all, whether they are kept."""


def find_starts(
    design: Design, inputs: Sequence[int], rng: np.random.Generator, key: str, most: float = np.inf
) -> StartSet:
    """Find all solutions of a generic member, from the drawing of a design.

    What is known is written into the cache on the way, and a later call with the same `key` goes on from there.

    Raises:
        TooMany: there are more than `most` solutions.
    """
    reading, drawn = design.reading, design.drawn(inputs)
    begun = load_starts(reading, key + _PART)
    if begun is None:
        own, pose = draw_generic(design, rng)
        begun = StartSet(reading.member_of(pose, own), pose[reading.unknown], WAYS[0], 0, 0, "")
    else:
        rng = np.random.default_rng([*key.encode(), begun.loops])  # other loops than those that were run
    for way in WAYS[WAYS.index(begun.way) :]:
        reduction = Reduction(reading, begun.member, drawn, way)
        placed = reduction.place(begun.member)
        freedoms = reduction.square_rows(placed, begun.x[:, 0], rng)
        if freedoms:
            raise PositiveDimension(freedoms)
        w, proved = reduction.shorten(begun.x), False
        if reduction.n == 0:
            return StartSet(begun.member, begun.x, way, 0, 0, _BY_PATHS)
        t = np.tensordot(reduction.mix, placed.restricted[0], 1)
        if reduction.n <= 8:  # 256 paths of the total degree
            every, proved = solve_by_degree(t, rng)
            every = every[:, placed.meets_all(every)]
            w = np.concatenate([w, every[:, is_new(w, every)]], axis=1)

        loop = functools.partial(_make_loop, reduction, placed, design, rng)
        last = way == WAYS[-1]
        search = _KeptLoops(placed, way, key + _PART, most)
        before = (begun.loops, begun.quiet) if way == begun.way else (0, 0)
        # One path between generic members may go to infinity.
        found = search.run(functools.partial(run_loops, w, loop, None if last else 1, proved, before))
        if not found.quiet and not last:
            continue  # the elimination leads out of the family
        remove_starts(key + _PART)
        proof = _BY_PATHS if proved and found.w.shape[1] == w.shape[1] else ""
        return dataclasses.replace(search.state(found), proof=proof)
    raise AssertionError("the last way ends")


class _KeptLoops:
    """A search for all solutions of a member, which is written into the cache while it goes on."""

    def __init__(self, placed: Placed, way: str, key: str, most: float):
        self.placed, self.way, self.key, self.most = placed, way, key, most
        self.begun = self.written = time.monotonic()
        self.latest: Found | None = None

    def state(self, found: Found) -> StartSet:
        """Write what is known as a start set."""
        every = self.placed.lengthen(found.w[:, self.placed.meets_all(found.w)])
        return StartSet(self.placed.member, every, self.way, found.loops, found.quiet, "")

    def run(self, loops: Callable[..., Found]) -> Found:
        """Run loops, and keep what they have found if they are interrupted."""
        try:
            return loops(keep=self._keep)
        except KeyboardInterrupt:
            known = self.latest
            if known is None or not save_starts(self.state(known), self.key):
                raise
            raise KeyboardInterrupt(
                f"modes(): {counted(known.w.shape[1], 'solution')} of a generic mechanism known after "
                f"{counted(known.loops, 'loop')} are kept; the same call goes on from there"
            ) from None

    def _keep(self, found: Found) -> None:
        self.latest, now, known = found, time.monotonic(), found.w.shape[1]
        if known > self.most:
            kept = save_starts(self.state(found), self.key)
            expected = max(known, found.estimate) if np.isfinite(found.estimate) else 2 * known
            # A search takes about fifteen ways through all solutions, in five loops.
            raise TooMany(known, round(expected), expected * 15 * (now - self.begun) / max(1, found.paths), kept)
        if now - self.written > 2.0:  # seconds after which what is known so far is kept
            save_starts(self.state(found), self.key)
            self.written = now


def prove_starts(design: Design, inputs: Sequence[int], starts: StartSet, rng: np.random.Generator) -> StartSet:
    """Show by the trace test that a start set has all that hangs together with it; what it lacks is added.

    It comes back as it is where the test comes to no end.
    """
    reduction = Reduction(design.reading, starts.member, design.drawn(inputs), starts.way)
    placed = reduction.place(starts.member)
    reduction.square_rows(placed, starts.x[:, 0], rng)
    line = reduction.paths(placed, _place_generic(reduction, design, rng))
    w, shown = trace_solutions(line, reduction.shorten(starts.x), rng)
    w = w[:, placed.meets_all(w)]
    return dataclasses.replace(starts, x=placed.lengthen(w), proof=_BY_TRACE) if shown else starts


def draw_generic(design: Design, rng: np.random.Generator) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Draw the constants of a generic member, and a pose ``(N, 1)`` that it has."""
    for _ in range(20):
        drawn = design.reading.draw_member(design.x, design.constants, rng)
        if drawn is not None:
            return drawn
    raise NoMember("drawn")


def count_tied(design: Design, inputs: Sequence[int], constants: tuple[np.ndarray, ...], pose: np.ndarray) -> int:
    """Count the rows beyond the unknowns that are left when linear rows are solved, at a pose of a generic member."""
    reading = design.reading
    member = reading.member_of(pose, constants)
    reduction = Reduction(reading, member, design.drawn(inputs))
    reduction.square_rows(reduction.place(member), pose[reading.unknown, 0], np.random.default_rng(7))
    return len(reduction.rows) - len(reduction.mix)


def _place_generic(reduction: Reduction, design: Design, rng: np.random.Generator) -> Placed:
    own, pose = draw_generic(design, rng)
    return reduction.place(reduction.reading.member_of(pose, own))


def _make_loop(reduction: Reduction, generic: Placed, design: Design, rng: np.random.Generator) -> list[QuadraticPaths]:
    """Three legs, by way of two other members and back."""
    around = [generic, *(_place_generic(reduction, design, rng) for _ in range(2))]
    return [reduction.paths(around[k], around[(k + 1) % 3]) for k in range(3)]


# -- kept --------------------------------------------------------------------------------------------------------------


def structure_key(reading: Reading, constants: Sequence[np.ndarray], seed: int) -> str:
    """A key of a structure with its inputs, without names, and of a seed; the same in every process."""
    top = reading.top
    blocks = [
        (part.block, part.instances.tolist(), part.sizes is not None, part.rows.source.nodes, part.rows.source.outputs)
        for part in reading.parts
    ]
    index = [(b.points, b.vectors, b.scalars) for b in top.blocks]
    fixed = [by_structure(c) for c in constants]
    zeros = [np.flatnonzero(c == 0.0).tolist() for c in fixed]
    copies = [c[np.abs(c) == 1.0].tolist() for c in fixed]
    # 4 is the version of the files, and of what their keys mean.
    text = repr(
        (4, top.dim, top.fixed, reading.known.tolist(), blocks, index, zeros, *([copies] if any(copies) else []))
    )
    return f"{hashlib.sha256(text.encode()).hexdigest()[:40]}-{seed}"


def recall_starts(design: Design, reading: Reading, seed: int) -> StartSet | None:
    """Read the start set of a structure, or of a kindred one, from the user's cache; None where there is none."""
    kindred = kindred_key(design, reading, seed)
    if kindred is None:
        return load_starts(reading, structure_key(reading, design.constants, seed))
    return adopt_starts(reading, design.constants, kindred)


def keep_starts(design: Design, reading: Reading, seed: int, starts: StartSet) -> None:
    """Keep a start set for its structure and, where there may be such, for kindred ones."""
    kindred = kindred_key(design, reading, seed)
    if kindred is None:
        save_starts(starts, structure_key(reading, design.constants, seed))
    else:
        offer_starts(reading, starts, kindred)


def kindred_key(design: Design, reading: Reading, seed: int) -> str | None:
    """A key that a structure shares with those whose bodies are described by other segments of the same points.

    Which segments a body's rows take depends on its shape. None where a body has something special: what is zero in one
    description is none in another.
    """
    top, bodies, kinds, rest = reading.top, {}, [], []
    for part in reading.parts:
        block, layout = top.blocks[part.block], top.layout[part.block]
        fixed = by_structure(design.constants[part.block])
        for i in part.instances:
            owner = design.owners[part.block][i][0]
            if owner.thing is Thing.BODY and part.sizes is None:
                if not np.isnan(fixed[i]).all():
                    return None
                bodies.setdefault(owner, set()).update(layout.variables[i].tolist())
                kinds.append((owner.number, block.kind.name))
            else:
                own = part.rows.source.nodes, part.rows.source.outputs, part.sizes is not None
                rest.append((own, layout.variables[i].tolist(), fixed[i].tolist()))
    if not bodies:
        return None
    described = sorted(sorted(items) for items in bodies.values())
    text = repr((1, top.dim, top.fixed, reading.known.tolist(), described, sorted(kinds), rest))
    return f"{hashlib.sha256(text.encode()).hexdigest()[:40]}-{seed}-kindred"


def adopt_starts(reading: Reading, constants: Sequence[np.ndarray], key: str) -> StartSet | None:
    """Read the start set of a kindred structure and describe its member anew; None where there is none that fits."""
    file = load_arrays(key)
    try:
        if file is None:
            return None
        pose, x, way, proof = file["pose"], file["x"], str(file["way"]), str(file["proof"])
        loops, quiet = (int(v) for v in file["history"])
    except (ValueError, KeyError):
        return None  # damaged: it is made anew
    member = reading.member_of(pose, reading.redraw(constants, pose))
    every = np.concatenate([np.ones((1, x.shape[1])), x])
    rows = np.einsum("is,rij,js->rs", every, reading.coefficients(member)[0], every)
    size = np.abs(every).max(axis=0) ** 2
    fits = np.isfinite(rows).all() and (np.abs(rows) <= 1e-9 * size).all()
    return StartSet(member, x, way, loops, quiet, proof) if fits else None


def offer_starts(reading: Reading, starts: StartSet, key: str) -> None:
    """Keep a start set for kindred structures: a pose of its member, and all solutions."""
    pose = starts.member.known.astype(complex)
    pose[reading.unknown] = starts.x[:, :1]
    arrays = {"pose": pose, "x": starts.x, "way": starts.way, "proof": starts.proof}
    save_arrays({**arrays, "history": np.array([starts.loops, starts.quiet])}, key)


def load_starts(reading: Reading, key: str) -> StartSet | None:
    """Read a start set from the user's cache; None where there is none that can be read."""
    file = load_arrays(key)
    try:
        if file is None:
            return None
        blocks = [file[f"constants {b}"] for b in range(len(reading.top.blocks))]
        member = Member(tuple(blocks), file["known"], file["turns"], file["sizes"])
        loops, quiet = (int(v) for v in file["history"])
        return StartSet(member, file["x"], str(file["way"]), loops, quiet, str(file["proof"]))
    except (ValueError, KeyError):
        return None  # damaged: it is made anew


def save_starts(starts: StartSet, key: str) -> bool:
    """Write a start set into the user's cache, if there is one that can be written; whether it is there now."""
    arrays: dict[str, Any] = {f"constants {b}": c for b, c in enumerate(starts.member.constants)}
    arrays |= {"known": starts.member.known, "turns": starts.member.turns, "sizes": starts.member.sizes}
    arrays |= {"x": starts.x, "way": starts.way, "proof": starts.proof}
    arrays["history"] = np.array([starts.loops, starts.quiet])
    return save_arrays(arrays, key)


def load_arrays(key: str) -> dict[str, np.ndarray] | None:
    """Read arrays from the user's cache; None where there are none that can be read."""
    folder = _folder()
    if folder is None:
        return None
    try:
        with np.load(folder / f"{key}.npz") as file:
            return dict(file)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None  # not there, or damaged: they are made anew


def save_arrays(arrays: Mapping[str, Any], key: str) -> bool:
    """Write arrays into the user's cache, if there is one that can be written; whether they are there now."""
    folder = _folder()
    if folder is None:
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, suffix=".part", delete=False) as file:
            np.savez(file, **arrays)
        os.replace(file.name, folder / f"{key}.npz")
    except OSError:
        return False  # a full disk, or a folder that is not ours: they are found again next time
    return True


def remove_starts(key: str) -> None:
    """Remove a start set from the user's cache, if it is there."""
    folder = _folder()
    if folder is not None:
        with contextlib.suppress(OSError):
            (folder / f"{key}.npz").unlink()


def _folder() -> Path | None:
    """Where start sets are kept, beside compiled programs; None where the environment turns the cache off."""
    told = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    where = cache_folder(os.environ, sys.platform, told)
    return None if where is None else Path(where) / "modes"
