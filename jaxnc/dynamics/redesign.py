"""How the numbers of a motion change with the design, in NumPy: numbers carry their changes along the last axis.

Every number of a motion follows from few parameters by functions that the host can read, so that the derivative of a
simulation by the design needs nothing compiled but what goes through the simulation itself.
"""

from typing import Any, cast

import numpy as np

from jaxnc.dynamics import inertia
from jaxnc.dynamics.adjoint import Law
from jaxnc.dynamics.extended import shown, spans
from jaxnc.dynamics.model import force_constants, force_formula
from jaxnc.solvers.assembly import free_plan, hosted
from jaxnc.solvers.host import HostView
from jaxnc.solvers.plan import Plan
from jaxnc.system.design import Drawn, carry_design, unit_formula
from jaxnc.system.equations import Equations, equations, renumbered
from jaxnc.system.frames import spread
from jaxnc.system.host import from_jax
from jaxnc.system.structure import readable
from jaxnc.system.system import System
from jaxnc.system.topology import Topology

DERIVED = "constants", "linear", "quadratic", "mass", "moments", "gravity", "forces"
"""Of a `Law`: what follows from the design."""

_DEPENDENT = 1e-7  # of the largest singular value: rows below are redundant
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
        self.given, self.system = x, system
        with np.errstate(all="ignore"):
            vectors = x["vectors"]
            if inner is not top:
                vectors = np.concatenate([vectors, _across(top, x["points"], _units(vectors, top.dim))])
            self.drawn = self._carry(inner, vectors)

    def _carry(self, top: Topology, vectors: np.ndarray) -> Drawn:
        parts = (self.given["points"], vectors, self.given["markers"], self.given["dimensions"])
        return carry_design(top, np.concatenate([part.reshape(-1, 1 + self.count) for part in parts]))

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

    def pose(self, view: Plan, q: np.ndarray) -> np.ndarray:
        """Changes of a pose ``(N, changes + known)``, by the parameters and then by the known coordinates of a plan."""
        host, home = HostView(view, hosted(self.eq)), self.drawn.home
        count, more = self.count, len(view.known)
        at = np.zeros((len(q), 1, 1 + count + more))
        at[:, 0, 0] = q
        at[view.fixed, 0, 1 : 1 + count] = home[view.fixed, 1:]
        at[view.known, 0, 1 + count + np.arange(more)] = 1.0
        wide = tuple(np.concatenate([c, np.zeros((*c.shape[:-1], more))], axis=-1) for c in self.drawn.constants)
        right = np.moveaxis(host.eq.changes(at, (), wide)[view.rows], 1, 0)
        at[view.unknown, 0, 1:] = -host.solve(host.matrices(q[:, None])[0], right)[0]
        return np.where(np.isfinite(at).all(), at[:, 0, 1:], 0.0)

    def start(self, q: np.ndarray, still: tuple[int, ...]) -> np.ndarray:
        """Changes of an assembled start ``(N, changes)``: see `jaxnc.solvers.newton.attach_start`."""
        top, x = self.system.topology, q
        drawn, eq, view = self.drawn, self.eq, free_plan(top)
        if self.top is not top:  # hidden vectors follow from what is moved
            drawn, x = self._carry(top, self.given["vectors"]), q[shown(top)]
            eq = equations(System(top, self.parameters.in_numpy()))
        host, at = hosted(eq) if eq is self.eq else from_jax(eq), drawn.home.copy()
        at[:, 0] = x
        put = np.isin(view.unknown, still)
        at[view.unknown[put], 1:] = 0.0
        weight = host.weights[view.unknown]
        slopes = host.jacobian(x[:, None])[0][np.ix_(view.rows, view.unknown)] / weight
        left = host.changes(at[:, None], (), drawn.constants)[view.rows, 0]
        if not (np.isfinite(slopes).all() and np.isfinite(left).all()):
            return np.zeros((len(q), self.count))
        for some in [np.where(put, 0.0, slopes), slopes] if put.any() else [slopes]:
            step = np.linalg.pinv(some, rcond=_DEPENDENT) @ left
            at[view.unknown, 1:] -= step / weight[:, None]
            left = left - slopes @ step
        return (at if self.top is top else _lifted(top, at))[:, 1:]


def _across(top: Topology, points: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Hidden vectors ``(hidden, 3, 1 + changes)``."""
    return _units(np.stack([_cross(a, b) for a, b in spans(top, points, vectors)]), top.dim)


def _lifted(top: Topology, x: np.ndarray) -> np.ndarray:
    """Coordinates ``(N, 1 + changes)`` with those of hidden vectors."""
    points, vectors = (np.moveaxis(np.asarray(part), 0, -1) for part in spread(top, cast(Any, x.T)))
    split = (len(top.points) + len(top.vectors)) * top.dim
    return np.concatenate([x[:split], _across(top, points, vectors).reshape(-1, x.shape[-1]), x[split:]])


def _units(x: np.ndarray, dim: int) -> np.ndarray:
    """Directions ``(n, dim, 1 + changes)`` divided by their lengths."""
    return np.stack(unit_formula(dim).carrying(list(np.moveaxis(x, 1, 0))), axis=1) if len(x) else x


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The vector across two, each ``(3, 1 + changes)``."""
    found = np.cross(a[:, :1], b, axis=0) + np.cross(a, b[:, :1], axis=0)
    found[:, 0] *= 0.5
    return found
