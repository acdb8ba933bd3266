"""Many designs of one mechanism along their own inputs, all at once in NumPy, and how their poses change with them.

The diagonal blocks of a plan are solved one after the other: what has a closed form for all poses of all designs at
once, the rest from pose to pose. Steps are as they are given; what leaves its branch on one of them is given up, and so
are the poses behind it. Coordinates are ``(N, steps, designs)``.
"""

import functools
from typing import Any, NamedTuple

import numpy as np

from jaxnc.reading import Program, function, partials, polynomials, rate
from jaxnc.reading.program import Builder
from jaxnc.remembered import with_owner
from jaxnc.solvers.plan import Plan, square_rows
from jaxnc.system.drawn import Drawn
from jaxnc.system.equations import pure_numbers
from jaxnc.system.precision import limits
from jaxnc.system.structure import program
from jaxnc.system.topology import Topology

_ITERATIONS = 12  # the most of Newton
_ASSEMBLY = 60  # and of Levenberg and Marquardt on a drawing that does not fit its dimensions
_SHARP = 0.5  # of the movement in a step: a longer correction may have led to another branch
_SLACK = 0.05  # of the size: shorter ones have not
_REBOUND = 0.3  # of a determinant: less was expected of it, so that it has been thrown back behind a gap
_DROP = 0.1  # of a determinant: a step that leaves less of it ends beside a change point, on either branch


class Continued(NamedTuple):
    """Poses of designs along their inputs."""

    q: np.ndarray  # coordinates (N, steps, designs), finite everywhere
    good: np.ndarray  # whether a pose, and every pose before it, is on the design's branch, (steps, designs)
    # steps across which a determinant changes too much to say that it is, (steps - 1, designs), of designs that are not
    # good for no other reason
    doubted: np.ndarray


class _Part:
    """Functions of some instances as one program of coordinates and constants.

    Wanted are, by instance (its block and its number there), outputs of its ``"residual"`` or ``"guard"``.
    """

    def __init__(self, top: Topology, wanted: dict[tuple[int, int], list[int]], which: str, columns: tuple[int, ...]):
        own = {at: [int(v) for v in top.layout[at[0]].variables[at[1]]] for at in wanted}
        self.coordinates = tuple(dict.fromkeys([*columns, *(v for some in own.values() for v in some)]))
        self.constants = [(b, i, k) for b, i in wanted for k in range(len(top.blocks[b].kind.constants))]
        place = {c: n for n, c in enumerate(self.coordinates)}
        number = {c: n for n, c in enumerate(self.constants, len(place))}
        builder, outputs = Builder(len(place) + len(number)), []
        for (b, i), some in wanted.items():
            kind = top.blocks[b].kind
            read = program(kind, which, top.dim)
            assert read is not None
            inputs = [place[v] for v in own[b, i]] + [number[b, i, k] for k in range(len(kind.constants))]
            at = builder.append(read, [builder.first[n] for n in inputs])
            outputs += [at[read.outputs[k]] for k in some]
        self.program: Program = builder.program(outputs)
        self.run = function(self.program)

    def given(self, q: np.ndarray, constants: Any) -> list[np.ndarray]:
        """The program's inputs from coordinates ``(N, …)`` and constants per block ``(instances, constants, …)``."""
        return [*(q[c] for c in self.coordinates), *(constants[b][i, k] for b, i, k in self.constants)]


