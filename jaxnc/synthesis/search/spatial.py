"""Variable projection in space: place, size and turn of a mechanism, and what rides on a body, fitted to targets.

With the way a of a body's point and the body's turns F the tracer is at t + R (s a + F k), and a frame on it is turned
by R F Q. For a given R the rest is linear, by sums that are the same for all R. For a given rest the best R and Q are
those of Kabsch. Both are found in turn.

Source: S. Umeyama, IEEE Trans. PAMI 13 (1991) 376-380; M. Shah, J. Mechanisms Robotics 5 (2013) 031007 (R F Q = T).
"""

from typing import Any, NamedTuple

import numpy as np

from jaxnc.synthesis.evaluate import assemble_drawings
from jaxnc.synthesis.path import MotionGeneration, PathGeneration, rotation_matrix, rotation_vector
from jaxnc.synthesis.problem import Boxes
from jaxnc.synthesis.pytree import take
from jaxnc.synthesis.search.planar import Pairs, all_parameters, length_dimensions, solve_finite, sweep_drawing
from jaxnc.system.topology import Segment

_RIDGE = 1e-10  # of each unknown's own weight: what nothing depends on stays as it is


class Sums(NamedTuple):
    """Sums over the targets of designs; weights w, a and F of the mechanism, places p and turns T of the targets."""

    normal: np.ndarray  # of the normal equations for t, s and k, (L, 7, 7)
    target: np.ndarray  # Σ w p, (L, 3)
    square: np.ndarray  # Σ w p²
    way: np.ndarray  # Σ w p aᵀ, (L, 3, 3)
    rides: np.ndarray  # Σ w p_i F_jk, (L, 3, 3, 3)
    turns: np.ndarray  # Σ w T_ij F_kl, (L, 3, 3, 3, 3), times half the square of the length that an angle counts as
    total: np.ndarray  # Σ w of these, times that square, (L,)

    @classmethod
    def of(
        cls, a: np.ndarray, f: np.ndarray, p: np.ndarray, w: np.ndarray, t: np.ndarray | None = None, reach: float = 0.0
    ) -> "Sums":
        """Sum over ways ``(L, M, 3)``, turns ``(L, M, 3, 3)``, places, weights ``(…, M)`` and turns that are wanted."""
        count, targets = a.shape[:2]
        heavy, flat = a * w[..., None], (f * w[..., None, None]).reshape(count, targets, 9)
        normal = np.zeros((count, 7, 7))
        every = np.broadcast_to(np.sum(w, axis=-1), count)[:, None]
        normal[:, [0, 1, 2], [0, 1, 2]] = normal[:, [4, 5, 6], [4, 5, 6]] = every
        normal[:, :3, 3] = heavy.sum(axis=1)
        normal[:, 3, 3] = np.sum(heavy * a, axis=(1, 2))
        normal[:, :3, 4:] = flat.sum(axis=1).reshape(count, 3, 3)
        normal[:, 3, 4:] = (heavy.reshape(count, 1, -1) @ f.reshape(count, -1, 3))[:, 0]
        lower = np.tril_indices(7, -1)
        normal[:, lower[0], lower[1]] = normal[:, lower[1], lower[0]]
        weighted = np.broadcast_to(p * w[..., None], a.shape)
        across = np.swapaxes(p, -1, -2)
        turns = np.zeros((count, 3, 3, 3, 3))
        if t is not None:
            turns = (0.5 * reach**2 * t.reshape(-1, 9).T @ flat).reshape(turns.shape)
        return cls(
            normal,
            weighted.sum(axis=1),
            np.sum(weighted * p, axis=(1, 2)),
            across @ heavy,
            (across @ flat).reshape(count, 3, 3, 3),
            turns,
            np.full(count, 0.0 if t is None else reach**2 * np.sum(w)),
        )

    def join(self, other: "Sums") -> "Sums":
        """Add the sums over other targets."""
        return Sums(*(a + b for a, b in zip(self, other, strict=True)))


class Fit(NamedTuple):
    """Designs as they are fitted, each ``(L, …)``."""

    place: np.ndarray  # t, (L, 3)
    grown: np.ndarray  # s, (L,)
    turn: np.ndarray  # R, (L, 3, 3)
    tracer: np.ndarray  # k, (L, 3)
    frame: np.ndarray  # Q, (L, 3, 3)


