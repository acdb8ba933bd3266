"""How the numbers of a motion change with the design, in NumPy: numbers carry their changes along the last axis.

Every number of a motion follows from few parameters by functions that the host can read, so that the derivative of a
simulation by the design needs nothing compiled but what goes through the simulation itself.
"""

import numpy as np

from jaxnc.dynamics import inertia
from jaxnc.dynamics.adjoint import Law
from jaxnc.dynamics.extended import spans
from jaxnc.dynamics.model import force_constants, force_formula
from jaxnc.solvers.assembly import hosted
from jaxnc.solvers.host import HostView
from jaxnc.solvers.plan import Plan
from jaxnc.system.design import Drawn, carry_design, unit_formula
from jaxnc.system.equations import Equations, renumbered
from jaxnc.system.host_kinds import readable
from jaxnc.system.system import System
from jaxnc.system.topology import Topology

DERIVED = "constants", "linear", "quadratic", "mass", "moments", "gravity", "forces"
"""Of a `Law`: what follows from the design."""

_FIELDS = "points", "vectors", "markers", "dimensions", "physical"


def suits(top: Topology) -> bool:
    """Whether the host can differentiate all that a mechanism's motion is made of."""
    inner = top.extended or top
    kinds = all(f.kind.drawn is None or force_formula(f.kind, inner.dim).program for f in inner.loads.forces)
    return not inner.rates and not inner.large and readable(inner) and kinds


class Carried:
    """The numbers of a motion with their changes by all parameters of the design.

    `eq` are the equations that its dynamics works on.
    """

    def __init__(self, system: System, eq: Equations):
        top, self.eq = system.topology, eq
        self.top = inner = top.extended or top
        par = {name: np.asarray(getattr(system.parameters, name)) for name in _FIELDS}
        ends = np.cumsum([0, *(x.size for x in par.values())])
        self.parameters, self.count = system.parameters, int(ends[-1])
        flat = np.concatenate(
            [np.concatenate([x.reshape(-1) for x in par.values()])[:, None], np.eye(self.count)], axis=1
        )
        x = {
            name: flat[a:b].reshape(*value.shape, 1 + self.count)
            for (name, value), a, b in zip(par.items(), ends[:-1], ends[1:], strict=True)
        }
        self.given = x
        with np.errstate(all="ignore"):
            vectors = x["vectors"]
            if inner is not top:
                directions = _units(vectors, top.dim)
                across = [_cross(a, b) for a, b in spans(top, x["points"], directions)]
                vectors = np.concatenate([vectors, _units(np.stack(across), top.dim)])
            parts = (x["points"], vectors, x["markers"], x["dimensions"])
            geometry = np.concatenate([part.reshape(-1, 1 + self.count) for part in parts])
            self.drawn: Drawn = carry_design(inner, geometry)

    def law(self) -> Law:
        """All numbers that accelerations depend on, but for those that are parameters as they are given."""
        top, loads, physical = self.top, self.top.loads, self.given["physical"]
        constants = self.drawn.constants
        eq = renumbered(self.eq, constants, [np.asarray(scale) for scale in self.eq.scales])
        mass, moments, _ = inertia.summed(top, self._inertias())
        gravity = physical[list(loads.gravity)] if loads.gravity else np.zeros((top.dim, 1 + self.count))
        forces = tuple(force_constants(top, self.drawn.home, block, physical) for block in loads.forces)
        return Law(constants, eq.linear, eq.quadratic, mass, moments, gravity, forces, (), (), ())

    def _inertias(self) -> list:
        points, drawing, vectors = self.given["points"], self.drawn.drawing, self.drawn.vectors
        out = []
        for group in self.top.loads.inertias:
            numbers = inertia.numbers_of(self.top.dim, group, points, drawing, vectors, self.given["physical"])
            out.append(inertia.group_on_lanes(self.top, group, numbers))
        return out

    def pose(self, view: Plan, q: np.ndarray, drawn_there: bool) -> np.ndarray:
        """Changes of an assembled pose ``(N, changes + known)``, by the parameters and then by its known coordinates.

        The known coordinates of `view`, which the others follow from, may move as they do in the drawing.
        """
        host, home = HostView(view, hosted(self.eq)), self.drawn.home
        count, more = self.count, len(view.known)
        at = np.zeros((len(q), 1, 1 + count + more))
        at[:, 0, 0] = q
        at[view.fixed, 0, 1 : 1 + count] = home[view.fixed, 1:]
        if drawn_there:
            at[view.known, 0, 1 : 1 + count] = home[view.known, 1:]
        at[view.known, 0, 1 + count + np.arange(more)] = 1.0
        wide = tuple(np.concatenate([c, np.zeros((*c.shape[:-1], more))], axis=-1) for c in self.drawn.constants)
        right = np.moveaxis(host.eq.changes(at, (), wide)[view.rows], 1, 0)
        at[view.unknown, 0, 1:] = -host.solve(host.matrices(q[:, None])[0], right)[0]
        return np.where(np.isfinite(at).all(), at[:, 0, 1:], 0.0)


def _units(x: np.ndarray, dim: int) -> np.ndarray:
    """Directions ``(n, dim, 1 + changes)`` divided by their lengths."""
    return np.stack(unit_formula(dim).carrying(list(np.moveaxis(x, 1, 0))), axis=1) if len(x) else x


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The vector across two, each ``(3, 1 + changes)``."""
    found = np.cross(a[:, :1], b, axis=0) + np.cross(a, b[:, :1], axis=0)
    found[:, 0] *= 0.5
    return found
