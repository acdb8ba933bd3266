"""Degrees of freedom of a large mechanism: the rank of its sparse Jacobian at the assembled drawing and near it."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jaxnc.errors import MechanismError
from jaxnc.solvers.assembly import derive, free_plan, settle
from jaxnc.solvers.large import LargePlan
from jaxnc.solvers.rank import Nullity, null_directions, projected, shape, sparse
from jaxnc.system.equations import Equations, weights
from jaxnc.system.system import System
from jaxnc.types import Coordinates

if TYPE_CHECKING:
    import scipy.sparse as sp

_NUDGE = 0.03  # of a typical bar: how far away the second pose is looked for


class LargeSample(NamedTuple):
    """An assembled pose, its largest residual, its free Jacobian (every coordinate a length), and what that misses."""

    q: Coordinates
    gap: float
    jacobian: "sp.csc_matrix"
    null: Nullity

    @property
    def rank(self) -> int:
        """Rank of the Jacobian."""
        return min(shape(self.jacobian)) - self.null.count


def large_samples(system: System, count: int = 2) -> list[LargeSample]:
    """The assembled drawing, and other poses nearby; arguments and result as of `assembly.sample_poses`."""
    view = free_plan(system.topology)
    assert isinstance(view, LargePlan)
    eq: Equations = derive(system)
    nudge = np.zeros(len(system.topology.coordinates))
    weight = np.asarray(weights(eq))[view.unknown]
    out: list[LargeSample] = []
    for step in range(count):
        q, gap, numbers = settle(eq, nudge)
        pattern = view.numbers
        matrix = sparse(np.asarray(numbers), pattern.rows, pattern.columns, pattern.shape)
        out.append(LargeSample(q, float(gap), matrix, null_directions(matrix)))
        if out[-1].rank == len(view.unknown):
            break
        mix = np.random.default_rng(7 + step).uniform(0.5, 1.0, len(view.unknown))
        way = projected(matrix, mix)
        way = way / max(np.abs(way).max(initial=0.0), 1e-300)
        nudge[view.unknown] = (1 - 2 * (step % 2)) * (step + 1) * _NUDGE * float(eq.length) * way / weight
    return out


def degrees_of_freedom(system: System) -> int:
    """Count a large system's degrees of freedom."""
    samples = large_samples(system)
    best = max(samples, key=lambda sample: sample.rank)
    if not best.null.sure:
        smallest = ", ".join(f"{value:.1e}" for value in best.null.smallest[:4])
        raise MechanismError(
            f"{system.name!r}: its degrees of freedom cannot be told; the smallest singular values of its constraints, "
            f"relative to the largest, are {smallest}, too close to those of a singular position. Draw it in a pose "
            f"further from a change point or dead point, or with proportions that do not magnify along the chain"
        )
    return len(system.topology.unknown) - best.rank
