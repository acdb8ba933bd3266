"""A mechanism in any family of coordinates, with the maps to natural ones and back; independent ones.

Independent coordinates are as many as there are freedoms (source text §1). Of an open chain they are its relative
coordinates, and every pose follows from them directly. Of a closed one they are inputs of the position problem, which
may have several solutions: these are found from many starts, in which bodies as rigid as they are have been thrown into
the mechanism's space.

Source of the rule by which starts are enough: I. J. Good, "The population frequencies of species and the estimation of
population parameters", Biometrika 40, 1953: species that were seen once tell of those that were not seen.
"""

import copy
import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.errors import InputError, brief, nearest
from jaxnc.families.bodies import Parts
from jaxnc.families.planner import Atlas, Planner, Reference, Variable, fit_parameters
from jaxnc.families.program import Evaluator
from jaxnc.families.relative import Relative, SpatialRelative
from jaxnc.families.shapes import PARAMETERS, values
from jaxnc.kinematics.inputs import make_plan
from jaxnc.kinematics.modes import modes
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.traced import analyse_traced
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.mechanism.model import Place as Spot
from jaxnc.records import record as recorded
from jaxnc.records import static
from jaxnc.solvers.assembly import derive, settle
from jaxnc.status import Status
from jaxnc.system.design import design, design_numbers
from jaxnc.system.equations import Equations as Numbered
from jaxnc.system.equations import measured
from jaxnc.system.frames import along, over, spread
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import AnyArray, Array, ArrayLike, Numbers
from jaxnc.validate import as_shape

if TYPE_CHECKING:
    from jaxnc.families.written import Equations


