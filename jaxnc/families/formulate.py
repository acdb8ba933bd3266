"""`formulate`: one mechanism in any family of coordinates."""

from collections.abc import Mapping, Sequence

from jaxnc.calls import public
from jaxnc.errors import InputError, nearest
from jaxnc.families.bodies import Parts
from jaxnc.families.formulation import Formulation
from jaxnc.families.independent import Chosen, Independent
from jaxnc.families.natural import natural as without
from jaxnc.families.planner import Planner, Variable
from jaxnc.families.reference import Reference
from jaxnc.families.relative import Relative
from jaxnc.families.spatial import SpatialRelative
from jaxnc.families.turns import PARAMETERS
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.mechanism.model import Place
from jaxnc.system.system import System

FAMILIES = ("independent", "relative", "reference", "natural", "mixed")


@public
def formulate(
    mechanism: Mechanism,
    family: str = "natural",
    keep: Sequence[str] = (),
    orientation: str = "euler parameters",
    closed: str = "joint",
    reference: str | Mapping[str, str | Place] = "mass",
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
        return _natural(mechanism, without(mechanism, keep) if family == "natural" else mechanism, family)
    system = mechanism.compile()
    parts = Parts(mechanism)
    if family == "reference":
        return planned(Reference(parts, system, keep, orientation, reference), system, family)
    if family == "relative":
        return planned(relative(parts, system, keep, orientation, closed), system, family)
    return _independent(mechanism, parts, system, keep)


def relative(
    parts: Parts,
    natural: System,
    keep: tuple[str, ...] = (),
    orientation: str = "euler parameters",
    closed: str = "joint",
) -> Planner:
    """The planner of relative coordinates, in the plane or in space."""
    if parts.dim == 2:
        return Relative(parts, natural, keep)
    return SpatialRelative(parts, natural, keep, orientation, closed)


def planned(planner: Planner, natural: System, family: str) -> Formulation:
    """The formulation of a planner."""
    planner.plan()
    return _compiled(planner, natural, family)


def _compiled(planner: Planner, natural: System, family: str) -> Formulation:
    atlas = planner.atlas()
    system = planner.system()
    listed = tuple(planner.variables.values())
    return Formulation(natural, family, system.topology, listed, atlas, system.degrees_of_freedom, system.independent)


def _natural(mechanism: Mechanism, chosen: Mechanism, family: str) -> Formulation:
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


def _independent(mechanism: Mechanism, parts: Parts, natural: System, keep: tuple[str, ...]) -> Formulation:
    if not keep:
        direct = relative(parts, natural)
        direct.plan()
        if not direct.rows:
            return _compiled(direct, natural, "independent")
    freedom = natural.degrees_of_freedom
    names = keep or tuple(natural.topology.scalars)[:freedom]
    if len(names) != freedom:
        raise InputError(
            f"{natural.name!r} has {freedom} degrees of freedom; name as many of its angles, distances or coordinates "
            f"of points as independent coordinates, keep=[…]; got {len(names)}"
        )
    chosen = Chosen(parts, natural, names)
    chosen.plan()
    system = chosen.system()
    listed = tuple(chosen.variables.values())
    return Independent(natural, "independent", system.topology, listed, None, freedom, system.independent)
