"""Independent coordinates: as many as there are freedoms (source text §1).

Of an open chain they are its relative coordinates, and every pose follows from them directly. Of a closed one they are
inputs of the position problem, which may have several solutions: `assemblies` finds them from many starts.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.errors import InputError
from jaxnc.families.assemblies import assemblies
from jaxnc.families.formulation import Formulation
from jaxnc.families.planner import Planner
from jaxnc.families.program import Frame, Place, Reading
from jaxnc.families.scribe import Scribe
from jaxnc.families.shapes import Recipe
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.records import record
from jaxnc.types import Array


class Chosen(Planner):
    """The independent coordinates alone, without rows: everything else follows from the position problem."""

    family = "independent"

    def _frame(self, scribe: Scribe, k: int) -> Frame:
        """Nothing hangs on these variables directly."""
        raise NotImplementedError

    def place(self, scribe: Scribe, k: int, point: int) -> Place:
        """Nothing hangs on these variables directly."""
        raise NotImplementedError

    def plan(self) -> None:
        """Note the variables."""
        for name in self.keep:
            if name not in self.a.scalars:
                found = self.component(name)
                assert found is not None
                reading = Reading(Recipe("mean" if self.parts.dim == 2 else "mean in space", (0,)), found[1])
                self.add_variable(name, f"coordinate {name}", reading, found[:1])
                continue
            self.own(name, f"the coordinate {name}")


@record
class Independent(Formulation):
    """A closed chain in independent coordinates."""

    def to_natural(self, z: Any) -> Array:
        """Natural coordinates from the independent ones, on the drawing's assembly; by solving the position problem."""
        z = z.q[..., self.topology.unknown] if isinstance(z, Motion) else jnp.asarray(z, self.natural.dtype)
        self._check(z.shape, len(self.listed), "variables of the family")
        flat = z.reshape(-1, z.shape[-1])
        found = solve_position(self.natural, {v.name: flat[:, k] for k, v in enumerate(self.listed)}, throw=False)
        return found.q.reshape(*z.shape[:-1], -1)

    def pose(self, z: Array) -> Array:
        """`to_natural` of one pose."""
        return self.to_natural(z)

    def from_natural(self, q: Any) -> Array:
        """The independent coordinates of a pose."""
        q = q.q if isinstance(q, Motion) else jnp.asarray(q, self.natural.dtype)
        top = self.natural.topology
        self._check(q.shape, len(top.coordinates), "coordinates of the mechanism")
        return q[..., np.array([top.position[v.name] for v in self.listed], int)]

    def of(self, natural: Any) -> "Independent":
        """The same for another design."""
        base = Formulation.of(self, natural)
        return Independent(base.natural, self.family, self.topology, self.listed, None, self.freedom, self.independent)

    def assemblies(self, values: dict[str, float], starts: int | None = None, seed: int = 0) -> Motion:
        """All poses with these values of the independent coordinates that are found from many starts.

        The list is observed, not proved: a pose that hardly any start leads to may be missing.

        Args:
            values: a number for every independent coordinate.
            starts: how many random starts, in each of which every body is whole and somewhere else. If not given, so
                many that the list is stable: 2048 at least, four times as many as the last new pose took, and every
                pose found five times; 16,384 at most.
            seed: another number gives other starts.

        Returns:
            The poses of the natural mechanism, ``(assemblies,)``; the one nearest to the drawing first. Each is a
            solution to rounding, and no two are the same.

        Raises:
            InputError: coordinates that are missing, or not of this formulation.
        """
        names = [v.name for v in self.listed]
        if set(values) != set(names):
            raise InputError(f"assemblies() takes a value of each of {', '.join(names)}; got {', '.join(values)}")
        return assemblies(self.natural, {name: float(values[name]) for name in names}, starts, seed)
