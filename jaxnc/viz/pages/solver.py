"""Equations of a page: those of a mechanism in JavaScript, and the numbers that they start from.

A page draws a changed mechanism as its pose stands: `page_design` is the program that reads its dimensions off again.

Forces are those that the library finds, read as programs of a pose's numbers. The page knows the pose, its rates and
the multipliers that it finds for them. Everything else is traced from the functions of `jaxnc.dynamics`, so that no
force is stated a second time.

A program becomes the body of a JavaScript function. A number that is used once stands where it is used, so that the
text is short; every other one has a name.
"""

import dataclasses
import functools
import itertools
import math
import string
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.constraints.coordinates import from_drawing
from jaxnc.constraints.elementary import Small
from jaxnc.constraints.joints import FOLLOWING
from jaxnc.constraints.kind import norm
from jaxnc.dynamics.extended import extended, lift, lift_rates
from jaxnc.dynamics.model import Dynamics, dynamics, forces, mass_matrix
from jaxnc.dynamics.reactions import Reactions, nodal_forces
from jaxnc.dynamics.wrenches import Ledger
from jaxnc.errors import InputError
from jaxnc.io.files import plain
from jaxnc.kinematics.design import geometry_vector
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.reading import Builder, Program, Unreadable, rate, trace, write
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.plan import Plan, plan
from jaxnc.solvers.rows import count_numbers, write_rows
from jaxnc.system.design import Step, carry_design, design, run_steps
from jaxnc.system.equations import jacobian, renumbered, weights
from jaxnc.system.frames import marker_program, mass_centres
from jaxnc.system.host import HostEquations, from_jax
from jaxnc.system.identity import Dimension, Owner, Quantity, Thing
from jaxnc.system.precision import WIDE, numbers
from jaxnc.system.structure import program, readable
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array
from jaxnc.viz.annotations import Arrows
from jaxnc.viz.pages.content import input_names, pack_exactly, round_numbers
from jaxnc.viz.poses import Poses, evenly
from jaxnc.viz.quantities import force_values

if TYPE_CHECKING:
    from jaxnc.kinematics.modes import Modes, ModesMap


FUNCTIONS = (
    "const {sqrt,abs,sign,sin,cos,tan,asin,acos,atan,atan2,sinh,cosh,tanh,exp,log,log1p,expm1,pow,max,min,floor,ceil}="
    "Math,rint=x=>{const f=floor(x),d=x-f;return d<.5||d===.5&&f%2===0?f:f+1};"
)
"""What the bodies need in front of them."""

_BINARY = {
    "add": ("+", 11), "sub": ("-", 11), "mul": ("*", 12), "div": ("/", 12), "rem": ("%", 12), "lt": ("<", 9),
    "le": ("<=", 9), "gt": (">", 9), "ge": (">=", 9), "eq": ("===", 8), "ne": ("!==", 8), "and": ("&&", 4),
    "or": ("||", 3),
}  # fmt: skip
"""Signs, and how strongly they bind; all of them from the left."""
_WHOLE, _NOT, _POWER, _TIMES, _PLUS, _CHOICE = 20, 14, 13, 12, 11, 2
_NAMED = {"round": "rint", "finite": "isFinite"}


