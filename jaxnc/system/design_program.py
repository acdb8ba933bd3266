"""What follows from a drawing, as one program: the same as `jaxnc.system.drawn` finds with NumPy.

For where a drawing is changed and there is no NumPy, such as a page.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from jaxnc.constraints.kind import norm
from jaxnc.constraints.small import Small
from jaxnc.constraints.spatial_coordinates import from_drawing
from jaxnc.reading import Builder, Program, write
from jaxnc.system.drawn import carrier_program, recipe_program
from jaxnc.system.identity import Thing
from jaxnc.system.structure import program
from jaxnc.system.topology import Segment, Topology


class DesignProgram(NamedTuple):
    """A program and what its numbers are."""

    # Of all coordinates as drawn (points, unit vectors, then angles and distances, which say only in which turn an
    # angle is), of the markers' places, and of the explicit dimensions.
    program: Program
    # Constants of all instances, block after block; angles and distances as drawn; coefficients of the markers; the
    # explicit dimensions of bodies as drawn, other dimensions as they are. An angle that is counted from the drawing
    # stays what it is, and so does the direction that it is counted from, which is none of these constants.
    outputs: tuple[int, int, int, int]
    # Places of the constants among the numbers of an instance, as `HostEquations.numbers` has them.
    constants: tuple[int, ...]


def design_program(top: Topology) -> DesignProgram:
    """The program of a mechanism whose kinds can be read."""
    return _Writer(top).whole()


class _Writer:
    def __init__(self, top: Topology):
        self.top, count, dim = top, len(top.coordinates), top.dim
        self.first = dim * (len(top.points) + len(top.vectors))  # of the angles and distances
        self.b = Builder(count + dim * len(top.markers) + len(top.dimensions))
        self.q, rest = self.b.first[:count], self.b.first[count:]
        self.markers, self.dimensions = rest[: dim * len(top.markers)], rest[dim * len(top.markers) :]
        places = [self.q[k : k + dim] for k in range(0, self.first, dim)]
        self.points, self.vectors = places[: len(top.points)], places[len(top.points) :]
        self.drawing = list(self.points)
        self.read = list(self.dimensions)
        for shape in top.shapes:
            for members, wanted in zip(shape.members, shape.dimensions, strict=True):
                self._shape(shape.recipe, members, wanted)
        self.zero = self.b.number(0.0)
        self.scalars = [self.zero] * len(top.scalars)

    def call(self, program: Program, inputs: Sequence[int]) -> list[int]:
        at = self.b.append(program, inputs)
        return [at[k] for k in program.outputs]

    def distance(self, p: Sequence[int], q: Sequence[int]) -> int:
        return self.call(write(lambda *x: norm(Small(x)), self.top.dim), self.between(p, q))[0]

    def between(self, p: Sequence[int], q: Sequence[int]) -> list[int]:
        return [self.b.op("sub", y, x) for x, y in zip(p, q, strict=True)]

    def _shape(self, recipe: tuple, members: tuple[int, ...], wanted: tuple[int, ...]) -> None:
        home = [self.drawing[k] for k in members]
        values = [self.dimensions[d] for d in wanted]
        dim = self.top.dim
        placed = self.call(
            recipe_program(recipe, len(members), dim, len(wanted)), [*(x for p in home for x in p), *values]
        )
        self.drawing += [placed[k : k + dim] for k in range(0, len(placed), dim)]
        (i, j, base), steps = recipe
        if base is not None:
            self.read[wanted[base]] = self.distance(home[i], home[j])
        for k, how, *data in steps:
            if how == "local":
                x, w = self.between(home[i], home[j]), self.between(home[i], home[k])
                size = self.distance(home[i], home[j])
                along = self._sum((x[0], w[0]), (x[1], w[1]))
                across = self.b.op("sub", self.b.op("mul", x[0], w[1]), self.b.op("mul", x[1], w[0]))
                self.read[wanted[data[0]]] = self.b.op("div", along, size)
                self.read[wanted[data[1]]] = self.b.op("div", across, size)
            elif how != "drawn":
                for origin, d in zip(data[::2], data[1::2], strict=True):
                    self.read[wanted[d]] = self.distance(home[origin], home[k])

    def _sum(self, *products: tuple[int, int]) -> int:
        return self.b.total(self.b.op("mul", x, y) for x, y in products)

    def constants(self, b: int, read: bool = False) -> list[list[int]]:
        """Constants of a block's instances, read off the drawing or given."""
        block, layout = self.top.blocks[b], self.top.layout[b]
        found = program(block.kind, "drawn", self.top.dim)
        explicit = [[self.zero] * len(block.kind.constants) for _ in range(block.count)]
        fixed: set[tuple[int, int]] = set()
        for i, k, p, q in block.lengths:
            explicit[i][k] = self.distance(self.drawing[p], self.drawing[q])
            fixed.add((i, k))
        for i, k, d in block.given:
            explicit[i][k] = self.dimensions[d]
            fixed.add((i, k))
        if found is None:
            return explicit
        out = []
        for i in range(block.count):
            x = [c for p in layout.drawn[i] for c in self.drawing[int(p)]]
            x += [c for v in layout.vectors[i] for c in self.vectors[int(v)]]
            x += [self.scalars[int(s) - self.first] for s in layout.scalars[i]]
            seen = self.call(found, [*x, *explicit[i]])
            out.append([explicit[i][k] if (i, k) in fixed else seen[k] for k in range(len(seen))])
            for instance, k, d in block.given:
                if instance == i and self.top.given[d].owner.thing is Thing.BODY:
                    self.read[d] = seen[k]
        return out

    def measured(self, k: int, constants: list[int]) -> int:
        """An angle or distance as drawn; an angle in the turn in which it was."""
        b, instance = self.top.measures[k]
        found = program(self.top.blocks[b].kind, "measure", self.top.dim)
        assert found is not None
        variables = [int(c) for c in self.top.layout[b].variables[instance]]
        first = self.first
        x = [self.zero if c >= first else self.q[c] for c in variables]
        if from_drawing(self.top.blocks[b].kind):
            return self.q[first + k]
        value = self.call(found, [*x, *constants])[0]
        if not self.top.angles[k]:
            return value
        turn = self.b.number(2.0 * math.pi)
        turns = self.b.op("round", self.b.op("div", self.b.op("sub", self.q[first + k], value), turn))
        return self.b.op("add", value, self.b.op("mul", turns, turn))

    def coefficients(self, k: int) -> list[int]:
        """Those of a marker."""
        marker, dim = self.top.markers[k], self.top.dim
        spans = [x for segment in marker.segments for x in self.span(segment, self.points)]
        arm = self.markers[dim * k : dim * k + dim]
        arm = arm if marker.direction else self.between(self.points[marker.origin], arm)
        read = self.span(marker.drawn[0], self.drawing)
        return self.call(carrier_program(dim, len(marker.segments), marker.direction), [*spans, *arm, *read])

    def span(self, segment: Segment, points: Sequence[Sequence[int]]) -> Sequence[int]:
        """From one point to another, or a vector."""
        return self.vectors[~segment[0]] if len(segment) == 1 else self.between(*(points[p] for p in segment))

    def whole(self) -> DesignProgram:
        top, found = self.top, {}
        for b in sorted({block for block, _ in top.measures}):
            found[b] = self.constants(b)
        self.scalars = [self.measured(k, found[b][i]) for k, (b, i) in enumerate(top.measures)]
        places, nodes, first = [], [], 0
        for b, block in enumerate(top.blocks):
            every = found[b] if b in found else self.constants(b)
            for instance in every:
                if not from_drawing(block.kind):
                    places += range(first, first + len(instance))
                    nodes += instance
                first += len(block.kind.constants) + len(block.kind.rows)
        markers = [c for k in range(len(top.markers)) for c in self.coefficients(k)]
        sizes = len(nodes), len(top.scalars), len(markers), len(self.read)
        return DesignProgram(self.b.program([*nodes, *self.scalars, *markers, *self.read]), sizes, tuple(places))
