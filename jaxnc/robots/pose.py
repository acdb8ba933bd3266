"""Where the links of an exported tree are in a pose of the mechanism, and the joint values that put them there."""

import math

import numpy as np

from jaxnc.families.bodies import Part, Parts
from jaxnc.robots.description import ElementaryJoint, Link, Vec, cross_matrix, perpendicular, rotate_about
from jaxnc.system.frames import quaternions


class TreePose:
    """A pose of a mechanism in space: places of points, directions of vectors, rotations of parts from home.

    `q` are all coordinates, ``(N,)``; `home` is the home pose, None for the home pose itself.
    """

    def __init__(self, parts: Parts, q: np.ndarray, home: "TreePose | None" = None):
        self.parts, self.q = parts, np.asarray(q, dtype=float)
        dim, count, vectors = parts.dim, len(parts.a.names), len(parts.a.vector_names)
        self.points = np.zeros((count, 3))
        self.points[:, :dim] = self.q[: dim * count].reshape(count, dim)
        self.vectors = self.q[dim * count : dim * (count + vectors)].reshape(vectors, dim)
        self.home = self if home is None else home

    def span(self, segment: tuple[int, ...]) -> Vec:
        """Return the unit vector along a segment: two points, or ~vector."""
        d = self.vectors[~segment[0]] if len(segment) == 1 else self.points[segment[1]] - self.points[segment[0]]
        return d / np.linalg.norm(d)

    def along(self, line: tuple[tuple[int, ...], tuple[int, ...]]) -> Vec:
        """Return the unit vector along a line: its two points, or its vector if it has one."""
        points, vectors = line
        return self.span((~vectors[0],) if vectors else points)

    def axes(self, part: Part) -> np.ndarray:
        """Return orthonormal axes of a part as rows."""
        if self.parts.dim == 2:
            x = self.span(part.axis)
            return np.array([x, [-x[1], x[0], 0.0], [0.0, 0.0, 1.0]])
        x = self.span(part.segments[0])
        y = self.span(part.segments[1])
        y = y - (y @ x) * x
        y /= np.linalg.norm(y)
        return np.array([x, y, np.cross(x, y)])

    def turn(self, k: int) -> np.ndarray | None:
        """Return the rotation of a part from home, of a bar without spin; None for a part without orientation."""
        part = self.parts.parts[k]
        if k == 0:
            return np.eye(3)
        if part.turns == "no":
            return None
        if part.turns == "bar":
            return _least_turn(self.home.span(part.segments[0]), self.span(part.segments[0]))
        return self.axes(part).T @ self.home.axes(part)


def _least_turn(a: Vec, b: Vec) -> np.ndarray:
    """Return the smallest rotation that takes one unit vector to another."""
    c, v = float(a @ b), np.cross(a, b)
    if c < -1.0 + 1e-12:  # half a turn, about anything across
        u = perpendicular(a)
        return 2.0 * np.outer(u, u) - np.eye(3)
    x = cross_matrix(v)
    return np.eye(3) + x + x @ x / (1.0 + c)


def _angle_about(axis: Vec, start: Vec, end: Vec) -> float:
    """Return the angle about an axis from one direction to another."""
    a, b = start - (start @ axis) * axis, end - (end @ axis) * axis
    return math.atan2(float(np.cross(a, b) @ axis), float(a @ b))


def _frames(links: list[Link], pose: TreePose) -> list[tuple[np.ndarray, Vec]]:
    """Find the rotation from home and the origin of every link in a pose."""
    out = [(np.eye(3), links[0].origin)]
    for link in links[1:]:
        if link.reference >= 0:
            out.append((out[link.parent][0], pose.points[link.reference]))
            continue
        part = pose.parts.parts[link.part]
        turn = out[link.parent][0] if link.spinless else pose.turn(link.part)
        assert turn is not None
        at = part.points[0]
        out.append((turn, pose.points[at] + turn @ (link.origin - pose.home.points[at])))
    return out


def joint_values(links: list[Link], pose: TreePose, before: np.ndarray | None = None) -> np.ndarray:
    """Find the values of all joints, in their order, of a pose: numbers of hinges and slides, a quaternion of a ball.

    Hinges are counted on from the values `before`.
    """
    at, out = _frames(links, pose), []
    for link, (turn, place) in zip(links[1:], at[1:], strict=True):
        base, where = at[link.parent]
        relative = base.T @ turn
        moved = base.T @ (place - where) - (link.origin - links[link.parent].origin)
        out += _link_values(link, relative, moved)
    values = np.array(out)
    if before is not None and len(values):
        hinge = np.repeat([j.kind == "hinge" for k in links for j in k.joints],
                          [j.width for k in links for j in k.joints])  # fmt: skip
        turns = np.round((values - before) / (2.0 * math.pi))
        values = np.where(hinge, values - 2.0 * math.pi * turns, values)
    return values


def _link_values(link: Link, relative: np.ndarray, moved: Vec) -> list[float]:
    """Find the values of the joints of one link from its rotation and displacement in its parent's frame."""
    joints, out = link.joints, {i: [0.0] for i in range(len(link.joints))}
    if len(joints) == 1 and joints[0].kind == "free":
        return [*(link.origin + moved), *map(float, quaternions(relative))]
    rotations = [i for i, j in enumerate(joints) if j.kind != "slide"]
    slides = [i for i, j in enumerate(joints) if j.kind == "slide"]
    if slides:
        own = bool(rotations) and slides[0] > rotations[0]  # they come after the rotation: along axes of the link
        axes = np.array([joints[i].axis for i in slides])
        found = np.linalg.lstsq(axes.T, relative.T @ moved if own else moved, rcond=None)[0]
        for i, value in zip(slides, found, strict=True):
            out[i] = [float(value)]
    for i, value in zip(rotations, _hinge_values([joints[i] for i in rotations], relative), strict=True):
        out[i] = value
    return [x for i in range(len(joints)) for x in out[i]]


def _hinge_values(joints: list[ElementaryJoint], relative: np.ndarray) -> list[list[float]]:
    if not joints:
        return []
    if joints[0].kind == "ball":
        return [list(map(float, quaternions(relative)))]
    first = joints[0].axis
    if len(joints) == 1:
        u = perpendicular(first)
        return [[_angle_about(first, u, relative @ u)]]
    second = joints[1].axis  # R = R(first, α) R(second, β): the second axis is seen where α has put it
    a = _angle_about(first, second, relative @ second)
    u = perpendicular(second)
    return [[a], [_angle_about(second, u, rotate_about(first, a).T @ relative @ u)]]