class _Rows(_Part):
    """Rows that are solved for some columns."""

    def __init__(self, top: Topology, rows: list[int], columns: tuple[int, ...]):
        owner = {
            int(r): (b, i, k)
            for b, layout in enumerate(top.layout)
            for i, some in enumerate(layout.rows)
            for k, r in enumerate(some)
        }
        wanted: dict[tuple[int, int], list[int]] = {}
        for r in rows:
            b, i, k = owner[r]
            wanted.setdefault((b, i), []).append(k)
        self.order = [int(top.layout[b].rows[i][k]) for (b, i), some in wanted.items() for k in some]
        super().__init__(top, wanted, "residual", columns)
        self.columns = columns
        first, self.places = partials(self.program, range(len(columns)))
        self._first, self._slopes = first, function(first)

    @functools.cached_property
    def changed(self) -> Any:
        """How the rows change with everything but the columns."""
        return function(rate(self.program, range(len(self.columns), self.program.inputs), 1))

    def newton(self, given: list[np.ndarray], lanes: tuple[int, ...]) -> list[np.ndarray]:
        """Newton's step of each column; not finite where the block is singular."""
        if self._step is not None:
            return list(self._step(given))
        rows = [np.broadcast_to(r, lanes) for r in self.run(given)]
        return _solved(self.slopes(given, lanes), rows)

    @functools.cached_property
    def _step(self) -> Any:
        """The same for few columns, written out by Cramer's rule."""
        n = len(self.columns)
        if n > 3:
            return None
        b = Builder(self.program.inputs)
        at = b.append(self.program, b.first)
        rows = [at[k] for k in self.program.outputs]
        at = b.append(self._first, b.first)
        a = [[b.number(0.0)] * n for _ in range(n)]
        for (r, c), k in zip(self.places, self._first.outputs, strict=True):
            a[r][c] = at[k]
        det = _written(b, a)
        inside = [[[rows[r] if k == c else a[r][k] for k in range(n)] for r in range(n)] for c in range(n)]
        return function(b.program([b.op("div", _written(b, m), det) for m in inside]))

    @functools.cached_property
    def form(self) -> str:
        """How it is solved: ``"affine"``, ``"pair"`` (of circles), ``"square"``, ``"angle"`` or ``"iterated"``."""
        n = len(self.columns)
        if self.turned is not None:
            return "angle"
        terms = [p.terms for p in polynomials(self.program, range(n))]
        if any(t is None or max(map(len, t), default=0) > 2 for t in terms):
            return "iterated"
        squares = [{m: c for m, c in t.items() if len(m) == 2} for t in terms if t is not None]
        if not any(squares):
            return "affine"
        if n == 1:
            return "square"
        return "pair" if n == 2 and all(not s or _round(s) for s in squares) else "iterated"

    @functools.cached_property
    def turned(self) -> Any:
        """The row with the cosine and sine of the only column as inputs more, if it is affine in these."""
        if len(self.columns) != 1:
            return None
        b = Builder(self.program.inputs + 2)
        ways, at = dict(zip(("cos", "sin"), b.first[-2:], strict=True)), []
        for node in self.program.nodes:
            if node.op == "input":
                at.append(b.first[node.value])
            elif node.op == "number":
                at.append(b.number(node.value[1]))
            elif node.op in ways and at[node.of[0]] == b.first[0]:
                at.append(ways[node.op])
            else:
                at.append(b.op(node.op, *(at[i] for i in node.of), value=node.value))
        made = b.program([at[k] for k in self.program.outputs])
        (row,) = polynomials(made, (0, made.inputs - 2, made.inputs - 1))
        affine = row.terms is not None and all(len(m) <= 1 for m in row.terms)
        return function(made) if affine and row.depends and 0 not in row.depends else None

    @functools.cached_property
    def bends(self) -> tuple[Any, ...]:
        """Second derivatives of the rows by the first column; None of a row that has none."""
        second, at = partials(self._first, (0,))
        found: list[Any] = [None] * len(self.order)
        for k, (n, _) in enumerate(at):
            if self.places[n][1] == 0:
                found[self.places[n][0]] = function(second.wanted([second.outputs[k]]))
        return tuple(found)

    def slopes(self, given: list[np.ndarray], lanes: tuple[int, ...]) -> np.ndarray:
        """Derivatives by the columns, ``(rows, columns, *lanes)``."""
        out = np.zeros((len(self.order), len(self.columns), *lanes))
        for (r, c), value in zip(self.places, self._slopes(given), strict=True):
            out[r, c] = value
        return out


def _round(squares: dict) -> bool:
    return set(squares) == {(0, 0), (1, 1)} and squares[0, 0] == squares[1, 1]


