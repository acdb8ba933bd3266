"""Forces in a page that calculates: those that the library finds, read as programs of a pose's numbers.

The page knows the pose, its rates and the multipliers that it finds for them. Everything else is traced from the
functions of `jaxnc.dynamics`, so that no force is stated a second time.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.extended import extended, lift, lift_rates
from jaxnc.dynamics.model import Dynamics, dynamics, forces, mass_matrix
from jaxnc.dynamics.reactions import Reactions, nodal_forces
from jaxnc.dynamics.wrenches import Ledger
from jaxnc.reading import Unreadable, trace
from jaxnc.reading.javascript import javascript
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import jacobian, renumbered, weights
from jaxnc.system.frames import mass_centres
from jaxnc.system.precision import WIDE, numbers
from jaxnc.system.system import System
from jaxnc.types import Array
from jaxnc.viz.arrows import Arrows
from jaxnc.viz.pages.packing import input_names
from jaxnc.viz.poses import Poses
from jaxnc.viz.quantities import force_values

_NAMES = ("q", "m", "d", "c", "v", "a", "t", "l")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class PosedReactions(Reactions):
    """Reactions of one pose whose equations of motion are given."""

    equations: Dynamics

    def _states(self) -> tuple[Dynamics, Any, Any, Any, Any]:
        top, (v, a) = self.motion.system.topology, self.motion.rates
        q = self.motion.q
        if top.extended is None:
            return self.equations, self.motion.time, q, v, a
        dq, ddq = jax.jvp(lambda q, v: lift_rates(top, q, v), (q[0], v[0]), (v[0], a[0]))
        return self.equations, self.motion.time, lift(top, q[0])[None], dq[None], ddq[None]

    def _ledger(self) -> Ledger:
        """Collect all wrenches, once: there is one trace."""
        return self._own_ledger

    @functools.cached_property
    def _own_ledger(self) -> Ledger:
        return super()._ledger()


def page_forces(
    data: Poses, view: Plan, drawn: Sequence[Arrows], plotted: Sequence[str]
) -> tuple[dict[str, str], int, dict[str, object] | None]:
    """Write functions of a page that find forces.

    Of forces that are drawn the page wants places (where these are no points) and forces; of those that are plotted, if
    they are vectors, their sizes, then their components.

    Returns:
        JavaScript by heads: `pushes`, what rows must hold along the unknowns, Q - M a; `forces`, all that is drawn and
        plotted; `inner`, derivatives of the rows, where dynamics has other coordinates. How many numbers `forces` are.
        And the view of the dynamics, with the weights of its unknowns, where it has other coordinates.
    """
    top = data.topology
    if top.extended is not None and top.dim == 2:
        raise Unreadable("bodies of its dynamics have coordinates that a page does not solve for")
    if top.loads.friction:
        raise Unreadable("friction depends on the forces themselves")
    if top.rates:
        raise Unreadable("bodies roll without slip")
    origin = data.reactions.motion.system
    dyn, plane = dynamics(extended(origin)), top.dim == 2
    whole = dyn.topology
    view = plan(whole, data.motion.driven, data.motion.held) if top.extended is not None else view
    counts = [(block.count, len(block.kind.constants), len(block.kind.rows)) for block in top.blocks]
    n, driven = len(top.coordinates), (*data.motion.driven, *data.motion.held)
    shapes = ((n,), (len(top.markers), top.dim), (len(top.dimensions),), (sum(k * (c + r) for k, c, r in counts),))
    shapes = (*shapes, (n,), (n,), (), (len(view.rows),))

    def redrawn(q: Array, m: Array, d: Array, c: Array) -> tuple[System, Dynamics]:
        """In the plane the page may have changed the mechanism."""
        system = _redrawn(origin, q, m, d)
        constants, scales, first = [], [], 0
        for count, width, rows in counts:
            own = c[first : first + count * (width + rows)].reshape(count, width + rows)
            constants.append(own[:, :width])
            scales.append(own[:, width:])
            first += own.size
        mass, moments, total = mass_matrix(system)
        eq = renumbered(dyn.eq, constants, scales)
        return system, dataclasses.replace(dyn, eq=eq, mass=mass, moments=moments, total=total, system=system)

    def pose(q: Array, m: Array, d: Array, c: Array, v: Array, a: Array, t: Array, l: Array) -> PosedReactions:  # noqa: E741
        system, made = redrawn(q, m, d, c) if plane else (origin, dyn)
        motion = dataclasses.replace(
            data.motion, system=system, poses=q[None], rates=(v[None], a[None]), asked=jnp.zeros((1, len(driven))),
            status=np.zeros(1, int), residual=None, conditioning=None, time=t[None],
        )  # fmt: skip
        multipliers = jnp.zeros((1, len(whole.rows))).at[:, view.rows].set(l)
        found = PosedReactions(motion, multipliers, jnp.zeros((1, len(driven))), made)
        at = np.array([whole.position[name] for name in driven], int)
        return PosedReactions(motion, multipliers, found._whole()[:, at], made)

    def every(*x: Any) -> list[Any]:
        found = pose(*x)
        known, (made, t, q, v, a) = nodal_forces(found), found._states()
        out = [jacobian(made.eq, q[0])[view.rows][:, view.unknown]]
        out.append((forces(made, t[0], q[0], v[0]) - made.mass @ a[0])[view.unknown])
        for one in drawn:
            for k, i in enumerate(one.chosen):
                places, vectors = known[one.noun]
                out += [places[0, i]] if one.point(data, k) is None else []
                out.append(vectors[0, i])
        for name in plotted:
            value = force_values(found, name)[0]
            out += [jnp.sqrt(jnp.sum(value * value))[None], value] if value.ndim else [value[None]]
        return out

    try:
        with numbers(WIDE):
            read = trace(every, *shapes, values_only=True)
    except Unreadable as reason:
        raise Unreadable(f"a load of theirs cannot be read ({reason.primitive})") from None
    count, cells = len(view.unknown), len(view.rows) * len(view.unknown)
    slopes, rest = read.outputs[:cells], read.outputs[cells:]
    at = [k for k, node in enumerate(slopes) if read.nodes[node].op != "number" or read.nodes[node].value[1] != 0]
    programs: dict[str, tuple[Sequence[int], tuple[int, ...]]]
    programs = {"pushes": (range(count), rest[:count]), "forces": (range(len(rest) - count), rest[count:])}
    if whole is not top:
        programs["inner"] = at, tuple(slopes[k] for k in at)
    names = input_names(*((x, math.prod(shape) if shape else None) for x, shape in zip(_NAMES, shapes, strict=True)))
    out = {
        f"{name}({','.join(_NAMES)},o)": javascript(read.wanted(nodes), names, lambda k, to=to: f"o[{to[k]}]")
        for name, (to, nodes) in programs.items()
    }
    if sum(map(len, out.values())) > 60_000:  # characters of the programs that a page still carries
        raise Unreadable("the mechanism has too many bodies")
    inner: dict[str, object] = {  # nothing is driven there
        "unknown": view.unknown.tolist(), "rows": len(view.rows), "driven": [], "guards": 0,
        "length": float(dyn.eq.length), "weights": np.asarray(weights(dyn.eq))[view.unknown].tolist(),
    }  # fmt: skip
    return out, len(rest) - count, None if whole is top else inner


def _redrawn(system: System, q: Array, m: Array, d: Array) -> System:
    """Redraw a planar system as it stands in a pose: a changed mechanism has no other drawing in a page.

    Centres of mass that are given as places keep theirs on their bodies.
    """
    par = system.parameters
    points = q[: par.points.size].reshape(par.points.shape)
    physical = jnp.asarray(np.asarray(par.physical))
    for one in mass_centres(system):
        along = points[one.segment[1]] - points[one.segment[0]]
        x, y = along / jnp.sqrt(jnp.sum(along * along))
        place = points[one.foot] + one.local @ jnp.array([[x, y], [-y, x]])
        physical = physical.at[np.array(one.at)].set(place)
    return dataclasses.replace(
        system, parameters=dataclasses.replace(par, points=points, markers=m, dimensions=d, physical=physical)
    )