def javascript(program: Program, given: Callable[[int], str], into: Callable[[int], str]) -> str:
    """Write statements that calculate a program's outputs; in front of them belongs `FUNCTIONS`.

    `given` is what stands for each input, `into` what each output is assigned to; neither begins with a capital letter.
    """
    uses = Counter(i for node in program.nodes for i in node.of) + Counter(program.outputs)
    text: list[tuple[str, int]] = []  # of each node, and how strongly it is bound
    named: list[str] = []
    names = _short_names()

    def bracket(i: int, least: int) -> str:
        shown, strength = text[i]
        return shown if strength >= least else f"({shown})"

    for k, (op, of, value) in enumerate(program.nodes):
        strength = _WHOLE
        if op == "input":
            term = given(value)
        elif op == "number":
            term = _script_literal(value[1])
        elif op in _BINARY:
            sign, strength = _BINARY[op]
            term = f"{bracket(of[0], strength)}{sign}{bracket(of[1], strength + 1)}"
        elif op == "neg":
            term, strength = f"-{bracket(of[0], _WHOLE)}", _PLUS
        elif op == "not":
            term, strength = f"!{bracket(of[0], _WHOLE)}", _NOT
        elif op == "power":
            term, strength = f"{bracket(of[0], _WHOLE)}**{abs(value)}", _POWER
            if value < 0:
                term, strength = f"1/{term}", _TIMES
        elif op == "float":
            term, strength = f"{bracket(of[0], _CHOICE + 1)}?1:0", _CHOICE
        elif op == "select":
            term, strength = "{}?{}:{}".format(*(bracket(i, _CHOICE + 1) for i in of)), _CHOICE
        else:
            term = f"{_NAMED.get(op, op)}({','.join(text[i][0] for i in of)})"
        if uses[k] > 1 and op not in ("input", "number"):
            name = next(names)
            named.append(f"{name}={term}")
            term, strength = name, _WHOLE
        text.append((term, strength))
    lines = [f"const {','.join(named)}"] if named else []
    lines += [f"{into(r)}={text[k][0]}" for r, k in enumerate(program.outputs)]
    return ";".join(lines)


def _short_names() -> Iterator[str]:
    """Yield short names that begin with a capital letter, and are none of the language's."""
    letters = string.ascii_uppercase + string.ascii_lowercase + string.digits
    for size in itertools.count(1):
        for first in string.ascii_uppercase:
            for rest in itertools.product(letters, repeat=size - 1):
                name = first + "".join(rest)
                if name != "NaN":
                    yield name


def _script_literal(value: float | bool) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "(1/0)" if value > 0 else "(-1/0)"
    shown = repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)
    return shown.removeprefix("0") or "0" if math.copysign(1.0, value) > 0 else f"({shown if value else '-0'})"


# -- forces ------------------------------------------------------------------------------------------------------------


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


# -- equations ---------------------------------------------------------------------------------------------------------


LARGEST = {2: 80, 3: 150}
"""Unknowns of the largest mechanisms that a page calculates with, by dimension."""


class Refused(Exception):
    """Why a page cannot calculate by itself, as a sentence."""


def page_solver(
    data: Poses,
    model: Mechanism | None = None,
    drawn: Sequence[Arrows] = (),
    plotted: Sequence[str] = (),
    modes: "bool | Modes | ModesMap" = False,
) -> tuple[str, dict[str, Any]]:
    """Write the equations of a motion's mechanism as JavaScript, and the numbers that go with them.

    Of the arrows those of forces are found again, and so are forces that are plotted. The `model` is what was compiled,
    for a model file of a changed design. Of the `modes` a page has start poses of all assemblies.

    Returns:
        An object of functions, as text; and what the page's solver reads beside it: why forces are not found again, if
        there are some, in ``"unforced"``.
    """
    motion, top = data.motion, data.topology
    if not data.good.any():
        raise Refused("No pose of this motion is right, so that there is none to start from.")
    view = plan(top, tuple(motion.driven), tuple(motion.held)) if motion.driven else None
    if view is None or motion.conditioning is None or not len(view.unknown):
        raise Refused("This motion has no inputs to drive.")
    if len(view.unknown) > LARGEST[top.dim]:
        raise Refused(f"This mechanism has {len(view.unknown)} unknowns, more than a page solves for.")
    which = ("residual", "guard", "drawn", "measure")
    if not readable(top, which):
        wanted = ((b.kind, w) for b in top.blocks for w in which if getattr(b.kind, w) is not None)
        unread = next(kind.name for kind, w in wanted if program(kind, w, top.dim) is None)
        raise Refused(f"The constraint kind {unread!r} branches or loops by its numbers: a page cannot calculate it.")
    eq = from_jax(derive(motion.system))
    numbers = _numbers(data, view, eq)
    numbers["design"] = _design_file(motion.system, model)
    if modes is not False and modes is not None:
        numbers["assemblies"] = _page_modes(motion, view, modes)
    parts = _functions(top, view, len(motion.rates))
    if plotted or any(a.chosen for a in drawn):
        try:
            more, numbers["felt"], numbers["inner"] = page_forces(data, view, drawn, plotted)
            parts |= more
        except Unreadable as reason:
            numbers["unforced"] = f"only in the poses of the motion as it was given: {reason}"
        else:
            if top.dim == 3:
                numbers["unforced"] = "in space only with the dimensions as they were given"
    return f"(()=>{{{FUNCTIONS}return{{{','.join(f'{head}{{{text}}}' for head, text in parts.items())}}}}})()", numbers