@public
@recorded
class Formulation:
    """A mechanism in one family of coordinates.

    The system is an ordinary one, so that `solve_position`, `sweep`, velocities, gradients, `vmap` and `diagnose` work
    on it as on any. It has the parameters of the natural one: moving points of the drawing are there as fixed points,
    called ``"B drawn"``.

    Attributes:
        family: its name.
        natural: the same mechanism as it compiles, in natural (mixed) coordinates; its parameters are the design.
        topology: the family's variables and rows.
        listed: the variables with what they mean.
        atlas: where all points and vectors are.
        freedom: degrees of freedom.
        independent: variables from which the others follow; see `System`.
    """

    natural: System
    family: str = static()
    topology: Topology = static()
    listed: tuple[Variable, ...] = static()
    atlas: Atlas | None = static()
    freedom: int = static()
    independent: tuple[str, ...] = static(default=())

    @property
    def system(self) -> System:
        """The compiled system of this family."""
        parameters = fit_parameters(self.natural.parameters, self.topology)
        return System(self.topology, parameters, self.freedom, self.independent)

    @property
    def variables(self) -> dict[str, str]:
        """The variables with what they mean, in order."""
        return {v.name: v.meaning for v in self.listed}

    @property
    def n(self) -> int:
        """Number of variables."""
        return len(self.topology.unknown)

    @property
    def g(self) -> int:
        """Degrees of freedom."""
        return self.freedom

    @property
    def r(self) -> int:
        """Number of independent constraint equations, ``n - g`` (1)."""
        return self.n - self.g

    @property
    def rows(self) -> int:
        """Number of constraint equations as written, redundant ones too."""
        return len(self.topology.rows)

    def replace(self, *values: Any, **more: Any) -> "Formulation":
        """Take another design; see `System.replace`."""
        return self.of(self.natural.replace(*values, **more))

    def of(self, natural: System) -> "Formulation":
        """Take another design of the compiled mechanism. Nothing recompiles."""
        if not isinstance(natural, System) or natural.topology != self.natural.topology:
            raise InputError(f"{self.natural.name!r}: of() takes a design of the same compiled mechanism")
        return dataclasses.replace(self, natural=natural)

    # -- maps ---------------------------------------------------------------------------------------------------

    def to_natural(self, z: ArrayLike) -> Array:
        """Natural coordinates from those of the family, exact and differentiable.

        Args:
            z: the variables, ``(..., n)``, or a motion of `system`.

        Returns:
            All coordinates of `natural`, ground included, ``(..., N)``, in the order of its ``topology.coordinates``.
        """
        z = z.q[..., self.topology.unknown] if isinstance(z, Motion) else self._numbers(z, "to_natural(): z")
        self._check(z.shape, len(self.listed), "variables of the family")
        return self._place_all(derive(self.natural), z)

    @jit
    def _place_all(self, eq: Numbered, z: Array) -> Array:
        """All coordinates of `natural`, from variables ``(..., n)``."""
        return over(lambda x: self.place(eq, x), z)

    def place(self, eq: Numbered, z: Array) -> Array:
        """`to_natural` of one pose, ``(n,)``, with the equations of `natural` at hand."""
        top, par = self.natural.topology, self.natural.parameters
        if self.atlas is None:
            q = eq.home.at[np.array([top.position[v.name] for v in self.listed], int)].set(z)
            return measure_scalars(top, eq, q, [n for n in top.scalars if n not in self.variables])
        at = self.atlas
        drawing = design_numbers(top, par, 1)[design(top).drawing]
        p, v = spread(top, eq.home)
        p_drawn, v_drawn = drawing[np.array(at.drawn, int)], v[np.array(at.vectors, int)]
        c = [x for r in at.recipes for x in values(r, p_drawn, v_drawn)]
        numbers = Evaluator(p[np.array(at.points, int)], v_drawn, z[np.array(at.variables, int)], c)
        found = [x for place in at.places for x in numbers.place(place)]
        found += [x for arm in at.directions for x in numbers.arm(arm)]
        scalars = [jnp.zeros(()) if s is None else numbers.scalar(s) for s in at.scalars]
        q = jnp.stack([jnp.asarray(x) for x in (*found, *scalars)])
        return measure_scalars(top, eq, q, [n for n, s in zip(top.scalars, at.scalars, strict=True) if s is None])

    def from_natural(self, q: Numbers, continuous: bool = True) -> Array:
        """Coordinates of the family from natural ones, exact and differentiable.

        Args:
            q: all coordinates of `natural`, ``(..., N)``, or a motion of it.
            continuous: whether angles, which a pose tells but for whole turns, go on along the last leading axis; they
                are in (-π, π] otherwise. Those that are coordinates of the mechanism count their turns in any case.

        Returns:
            The variables, ``(..., n)``.
        """
        q = q.q if isinstance(q, Motion) else self._numbers(q, "from_natural(): q")
        top = self.natural.topology
        self._check(q.shape, len(top.coordinates), "coordinates of the mechanism")
        z = self._read_all(derive(self.system), q)
        if self.atlas is None or z.ndim < 2 or not continuous:
            return z
        turning = np.array([v.angle and v.name not in top.scalars for v in self.listed])
        return jnp.where(turning, jnp.unwrap(z, axis=-2), z)

    @jit
    def _read_all(self, eq: Numbered, q: Array) -> Array:
        return over(lambda x: self._read(eq, x), q)

    def _read(self, eq: Numbered, q: Array) -> Array:
        top = self.natural.topology
        if self.atlas is None:
            return q[np.array([top.position[v.name] for v in self.listed], int)]
        if not self.listed:
            return q[:0]
        (p, v), (home, directions), out = spread(top, q), spread(top, eq.home), []
        for one in self.listed:
            if one.reading is None or one.name in top.scalars:
                out.append(q[top.position[one.name]])
                continue
            reading, at, along = one.reading
            points, vectors = np.array(at, int), np.array(along, int)
            out.append(reading.evaluate(p[points], v[vectors], home[points], directions[vectors]))
        return jnp.stack([jnp.asarray(x) for x in out])

    def _numbers(self, x: ArrayLike, what: str) -> Array:
        return jnp.asarray(as_shape(x, what, ..., None, dtype=self.natural.dtype))

    def _check(self, shape: tuple, size: int, what: str) -> None:
        if not shape or shape[-1] != size:
            raise InputError(f"{self.family}: there are {size} {what}, shape (..., {size}); got shape {shape}")

    def motion(self, found: Motion) -> Motion:
        """A motion of `system` as one of the natural mechanism, with its points and rates by name.

        Args:
            found: what `solve_position` or `sweep` returned for `system`.

        Returns:
            The same poses, rates and statuses in natural coordinates.
        """
        if not isinstance(found, Motion):
            raise InputError(f"motion() takes one that solve_position or sweep made of .system, got {brief(found)}")
        z, place = found.q[..., self.topology.unknown], functools.partial(self.place, derive(self.natural))
        rates = tuple(
            along(place, z, tuple(x[..., self.topology.unknown] for x in found.rates[: k + 1]))
            for k in range(len(found.rates))
        )
        q = found.still_where_failed(self.to_natural(z))
        return Motion(
            self.natural, found.driven, found.held, q, rates, found.asked, found.status,
            found.residual, found.conditioning, found.time,
        )  # fmt: skip

    def equations(self, numbers: bool = False, names: dict[str, str] | None = None) -> "Equations":
        """The constraint equations, to be read: ``print(f.equations())``, ``.markdown()``, ``.latex()``.

        Args:
            numbers: put numbers in the place of lengths and other constants.
            names: other names of symbols, by the names that they have without, such as ``{"L_A1": "L_1"}``.

        Returns:
            The equations, one for each row.
        """
        from jaxnc.families.written import write_equations

        return write_equations(self, numbers, names or {})

    def __repr__(self) -> str:
        return (
            f"Formulation({self.natural.name!r} in {self.family} coordinates: n = {self.n}, r = {self.r}, g = {self.g})"
        )

    def __str__(self) -> str:
        lines = [f"{self.natural.name}: {self.family} coordinates, n = {self.n}, r = {self.r}, g = {self.g}"]
        width = max((len(n) for n in self.variables), default=0)
        return "\n".join([*lines, *(f"  {name:{width}}  {what}" for name, what in self.variables.items())])


