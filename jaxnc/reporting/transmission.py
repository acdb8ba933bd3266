"""Transmission angles of a planar motion, where its joints have one: found by looking at what meets where."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.planar import transmission_angle
from jaxnc.system.topology import Topology


@dataclass(frozen=True)
class Transmission:
    """The angle under which a coupler drives what it is to move: 90 degrees is best, 0 a dead point.

    Attributes:
        at: the joint.
        said: what meets there.
        values: degrees, ``(T,)``; NaN where a pose was not found.
    """

    at: str
    said: str
    values: np.ndarray


def transmissions(motion: Motion) -> list[Transmission]:
    """Transmission angles of a planar sweep.

    Of a follower that turns about a pivot on the ground, the angle between it and the coupler that drives it; of a
    point that slides along an axis, that between the coupler and the normal of the axis.

    Args:
        motion: poses in a row.

    Returns:
        One for each joint of a coupler with what it drives; none in space.
    """
    top = motion.system.topology
    if top.dim != 2 or motion.status.ndim != 1:
        return []
    bad = ~np.asarray(motion.converged)
    out = []
    for start, joint, end, said in _dyads(top, motion.driven):
        if isinstance(end, str):
            angle = np.asarray(transmission_angle(motion, start, joint, end))
        else:
            rod, way = np.asarray(motion[start]) - np.asarray(motion[joint]), _way(motion, end)
            angle = np.arctan2(np.abs(rod @ way), np.abs(rod @ np.array([-way[1], way[0]])))
        out.append(Transmission(joint, said, np.where(bad, np.nan, np.degrees(angle))))
    return out


def _way(motion: Motion, end: tuple[int, ...]) -> np.ndarray:
    """The direction in which a slider moves: that of a line of the ground, or an axis."""
    if len(end) == 1:
        return np.eye(2)[end[0]]
    a, b = (np.asarray(motion[motion.system.topology.points[k]])[0] for k in end)
    return (b - a) / np.linalg.norm(b - a)


def _dyads(top: Topology, driven: tuple[str, ...]) -> Iterator[tuple[str, str, str | tuple[int, ...], str]]:
    """Far point of a coupler, joint, pivot of the follower (of a slider its axis or line), and what meets there."""
    slots = {j.points[2]: j.points[:2] for j in top.joints if j.drawn and j.type == "slot"}
    fixed = np.array(top.fixed[: 2 * len(top.points)]).reshape(-1, 2)
    holders: list[set[int]] = [{b for b, body in enumerate(top.bodies) if k in body.points} for k in range(len(fixed))]
    pivots = [next((p for p in body.points if fixed[p].all()), None) for body in top.bodies]
    led = _led(top, driven, fixed)
    for c, body in enumerate(top.bodies):
        if pivots[c] is not None or c in led:
            continue
        for joint in body.points:
            line = slots.get(joint, ())
            sliding = (int(np.argmin(fixed[joint])),) if fixed[joint].sum() == 1 else tuple(line)
            if len(sliding) == 2 and not fixed[list(sliding)].all():
                sliding = ()  # along a line that moves
            followers = [f for f in holders[joint] - {c} if pivots[f] is not None and f not in led]
            if not (sliding or followers):
                continue
            starts = [p for p in body.points if p != joint and len(holders[p]) > 1]
            starts = [p for p in starts if holders[p] & led] or starts
            if not starts:
                continue
            start, names = starts[0], top.points
            if sliding:
                yield names[start], names[joint], sliding, f"{body.name} and the normal of the way of {names[joint]}"
            for f in followers:
                pivot = pivots[f]
                if pivot is not None and pivot != joint:
                    yield names[start], names[joint], names[pivot], f"{body.name} and {top.bodies[f].name}"


def _led(top: Topology, driven: tuple[str, ...], fixed: np.ndarray) -> set[int]:
    """Bodies whose place the inputs give directly."""
    points: set[int] = set()
    for name in driven:
        if name in top.scalars:
            block, instance = top.measures[top.scalars.index(name)]
            points |= set(top.blocks[block].points[instance])
        else:
            points.add(top.points.index(name.rpartition(".")[0]))
    moving = {p for p in points if not fixed[p].all()}
    return {
        b for b, body in enumerate(top.bodies) if moving & set(body.points) and any(fixed[p].all() for p in body.points)
    }
