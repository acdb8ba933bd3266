"""From a description to a compiled system: check with names, choose forms, group constraints by kind."""

from typing import TYPE_CHECKING

from jaxnc.system.planar import PlanarAssembler
from jaxnc.system.spatial import SpatialAssembler
from jaxnc.system.system import System

if TYPE_CHECKING:
    from jaxnc.mechanism import Mechanism


def assemble(mechanism: "Mechanism", sparse: bool | None = None) -> System:
    """Compile a description, all but its degrees of freedom.

    Args:
        mechanism: the description.
        sparse: whether matrices are kept sparse; None to go by the number of unknowns.

    Returns:
        A system whose ``degrees_of_freedom`` is still zero.

    Raises:
        MechanismError: see `Mechanism.compile`.
    """
    forms = PlanarAssembler if mechanism.model.dim == 2 else SpatialAssembler
    return forms(mechanism, sparse).system()
