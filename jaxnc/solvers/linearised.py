"""A plan's rows and their derivatives as one program, from those of the kinds."""

from typing import NamedTuple

from jaxnc.reading import Builder
from jaxnc.reading.calculus import along
from jaxnc.solvers.plan import Plan
from jaxnc.system.structure import pattern, program
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
    top = plan.topology
    row_of = {int(r): k for k, r in enumerate(plan.rows)}
    unknown = {int(c): k for k, c in enumerate(plan.unknown)}
    driven = {int(c): k for k, c in enumerate(plan.known[: len(plan.driven)])}
    out = Linearised([b.number(0.0)] * len(plan.rows), {}, {}, [])
    first = len(top.coordinates)
    for block, layout in zip(top.blocks, top.layout, strict=True):
        kind, constants = block.kind, len(block.kind.constants)
        found, structure = program(kind, "residual", top.dim), pattern(kind, top.dim)
        for variables, at_rows in zip(layout.variables, layout.rows, strict=True):
            scales = b.first[first + constants : first + constants + len(kind.rows)]
            inputs = [*(b.first[int(c)] for c in variables), *b.first[first : first + constants]]
            first += constants + len(kind.rows)
            guard = program(kind, "guard", top.dim)
            if guard is not None:
                at = b.append(guard, inputs)
                out.guards.extend(at[k] for k in guard.outputs)
            asked = [(r, row_of[int(g)]) for r, g in enumerate(at_rows) if int(g) in row_of]
            if not asked:
                continue
            assert found is not None
            at = b.append(found, inputs)
            places = {node.value: k for k, node in enumerate(found.nodes) if node.op == "input"}
            for r, row in asked:
                out.rows[row] = b.op("mul", at[found.outputs[r]], scales[r])
            for v, c in enumerate(int(c) for c in variables):
                into, column = (out.matrix, unknown[c]) if c in unknown else (out.by_known, driven.get(c, -1))
                if column < 0 or v not in places:
                    continue
                change = along(b, found, at, {places[v]: b.number(1.0)})
                for r, row in asked:
                    k = found.outputs[r]
                    if structure[r, v] and k in change:
                        slope = b.op("mul", change[k], scales[r])
                        before = into.get((row, column))
                        into[row, column] = slope if before is None else b.op("add", before, slope)
    return out