def determinant(a: np.ndarray) -> np.ndarray:
    """Determinants of matrices ``(k, k, *lanes)``."""
    if len(a) == 1:
        return a[0, 0]
    if len(a) == 2:
        return a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    return np.linalg.det(np.moveaxis(a, (0, 1), (-2, -1)))


def _solved(a: np.ndarray, right: list[np.ndarray]) -> list[np.ndarray]:
    """Solutions of ``(k, k, *lanes)`` for right sides that may have an axis more, first; not finite where singular."""
    if len(a) == 1:
        return [right[0] / a[0, 0]]
    if len(a) == 2:
        inverse = 1.0 / determinant(a)
        p, q = right
        return [(a[1, 1] * p - a[0, 1] * q) * inverse, (a[0, 0] * q - a[1, 0] * p) * inverse]
    more = right[0].ndim > a.ndim - 2
    matrix, sides = np.moveaxis(a, (0, 1), (-2, -1)), np.stack(right, axis=-1)
    sides = np.moveaxis(sides, 0, -1) if more else sides[..., None]
    regular = np.isfinite(matrix).all(axis=(-2, -1)) & (np.linalg.slogdet(matrix)[0] != 0.0)
    safe = np.where(regular[..., None, None], matrix, np.eye(len(a)))
    found = np.where(regular[..., None, None], np.linalg.solve(safe, sides), np.nan)
    return [np.moveaxis(found[..., k, :], -1, 0) if more else found[..., k, 0] for k in range(len(a))]


def _written(b: Builder, a: list[list[int]]) -> int:
    """A determinant, from where the elements are, by the first row."""
    if len(a) == 1:
        return a[0][0]
    out = b.number(0.0)
    for c, element in enumerate(a[0]):
        if b.known(element) == 0:
            continue
        term = b.op("mul", element, _written(b, [row[:c] + row[c + 1 :] for row in a[1:]]))
        out = b.op("sub" if c % 2 else "add", out, term)
    return out


