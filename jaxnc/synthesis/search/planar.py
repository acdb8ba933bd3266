"""Variable projection in the plane: what enters a path linearly is solved for, so that only shapes have to be searched.

A point that rides on a body without carrying anything is P = z0 + w (A + k D), as complex numbers, with A and D the
body's base: the place z0 and the similarity w of the whole mechanism and the place k of the point in its body are
linear in (z0, w, w k), whatever the mechanism. How a guided frame is turned against the mechanism is fitted too.

Source: G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973).
"""

from typing import Any, NamedTuple

import numpy as np

from jaxnc.kinematics.design import geometry_components, geometry_vector, with_geometry
from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.host.view import solve_exactly
from jaxnc.synthesis.evaluate import marker_places
from jaxnc.synthesis.path import MotionGeneration, PathGeneration
from jaxnc.synthesis.problem import Boxes
from jaxnc.types import AnyArray, ArrayLike


class Linear(NamedTuple):
    """The unknowns of a path that are linear."""

    axes: tuple[bool, bool]  # whether the whole mechanism may move along x and along y
    scale: bool  # whether it may be enlarged
    turn: bool  # whether it may be turned
    tracer: int  # index of the point (or, from the number of points on, of the marker) if its place in its body is free
    free: bool
    base: tuple[int, int]  # indices of the two points that carry it; the tracer itself twice if it is not free
    points: int  # how many points there are
    spots: int  # how many points and markers

    @property
    def columns(self) -> list[tuple[int, bool]]:
        """Numbers that are fitted, in order: of z0, w or w k (0, 1, 2), and whether its imaginary part."""
        free = (*self.axes, self.scale, self.scale and self.turn, self.free, self.free)
        return [(k // 2, k % 2 == 1) for k in range(6) if free[k]]

    def join(self, parts: np.ndarray) -> np.ndarray:
        """Place z0, similarity w and tracer w k of what is fitted ``(columns, …)``: complex, ``(3, …)``."""
        found = np.zeros((3, *parts.shape[1:]), complex)
        found[1] = not self.scale
        for value, (k, turned) in zip(parts, self.columns, strict=True):
            found[k] += 1j * value if turned else value
        return found


class LinearLimits(NamedTuple):
    """Room that bounds leave of what is fitted, of designs; the columns are those of `Linear`.

    Places are counted from an origin of each design, and bounds from the targets' middle: far from the origin of all
    the place of a design and its size are nearly the same column.
    """

    rows: np.ndarray  # how bounded places depend on what is fitted, (B, bounds, columns)
    fixed: np.ndarray  # and what they are without it, (B, bounds)
    low: np.ndarray  # (bounds,)
    high: np.ndarray  # (bounds,)
    least: np.ndarray  # of the factor by which a design grows, (B,)
    most: np.ndarray  # (B,)
    extent: np.ndarray  # of the designs as they are drawn, (B,)
    origin: np.ndarray  # the middles of the designs, complex (B,)
    grown: list[int]  # columns of the similarity

    def of(self, at: np.ndarray) -> "LinearLimits":
        """Select some designs."""
        own = {name: getattr(self, name)[at] for name in ("rows", "fixed", "least", "most", "extent", "origin")}
        return self._replace(**own)


def find_linear(problem: PathGeneration) -> Linear | None:
    """Find the linear unknowns of a path problem by trying; None if there are none, or the mechanism is spatial."""
    system, top = problem.system, problem.system.topology
    if top.dim != 2 or top.vectors:
        return None
    at = np.zeros(len(geometry_components(system)), dtype=bool)
    at[problem.variables.at] = True
    spread = 2 * (len(top.points) + len(top.markers))
    x_free, y_free = at[:spread:2], at[1:spread:2]
    flat = np.asarray(geometry_vector(system), dtype=float)
    x, y = flat[:spread:2], flat[1:spread:2]
    long = length_dimensions(problem)
    still = not long.any() or bool(at[spread:][long].all())
    axes = (bool(x_free.all()), bool(y_free.all()))
    scale = bool((x_free | (x == 0)).all() and (y_free | (y == 0)).all() and still)
    turn = scale and bool((x_free & y_free | (x == 0) & (y == 0)).all())
    markers = [m.name for m in top.markers]
    if problem.point in top.points:
        index = top.points.index(problem.point)
        bodies = [b for b in top.bodies if index in b.points]
        carried = len(bodies) == 1 and bodies[0].base is not None and index not in bodies[0].base
        base = bodies[0].base if carried else None
    else:
        index = len(top.points) + markers.index(problem.point)
        base = top.markers[markers.index(problem.point)].base
    free = base is not None and bool(x_free[index] and y_free[index])
    both = base if free and base is not None else (index, index)
    found = Linear(axes, scale, turn, index, free, both, len(top.points), spread // 2)
    found = _confirm_linear(problem, found)
    return found if any(found.axes) or found.scale or found.free else None


def length_dimensions(problem: PathGeneration) -> np.ndarray:
    """Mark the explicit dimensions that are lengths."""
    return np.array([d.quantity.long for d in problem.system.topology.given], dtype=bool)


def move_whole(
    problem: PathGeneration, found: Linear, flat: np.ndarray, z0: object, w: ArrayLike, place: ArrayLike
) -> np.ndarray:
    """Move mechanisms as a whole and put their tracers somewhere: parameters ``(..., n)``.

    They move by z0, turn and grow by w, both complex ``(...,)``; `place` is where the tracer is drawn afterwards.
    """
    top = problem.system.topology
    spread = 2 * (len(top.points) + len(top.markers))
    w = np.asarray(w)[..., None]
    z = np.asarray(z0)[..., None] + w * (flat[..., :spread:2] + 1j * flat[..., 1:spread:2])
    if found.free:
        z[..., found.tracer] = place
    both = np.stack([z.real, z.imag], axis=-1).reshape(*z.shape[:-1], spread)
    return np.concatenate([both, flat[..., spread:] * np.where(length_dimensions(problem), np.abs(w), 1.0)], axis=-1)


def _confirm_linear(problem: PathGeneration, found: Linear) -> Linear:
    """Take away from what is linear whatever does not do to the path what it does to the drawing."""
    top, size = problem.system.topology, problem.size
    flat = np.asarray(geometry_vector(problem.system), dtype=float)
    n = 2 * (len(top.points) + len(top.markers))
    z = flat[:n:2] + 1j * flat[1:n:2]
    # 0.37 radians, to try whether a mechanism turns as a whole
    ways = [(0.0, 1.0), (0.1 * size, 1.0), (0.1j * size, 1.0), (0.0, 1.1), (0.0, np.exp(1j * 0.37))]
    drawn = [move_whole(problem, found, flat, z0, w, z0 + w * z[found.tracer]) for z0, w in ways]
    a, b = (z[i] for i in found.base)
    drawn.append(move_whole(problem, found, flat, 0.0, 1.0, z[found.tracer] + 0.2 * (b - a)))
    names = (problem.point, *(top.points[i] for i in found.base if found.free))
    motions = [sweep_drawing(problem, one) for one in drawn]
    good = np.all([motion.converged for motion in motions], axis=0)
    # (ways, names, poses) of complex numbers
    paths = np.stack([[np.asarray(motion[n]) @ np.array([1.0, 1j]) for n in names] for motion in motions])[:, :, good]
    here = paths[0]

    def like(k: int, name: int, other: np.ndarray) -> bool:
        return bool(np.allclose(paths[k][name], other, atol=1e-6 * size))

    x, y, scale, turn = (like(k, 0, z0 + w * here[0]) for k, (z0, w) in enumerate(ways) if k)
    free = found.free and all(like(5, k, here[k]) for k in (1, 2)) and like(5, 0, here[0] + 0.2 * (here[2] - here[1]))
    scale = found.scale and scale
    return found._replace(
        axes=(found.axes[0] and x, found.axes[1] and y),
        scale=scale,
        turn=found.turn and scale and turn,
        free=free,
        base=found.base if free else (found.tracer, found.tracer),
    )


def sweep_drawing(problem: PathGeneration, flat: np.ndarray) -> Motion:
    """Move a drawing over the range of the input, to try whether a mechanism moves, turns and grows as a whole."""
    return problem.sweep(with_geometry(problem.system, flat), np.linspace(*problem.travel, 37))


def component_rows(
    found: Linear, flat: np.ndarray, at: np.ndarray, origin: ArrayLike = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of components of places by what is fitted, ``(B, bounds, columns)``, and their fixed parts.

    `flat` are all parameters of drawings, ``(B, n)``; `at` says of which components, ``(bounds,)``; places are counted
    from the `origin`, ``(B,)``.
    """
    rides = found.free & (at // 2 == found.tracer)
    spot, up = np.where(rides, found.base[0], at // 2), at % 2 == 1
    a, b = (flat[:, 2 * k] + 1j * flat[:, 2 * k + 1] for k in found.base)
    here: AnyArray = flat[:, 2 * spot] + 1j * flat[:, 2 * spot + 1] - np.reshape(origin, (-1, 1))
    by = [np.ones(here.shape, complex), here, np.where(rides, (b - a)[:, None], 0.0)]  # z0, w and w k
    columns = [by[k] * 1j if turned else by[k] for k, turned in found.columns]
    fixed = np.zeros(here.shape) if found.scale else np.where(up, here.imag, here.real)
    return np.stack([np.where(up, c.imag, c.real) for c in columns], axis=-1), fixed


def limits_of(boxes: Boxes, found: Linear, flat: np.ndarray, middle: complex = 0.0) -> LinearLimits:
    """Room that bounds leave of the places and sizes of mechanisms drawn as ``flat``, ``(B, n)``.

    Bounds are counted from the `middle` of the targets.
    """
    at = np.flatnonzero((np.isfinite(boxes.low) | np.isfinite(boxes.high))[: 2 * found.spots])
    points = flat[:, : 2 * found.points]
    origin = np.mean(points[:, ::2] + 1j * points[:, 1::2], axis=1) * all(found.axes)
    rows, fixed = component_rows(found, flat, at, origin)
    shift = np.where(at % 2 == 1, middle.imag, middle.real)
    extent, least, most = boxes.room(flat, 2, found.tracer if found.free else -1)
    grown = [n for n, (k, _) in enumerate(found.columns) if k == 1]
    return LinearLimits(rows, fixed, boxes.low[at] - shift, boxes.high[at] - shift, least, most, extent, origin, grown)


def _sum_products(a: np.ndarray, b: np.ndarray) -> AnyArray:
    """Sum products over the last axis."""
    if a.ndim == 1 or b.ndim == 1:
        return b @ a if a.ndim == 1 else a @ b
    return (a[..., None, :] @ b[..., :, None])[..., 0, 0]


def solve_finite(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve linear systems ``(…, n, n)`` for right sides ``(…, n, c)``; NaN where one is not finite or singular."""
    n = matrix.shape[-1]
    good: AnyArray = np.isfinite(matrix).all(axis=(-2, -1), keepdims=True)
    safe = np.where(good, matrix, np.eye(n)).reshape(-1, n, n)
    return np.where(good, solve_exactly(safe, right.reshape(-1, *right.shape[-2:])).reshape(right.shape), np.nan)


def _pull_inside(
    limits: LinearLimits, normal: np.ndarray, side: np.ndarray, sizes: np.ndarray, y: np.ndarray, weight: float
) -> np.ndarray:
    """Pull solutions `y` that miss bounds into them, in place; by how much they still miss them, weighted."""
    shape, n = y.shape[:-2], y.shape[-2]
    design = np.broadcast_to(np.arange(shape[0]).reshape(-1, *[1] * (len(shape) - 1)), shape).reshape(-1)
    flat_y, sizes = y.reshape(-1, n), sizes.reshape(-1, n)
    normal, side = normal.reshape(-1, n, n), side.reshape(-1, n)
    columns, scale = np.array(limits.grown, int), bool(limits.grown)
    missed = np.zeros(len(flat_y))
    lanes: AnyArray = np.arange(len(flat_y))
    most = 6  # times that what is out of bounds is looked for
    for turn in range(most + 1):
        own: AnyArray = design[lanes]
        real = flat_y[lanes] / sizes[lanes]
        place = np.einsum("lbc,lc->lb", limits.rows[own], real) + limits.fixed[own]
        goal: AnyArray = np.clip(place, limits.low, limits.high)
        off: AnyArray = goal - place
        w: AnyArray = real[:, columns]
        long: AnyArray = np.maximum(np.linalg.norm(w, axis=1), 1e-300) if scale else np.ones(len(lanes))
        factor: AnyArray = np.clip(long, limits.least[own], limits.most[own]) / long
        far: AnyArray = np.abs(factor - 1.0) * long * limits.extent[own] if scale else np.zeros(len(lanes))
        missed[lanes] = weight * (np.sum(off**2, axis=1) + far**2)
        out: AnyArray = (off != 0.0).any(axis=1) | (far > 1e-9 * long * limits.extent[own])
        if turn == most or not out.any():
            break
        lanes, own, off, goal, w, factor, far = (v[out] for v in (lanes, own, off, goal, w, factor, far))
        active = limits.rows[own] / sizes[lanes, None, :] * (off != 0.0)[..., None]
        more = weight * np.swapaxes(active, 1, 2) @ active
        aim = weight * np.einsum("lbc,lb->lc", active, goal - limits.fixed[own])
        if scale:
            heavy = np.where(far > 0.0, weight * limits.extent[own] ** 2, 0.0)[:, None]
            more[:, columns, columns] += heavy / sizes[lanes][:, columns] ** 2
            aim[:, columns] += heavy * factor[:, None] * w / sizes[lanes][:, columns]
        flat_y[lanes] = solve_finite(normal[lanes] + more, (side[lanes] + aim)[..., None])[..., 0]
    y[...] = flat_y.reshape(y.shape)
    return missed.reshape(shape)


def nearest_move(
    found: Linear, rows: np.ndarray, goal: np.ndarray, extent: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the move of designs as a whole that brings places to goals ``(B, bounds)``; what is left open stays."""
    n = rows.shape[-1]
    first = sum(found.axes)
    home = np.zeros(n)
    home[first : first + found.scale] = 1.0
    heavy = np.where(np.arange(n) < first, 1.0, extent[:, None] ** 2) * 1e-9
    normal = np.swapaxes(rows, 1, 2) @ rows + heavy[:, None, :] * np.eye(n)
    side = np.einsum("lbc,lb->lc", rows, goal) + heavy * home
    z0, w, _ = found.join(solve_finite(normal, side[..., None])[..., 0].T)
    return z0, w


Pairs = list[tuple[np.ndarray, np.ndarray, float]]
"""Curves ``(B, guesses, poses)``, what targets want of them ``(M,)`` and weights; two numbers in one complex one."""


class PlanarFit:
    """A fit of designs in the plane to a problem's targets.

    The turn of a body that is guided is linear by itself: its error is the distance of two complex numbers of length
    one, to which the mechanism's own turn adds nothing that the frame's does not.
    """

    own = 0  # unknowns of the problem that say how a frame is turned
    wanted: AnyArray = None

    def __init__(self, problem: PathGeneration, found: Linear):
        self.problem, self.free, self.target = problem, found, problem.target @ np.array([1.0, 1j])
        self.middle = complex(self.target.mean()) * all(found.axes)
        if isinstance(problem, MotionGeneration):
            self.own, self.reach, self.heavy = 1, problem.reach, problem.weights * problem.reach**2
            self.wanted = np.exp(1j * problem.turns)
            self.base = next(b.base for b in problem.system.topology.bodies if b.name == problem.body)

    @classmethod
    def of(cls, problem: PathGeneration) -> "PlanarFit | None":
        """Make the fit of a problem; None if nothing of it is linear."""
        found = find_linear(problem)
        return None if found is None else cls(problem, found)

    def rows(self, z: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, ...]:
        """Read from poses ``(B, T, N)`` what is fitted.

        Returns:
            The tracer's first base point, the way to the second one, complex, and the direction of the body that is
            guided, ones where none is, ``(B, T)``.
        """
        points = len(self.problem.system.topology.points)

        def place(index: int) -> np.ndarray:
            if index >= points:  # a marker that is not free
                return marker_places(self.problem, z, q, index - points)
            return q[..., 2 * index] + 1j * q[..., 2 * index + 1]

        base = place(self.free.base[0])
        return base, place(self.free.base[1]) - base, self._body_direction(q)

    def limits(self, z: np.ndarray) -> LinearLimits:
        """Room that bounds leave of designs."""
        return limits_of(Boxes.of(self.problem), self.free, all_parameters(self.problem, z), self.middle)

    def into(self, boxes: Boxes, flat: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Move mechanisms ``(B, n)`` as a whole to where their joints in boxes are to be, and put these there."""
        found = self.free
        whole = found._replace(free=False)
        room = limits_of(boxes, whole, flat)
        if found.scale:  # of a size that lengths allow
            flat = move_whole(self.problem, whole, flat, np.zeros(len(flat)), np.clip(1.0, room.least, room.most), 0.0)
        at = np.flatnonzero(boxes.narrow[: 2 * found.spots])
        if len(at):
            rows, fixed = component_rows(whole, flat, at)
            z0, w = nearest_move(whole, rows, goal[:, at] - fixed, room.extent)
            flat = move_whole(self.problem, whole, flat, z0, w, 0.0)
            flat[:, at] = goal[:, at]
        return flat

    def fit(self, rows: tuple[np.ndarray, ...], limits: LinearLimits, some: slice | np.ndarray = slice(None)) -> Any:
        """Fit place, similarity, tracer and turn of designs ``(B, …)`` to some targets; the squares left."""
        base, along, seen = rows
        z0, w, k, left = self._fit_places(base, along, limits, some)
        by = np.ones(left.shape, complex)
        if self.wanted is not None:
            heavy, wanted = self.heavy[some], self.wanted[some]
            by = np.conj(seen) @ (heavy * wanted)
            by = by / np.maximum(np.abs(by), 1e-300)
            off = wanted - by[..., None] * seen
            left = left + (off.real**2 + off.imag**2) @ heavy
        return (z0, w, k, by), left

    def curves(self, rows: tuple[np.ndarray, ...], parts: tuple[np.ndarray, ...], some: np.ndarray) -> Pairs:
        """Whole curves of designs as they were fitted, from ``rows`` ``(B, poses)``, and what targets want."""
        base, along, seen = (row[:, None] for row in rows)
        z0, w, k, by = (part[..., None] for part in parts)
        out: Pairs = [(z0 + w * base + k * along, self.target[some], 1.0)]
        if self.wanted is not None:
            out.append((by * seen, self.wanted[some], self.reach**2))
        return out

    def place_mechanisms(
        self, z: np.ndarray, parts: tuple[np.ndarray, ...]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Move mechanisms to where they were fitted: parameters ``(B, n)``, turns of the frame, growth ``(B,)``."""
        z0, w, k, by = parts
        flat = all_parameters(self.problem, z)
        place: AnyArray = 0.0
        if self.free.free:
            a, b = (flat[:, 2 * i] + 1j * flat[:, 2 * i + 1] for i in self.free.base)
            place = z0 + w * a + k * (b - a)
        turn = (np.angle(w) - np.angle(by))[:, None] if self.own else np.zeros((len(z), 0))
        return move_whole(self.problem, self.free, flat, z0, w, place), turn, np.abs(w)

    def _fit_places(
        self, base: np.ndarray, direction: np.ndarray, limits: LinearLimits, some: slice | np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Fit place z0, similarity w and tracer w·k of paths by least squares; the sum of squares left, ``(B, …)``.

        `base` is the body's first point (or the tracer), and `direction` leads from it to the second point, both
        ``(B, …, M)`` and complex; bounds are kept nearly.
        """
        found, target, weights = self.free, self.target[some] - self.middle, self.problem.weights[some]
        origin = limits.origin.reshape(-1, *[1] * (base.ndim - 2))
        base = base - origin[..., None]
        # The real columns are complex ones, which come once as they are and once turned by a right angle.
        spots = found.columns
        rest = target if found.scale else target - base
        count = base.shape[-1]
        heavy = np.broadcast_to(weights, (count,))
        every: list[AnyArray] = [np.ones(count), base, direction, rest]
        light = [np.conj(v) * heavy for v in every]
        inner: dict[tuple[int, int], AnyArray] = {}
        used = [*dict.fromkeys(k for k, _ in spots)]
        for n, i in enumerate(used):
            for j in [*used[n:], 3]:
                inner[i, j] = _sum_products(light[i], every[j])
                inner[j, i] = np.conj(inner[i, j])
        total = np.broadcast_to(_sum_products(light[3], every[3]).real, base.shape[:-1])

        def real(i: int, turned: bool, j: int, other: bool) -> np.ndarray:
            value = inner[i, j]
            return np.broadcast_to(
                value.real if turned == other else (-value.imag if other else value.imag), total.shape
            )

        normal = np.stack([np.stack([real(*p, *q) for q in spots], axis=-1) for p in spots], axis=-2)
        side = np.stack([real(*p, 3, False) for p in spots], axis=-1)
        sizes = np.maximum(np.sqrt(np.diagonal(normal, axis1=-2, axis2=-1)), 1e-12)
        normal = normal / (sizes[..., :, None] * sizes[..., None, :]) + 1e-10 * np.eye(len(spots))
        side = (side / sizes)[..., None]
        y = solve_finite(normal, side)
        # what bounds miss is 1e3 times as heavy as errors, before it is cut off
        missed = _pull_inside(limits, normal, side, sizes, y, 1e3 * float(weights.sum()))
        left = total + np.sum(y * (normal @ y - 2.0 * side), axis=(-2, -1))
        left = np.where(left > 0.0, left, 0.0 * left) + missed
        z0, w, k = found.join(np.moveaxis(y[..., 0] / sizes, -1, 0))
        return z0 + self.middle - w * origin, w, k, left

    def _body_direction(self, q: np.ndarray) -> np.ndarray:
        if self.wanted is None:
            return np.ones(q.shape[:-1], complex)
        assert self.base is not None
        a, b = self.base
        d = q[..., 2 * b] - q[..., 2 * a] + 1j * (q[..., 2 * b + 1] - q[..., 2 * a + 1])
        return d / np.maximum(np.abs(d), 1e-300)


def all_parameters(problem: PathGeneration, z: np.ndarray) -> np.ndarray:
    """All parameters of designs ``(B, variables)``."""
    flat = np.repeat(np.asarray(geometry_vector(problem.system), dtype=float)[None], len(z), axis=0)
    flat[:, problem.variables.at] = z
    return flat