def measure_all(system: System, q: np.ndarray) -> Array:
    """Poses ``(B, N)`` with their angles and distances measured anew from their points."""
    return _measure_poses(system.topology, derive(system), q)


@functools.partial(jit, static_argnums=0)
def _measure_poses(top: Topology, eq: Numbered, q: Array) -> Array:
    return jax.vmap(lambda x: measure_scalars(top, eq, x, top.scalars))(q)


def measure_scalars(top: Topology, eq: Numbered, q: Array, names: Sequence[str]) -> Array:
    """A pose ``(N,)`` with some of its angles and distances measured from its points."""
    at = np.array([top.position[n] for n in names], int)
    return q.at[at].set(measured(top, eq.constants, q)[at - len(top.coordinates)]) if names else q


# -- formulating ------------------------------------------------------------------------------------------------------

FAMILIES = ("independent", "relative", "reference", "natural", "mixed")

_LANES = 512  # starts that are solved together
_SPREADS = (1.0, 2.0, 4.0)  # of the drawing's box, batch by batch: legs may be longer than they are drawn


@public
def formulate(
    mechanism: Mechanism,
    family: str = "natural",
    keep: Sequence[str] = (),
    orientation: str = "euler parameters",
    closed: str = "joint",
    reference: str | Mapping[str, str | Spot] = "mass",
) -> Formulation:
    """Formulate a mechanism in a family of coordinates.

    Args:
        mechanism: the description.
        family: ``"relative"``, ``"reference"`` (reference points), ``"natural"``, ``"mixed"`` (natural coordinates with
            the mechanism's angles and distances) or ``"independent"``.
        keep: angles and distances of the mechanism that are to be variables, each with its own equation. Those that
            are a variable of the family anyway need not be named, and joints may keep some (docs/families.md).
        orientation: in space, of every body by its reference point, and in relative coordinates of ball joints:
            ``"euler parameters"``, ``"euler angles"``, ``"bryant angles"``, ``"rotation matrix"``.
        closed: how relative coordinates in space close a loop: by a ``"joint"`` that is left out with its variables, or
            through a ``"body"``, in six equations: then every joint has its variables.

        reference: reference points of bodies: ``"mass"``, the centre of mass of each (the middle of its points without
            mass), ``"middle"``, or for some bodies any point: ``{"coupler": "P"}`` by the name of one of its points or
            markers, ``{"coupler": (0.1, 0.2)}`` where it is drawn, lengths; the others have their centres of mass.

    Raises:
        InputError: unknown family or coordinate, something that the family cannot express.
        MechanismError: as in `Mechanism.compile`.

    Source: source text, §1 and §2, (1)-(17).
    """
    if not isinstance(mechanism, Mechanism):
        raise InputError(
            f"formulate() takes the Mechanism, got {type(mechanism).__name__}: a compiled System no longer knows its "
            f"bodies and joints as they were described; keep the Mechanism that it was compiled from"
        )
    if family not in FAMILIES:
        raise InputError(f"family={family!r}; {nearest(family, FAMILIES)}")
    if orientation not in PARAMETERS:
        raise InputError(f"orientation={orientation!r}; {nearest(orientation, PARAMETERS)}")
    if closed not in ("joint", "body"):
        raise InputError(f"closed={closed!r}; use 'joint' or 'body'")
    if closed == "body" and (family != "relative" or mechanism.model.dim == 2):
        raise InputError("closed='body' is for relative coordinates in space; in the plane a joint closes a loop")
    keep = (keep,) if isinstance(keep, str) else tuple(keep)
    if rolling := [n for n, j in mechanism.model.joints.items() if isinstance(j, record.Skate | record.RollingDisc)]:
        raise InputError(
            f"formulate: {mechanism.name!r} has rows on velocities ({', '.join(rolling)}), which no family of "
            f"coordinates writes; leave them out, or compile() and simulate() the mechanism"
        )
    if family in ("natural", "mixed"):
        return _formulate_natural(
            mechanism, _without_scalars(mechanism, keep) if family == "natural" else mechanism, family
        )
    system = mechanism.compile()
    parts = Parts(mechanism)
    if family == "reference":
        planner = Reference(parts, system, keep, orientation)
        planner.refer(reference)
        planner.plan()
        return compile_family(planner, system, family)
    if family == "relative":
        return compile_family(plan_relative(parts, system, keep, orientation, closed), system, family)
    return _formulate_independent(parts, system, keep)


