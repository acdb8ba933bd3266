"""How the numbers of a motion change with its design: the host knows, also where compiled code asks for it.

Every number of a motion follows from few parameters by functions that the host can read, so that the derivative of a
simulation by the design needs nothing compiled but what goes through the simulation itself. In NumPy, numbers carry
their changes along the last axis.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.extended import across_vectors, lift, shown_places
from jaxnc.dynamics.flow import Law
from jaxnc.dynamics.mass import group_inertias, sum_inertias
from jaxnc.dynamics.model import drawn_parameters, force_constants
from jaxnc.dynamics.runs import SimulationSpec
from jaxnc.solvers.assembly import free_plan, to_host
from jaxnc.solvers.host import HostView
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.traced import PIECE, ask_host, shorten_equations
from jaxnc.system.design import Drawn, carry_design, unit_formula
from jaxnc.system.equations import Equations, equations, renumbered
from jaxnc.system.host import from_jax
from jaxnc.system.structure import readable
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Float, Numbers, PyTree

DERIVED = "constants", "linear", "quadratic", "mass", "moments", "gravity", "forces"
"""Numbers of a `Law` that follow from the design."""

Origin = Plan | tuple[int, ...] | None
"""What a start follows from: the known coordinates of a plan, the drawing but for some coordinates, or nothing."""

_GEOMETRY = "points", "vectors", "markers", "dimensions", "physical"


def host_differentiates(top: Topology) -> bool:
    """Tell whether the host can differentiate all that a mechanism's motion is made of."""
    inner = top.extended or top
    kinds = all(f.kind.drawn is None or drawn_parameters(f.kind, inner.dim)[0].program for f in inner.loads.forces)
    return not inner.rates and not inner.large and not inner.loads.friction and readable(inner) and kinds


class DesignChanges:
    """The numbers of a motion with their changes by all parameters of the design.

    `eq` are the equations that its dynamics works on.
    """

    def __init__(self, system: System, eq: Equations):
        top, self.eq, self.system = system.topology, eq, system
        self.top = inner = top.extended or top
        par = {name: np.asarray(getattr(system.parameters, name)) for name in _GEOMETRY}
        ends = np.cumsum([0, *(x.size for x in par.values())])
        self.count = int(ends[-1])
        values = np.concatenate([x.reshape(-1) for x in par.values()])
        flat = np.concatenate([values[:, None], np.eye(self.count)], axis=1)
        self.given = x = {
            name: flat[a:b].reshape(*value.shape, 1 + self.count)
            for (name, value), a, b in zip(par.items(), ends[:-1], ends[1:], strict=True)
        }
        with np.errstate(all="ignore"):
            vectors = x["vectors"]
            if inner is not top:
                units = np.stack(unit_formula(top.dim).carrying(list(np.moveaxis(vectors, 1, 0))), axis=1)
                vectors = np.concatenate([vectors, across_vectors(top, x["points"], units)])
            self.drawn = self._carry(inner, vectors)

    def _carry(self, top: Topology, vectors: np.ndarray) -> Drawn:
        parts = (self.given["points"], vectors, self.given["markers"], self.given["dimensions"])
        return carry_design(top, np.concatenate([part.reshape(-1, 1 + self.count) for part in parts]))

    def law(self) -> Law:
        """Return all numbers that accelerations depend on, but parameters that are used as they are given."""
        top, x, drawn, loads = self.top, self.given, self.drawn, self.top.loads
        physical, constants = x["physical"], drawn.constants
        eq = renumbered(self.eq, constants, [np.asarray(scale) for scale in self.eq.scales])
        found = group_inertias(top, x["points"], drawn.drawing, drawn.vectors, physical)
        mass, moments, _ = sum_inertias(top, found)
        gravity = physical[list(loads.gravity)] if loads.gravity else np.zeros((top.dim, 1 + self.count))
        forces = tuple(force_constants(top, drawn.home, block, physical) for block in loads.forces)
        return Law(constants, eq.linear, eq.quadratic, mass, moments, gravity, forces, (), (), ())

    def pose(self, view: Plan, q: np.ndarray) -> np.ndarray:
        """Return changes of a pose ``(N, changes + known)``, by the parameters, then by a plan's known coordinates."""
        host, home = HostView(view, to_host(self.eq)), self.drawn.home
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
        """Return changes of an assembled start ``(N, changes)``: see `jaxnc.solvers.newton.attach_start`."""
        top, x = self.system.topology, q
        drawn, eq, view = self.drawn, self.eq, free_plan(top)
        if self.top is not top:  # hidden vectors follow from what is moved
            drawn, x = self._carry(top, self.given["vectors"]), q[shown_places(top)]
            eq = equations(System(top, self.system.parameters.in_numpy()))
        host, at = to_host(eq) if eq is self.eq else from_jax(eq), drawn.home.copy()
        at[:, 0] = x
        put = np.isin(view.unknown, still)
        at[view.unknown[put], 1:] = 0.0
        weight = host.weights[view.unknown]
        slopes = host.jacobian(x[:, None])[0][np.ix_(view.rows, view.unknown)] / weight
        left = host.changes(at[:, None], (), drawn.constants)[view.rows, 0]
        if not (np.isfinite(slopes).all() and np.isfinite(left).all()):
            return np.zeros((len(q), self.count))
        for some in [np.where(put, 0.0, slopes), slopes] if put.any() else [slopes]:
            # 1e-7 of the largest singular value: rows below are redundant
            step = np.linalg.pinv(some, rcond=1e-7) @ left
            at[view.unknown, 1:] -= step / weight[:, None]
            left = left - slopes @ step
        return lift(top, at)[:, 1:]