class Lockstep:
    """A plan, ready for many designs. Make it with `lockstep`; all its kinds are readable (`host_kinds.readable`)."""

    def __init__(self, plan: Plan):
        self.plan, top = plan, plan.topology
        self.blocks = [
            _Rows(top, [int(plan.rows[r]) for r in rows], tuple(int(c) for c in plan.unknown[columns]))
            for rows, columns in square_rows(plan).sequence
        ]
        free = tuple(int(c) for c in np.flatnonzero(~np.array(top.fixed, dtype=bool)))
        self.everything = _Rows(top, list(range(len(top.rows))), free)
        guarded = [(b, kind) for b, kind in ((b, block.kind) for b, block in enumerate(top.blocks)) if kind.guard]
        wanted = {(b, i): list(range(len(_outputs(top, b)))) for b, _ in guarded for i in range(top.blocks[b].count)}
        self.guards = _Part(top, wanted, "guard", ()) if wanted else None
        self.closed = all(block.form != "iterated" for block in self.blocks)

    def follow(
        self, drawn: Drawn, scales: Any, length: float, start: np.ndarray, track: np.ndarray, sure: bool = False
    ) -> Continued:
        """Poses along values of the known coordinates.

        Args:
            drawn: the designs, an axis of theirs behind each number's own; changes are not looked at.
            scales: factors of all rows, which make them lengths, ``(rows,)``.
            length: size of the mechanism.
            start: the assembled designs, ``(N, designs)``.
            track: values of the known coordinates ``(known, steps, designs)``, those of the start first.
            sure: that designs stay on their branch, however much determinants change in a step.
        """
        plan, least = self.plan, limits(np.zeros(0))
        constants = [c[..., 0] for c in drawn.constants]
        q = np.repeat(start[:, None], track.shape[1], axis=1)
        q[plan.known] = track
        good = np.ones(track.shape[1:], bool)
        weights = np.where(pure_numbers(plan.topology), length, 1.0)
        determinants, share = [], shares(track)
        with np.errstate(all="ignore"):
            for block in self.blocks:
                if block.form == "iterated":
                    good &= self._iterated(block, constants, weights, length, q, share)
                else:
                    _closed(block, constants, q)
                a = block.slopes(block.given(q, constants), good.shape)
                size = np.prod(np.sqrt(np.sum((a / weights[list(block.columns), None, None]) ** 2, axis=1)), axis=0)
                value = determinant(a) / np.prod(weights[list(block.columns)])
                determinants.append(value)
                good &= np.abs(value) > least.poor * size
            going = np.ones(share.shape, bool)
            for value in determinants:
                good &= np.sign(value) == np.sign(value[0])
                going &= sure | steady(value, share)
            rows = self.everything.run(self.everything.given(q, constants))
            off = np.zeros(good.shape)
            for row, r in zip(rows, self.everything.order, strict=True):
                np.maximum(off, np.abs(row) * scales[r], out=off)
            top = plan.topology
            spread = np.max(
                np.ptp(start[: len(top.points) * top.dim].reshape(-1, top.dim, start.shape[1]), axis=0), axis=0
            )
            grown = np.maximum(1.0, spread / length) ** 2  # rows are squared lengths: their rounding grows like these
            good &= off <= least.accept * length * grown + least.rounding * np.max(
                weights[:, None, None] * np.abs(q), axis=0
            )
            if self.guards is not None:
                for value in self.guards.run(self.guards.given(q, constants)):
                    good &= value > 0.0
        doubted = ~going & np.logical_and.accumulate(good, axis=0)[1:]
        good[1:] &= going
        good = np.logical_and.accumulate(good, axis=0)
        q = np.where(good, q, start[:, None])
        return Continued(q, good, doubted)

    def intersect(self, constants: Any, q: np.ndarray) -> None:
        """Put poses ``(N, steps, designs)`` in their places, if `closed`; all are on the sides of the first of them."""
        for block in self.blocks:
            _closed(block, constants, q)

    def _iterated(
        self, block: _Rows, constants: Any, weights: np.ndarray, length: float, q: np.ndarray, share: np.ndarray
    ) -> np.ndarray:
        """Newton from pose to pose, in all designs; whether each pose was found."""
        columns, least = list(block.columns), limits(np.zeros(0))
        weight, good = weights[columns, None], np.zeros(q.shape[1:], bool)
        good[0], live = True, np.arange(q.shape[2])
        constants = [constants[b][i, k] for b, i, k in block.constants]
        for s in range(1, q.shape[1]):
            before = q[columns, s - 1][:, live]
            guess = before
            if s > 1:
                guess = before + share[s - 1, live] * (before - q[columns, s - 2][:, live])
            given = [*guess, *(q[c, s, live] for c in block.coordinates[len(columns) :]), *constants]
            far = np.full(len(live), np.inf)
            for _ in range(_ITERATIONS):
                step = block.newton(given, live.shape)
                given[: len(columns)] = [x - d for x, d in zip(given, step, strict=False)]
                far = functools.reduce(np.maximum, (np.abs(d) * w for d, w in zip(step, weight, strict=True)))
                if not np.any(far > least.fine * length):  # what is not finite goes on no longer
                    break
            x = np.stack(given[: len(columns)])
            moved, off = (np.sqrt(np.sum((weight * (x - at)) ** 2, axis=0)) for at in (before, guess))
            found = (far <= least.fine * length) & (off <= _SHARP * moved + _SLACK * length)
            q[np.ix_(columns, [s], live)] = np.where(found, x, before)[:, None]
            good[s, live] = found
            if not found.all():
                live = live[found]
                constants = [c[found] for c in constants]
                if not len(live):
                    break
        for s in range(1, q.shape[1]):
            q[columns, s] = np.where(good[s], q[columns, s], q[columns, s - 1])
        return good

    def assembled(self, drawn: Drawn, scales: Any, length: float) -> np.ndarray:
        """The pose of each design that is closest to its drawing, ``(N, designs)``; see `host.closest`."""
        q = drawn.home[..., 0].copy()
        part, least, constants = self.everything, limits(np.zeros(0)), [c[..., 0] for c in drawn.constants]
        columns, scale = list(part.columns), np.array([scales[r] for r in part.order])[:, None]
        inner = np.where(pure_numbers(self.plan.topology), length, 1.0)[columns]
        n, floor = len(columns), 2.5 * least.floor * length
        damping, cost = np.full(q.shape[1], 1e-2), np.full(q.shape[1], np.inf)
        trial, slopes, r = q.copy(), np.zeros((q.shape[1], len(part.order), n)), np.zeros((q.shape[1], len(part.order)))
        with np.errstate(all="ignore"):
            for turn in range(_ASSEMBLY):
                given = part.given(trial, constants)
                new = np.stack([np.broadcast_to(row, q.shape[1:]) for row in part.run(given)] or [np.zeros(q.shape[1])])
                new = new * scale if len(part.order) else new
                size = np.sum(new * new, axis=0)
                better = size < cost
                q[:, better] = trial[:, better]
                if turn == 0 and np.all(np.abs(new) <= least.accept * length):
                    break
                at = np.moveaxis(part.slopes(given, q.shape[1:]) * scale[:, None], 2, 0) / inner
                slopes[better], r[better], cost = at[better], new.T[better], np.where(better, size, cost)
                damping = np.where(
                    better, np.maximum(0.1 * damping, least.damping), 10.0 * damping if turn else damping
                )
                live = (np.max(np.abs(r), axis=1) > floor) & (damping < 1e8)
                if not live.any():
                    break
                normal = np.swapaxes(slopes, 1, 2) @ slopes
                trace = np.trace(normal, axis1=1, axis2=2)
                normal[:, np.arange(n), np.arange(n)] += (damping * trace / n + least.tiny)[:, None]
                right = np.swapaxes(slopes, 1, 2) @ r[:, :, None]
                step = np.linalg.solve(normal, right)[:, :, 0] / inner
                trial = q.copy()
                trial[columns] -= np.where(live & np.isfinite(step).all(axis=1), step.T, 0.0)
        return q

    def changes(self, drawn: Drawn, q: np.ndarray, good: np.ndarray, known: np.ndarray) -> np.ndarray:
        """How poses change with designs and inputs, ``(N, changes, steps, designs)``, by the implicit rule; else zero.

        The poses ``(N, steps, designs)`` are there where they are good, ``(steps, designs)``; changes of the known
        coordinates are ``(known, changes, steps, designs)``.
        """
        plan = self.plan
        out = np.zeros((len(q), *known.shape[1:]))
        out[plan.fixed] = np.moveaxis(drawn.home[plan.fixed, :, 1:], -1, 1)[:, :, None]
        out[plan.known] = known
        constants = [c[..., 0] for c in drawn.constants]
        moved = [np.ascontiguousarray(np.moveaxis(c[..., 1:], -1, 2))[:, :, :, None] for c in drawn.constants]
        with np.errstate(all="ignore"):
            for block in self.blocks:
                given = block.given(q, constants)
                rows = block.changed([*given, *block.given(out, moved)[len(block.columns) :]])
                rows = [np.broadcast_to(r, out.shape[1:]) for r in rows]
                a = block.slopes(given, q.shape[1:])
                for c, change in zip(block.columns, _solved(a, rows), strict=True):
                    np.negative(change, out=out[c])
        out[~(good & np.isfinite(out))] = 0.0
        return out


