"""Freedoms that were hardly meant, and bodies that lock a mechanism, by name."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnc.solvers.assembly import derive, evaluate, free_plan, rank_of, sample_poses, settle, to_host
from jaxnc.solvers.plan import plan
from jaxnc.system.identity import Owner, Thing
from jaxnc.system.precision import widened
from jaxnc.system.system import System, unheld

_STILL = 1e-6  # of the largest velocity
_LISTED = 6  # names that a sentence gives
_LOCKING = (Thing.BODY, Thing.JOINT, Thing.RELATION, Thing.CONSTRAINT)


@widened
def loose_motions(system: System, driven: Sequence[str]) -> list[str]:
    """What can still move without anything else: bodies that spin about their own line, and what nothing holds.

    Returns:
        For each such body a phrase that names it and its line, and a coordinate that would hold it; also points and
        vectors that nothing holds at all.
    """
    top = system.topology
    stray = unheld(top)
    eq = derive(system)
    q, *_ = settle(eq, np.zeros(len(top.coordinates)))
    view = plan(top, tuple(driven))
    weight = to_host(eq).weights
    _, null = rank_of(np.asarray(evaluate(eq, q)[1])[np.ix_(view.rows, view.unknown)] / weight[view.unknown])
    found = []
    for body in top.bodies:
        spin = _spin(system, np.asarray(q), body)
        if spin is None:
            continue
        change, line = spin[0] * weight, spin[1]
        size = np.linalg.norm(change[view.unknown])
        if size == 0.0 or np.abs(change[view.known]).max(initial=0.0) > _STILL * size:
            continue
        rest = change[view.unknown] - null.T @ (null @ change[view.unknown])
        others = np.delete(change, view.unknown)
        if np.linalg.norm(rest) <= _STILL * size and np.abs(others).max(initial=0.0) <= _STILL * size:
            name = top.coordinates[int(np.argmax(np.abs(change)))]
            found.append(f"body {body.name!r} can spin about its own line {line} (hold or drive {name!r})")
    return [*stray, *found]


@widened
def explain_lock(system: System) -> list[str]:
    """Name the bodies, joints and equations that lock a mechanism together, and as few as possible to leave out.

    Returns:
        One sentence; none where the mechanism moves, is large, or stands still without any of them.
    """
    top = system.topology
    if top.large:
        return []
    sample, view = sample_poses(system, 1)[0], free_plan(top)
    if sample.rank < len(view.unknown):
        return []
    owners = [set(top.row_owners[i]) for i in view.rows]
    things = sorted(o for o in top.owners if o.thing in _LOCKING)

    def freed(without: set[Owner]) -> int:
        rest = sample.jacobian[[k for k, of in enumerate(owners) if not of or not of <= without]]
        return len(view.unknown) - (rank_of(rest)[0] if len(rest) else 0)

    # Of equals the one that was added last is the likely slip. Where several are too many, the last go first.
    without: list[Owner] = []
    while not (unlocking := {o: n for o in things if o not in without and (n := freed({*without, o}))}):
        if len(without) == len(things):
            return []
        without.append(next(o for o in reversed(things) if o not in without))
    least = min(unlocking.values())
    *others, last = [o for o, gained in unlocking.items() if gained == least]
    for o in list(without):
        if freed({*without, last} - {o}):
            without.remove(o)
    least = freed({*without, last})
    rest, out = ([f"{o.thing.noun} {top.called(o)!r}" for o in some] for some in (others, sorted([last, *without])))
    also = f" (or {', '.join(rest[:_LISTED])}{', …' if len(rest) > _LISTED else ''})" if others and not without else ""
    freedoms = f"{least} degree{'s' if least != 1 else ''} of freedom"
    locks = [*rest[:_LISTED], *out]
    together = f"{', '.join(locks)} lock each other" if len(locks) > 1 else f"{locks[0]} locks it"
    return [f"{together}; leave out {' and '.join(out)}{also} and it has {freedoms}"]


@widened
def undriven_freedoms(system: System) -> list[str]:
    """Name what still moves while every angle and distance of a mechanism is driven; none where nothing does."""
    top = system.topology
    view = free_plan(top)
    if top.large or not top.scalars or loose_motions(system, ()):  # these have been named by themselves
        return []
    sample = sample_poses(system, 1)[0]
    scalars = np.asarray(view.unknown) >= len(top.coordinates) - len(top.scalars)
    null = rank_of(np.concatenate([sample.jacobian, np.eye(len(view.unknown))[scalars]]))[1]
    if not len(null):
        return []
    moving = np.zeros(len(top.coordinates))
    moving[view.unknown] = np.abs(null).max(axis=0)
    points = moving[: len(top.points) * top.dim].reshape(-1, top.dim).max(axis=1) > _STILL
    bodies = [b.name for b in top.bodies if any(points[i] for i in b.points)]
    names = bodies or [name for name, moves in zip(top.points, points, strict=True) if moves]
    if not names:
        return []
    count = f"{len(null)} degree{'s' if len(null) != 1 else ''} of freedom"
    return [
        f"with {', '.join(top.scalars[:_LISTED])} driven {count} would be left, of {', '.join(names[:_LISTED])}: "
        f"a body or a joint is missing there, or drive or hold as many coordinates more"
    ]


def _spin(system: System, q: np.ndarray, body: Any) -> tuple[np.ndarray, str] | None:
    """The velocity of all coordinates while one body turns about the line between the joints that hold it."""
    top = system.topology
    if top.dim != 3 or len(body.segments) < 2:
        return None
    count = len(top.points)
    points = q[: 3 * count].reshape(-1, 3)
    vectors = q[3 * count : 3 * (count + len(top.vectors))].reshape(-1, 3)
    others = [b for b in top.bodies if b is not body]
    tied = {i for b in others for i in b.points} | {i for joint in top.joints for i in joint.points}
    tied |= {i for i in range(count) if any(top.fixed[3 * i : 3 * i + 3])}
    held = [i for i in body.points if i in tied]
    shared = [k for k in body.vectors if top.fixed[3 * (count + k)] or any(k in b.vectors for b in others)]
    axes = [(i, vectors[k], top.vectors[k]) for i in held[:1] for k in shared]
    axes += [(i, points[j] - points[i], f"{top.points[i]}-{top.points[j]}") for i in held for j in held if i < j]
    if not axes:
        return None
    start, direction, line = axes[0]
    direction = direction / np.linalg.norm(direction)
    change = np.zeros(len(q))
    for i in body.points:
        change[3 * i : 3 * i + 3] = np.cross(direction, points[i] - points[start])
    for k in body.vectors:
        at = 3 * (count + k)
        change[at : at + 3] = np.cross(direction, vectors[k])
    return change, line
