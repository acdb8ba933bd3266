"""A plan's rows and their derivatives as one program, from those of the kinds."""

from typing import NamedTuple

from jaxnc.reading import Builder, Program
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.rows import Functions, Rows, guards
from jaxnc.system.topology import Topology

Place = tuple[int, int]


class Linearised(NamedTuple):
    """Nodes of a program."""

    rows: list[int]  # the plan's rows
    matrix: dict[Place, int]  # their derivatives by the unknowns that can differ from zero, by row and column
    by_known: dict[Place, int]  # the same by the driven coordinates
    guards: list[int]  # what is positive where nothing is met by a mirror image


def given(top: Topology) -> int:
    """How many constants and scales all instances have; in the order of `HostEquations.numbers`."""
    return sum(block.count * (len(block.kind.constants) + len(block.kind.rows)) for block in top.blocks)


def linearised(plan: Plan, b: Builder) -> Linearised:
    """Write a plan's rows and their derivatives; the kinds must be readable.

    The first inputs of where it is written are all coordinates, then all constants and scales.
    """
    top, unknowns = plan.topology, len(plan.unknown)
    columns = [*plan.unknown.tolist(), *plan.known[: len(plan.driven)].tolist()]
    place, count = {}, len(top.coordinates)
    for k, block in enumerate(top.blocks):
        constants, scales = len(block.kind.constants), len(block.kind.rows)
        for i in range(block.count):
            place |= {("constant", k, i, j): count + j for j in range(constants)}
            place |= {("scale", k, i, j): count + constants + j for j in range(scales)}
            count += constants + scales

    def written(part: Functions, program: Program) -> list[int]:
        inputs = [*part.coordinates, *(place["constant", *c] for c in part.constants)]
        inputs += [place["scale", *s] for s in part.scales]
        at = b.append(program, [b.first[k] for k in inputs])
        return [at[k] for k in program.outputs]

    rows, guard = Rows(top, plan.rows.tolist(), columns), guards(top)
    found = dict(zip(rows.places, written(rows, rows.partials), strict=True))
    return Linearised(
        written(rows, rows.program),
        {(r, c): k for (r, c), k in found.items() if c < unknowns},
        {(r, c - unknowns): k for (r, c), k in found.items() if c >= unknowns},
        written(guard, guard.program),
    )