def plan_relative(
    parts: Parts,
    natural: System,
    keep: tuple[str, ...] = (),
    orientation: str = "euler parameters",
    closed: str = "joint",
) -> Relative | SpatialRelative:
    """Plan relative coordinates, in the plane or in space."""
    if parts.dim == 2:
        planner = Relative(parts, natural, keep)
    else:
        parts.drop_rods()
        planner = SpatialRelative(parts, natural, keep, orientation)
        planner.closed = closed
    planner.plan()
    return planner


def compile_family(planner: Planner, natural: System, family: str) -> Formulation:
    """The formulation of a planner that has noted its variables and rows."""
    atlas, system, listed = planner.atlas(), planner.system(), tuple(planner.variables.values())
    return Formulation(natural, family, system.topology, listed, atlas, system.degrees_of_freedom, system.independent)


def _formulate_natural(mechanism: Mechanism, chosen: Mechanism, family: str) -> Formulation:
    whole = mechanism.compile()
    system = whole if chosen is mechanism else chosen.compile()
    top = system.topology
    first = len(top.coordinates) - len(top.scalars)
    listed = []
    for i in map(int, top.unknown):
        name = top.coordinates[i]
        angle = i >= first and top.angles[i - first]
        meaning = f"the {'angle' if angle else 'distance'} {name}" if i >= first else f"coordinate {name}"
        listed.append(Variable(name, meaning, angle, angle))
    return Formulation(whole, family, top, tuple(listed), None, system.degrees_of_freedom, system.independent)


def _formulate_independent(parts: Parts, natural: System, keep: tuple[str, ...]) -> Formulation:
    if not keep:
        direct = plan_relative(parts, natural)
        if not direct.rows:
            return compile_family(direct, natural, "independent")
    freedom = natural.degrees_of_freedom
    names = keep or tuple(natural.topology.scalars)[:freedom]
    if len(names) != freedom:
        raise InputError(
            f"{natural.name!r} has {freedom} degrees of freedom; name as many of its angles, distances or coordinates "
            f"of points as independent coordinates, keep=[…]; got {len(names)}"
        )
    chosen = Reference(parts, natural, names)
    chosen.choose("independent")
    system, listed = chosen.system(), tuple(chosen.variables.values())
    return Independent(natural, "independent", system.topology, listed, None, freedom, system.independent)


def _without_scalars(mechanism: Mechanism, keep: tuple[str, ...]) -> Mechanism:
    """The description without its angles and distances, but for some."""
    m = mechanism.model
    for name in keep:
        if name not in mechanism.scalar_names:
            raise InputError(f"keep={name!r}: {m.name!r} has no angle or distance of that name")
    gone = set(mechanism.scalar_names) - set(keep)
    used: list[tuple[str, Sequence[str]]] = []
    for name, joint in m.joints.items():
        if isinstance(joint, record.Wheels):
            used.append((f"the {joint.noun} {name!r}", joint.angles))
        elif isinstance(joint, record.Rolling | record.Screw | record.RackAndPinion):
            used.append((f"the {joint.noun} {name!r}", (joint.angle, joint.distance)))
    used += [(f"the relation {n!r}", [s for s in x.terms if s in gone]) for n, x in m.relations.items()]
    for noun, table in (("constraint", m.constraints), ("force", m.forces)):
        used += [(f"the {noun} {n!r}", [s for s in x.scalars if s in gone]) for n, x in table.items()]
    for what, names in used:
        if gone & set(names):
            raise InputError(
                f"{what} is an equation between {' and '.join(names)}, and natural coordinates have no angles and "
                f"distances; use family='mixed', or keep={list(names)!r}"
            )
    other = copy.copy(mechanism)
    other.model = copy.deepcopy(m)
    other.model.angles = {n: a for n, a in m.angles.items() if n not in gone}
    other.model.distances = {n: d for n, d in m.distances.items() if n not in gone}
    return other


