"""`formulate`: one mechanism in any family of coordinates."""

from collections.abc import Sequence

from jaxnc.errors import InputError, nearest
from jaxnc.families.bodies import Parts
from jaxnc.families.formulation import Formulation
from jaxnc.families.planner import Planner
from jaxnc.families.reference import Reference
from jaxnc.families.relative import Relative
from jaxnc.families.turns import PARAMETERS
from jaxnc.mechanism import Mechanism

FAMILIES = ("independent", "relative", "reference", "natural", "mixed")


def formulate(
    mechanism: Mechanism,
    family: str = "natural",
    keep: Sequence[str] = (),
    orientation: str = "euler parameters",
) -> Formulation:
    """Formulate a mechanism in a family of coordinates.

    Args:
        mechanism: the description.
        family: ``"relative"``, ``"reference"`` (reference points), ``"natural"``, ``"mixed"`` (natural coordinates with
            the mechanism's angles and distances) or ``"independent"``.
        keep: angles and distances of the mechanism that are to be variables, each with its own equation. Those that
            are a variable of the family anyway need not be named, and joints may keep some (docs/families.md).
        orientation: of reference-point coordinates in space: ``"euler parameters"``, ``"euler angles"``,
            ``"bryant angles"``, ``"rotation matrix"``.

    Returns:
        The formulation.

    Raises:
        InputError: unknown family or coordinate, something that the family cannot express.
        MechanismError: as in `Mechanism.compile`.

    Source: source text, §1 and §2.
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
    keep = (keep,) if isinstance(keep, str) else tuple(keep)
    natural = mechanism.compile()
    parts = Parts(mechanism)
    planner: Planner = Reference(parts, keep, orientation) if family == "reference" else Relative(parts, keep)
    planner.plan()
    atlas = planner.atlas()
    system = planner.system(natural)
    return Formulation(
        natural, planner.family, system.topology, tuple(planner.variables.values()), atlas, system.degrees_of_freedom
    )
