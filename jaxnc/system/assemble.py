"""From a description to a compiled system: check with names, choose forms, group constraints by kind."""

from typing import TYPE_CHECKING

import jax

from jaxnc.errors import JaxncError
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
        JaxncError: when 64-bit numbers are off.
    """
    if not jax.config.read("jax_enable_x64"):
        raise JaxncError(
            "jaxnc needs 64-bit numbers, and JAX has them switched off: write "
            'jax.config.update("jax_enable_x64", True) before the first computation, or set JAX_ENABLE_X64=1'
        )
    forms = PlanarAssembler if mechanism.model.dim == 2 else SpatialAssembler
    return forms(mechanism, sparse).system()