def _page_modes(motion: Motion, view: Plan, given: "bool | Modes | ModesMap") -> list[dict[str, object]]:
    """List start poses of a page: inputs, and the unknowns of every assembly there.

    They are those of the motion's inputs where True is given. The page finds those at any inputs from them.
    """
    from jaxnc.kinematics.modes import Modes, ModesMap, modes

    found = given
    if given is True:
        asked = np.unique(np.asarray(motion.asked, float).reshape(-1, len(motion.driven)), axis=0)
        inputs = dict(zip(motion.driven, evenly(asked, 36).T, strict=True))  # every 10° of a turn
        found = modes(motion.system, inputs, hold=motion.held, unit="rad")
    if not isinstance(found, Modes | ModesMap):
        raise InputError(f"modes= takes True, or what jaxnc.modes found of this mechanism, got {type(found).__name__}")
    poses, top = found.poses, motion.system.topology
    if poses.system.topology != top or poses.system.parameters.points.ndim > 2:
        raise InputError(f"modes= takes assemblies of {top.name!r} and of one design, as jaxnc.modes finds them")
    if set(poses.driven) != set(motion.driven) or set(poses.held) != set(motion.held):
        raise InputError(
            f"modes= takes assemblies of {top.name!r} for the inputs of the motion, {', '.join(motion.driven)}, got "
            f"such for {', '.join(poses.driven) or 'no input'}; modes=True finds them"
        )
    q, good = np.asarray(poses.q, float), np.asarray(poses.converged)
    q, good = (a.reshape(-1, good.shape[-1], *a.shape[good.ndim :]) for a in (q, good)) if good.size else (q[:0], good)
    # A page may have 5000 numbers of them, 50 kB.
    most = max(1, 5000 // max(1, len(view.unknown) * int(good.sum(axis=-1).max(initial=0))))
    return [
        {"asked": [float(x) for x in some[0, list(view.driven)]], "q": round_numbers(some[:, view.unknown])}
        for some in (q[k, good[k]] for k in evenly(np.arange(len(q)), most))
        if len(some)
    ]


def _functions(top: Topology, view: Plan, rates: int) -> dict[str, str]:
    """Write functions of coordinates q and numbers c, by their heads; each fills the array that it is given last."""
    n, numbers = len(top.coordinates), count_numbers(top)
    b, name = Builder(n + numbers), input_names(("q", n), ("c", numbers))
    found = write_rows(view, b)
    driven = len(view.driven)

    def body(nodes: Iterable[int], into: Callable) -> str:
        return javascript(b.program([*nodes]), name, into)

    at = [r * len(view.unknown) + c for r, c in found.matrix]
    by = [r * driven + k for r, k in found.by_known]
    parts = {
        "rows(q,c,o)": body(found.rows, lambda k: f"o[{k}]"),
        "matrix(q,c,o)": body(found.matrix.values(), lambda k: f"o[{at[k]}]"),
        "driven(q,c,o)": body(found.by_known.values(), lambda k: f"o[{by[k]}]"),
        "guards(q,c,o)": body(found.guards, lambda k: f"o[{k}]"),
        "markers(q,k,o)": _markers(top),
    }
    if any(block.kind == FOLLOWING for block in top.blocks):
        parts["saved(q,c,d)"] = _factors_to_save(top)
    if rates > 1:
        parts["second(q,c,v,a,o)"] = _second(top, view)
    drawn = page_design(top)
    into = [f"c[{k}]" for k in drawn.constants]
    into += [f"{letter}[{k}]" for letter, size in zip("ske", drawn.outputs[1:], strict=True) for k in range(size)]
    names = input_names(("q", n), ("m", top.dim * len(top.markers)), ("d", len(top.dimensions)))
    parts["design(q,m,d,c,s,k,e)"] = javascript(drawn.program, names, lambda k: into[k])
    return parts


def _second(top: Topology, view: Plan) -> str:
    """Write second time derivatives of the rows where the unknowns have velocities and no accelerations."""
    n, numbers = len(top.coordinates), count_numbers(top)
    b = Builder(3 * n + numbers)
    row_of = {int(r): k for k, r in enumerate(view.rows)}
    moving, driven = {*view.unknown.tolist(), *view.driven}, set(view.driven)
    zero = b.number(0.0)
    rows, first = [zero] * len(view.rows), n
    for block, layout in zip(top.blocks, top.layout, strict=True):
        constants, found = len(block.kind.constants), program(block.kind, "residual", top.dim)
        for variables, at_rows in zip(layout.variables.tolist(), layout.rows.tolist(), strict=True):
            scales = b.first[first + constants : first + constants + len(at_rows)]
            inputs = [*(b.first[c] for c in variables), *b.first[first : first + constants]]
            first += constants + len(at_rows)
            asked = [(r, row_of[g]) for r, g in enumerate(at_rows) if g in row_of]
            if not asked or found is None:
                continue
            inputs += [b.first[n + numbers + c] if c in moving else zero for c in variables]
            inputs += [b.first[2 * n + numbers + c] if c in driven else zero for c in variables]
            twice = rate(found, range(len(variables)), 2)
            at = b.append(twice, inputs)
            for r, row in asked:
                rows[row] = b.op("mul", at[twice.outputs[r]], scales[r])
    names = input_names(("q", n), ("c", numbers), ("v", n), ("a", n))
    return javascript(b.program(rows), names, lambda k: f"o[{k}]")


def _markers(top: Topology) -> str:
    """Write places (directions) of the markers from the coordinates and their coefficients."""
    n, lines = len(top.coordinates), []
    b = Builder(n + top.dim * len(top.markers))
    for k, _ in enumerate(top.markers):
        found: Program = marker_program(top, k)
        at = b.append(found, [*b.first[:n], *b.first[n + top.dim * k : n + top.dim * (k + 1)]])
        lines += [at[i] for i in found.outputs]
    return javascript(b.program(lines), input_names(("q", n), ("k", b.inputs - n)), lambda k: f"o[{k}]")


def _factors_to_save(top: Topology) -> str:
    """Write the factors of polynomials between coordinates, counted from another drawing than the first one."""
    n, first = len(top.coordinates), 0
    b = Builder(n + count_numbers(top))
    found: dict[int, int] = {}  # nodes by their dimensions
    for block, layout in zip(top.blocks, top.layout, strict=True):
        for k, scalars in enumerate(layout.scalars.tolist()):
            if block.kind == FOLLOWING:
                given = {c: d for i, c, d in block.given if i == k}
                if not given.keys() >= set(range(3, max(given, default=0))):  # those above stay zero, and so does a0
                    raise Refused("A page needs every factor of a joint that follows another from a1 up to the last.")
                own = b.first[n + first : n + first + 7]
                x, factors = b.op("sub", b.first[scalars[1]], own[1]), own[2:]
                for j in (3, 2, 1, 0, 3, 2, 1, 3, 2, 3):  # Horner's scheme, for the value and for each slope
                    factors[j] = b.op("add", factors[j], b.op("mul", x, factors[j + 1]))
                found |= {d: factors[c - 2] if c > 2 else b.number(0.0) for c, d in given.items()}
            first += len(block.kind.constants) + len(block.kind.rows)
    at = list(found)
    return javascript(b.program([*found.values()]), input_names(("q", n), ("c", b.inputs - n)), lambda k: f"d[{at[k]}]")


def _numbers(data: Poses, view: Plan, eq: HostEquations) -> dict[str, object]:
    """Collect what the page's solver reads: indices, the pose to start from, inputs of all poses, dimensions."""
    motion, top = data.motion, data.topology
    good = np.flatnonzero(data.good)
    start = int(good[0])
    q = np.asarray(motion.q, float).reshape(data.count, -1)
    # A pose that was not found has no rates, but other dimensions may reach it: it gets those between its neighbours'.
    rates = [
        np.stack([np.interp(np.arange(data.count), good, x[good, k]) for k in view.driven], axis=1)
        for x in (np.asarray(x, float).reshape(data.count, -1) for x in motion.rates[:2])
    ]
    par = motion.system.parameters
    names = [top.coordinates[k] for k in view.driven]
    guards = [(block, program(block.kind, "guard", top.dim)) for block in top.blocks]
    tied = {k for block in top.blocks if not block.kind.measure for own in block.scalars for k in own}
    return {
        "start": start,
        "q": q[start].tolist(),
        "home": np.asarray(eq.home, float)[list(view.driven)].tolist(),
        "c": [float(x) for x in eq.numbers],
        "k": np.asarray(eq.markers, float).reshape(-1).tolist(),
        "d": np.asarray(par.dimensions, float).tolist(),
        "unknown": view.unknown.tolist(),
        "driven": list(view.driven),
        "names": names,
        "angles": [bool(top.is_angle(name)) for name in names],
        "periodic": [name in top.scalars and bool(top.periodic[top.scalars.index(name)]) for name in names],
        "counted": [k for k in np.flatnonzero(top.mark(top.angles)).tolist() if k in tied],  # whose turns count
        "rows": len(view.rows),
        "weights": [float(x) for x in np.asarray(eq.weights)[view.unknown]],
        "length": float(eq.length),
        "guards": sum(len(block.owners) * len(guard.outputs) for block, guard in guards if guard is not None),
        "asked": [pack_exactly(x) for x in np.asarray(motion.asked, float).reshape(data.count, -1).T],
        "rates": [[pack_exactly(x) for x in rate.T] for rate in rates],
        "points": list(top.points),
        "markers": [[m.name, m.direction] for m in top.markers],
        "fixed": [bool(x) for x in top.fixed],
        "dimensions": [  # explicit ones: what they are called, their unit, whether they are positive
            {
                "name": name,
                "unit": top.length_unit if one.quantity.long else "",
                "positive": one.quantity is Quantity.LENGTH,
            }
            for name, one in zip(top.dimensions, top.given, strict=True)
        ],
        "links": _links(motion.system),
    }


def _design_file(system: System, model: Mechanism | None) -> dict[str, object]:
    """Write a model file, and where points, vectors, markers and explicit dimensions stand in it; or their values.

    The drawing of the file may be another pose: planar centres of mass follow their bodies, springs keep their length.
    """
    top = system.topology
    dimensions = [[name] for name in top.dimensions]
    centred = [[*one.segment, one.foot, *one.local.tolist()] for one in mass_centres(system)]
    if model is None:
        names = [[[top.loads.physical[k]] for k in one.at] for one in mass_centres(system)]
        return {"file": {}, "points": [[p] for p in (*top.points, *top.vectors)],
                "markers": [[m.name] for m in top.markers],
                "dimensions": dimensions, "centres": centred, "centred": names}  # fmt: skip
    data = plain(model.model)
    home = np.asarray(from_jax(derive(system)).home, float)
    for spring in data.get("forces", {}).values():
        if spring["kind"] == "spring":
            start, end = (home[top.dim * k : top.dim * (k + 1)] for k in map(top.points.index, spring["points"]))
            spring["parameters"].setdefault("free", float(np.linalg.norm(end - start)))
        elif spring["kind"] == "coordinate spring":
            spring["parameters"].setdefault("free", float(home[top.position[spring["scalars"][0]]]))

    def place(name: str, tables: Sequence[str] = ("ground", "points")) -> list[str] | None:
        table = next((table for table in tables if name in data.get(table, {})), None)
        if table is None:
            return None
        return [table, name, "at"] if isinstance(data[table][name], dict) else [table, name]

    def marker(name: str) -> list[str] | None:
        one = data.get("markers", {}).get(name)
        if not isinstance(one, dict):
            return None if one is None else ["markers", name]
        return ["markers", name, "direction" if "direction" in one else "at"]

    for k, one in enumerate(top.given):
        dimensions[k] = _where(data, top, one)
    vectors = [place(v, ("ground_vectors", "vectors")) for v in top.vectors]
    return {"file": data, "points": [*map(place, top.points), *vectors],
            "markers": [marker(m.name) for m in top.markers], "dimensions": dimensions, "centres": centred,
            "centred": [[["bodies", one.body, "com", k] for k in (0, 1)] for one in mass_centres(system)]}  # fmt: skip


def _where(data: dict[str, Any], top: Topology, one: Dimension) -> list[Any]:
    """Find where a dimension stands in a model file; nowhere, if it is not known."""
    table = {
        Thing.BODY: "bodies", Thing.JOINT: "joints", Thing.RELATION: "relations", Thing.CONSTRAINT: "constraints"
    }.get(one.owner.thing)  # fmt: skip
    entry = data.get(table, {}).get(top.called(one.owner)) if table else None
    if not isinstance(entry, dict) or table is None:
        return []
    path = [table, top.called(one.owner)]
    for group in ("lengths", "terms", "constants"):
        if one.key in entry.get(group, {}):
            return [*path, group, one.key]
    point, _, axis = one.key.rpartition(".")
    if point in entry.get("local", {}):
        return [*path, "local", point, int(axis == "across")]
    if one.key in ("radius1", "radius2") and "radii" in entry:
        return [*path, "radii", int(one.key[-1]) - 1]
    return [*path, one.key] if isinstance(entry.get(one.key), float) else []


def _links(system: System) -> list[dict[str, object]]:
    """List lengths of links that are read off the drawing: two points, and which of the numbers follow from them."""
    top, first = system.topology, 0
    at: dict[Owner, list[int]] = {}
    constants: list[int] = []
    counted: list[int] = []  # of each constant, the first of its instance if that counts something from the drawing
    for block in top.blocks:
        for owners in block.owners:
            own = range(first, first + len(block.kind.constants))
            for owner in owners:
                at.setdefault(owner, []).extend(own)
            counted += [len(constants) if name == "constant" else -1 for name in block.kind.constants]
            constants += own
            first += len(own) + len(block.kind.rows)
    explicit = {one.owner for one in top.given}
    moving = ~np.all(np.array(top.fixed[: top.dim * len(top.points)], bool).reshape(-1, top.dim), axis=1)
    links: list[tuple[int, int]] = []
    holders: list[Owner] = []
    for body in top.bodies:
        owner = Owner(Thing.BODY, top.names[Thing.BODY].index(body.name))
        if owner in explicit or not at.get(owner):
            continue
        p = body.points
        pairs = [(p[0], p[1]), *(pair for x in p[2:] for pair in ((p[0], x), (p[1], x)))] if len(p) > 1 else []
        # Else it is a length of the ground. What is changed moves the second point, which is not one of the ground.
        pairs = [(i, j) if moving[j] else (j, i) for i, j in pairs if moving[[i, j]].any()]
        links += pairs
        holders += [owner] * len(pairs)
    follow = _following(system, links, np.array(counted, int))
    return [
        {"points": [int(i), int(j)], "numbers": sorted({*at[owner], *np.array(constants)[own].tolist()})}
        for (i, j), owner, own in zip(links, holders, follow, strict=True)
    ]


def _following(system: System, links: Sequence[tuple[int, int]], counted: np.ndarray) -> np.ndarray:
    """Mark the constants that a distance between two points decides alone, whoever's they are, ``(links, constants)``.

    They change when the second point moves away from the first, and stay when everything else is elsewhere. What an
    instance of such constants counts from the drawing is counted anew; `counted` says which constants these are, by the
    first of their instance, -1 for none.
    """
    top, count = system.topology, len(links)
    flat = np.asarray(geometry_vector(system), float)
    places, spread = flat[: top.dim * len(top.points)].reshape(-1, top.dim), np.random.default_rng(0)
    drawings = np.repeat(flat[:, None], 1 + 2 * count, axis=1)
    for k, (i, j) in enumerate(links):
        own = [top.dim * p + x for p in (i, j) for x in range(top.dim)]
        drawings[own[top.dim :], 1 + k] += 0.1 * (places[j] - places[i])
        elsewhere = flat + 0.1 * (1.0 + np.abs(flat)) * spread.uniform(0.1, 1.0, flat.shape)
        elsewhere[own] = flat[own]
        drawings[:, 1 + count + k] = elsewhere
    with np.errstate(all="ignore"):
        found = carry_design(top, drawings[..., None]).constants
    values = np.concatenate([np.zeros((0, 1 + 2 * count)), *(c[..., 0].reshape(-1, 1 + 2 * count) for c in found)])
    same = np.isclose(values[:, 1:], values[:, :1], rtol=1e-9, atol=0.0)
    found = (~same[:, :count] & same[:, count:]).T
    for k, start in enumerate(counted):
        if start >= 0:
            found[:, k] = found[:, start:k].any(axis=1)
    return found


# -- the design of a changed mechanism ---------------------------------------------------------------------------------


class PageDesign(NamedTuple):
    """A program and what its numbers are."""

    # Of all coordinates as drawn (points, unit vectors, then angles and distances, which say only in which turn an
    # angle is), of the markers' places, and of the explicit dimensions.
    program: Program
    # Constants of all instances, block after block; angles and distances as drawn; coefficients of the markers; the
    # explicit dimensions of bodies as drawn, other dimensions as they are. An angle that is counted from the drawing
    # stays what it is, and so do the direction that it is counted from and the values of coordinates that a polynomial
    # between them is counted from, which are none of these constants.
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
        return [list(row) for row in zip(*columns, strict=True)]

    x = run_steps(found, np.array([b.number(0.0), *q[:spread], *rest, *q[spread:]]), run, np.concatenate)
    at, nodes, first = [], [], 0
    for block, constants in zip(top.blocks, found.constants, strict=False):
        stay = len(block.kind.constants) if from_drawing(block.kind) else 2 if block.kind == FOLLOWING else 0
        for instance in constants:
            at += range(first + stay, first + len(instance))
            nodes += x[instance[stay:]].tolist()
            first += len(block.kind.constants) + len(block.kind.rows)
    parts = (
        nodes,
        x[found.home[spread:]].tolist(),
        x[found.markers].reshape(-1).tolist(),
        _explicit_dimensions(top, b, x),
    )
    return PageDesign(b.program([node for part in parts for node in part]), tuple(map(len, parts)), tuple(at))


def _explicit_dimensions(top: Topology, b: Builder, x: np.ndarray) -> list[int]:
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