def _outputs(top: Topology, b: int) -> tuple[int, ...]:
    read = program(top.blocks[b].kind, "guard", top.dim)
    assert read is not None
    return read.outputs


def shares(track: np.ndarray) -> np.ndarray:
    """How long each step is in terms of the one before, ``(steps - 1, designs)``; of the first one 0."""
    ways = np.diff(track, axis=1)
    ahead, square = np.sum(ways[:, 1:] * ways[:, :-1], axis=0), np.sum(ways[:, :-1] ** 2, axis=0)
    share = ahead / np.where(square > 0.0, square, 1.0)
    return np.concatenate([np.zeros_like(share[:1]) if len(share) else np.zeros((0, *track.shape[2:])), share])[
        : track.shape[1] - 1
    ]


def steady(value: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Whether determinants go on as they did, ``(steps - 1, designs)``; see `jaxnc.solvers.continuation`."""
    rise = np.concatenate([np.zeros_like(value[:1]), np.diff(value, axis=0)])[: len(value) - 1]
    size = np.abs(value[1:])
    return ((value[:-1] + share * rise) * np.sign(value[1:]) >= _REBOUND * size) & (size >= _DROP * np.abs(value[:-1]))


def _closed(block: _Rows, constants: Any, q: np.ndarray) -> None:
    """Solve a block with a closed form, in all poses, on the side that its first pose has."""
    columns, lanes = list(block.columns), q.shape[1:]
    if block.form == "affine":
        given = block.given(q, constants)
        rows = [np.broadcast_to(r, lanes) for r in block.run(given)]
        q[columns] -= np.stack(_solved(block.slopes(given, lanes), rows))
        return
    first = q[:, :1]
    sign = np.sign(determinant(block.slopes(block.given(first, constants), (1, lanes[1]))))
    given = block.given(q, constants)
    bends: list[Any] = [None if b is None else b(given)[0] for b in block.bends]
    rows, a = block.run(given), block.slopes(given, lanes)
    if block.form == "angle":
        assert block.turned is not None
        rest, x, y = (block.turned([*given, *at])[0] for at in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
        x, y = x - rest, y - rest
        # The sine of the angle from the direction (x, y) has the sign of the row's derivative, turned round.
        far = np.arccos(np.clip(-rest / np.hypot(x, y), -1.0, 1.0))
        angle = np.broadcast_to(np.arctan2(y, x) - sign * far, lanes)
        turns = np.diff(np.concatenate([q[columns[0], :1], angle]), axis=0)
        q[columns[0]] += np.cumsum(turns - 2 * np.pi * np.round(turns / (2 * np.pi)), axis=0)
        given = block.given(q, constants)
        q[columns[0]] -= np.asarray(block.newton(given, lanes)[0])
        return
    if block.form == "square":
        root = np.sqrt(np.maximum(a[0, 0] ** 2 - 2.0 * bends[0] * rows[0], 0.0))
        q[columns[0]] += (sign * root - a[0, 0]) / bends[0]
        return
    q[columns] += intersection(rows, a, bends, sign)


def intersection(rows: Any, slopes: np.ndarray, bends: Any, sign: np.ndarray) -> np.ndarray:
    """Steps to the intersection of two circles, or of a circle and a line, that has an orientation, ``(2, *lanes)``.

    Slopes of both rows are ``(2, 2, *lanes)``; bends are the same in every direction, None of a line; `sign` is that of
    the determinant there.
    """
    a, b = slopes
    if bends[0] is None:
        line, offset, circle, value, bend, side = a, rows[0], b, rows[1], bends[1], sign
    elif bends[1] is None:
        line, offset, circle, value, bend, side = b, rows[1], a, rows[0], bends[0], -sign
    else:  # the radical axis
        line, offset = bends[1] * a - bends[0] * b, bends[1] * rows[0] - bends[0] * rows[1]
        circle, value, bend, side = a, rows[0], bends[0], sign * np.sign(bends[0])
    square = line[0] * line[0] + line[1] * line[1]
    foot = -offset / square * line
    along = np.stack([-line[1], line[0]])
    # value + circle · (foot + t along) + bend/2 |foot + t along|² = 0
    slope = circle[0] * along[0] + circle[1] * along[1]
    rest = value + circle[0] * foot[0] + circle[1] * foot[1] + 0.5 * bend * (foot[0] ** 2 + foot[1] ** 2)
    twice = bend * square
    root = np.sqrt(np.maximum(slope * slope - 2.0 * twice * rest, 0.0))
    return foot + (side * root - slope) / twice * along


@with_owner
def lockstep(plan: Plan) -> Lockstep:
    """A plan, made ready once."""
    return Lockstep(plan)