class Freedom(NamedTuple):
    """Free parts of a fit: t along axes (all, or no turn), s within bounds, also a negative one, R, k, and Q."""

    axes: tuple[bool, ...]
    scale: bool
    mirror: bool
    turn: bool
    tracer: bool
    frame: bool


def begin_fit(free: Freedom, sums: Sums, tracer: np.ndarray) -> Fit:
    """Begin a fit with tracers as they are drawn ``(L, 3)``, and turns that suit what is known by itself."""
    count = len(tracer)
    one = np.repeat(np.eye(3)[None], count, axis=0)
    fit = Fit(np.zeros((count, 3)), np.ones(count), one, tracer, one)
    if free.frame and free.turn:
        return fit._replace(turn=_common_turn(sums.turns))
    ways = [_fit_turn(free, sums, fit)]
    if not (free.mirror and free.turn):
        return ways[0]
    ways.append(_fit_turn(free, sums, fit._replace(grown=-fit.grown)))
    none = np.zeros(count)
    one, other = (_fit_rest(free, sums, way, none, none + np.inf)[1] for way in ways)
    return Fit(*(_choose(one <= other, a, b) for a, b in zip(*ways, strict=True)))


def _choose(good: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Choose the first of two where a design is good, else the second."""
    return np.where(good.reshape(-1, *[1] * (a.ndim - 1)), a, b)


def fit_sums(free: Freedom, sums: Sums, fit: Fit, least: np.ndarray, most: np.ndarray) -> tuple[Fit, np.ndarray]:
    """Fit designs within bounds of their growth, from where the fit begins; the squares left."""
    for _ in range(4 if free.turn else 1):  # the turn and the rest are fitted in turn
        if free.frame:
            fit = fit._replace(frame=nearest_rotation(np.einsum("nijkl,nik->nlj", sums.turns, fit.turn)))
        fit, _ = _fit_rest(free, sums, fit, least, most)
        fit = _fit_turn(free, sums, fit)
    if free.frame:
        fit = fit._replace(frame=nearest_rotation(np.einsum("nijkl,nik->nlj", sums.turns, fit.turn)))
    fit, left = _fit_rest(free, sums, fit, least, most)
    if free.frame:
        like = np.einsum("nijkl,nik,nlj->n", sums.turns, fit.turn, fit.frame)
        left = left + 3.0 * sums.total - 2.0 * like
    return fit, left


def nearest_rotation(g: np.ndarray) -> np.ndarray:
    """Find the rotations R ``(L, 3, 3)`` with the largest Σ R_ij G_ij."""
    left, _, right = np.linalg.svd(np.nan_to_num(g, posinf=0.0, neginf=0.0))
    out = left @ right
    left = left.copy()
    left[:, :, 2] *= np.sign(np.linalg.det(out))[:, None]
    return left @ right


def _fit_turn(free: Freedom, sums: Sums, fit: Fit) -> Fit:
    """Fit the turn of designs, all else as it is; where they move freely, with the place that suits it."""
    if not free.turn:
        return fit
    g = fit.grown[:, None, None] * sums.way
    if free.tracer:
        g = g + (sums.rides @ fit.tracer[:, None, :, None])[..., 0]
    if all(free.axes):
        inner = fit.grown[:, None] * sums.normal[:, :3, 3]
        if free.tracer:
            inner = inner + (sums.normal[:, :3, 4:] @ fit.tracer[:, :, None])[..., 0]
        g = g - sums.target[:, :, None] * inner[:, None, :] / sums.normal[:, :1, :1]
    if free.frame:
        g = g + np.einsum("nijkl,nlj->nik", sums.turns, fit.frame)
    return fit._replace(turn=nearest_rotation(g))


def _fit_rest(free: Freedom, sums: Sums, fit: Fit, least: np.ndarray, most: np.ndarray) -> tuple[Fit, np.ndarray]:
    """Fit place, size and tracer of designs turned as they are; the squares that are left of the places."""
    r = fit.turn
    side = np.zeros((len(r), 7))
    side[:, :3] = (np.swapaxes(r, 1, 2) @ sums.target[:, :, None])[..., 0] if all(free.axes) else sums.target
    side[:, 3] = np.sum(r * sums.way, axis=(1, 2))
    side[:, 4:] = np.einsum("nij,nijl->nl", r, sums.rides)
    use = np.array([*free.axes, True, *[free.tracer] * 3])
    y = np.zeros((len(r), 7))
    y[:, 3] = 1.0
    if free.scale:
        y[:, use] = _solve_linear(sums.normal, side, use, y[:, 3], _RIDGE)
    held = y[:, 3]
    if free.scale:
        held = np.where(free.mirror & (held < 0.0), -1.0, 1.0) * np.clip(
            np.abs(held) if free.mirror else held, least, most
        )
    again = (held != y[:, 3]) | (not free.scale)
    if again.any():
        # a size at its bound is held
        y[np.ix_(again, use)] = _solve_linear(sums.normal[again], side[again], use, held[again], 1e8)
        y[again, 3] = held[again]
    left = sums.square + np.einsum("ni,ni->n", y, (sums.normal @ y[:, :, None])[..., 0] - 2.0 * side)
    place = (r @ y[:, :3, None])[..., 0] if all(free.axes) else y[:, :3]
    return fit._replace(place=place, grown=y[:, 3], tracer=y[:, 4:]), np.where(left > 0.0, left, 0.0 * left)


def _solve_linear(normal: np.ndarray, side: np.ndarray, use: np.ndarray, size: np.ndarray, weight: float) -> np.ndarray:
    """Solve for the unknowns in use, with the size drawn to a value with a weight."""
    normal, side = normal[:, use][:, :, use], side[:, use]
    at = int(np.sum(use[:3]))
    sizes = np.maximum(np.sqrt(np.diagonal(normal, axis1=1, axis2=2)), 1e-12)
    normal = normal / (sizes[:, :, None] * sizes[:, None, :]) + _RIDGE * np.eye(sizes.shape[1])
    side = side / sizes
    normal[:, at, at] += weight
    side[:, at] += weight * size * sizes[:, at]
    return solve_finite(normal, side[:, :, None])[..., 0] / sizes


def _common_turn(turns: np.ndarray) -> np.ndarray:
    """Find turns R that nearly suit R F Q = T for some Q: the first singular vector of Σ T F, made a rotation."""
    matrix = np.nan_to_num(turns.transpose(0, 1, 3, 4, 2).reshape(-1, 9, 9), posinf=0.0, neginf=0.0)
    square = matrix @ np.swapaxes(matrix, 1, 2)
    for _ in range(5):  # a matrix is squared until its largest eigenvalue is alone
        square = square / np.maximum(np.trace(square, axis1=1, axis2=2), 1e-300)[:, None, None]
        square = square @ square
    largest = np.argmax(np.diagonal(square, axis1=1, axis2=2), axis=1)
    r = square[np.arange(len(square)), :, largest].reshape(-1, 3, 3)
    return nearest_rotation(np.sign(np.linalg.det(r))[:, None, None] * r)


_TURN = np.array([0.2, -0.3, 0.25])  # for trying whether a mechanism turns as a whole
_SMALLEST = 1e-3  # times as large as drawn: what is fitted does not vanish


class Room(NamedTuple):
    """Room that bounds leave of designs, and their tracers as drawn."""

    tracer: np.ndarray  # from the point that it is counted from, (B, 3)
    spots: np.ndarray  # places of those that have bounds, without the tracer, (B, spots, 3)
    rides: np.ndarray  # which of them is the tracer, (spots,)
    low: np.ndarray  # (spots, 3)
    high: np.ndarray  # (spots, 3)
    least: np.ndarray  # of the factor by which designs grow, (B,)
    most: np.ndarray  # (B,)

    def of(self, at: np.ndarray) -> "Room":
        """Select some designs."""
        return self._replace(**{name: getattr(self, name)[at] for name in ("tracer", "spots", "least", "most")})


class Spatial:
    """A fit of designs in space to a problem's targets."""

    def __init__(self, problem: PathGeneration):
        self.problem, top = problem, problem.system.topology
        self.points, self.vectors, self.markers = len(top.points), len(top.vectors), len(top.markers)
        flat = np.asarray(all_parameters(problem, problem.variables.home[None]))[0]
        places = self._split(flat[None])[0]
        free, bound = np.zeros((2, len(flat)), bool)
        free[problem.variables.at] = True
        bound[problem.variables.at] = (problem.variables.low > -1.0) | (problem.variables.high < 1.0)
        may, turning, sizes = self._split(free[None])
        spots = np.array([True] * self.points + [not m.direction for m in top.markers])
        fixed = places[0][spots & ~may[0].all(axis=1)]
        axes = tuple(bool(a) for a in may[0][spots].all(axis=0))
        middle = np.average(problem.target, axis=0, weights=problem.weights)
        one = bool((np.ptp(fixed, axis=0) == 0.0).all()) if len(fixed) else True
        # About which designs turn and grow: of those that move anywhere, the middle of the targets.
        self.centre = fixed[0] if len(fixed) and one else middle
        turn = one and bool(turning.all() and may[0][~spots].all() and not self._split(bound[None])[1].any())
        if turn and len(fixed):
            axes = (False,) * 3
        long = length_dimensions(problem)
        scale = one and (not long.any() or bool(sizes[0][long].all())) and bool(np.ptp(places[0], axis=0).any())
        self.guided = isinstance(problem, MotionGeneration)
        self.own = 3 if self.guided else 0  # unknowns of the problem that say how a frame is turned
        self._find_carrier(may[0])
        self.free = self._confirm(
            flat, Freedom(axes, scale, scale, turn, self.rides, self.guided)
        )  # what may be fitted

    @classmethod
    def of(cls, problem: PathGeneration) -> "Spatial | None":
        """Make the fit of a problem; None if nothing of it is to be fitted."""
        fit = cls(problem)
        return fit if fit.moves or fit.free.tracer or fit.free.frame else None

    @property
    def moves(self) -> bool:
        """True if mechanisms move as a whole."""
        return any(self.free.axes) or self.free.scale or self.free.turn

    def assemble(self, z: np.ndarray) -> np.ndarray:
        """Assemble drawings ``(B, variables)``.

        What that changes depends on how large they are and how they are turned, and should not when they are fitted.
        """
        q = assemble_drawings(self.problem, z)
        if q is None:
            return z
        flat, coordinates = all_parameters(self.problem, z), 3 * (self.points + self.vectors)
        new = flat.copy()
        new[:, :coordinates] = q[:, :coordinates]
        places, drawn = self._split(flat)[0], flat[:, :coordinates]
        for k, marker in enumerate(self.problem.system.topology.markers):
            at = slice(coordinates + 3 * k, coordinates + 3 * k + 3)
            arm = flat[:, at] if marker.direction else flat[:, at] - places[:, marker.origin]
            parts = self._axes(marker.segments, drawn) @ arm[:, :, None]
            arm = (np.swapaxes(self._axes(marker.segments, q), 1, 2) @ parts)[..., 0]
            new[:, at] = arm if marker.direction else arm + q[:, 3 * marker.origin : 3 * marker.origin + 3]
        z = np.where(np.isfinite(new), new, flat)[:, self.problem.variables.at]
        return np.clip(z, self.problem.variables.low, self.problem.variables.high)

    def rows(self, z: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, ...]:
        """Read from poses ``(B, T, N)`` what is fitted.

        Returns:
            The way of the tracer, or of the point that it is counted from, seen from the centre, ``(B, T, 3)``, and how
            its body is turned from the drawing, ``(B, T, 3, 3)``.
        """
        flat = all_parameters(self.problem, z)
        drawn = flat[:, : 3 * (self.points + self.vectors)][:, None]
        count = q.shape[1]
        if self.origin >= 0:
            way = q[..., 3 * self.origin : 3 * self.origin + 3]
        else:  # a marker that is not free
            m = self.problem.system.topology.markers[self.tracer - self.points]
            places = self._split(flat)[0]
            arm = places[:, self.tracer] - places[:, m.origin]
            axes, home = self._axes(m.segments, q), self._axes(m.segments, drawn)
            way = q[..., 3 * m.origin : 3 * m.origin + 3]
            way = way + ((home @ arm[:, None, :, None])[..., 0].repeat(count, 1)[..., None, :] @ axes)[..., 0, :]
        return way - self.centre, self._turns(q, drawn)

    def limits(self, z: np.ndarray) -> Room:
        """Room that bounds leave of designs, and their tracers."""
        flat, boxes = all_parameters(self.problem, z), Boxes.of(self.problem)
        places = self._split(flat)[0]
        low, high = (self._split(v[None])[0][0] for v in (boxes.low, boxes.high))
        at = np.flatnonzero((np.isfinite(low) | np.isfinite(high)).any(axis=1))
        rides = (at == self.tracer) & self.free.tracer
        tracer = places[:, self.tracer] - places[:, self.origin] if self.free.tracer else np.zeros((len(z), 3))
        spots = places[:, np.where(rides, self.origin, at)] - self.centre
        _, least, most = boxes.room(flat, 3, self.tracer if self.free.tracer else -1)
        if not self.moves:
            at, spots, rides = at[rides], spots[:, rides], rides[rides]
        return Room(tracer, spots, rides, low[at], high[at], np.maximum(least, np.minimum(_SMALLEST, most)), most)

    def fit(self, rows: tuple[np.ndarray, ...], room: Room, some: Any = slice(None)) -> tuple[Fit, np.ndarray]:
        """Fit designs to some targets by what `rows` are there ``(B, …, M)``; the squares left ``(B, …)``."""
        problem, lead = self.problem, rows[0].shape[:-2]
        way, turns = (row.reshape(-1, *row.shape[len(lead) :]) for row in rows)
        own = np.repeat(np.arange(lead[0]), len(way) // max(lead[0], 1))
        wanted, weights, reach = None, problem.weights[some], 0.0
        if isinstance(problem, MotionGeneration):
            wanted, reach = problem.turns[some], problem.reach
        sums = Sums.of(way, turns, problem.target[some] - self.centre, weights, wanted, reach)
        first = begin_fit(self.free, sums, room.tracer[own])
        fit, left = fit_sums(self.free, sums, first, room.least[own], room.most[own])
        if len(room.rides):
            # what bounds miss is 1e3 times as heavy as targets
            fit, left = self._pull_in(sums, fit, left, room.of(own), 1e3 * float(np.sum(weights)))
        return Fit(*(part.reshape(*lead, *part.shape[1:]) for part in fit)), left.reshape(lead)

    def curves(self, rows: tuple[np.ndarray, ...], fit: Fit, some: np.ndarray) -> Pairs:
        """Whole curves of designs as they were fitted, from ``rows`` ``(B, poses, …)``, and what targets want."""
        problem, (way, turns) = self.problem, rows
        arm = turns.reshape(len(turns), -1, 3) @ np.swapaxes(fit.tracer, 1, 2)
        arm = np.moveaxis(arm.reshape(*way.shape, -1), -1, 1)
        place = (fit.grown[..., None, None] * way[:, None] + arm) @ np.swapaxes(fit.turn, -1, -2)
        place, goal = place + fit.place[..., None, :], problem.target[some] - self.centre
        out = _complex_pairs(place, goal, 1.0)
        if isinstance(problem, MotionGeneration):
            both = np.einsum("bgik,bglj->bgijkl", fit.turn, fit.frame).reshape(*fit.grown.shape, 9, 9)
            seen = turns.reshape(len(turns), 1, -1, 9) @ np.swapaxes(both, -1, -2)
            out += _complex_pairs(seen, problem.turns[some].reshape(-1, 9), 0.5 * problem.reach**2)
        return out

    def place_mechanisms(self, z: np.ndarray, fit: Fit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Move mechanisms to where they were fitted: parameters ``(B, n)``, turns of the frame, growth ``(B,)``."""
        fit = Fit(*fit)
        new = self._move_whole(all_parameters(self.problem, z), fit)
        frame = fit.turn @ fit.frame if self.free.turn else fit.frame
        turn = rotation_vector(np.nan_to_num(frame)) if self.own else np.zeros((len(z), 0))
        return new, turn, np.abs(fit.grown)

    def into(self, boxes: Boxes, flat: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Move mechanisms ``(B, n)`` as a whole to where their joints in boxes are to be, and put these there."""
        narrow = self._split(boxes.narrow[None])[0][0].any(axis=1)
        if self.free.tracer:
            narrow[self.tracer] = False
        at = np.flatnonzero(narrow)
        _, least, most = boxes.room(flat, 3, self.tracer if self.free.tracer else -1)
        free = self.free._replace(tracer=False, frame=False, scale=self.free.scale and len(at) > 1)
        start, none = self._split(flat)[0], np.zeros((len(flat), 3))
        if len(at) and self.moves:
            a, p = start[:, at] - self.centre, self._split(goal)[0][:, at] - self.centre
            sums = Sums.of(a, np.zeros((*a.shape, 3)), p, np.ones(len(at)))
            fit, _ = fit_sums(free, sums, begin_fit(free, sums, none), np.maximum(least, _SMALLEST), most)
            flat = self._move_whole(flat, fit)
        whole = np.zeros(flat.shape[1], bool)
        whole[: 3 * self.points] = np.repeat(narrow[: self.points], 3)
        whole[3 * (self.points + self.vectors) :][: 3 * self.markers] = np.repeat(narrow[self.points :], 3)
        return np.where(whole, goal, flat)

    # -- inside ----------------------------------------------------------------------------------------------------

    def _split(self, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Split parameters: places of points and markers ``(B, spots, 3)``, directions ``(B, vectors, 3)``, dimensions.

        A marker that is a direction has its place among the spots all the same, and is in both.
        """
        a, b = 3 * self.points, 3 * (self.points + self.vectors)
        c = b + 3 * self.markers
        points, vectors, markers = (v.reshape(len(flat), -1, 3) for v in (flat[:, :a], flat[:, a:b], flat[:, b:c]))
        return np.concatenate([points, markers], axis=1), vectors, flat[:, c:]

    def _axes(self, segments: tuple[Segment, ...], q: np.ndarray) -> np.ndarray:
        """Axes of a body in poses ``(…, N)`` as rows, ``(…, 3, 3)``; one for a bar."""

        def span(segment: Segment) -> np.ndarray:
            if len(segment) == 1:
                k = 3 * (self.points + ~segment[0])
                return q[..., k : k + 3]
            a, b = 3 * segment[0], 3 * segment[1]
            return q[..., b : b + 3] - q[..., a : a + 3]

        def unit(v: np.ndarray) -> np.ndarray:
            return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300)

        first = unit(span(segments[0]))
        if len(segments) == 1:
            return first[..., None, :]
        second = span(segments[1])
        second = unit(second - np.sum(second * first, axis=-1, keepdims=True) * first)
        return np.stack([first, second, np.cross(first, second)], axis=-2)

    def _turns(self, q: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """How the tracer's body is turned in poses ``(…, N)`` from the drawing, ``(…, 3, 3)``."""
        if not self.segments:
            return np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3))
        return np.swapaxes(self._axes(self.segments, q), -1, -2) @ self._axes(self.segments, drawn)

    def _find_carrier(self, may: np.ndarray) -> None:
        """Find the points that carry the tracer, and whether its place may be fitted."""
        problem, top = self.problem, self.problem.system.topology
        self.segments: tuple[Segment, ...] = ()
        if isinstance(problem, MotionGeneration):
            self.segments = next(b.segments for b in top.bodies if b.name == problem.body)
        if problem.point in top.points:
            self.tracer = self.origin = top.points.index(problem.point)
            bodies = [b for b in top.bodies if self.tracer in b.points]
            carries = len(bodies) != 1 or any(self.tracer in s for s in bodies[0].segments if len(s) == 2)
            others = [] if carries else [p for p in bodies[0].points if p != self.tracer]
            self.rides = bool(others and len(bodies[0].segments) == 2 and may[self.tracer].all())
            if self.rides:
                self.segments, self.origin = bodies[0].segments, others[0]
        else:
            k = [m.name for m in top.markers].index(problem.point)
            self.tracer, marker = self.points + k, top.markers[k]
            self.rides = bool(len(marker.segments) == 2 and may[self.tracer].all())
            self.origin = marker.origin if self.rides else -1
            self.segments = marker.segments if self.rides else self.segments

    def _move_whole(self, flat: np.ndarray, fit: Fit) -> np.ndarray:
        """Move mechanisms as a whole, and put a tracer that may be fitted to its place."""
        places, vectors, sizes = self._split(flat)
        top = self.problem.system.topology
        back = np.swapaxes(fit.turn, 1, 2)
        arms = fit.grown[:, None, None] * (places - self.centre)
        if self.free.tracer:
            arms[:, self.tracer] = arms[:, self.origin] + fit.tracer
        new = self.centre + fit.place[:, None] + arms @ back
        for k, marker in enumerate(top.markers):
            if marker.direction:
                new[:, self.points + k] = (places[:, self.points + k, None] @ back)[:, 0]
        sizes = sizes * np.where(length_dimensions(self.problem), np.abs(fit.grown)[:, None], 1.0)
        parts = (new[:, : self.points], vectors @ back, new[:, self.points :])
        return np.concatenate([*(part.reshape(len(flat), -1) for part in parts), sizes], axis=1)

    def _pull_in(self, sums: Sums, fit: Fit, left: np.ndarray, room: Room, weight: float) -> tuple[Fit, np.ndarray]:
        """Pull fits that miss bounds into them; the squares left, with what is still missed, weighted."""
        fit, missed = Fit(*(part.copy() for part in fit)), np.zeros(len(left))
        lanes = np.arange(len(left))
        most = 6  # times that what is out of bounds is looked for
        for turn in range(most + 1):
            own, now = room.of(lanes), take(fit, lanes)
            arm = now.grown[:, None, None] * own.spots + room.rides[:, None] * now.tracer[:, None]
            place = self.centre + now.place[:, None] + arm @ np.swapaxes(now.turn, 1, 2)
            goal = np.clip(place, room.low, room.high)
            missed[lanes] = weight * np.sum((goal - place) ** 2, axis=(1, 2))
            out = np.flatnonzero((np.abs(goal - place) > 1e-9 * self.problem.size).any(axis=(1, 2)))
            if turn == most or not len(out):
                break
            lanes, own, goal, place = lanes[out], own.of(out), goal[out], place[out]
            heavy = weight * (goal != place).any(axis=2)
            rides = np.broadcast_to(room.rides[:, None, None] * np.eye(3), (*heavy.shape, 3, 3))
            both = take(sums, lanes).join(Sums.of(own.spots, rides, goal - self.centre, heavy))
            now, rest = fit_sums(self.free, both, take(now, out), own.least, own.most)
            for part, new in zip(fit, now, strict=True):
                part[lanes] = new
            left[lanes] = rest
        return fit, left + missed

    def _confirm(self, flat: np.ndarray, free: Freedom) -> Freedom:
        """Take away from what is free whatever does not do to the motion what it does to the drawing."""
        size, eye = self.problem.size, np.eye(3)
        self.free = free
        home = Fit(np.zeros((1, 3)), np.ones(1), eye[None], np.zeros((1, 3)), eye[None])
        if free.tracer:
            places = self._split(flat[None])[0][0]
            home = home._replace(tracer=(places[self.tracer] - places[self.origin])[None])
        ways = [home._replace(place=0.1 * size * axis[None]) for axis in eye]
        ways += [home._replace(grown=np.full(1, by), tracer=by * home.tracer) for by in (1.1, -1.1)]
        ways += [home._replace(turn=rotation_matrix(_TURN)[None]), home._replace(tracer=home.tracer + 0.1 * size)]
        seen = [self._track_point(self._move_whole(flat[None], fit)) for fit in (home, *ways)]
        good = np.all([ok for *_, ok in seen], axis=0)
        (place, turns, _), wanted = seen[0], []
        for fit in ways:
            at = (fit.grown[0] * (place - self.centre)) @ fit.turn[0].T + self.centre + fit.place
            if fit is ways[-1]:
                at = place + turns @ (fit.tracer - home.tracer)[0]
            wanted.append((at, fit.turn[0] @ turns @ fit.turn[0].T))
        same = [
            bool(np.allclose(a[good], at[good], atol=1e-6 * size) and np.allclose(f[good], w[good], atol=1e-6))
            for (at, w), (a, f, _) in zip(wanted, seen[1:], strict=True)
        ]
        axes = tuple(a and b for a, b in zip(free.axes, same[:3], strict=True))
        turn = free.turn and same[5] and len(set(axes)) == 1
        scale, tracer = free.scale and same[3], free.tracer and same[6]
        return Freedom(axes, scale, scale and same[4], turn, tracer, free.frame)

    def _track_point(self, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Move a drawing over the range: the tracer's places, its body's turns, and which poses are found."""
        motion = sweep_drawing(self.problem, flat[0])
        turns = self._turns(np.asarray(motion.q), flat[:, : 3 * (self.points + self.vectors)])
        return np.asarray(motion[self.problem.point]), turns, np.asarray(motion.converged)


def _complex_pairs(curve: np.ndarray, wanted: np.ndarray, weight: float) -> Pairs:
    """Pair numbers of curves ``(B, guesses, poses, n)`` to complex ones."""
    count, out = wanted.shape[1], []
    for k in range(0, count - 1, 2):
        out.append((curve[..., k] + 1j * curve[..., k + 1], wanted[:, k] + 1j * wanted[:, k + 1], weight))
    return out + ([(curve[..., -1], wanted[:, -1], weight)] if count % 2 else [])
