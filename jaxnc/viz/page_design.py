"""The program of a design for a page, which draws a changed mechanism as its pose stands."""

import math
from typing import NamedTuple

import numpy as np

from jaxnc.constraints.kind import norm
from jaxnc.constraints.small import Small
from jaxnc.constraints.spatial_coordinates import from_drawing
from jaxnc.reading import Builder, Program, write
from jaxnc.system.design import Step, design, run_steps
from jaxnc.system.identity import Thing
from jaxnc.system.topology import Topology


class PageDesign(NamedTuple):
    """A program and what its numbers are."""

    # Of all coordinates as drawn (points, unit vectors, then angles and distances, which say only in which turn an
    # angle is), of the markers' places, and of the explicit dimensions.
    program: Program
    # Constants of all instances, block after block; angles and distances as drawn; coefficients of the markers; the
    # explicit dimensions of bodies as drawn, other dimensions as they are. An angle that is counted from the drawing
    # stays what it is, and so does the direction that it is counted from, which is none of these constants.
    outputs: tuple[int, ...]
    # Places of the constants among the numbers of an instance, as `HostEquations.numbers` has them.
    constants: tuple[int, ...]


def page_design(top: Topology) -> PageDesign:
    """Write the program of a mechanism whose kinds can be read."""
    found, spread = design(top), top.dim * (len(top.points) + len(top.vectors))
    width = top.dim * len(top.markers)
    b = Builder(len(top.coordinates) + width + len(top.dimensions))
    q, rest = b.first[: len(top.coordinates)], b.first[len(top.coordinates) :]

    def run(step: Step, given: np.ndarray) -> list[list[int]]:
        if step.finds == "misfit":
            return [[b.number(0.0)] * given.shape[1]]
        if step.finds == "unit":  # what a pose has are unit vectors
            return given.tolist()
        columns = [step.formula.write(b, instance) for instance in given.T.tolist()]
        if step.finds == "measure":
            block = top.blocks[top.measures[step.at[0]][0]]
            drawn = [q[spread + k] for k in step.at]
            if from_drawing(block.kind):
                return [drawn]
            columns = [
                [_in_turn(b, value, at) if top.angles[k] else value]
                for k, (value,), at in zip(step.at, columns, drawn, strict=True)
            ]
        return [list(row) for row in zip(*columns, strict=True)]

    x = run_steps(found, np.array([b.number(0.0), *q[:spread], *rest]), run, np.concatenate)
    at, nodes, first = [], [], 0
    for block, constants in zip(top.blocks, found.constants, strict=False):
        for instance in constants:
            if not from_drawing(block.kind):
                at += range(first, first + len(instance))
                nodes += x[instance].tolist()
            first += len(block.kind.constants) + len(block.kind.rows)
    parts = nodes, x[found.home[spread:]].tolist(), x[found.markers].reshape(-1).tolist(), _dimensions(top, b, x)
    return PageDesign(b.program([node for part in parts for node in part]), tuple(map(len, parts)), tuple(at))


def _in_turn(b: Builder, angle: int, drawn: int) -> int:
    """Write an angle in the turn in which it was drawn."""
    turn = b.number(2.0 * math.pi)
    turns = b.op("round", b.op("div", b.op("sub", drawn, angle), turn))
    return b.op("add", angle, b.op("mul", turns, turn))


def _dimensions(top: Topology, b: Builder, x: np.ndarray) -> list[int]:
    """Write explicit dimensions: those of bodies as drawn, others as they are."""
    found = design(top)
    out = x[found.parameters[3]].tolist()
    points = x[found.parameters[0]].tolist()

    def between(i: int, j: int) -> list[int]:
        return [b.op("sub", y, z) for z, y in zip(points[i], points[j], strict=True)]

    def distance(i: int, j: int) -> int:
        program = write(lambda *y: norm(Small(y)), top.dim)
        return b.append(program, between(i, j))[program.outputs[0]]

    for shape in top.shapes:
        for members, wanted in zip(shape.members, shape.dimensions, strict=True):
            (i, j, base), steps = shape.recipe
            if base is not None:
                out[wanted[base]] = distance(members[i], members[j])
            for k, how, *data in steps:
                if how == "local":
                    axis, arm = between(members[i], members[j]), between(members[i], members[k])
                    size = distance(members[i], members[j])
                    along = b.total(b.op("mul", y, z) for y, z in zip(axis, arm, strict=True))
                    across = b.op("sub", b.op("mul", axis[0], arm[1]), b.op("mul", axis[1], arm[0]))
                    out[wanted[data[0]]], out[wanted[data[1]]] = (b.op("div", y, size) for y in (along, across))
                elif how != "drawn":
                    for origin, d in zip(data[::2], data[1::2], strict=True):
                        out[wanted[d]] = distance(members[origin], members[k])
    for block, read in zip(top.blocks, found.read, strict=False):
        for i, k, d in block.given:
            if top.given[d].owner.thing is Thing.BODY:
                out[d] = int(x[read[i, k]])
    return out
