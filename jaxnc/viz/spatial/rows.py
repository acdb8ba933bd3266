"""What a joint or coordinate acts on, read off its rows: points in order, and directions as its kind takes them."""

from dataclasses import dataclass

import numpy as np

from jaxnc.solvers.assembly import derive
from jaxnc.system.identity import Owner
from jaxnc.system.system import System
from jaxnc.system.topology import Block, Topology
from jaxnc.viz.spatial.scene import Way


@dataclass(frozen=True)
class Reading:
    """One instance of a kind."""

    block: Block  # where it is
    instance: int  # which one
    points: tuple[int, ...]  # its own points, without those of its directions
    ways: tuple[Way, ...]  # its directions
    vectors: tuple[int, ...]  # for each direction, the index of its unit vector; -1 for a segment

    def constants(self, system: System, start: str) -> list[float]:
        """Values of those constants whose names start so."""
        top, kind = system.topology, self.block.kind
        values = np.asarray(derive(system).constants[top.blocks.index(self.block)])[self.instance]
        return [float(values[i]) for i, name in enumerate(kind.constants) if name.startswith(start)]


def read(block: Block, instance: int, first: int) -> Reading:
    """Read one instance; `first` is the column of the first unit vector."""
    words = block.kind.name.replace(",", " ").split()
    forms = next((word for word in reversed(words) if set(word) <= {"p", "v"}), "")
    points, vectors = list(block.points[instance]), list(block.vectors[instance])
    leading = len(points) - 2 * forms.count("p")
    rest = points[leading:]
    ways, own = [], []
    for form in forms:
        if form == "v":
            own.append(vectors.pop(0))
            ways.append(Way((first + own[-1],)))
        else:
            ways.append(Way((rest.pop(0), rest.pop(0))))
            own.append(-1)
    return Reading(block, instance, tuple(points[:leading]), tuple(ways), tuple(own))


def readings(top: Topology, owner: Owner, first: int) -> list[Reading]:
    """All instances that belong to a joint or coordinate."""
    return [read(block, i, first) for block in top.blocks for i, owners in enumerate(block.owners) if owner in owners]