@recorded
class Independent(Formulation):
    """A closed chain in independent coordinates: poses follow by the position problem, on the drawing's assembly."""

    def _place_all(self, eq: Numbered, z: Array) -> Array:
        flat = z.reshape(-1, z.shape[-1])
        found = solve_position(self.natural, {v.name: flat[:, k] for k, v in enumerate(self.listed)}, throw=False)
        return found.q.reshape(*z.shape[:-1], -1)

    def place(self, eq: Numbered, z: Array) -> Array:
        """`to_natural` of one pose."""
        return self._place_all(eq, z)

    def assemblies(self, values: dict[str, float], starts: int | None = None, seed: int = 0) -> Motion:
        """All poses with these values of the independent coordinates: those of `jaxnc.modes`, which has the proof too.

        A mechanism that it refuses is solved from many starts. That list is observed, not proved: a pose that hardly
        any start leads to may be missing.

        Args:
            values: a number for every independent coordinate.
            starts: how many random starts, in each of which every body is whole and somewhere else, if it is to be
                random starts. Where it has to be and this is not given, so many that the list is stable: 2048 at least,
                four times as many as the last new pose took, and every pose found five times; 16,384 at most.
            seed: another number gives other ways, or other starts.

        Returns:
            The poses of the natural mechanism, ``(assemblies,)``; the one nearest to the drawing first. Each is a
            solution to rounding, and no two are the same.

        Raises:
            InputError: coordinates that are missing, or not of this formulation.
        """
        names = [v.name for v in self.listed]
        if set(values) != set(names):
            raise InputError(f"assemblies() takes a value of each of {', '.join(names)}; got {', '.join(values)}")
        values = {name: float(values[name]) for name in names}
        if starts is None:
            try:
                return modes(self.natural, values, seed=seed).poses
            except InputError:  # no polynomials, or not isolated; what is wrong with the values is told below
                pass
        system, top, eq = self.natural, self.natural.topology, derive(self.natural)
        view = make_plan(system, tuple(values), (), "least squares")
        home = np.asarray(settle(eq, np.zeros(len(top.coordinates))).q)
        rng, lanes = np.random.default_rng(seed), min(_LANES, starts or _LANES)
        asked = jnp.broadcast_to(jnp.array(list(values.values())), (lanes, len(values)))
        found = _Poses(home, len(top.coordinates) - len(top.scalars))
        while found.starts < starts if starts else not found.stable:
            begun = _rigid_starts(system, home, lanes, rng, _SPREADS[found.starts // lanes % len(_SPREADS)])
            one = analyse_traced(view, "guess", eq, jnp.array(begun), asked, ())
            count = lanes if starts is None else min(lanes, starts - found.starts)
            found.add(*(np.asarray(a)[:count] for a in (one.q, one.status, one.size, one.conditioning)))
        q, status, residual, conditioning = found.sort()
        return Motion(
            system, tuple(values), (), jnp.array(q), (), jnp.broadcast_to(asked[0], (len(q), len(values))),
            jnp.array(status), jnp.array(residual), jnp.array(conditioning),
        )  # fmt: skip


class _Poses:
    """Distinct poses, each as well as it is known so far, and how often it was found."""

    def __init__(self, home: np.ndarray, spread: int):
        self.home, self.spread, self.size = home, spread, max(float(np.ptp(home[:spread])), 1e-300)
        self.starts = self.newest = 0  # how many there were, and how many when the last new pose was found
        self.seen = np.zeros(0, int)
        # Coordinates, statuses, residuals and conditionings.
        self.known = np.zeros((0, len(home))), np.zeros(0, int), np.zeros(0), np.zeros(0)

    def add(self, *ends: np.ndarray) -> None:
        """Sort the ends of some starts into the list: coordinates, statuses, residuals and conditionings."""
        self.starts += len(ends[0])
        q, status, residual, conditioning = (np.concatenate(a) for a in zip(self.known, ends, strict=True))
        often = np.append(self.seen, np.ones(len(ends[0]), int))
        good = np.flatnonzero((status == int(Status.CONVERGED)) | (status == int(Status.SINGULAR)))
        kept, seen, places = [], [], np.zeros((0, self.spread))
        # Of one assembly the pose that is known best is kept.
        for i in good[np.argsort(residual[good] / np.maximum(conditioning[good], 1e-300), kind="stable")]:
            # Poses closer than 1e-6 of the size are one assembly, or than Newton may be off at this conditioning.
            same = self.size * min(1e-3, max(1e-6, 1e-10 / max(conditioning[i], 1e-300)))
            like = np.flatnonzero(np.abs(places - q[i, : self.spread]).max(axis=1) <= same)
            if len(like):
                seen[like[0]] += often[i]
            else:
                kept, seen = [*kept, i], [*seen, often[i]]
                places = np.concatenate([places, q[i : i + 1, : self.spread]])
        if len(kept) > len(self.seen):
            self.newest = self.starts
        self.known, self.seen = (q[kept], status[kept], residual[kept], conditioning[kept]), np.array(seen, int)

    @property
    def stable(self) -> bool:
        """True if many more starts than the last new pose took brought none, and every pose came several times."""
        # Four times as many starts as the last new pose took; a pose that came five times was missed once in 150. A
        # list is returned as it is after 32 batches.
        quiet = self.starts >= 4 * max(_LANES, self.newest) and bool((self.seen >= 5).all())
        return quiet or self.starts >= 32 * _LANES

    def sort(self) -> tuple[np.ndarray, ...]:
        """Coordinates, statuses, residuals and conditionings, those of the pose nearest to the drawing first."""
        away = np.abs(self.known[0][:, : self.spread] - self.home[: self.spread]).sum(axis=1)
        return tuple(a[np.argsort(away, kind="stable")] for a in self.known)


def _rigid_starts(system: System, home: AnyArray, starts: int, rng: np.random.Generator, width: float) -> np.ndarray:
    """Poses ``(starts, N)`` in which every body is as long and wide as it is, turned and placed at random.

    A body that shares a point with the ground, or with a body before it, hangs on that point; others lie in a box that
    is `width` times as wide as the drawing's.
    """
    top = system.topology
    points, vectors = spread(top, home)
    fixed: AnyArray = np.array(top.fixed)
    placed, directed = (np.asarray(x.all(axis=1)) for x in spread(top, fixed))
    size, middle = width * float(np.ptp(points, axis=0).max()), points.mean(axis=0)
    out = np.broadcast_to(home, (starts, len(home))).copy()
    p = middle + size * rng.uniform(-1.0, 1.0, (starts, *points.shape))
    v = np.broadcast_to(vectors, (starts, *vectors.shape)).copy()
    p[:, placed] = points[placed]
    waiting = list(top.bodies)
    while waiting:
        # Bodies that hang on something come first.
        body = next((b for b in waiting if placed[list(b.points)].any()), waiting[0])
        waiting.remove(body)
        own, axes = list(body.points), list(body.vectors)
        turn = _draw_rotations(rng, starts, top.dim)
        hung = [k for k in own if placed[k]][:1]
        if own:
            pivot, where = (points[hung[0]], p[:, hung[0]]) if hung else (points[own].mean(axis=0), p[:, own[0]])
            free = [k for k in own if not placed[k]]
            p[:, free] = where[:, None] + np.einsum("sij,kj->ski", turn, points[free] - pivot)
            placed[own] = True
        free = [k for k in axes if not directed[k]]
        v[:, free] = np.einsum("sij,kj->ski", turn, vectors[free])
        directed[axes] = True
    thrown = np.concatenate([p.reshape(starts, -1), v.reshape(starts, -1)], axis=1)
    out[:, : thrown.shape[1]] = np.where(fixed[: thrown.shape[1]], home[: thrown.shape[1]], thrown)
    if top.scalars:
        out = np.asarray(measure_all(system, out))
    return out


def _draw_rotations(rng: np.random.Generator, count: int, dim: int) -> np.ndarray:
    """Rotations ``(count, dim, dim)``, uniform over all of them."""
    q, r = np.linalg.qr(rng.normal(size=(count, dim, dim)))
    q = q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]
    q[np.linalg.det(q) < 0.0, :, 0] *= -1.0
    return q