def pull_back_design(
    spec: SimulationSpec,
    origin: Origin,
    parameters: Parameters,
    eq: Equations,
    at: np.ndarray,
    pose_bar: np.ndarray,
    law_bar: Law,
) -> np.ndarray:
    """Pull changes of a start and of the numbers of a motion back to the design, in NumPy.

    Args:
        spec: the simulation.
        origin: what the start follows from.
        parameters: of the design.
        eq: the equations that its dynamics works on.
        at: the start.
        pose_bar: the changes of the start.
        law_bar: the changes of the numbers.

    Returns:
        Changes of all parameters, then of the known coordinates of an assembled start, one after the other.
    """
    with np.errstate(all="ignore"):
        changes = DesignChanges(spec.system(parameters), eq)
        found, law = np.zeros(changes.count), changes.law()
        for name in DERIVED:
            for bar, value in zip(*(jax.tree.leaves(getattr(x, name)) for x in (law_bar, law)), strict=True):
                found = found + np.tensordot(bar, value[..., 1:], bar.ndim)
        if origin is None:
            return found
        if not isinstance(origin, Plan):
            return found + pose_bar @ changes.start(at, origin)
        through = pose_bar @ changes.pose(origin, at)
    return np.concatenate([found + through[: changes.count], through[changes.count :]])


def request_pull_back(
    spec: SimulationSpec,
    origin: Origin,
    parameters: Parameters,
    eq: Equations,
    at: Array,
    pose_bar: Array,
    law_bar: Law,
) -> Float[Array, " changes"] | None:
    """Ask the host for `pull_back_design` in traced code; None where its arguments are too large for that."""
    count = len(origin.known) if isinstance(origin, Plan) else 0
    par = tuple(getattr(parameters, name) for name in _GEOMETRY)
    law = tuple(getattr(law_bar, name) for name in DERIVED)
    given = (par, shorten_equations(eq), at, jnp.zeros(0) if origin is None else pose_bar, law)
    if max(x.size for x in jax.tree.leaves(given)) > PIECE:
        return None
    leaves, structure = jax.tree.flatten(given)
    _read_programs(spec, origin, tuple((x.shape, x.dtype.name) for x in leaves), structure)
    like = jax.ShapeDtypeStruct((sum(x.size for x in par) + count,), at.dtype)
    answer = functools.partial(_answer, spec, origin)
    return ask_host(
        "differentiated a design", like, answer, *given, given_up=lambda *_: np.zeros(like.shape, like.dtype)
    )


def _answer(
    spec: SimulationSpec, origin: Origin, par: PyTree, eq: Equations, at: np.ndarray, pose: np.ndarray, law: Any
) -> np.ndarray:
    whole = Law(**dict.fromkeys(Law._fields, ()) | dict(zip(DERIVED, law, strict=True)))
    return pull_back_design(spec, origin, Parameters(*par), eq, at, pose, whole).astype(at.dtype)


@functools.lru_cache(maxsize=256)
def _read_programs(spec: SimulationSpec, origin: Origin, shapes: tuple, structure: object) -> None:
    """Have the host read all programs that it needs, on any numbers: inside of compiled code it may not trace."""
    rng = np.random.default_rng(0)
    numbers = [rng.uniform(0.5, 1.5, shape).astype(dtype) for shape, dtype in shapes]
    _answer(spec, origin, *jax.tree.unflatten(structure, numbers))


def join_parameters(parameters: Parameters, found: Numbers, own: PyTree) -> tuple[Parameters, Numbers]:
    """Put changes of all parameters ``(changes,)``, and of the functions' own, together as parameters.

    Returns:
        The changes as parameters, and changes behind them.
    """
    parts, start = [], 0
    for name in _GEOMETRY:
        shape = np.shape(getattr(parameters, name))
        end = start + int(np.prod(shape, dtype=int))
        parts.append(found[start:end].reshape(shape))
        start = end
    return Parameters(*parts, own=own), found[start:]
