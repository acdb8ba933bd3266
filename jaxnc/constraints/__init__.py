"""The catalogue of constraints: every kind the library knows, by name."""

from jaxnc.constraints.coordinates import (
    ANGLE,
    ANGLE_FROM_X,
    DISTANCE_ALONG,
    DISTANCE_ALONG_FREE,
    DISTANCE_BETWEEN,
)
from jaxnc.constraints.joints import (
    ALIGNED,
    COINCIDENT,
    CONTACT,
    EXTERNAL_GEAR,
    FIXED_ANGLE,
    INTERNAL_GEAR,
    PERPENDICULAR,
    ROLLING,
    SCALAR_PRODUCT,
    cable,
    relation,
)
from jaxnc.constraints.kind import Kind
from jaxnc.constraints.rigid import ATTACHED, COMBINATION, DISTANCE, PROPORTIONAL

CATALOGUE: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        DISTANCE,
        ATTACHED,
        PROPORTIONAL,
        COMBINATION,
        COINCIDENT,
        ALIGNED,
        FIXED_ANGLE,
        SCALAR_PRODUCT,
        PERPENDICULAR,
        CONTACT,
        ROLLING,
        EXTERNAL_GEAR,
        INTERNAL_GEAR,
        *ANGLE.values(),
        *ANGLE_FROM_X.values(),
        *DISTANCE_ALONG.values(),
        DISTANCE_ALONG_FREE,
        DISTANCE_BETWEEN,
        cable(3),
        relation(2),
    )
}

__all__ = [
    "ALIGNED",
    "ANGLE",
    "ANGLE_FROM_X",
    "ATTACHED",
    "CATALOGUE",
    "COINCIDENT",
    "COMBINATION",
    "CONTACT",
    "DISTANCE",
    "DISTANCE_ALONG",
    "DISTANCE_ALONG_FREE",
    "DISTANCE_BETWEEN",
    "EXTERNAL_GEAR",
    "FIXED_ANGLE",
    "INTERNAL_GEAR",
    "PERPENDICULAR",
    "PROPORTIONAL",
    "ROLLING",
    "SCALAR_PRODUCT",
    "Kind",
    "cable",
    "relation",
]
