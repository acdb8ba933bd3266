"""Every kind of constraint the library knows, by name."""

from itertools import product as every

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
    cable,
    relation,
)
from jaxnc.constraints.kind import Kind
from jaxnc.constraints.rigid import ATTACHED, COMBINATION, DISTANCE, PROPORTIONAL
from jaxnc.constraints.spatial_bodies import (
    SCALAR_PRODUCT,
    UNIT,
    carried,
    collinear,
    combined,
    coplanar,
    handed,
    product,
)
from jaxnc.constraints.spatial_coordinates import (
    ANGLE_ABOUT_FORMS,
    DISTANCE_ALONG_FORMS,
    angle_about,
    angle_from_drawing,
    distance_along,
)
from jaxnc.constraints.spatial_joints import (
    COINCIDENT_IN_SPACE,
    SCREW,
    aligned,
    bevel,
    constant_velocity,
    contact,
    no_turn,
    parallel,
    rack,
)


def _all(make, count: int):
    """A kind for every choice of vectors and segments."""
    return [make("".join(forms)) for forms in every("pv", repeat=count)]


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
        UNIT,
        *_all(product, 2),
        *_all(carried, 3),
        *_all(combined, 4),
        *_all(coplanar, 3),
        *_all(collinear, 2),
        *_all(handed, 3),
        COINCIDENT_IN_SPACE,
        *_all(aligned, 1),
        *_all(parallel, 2),
        *_all(no_turn, 3),
        *_all(constant_velocity, 4),
        *(bevel("".join(forms), internal) for forms in every("pv", repeat=2) for internal in (False, True)),
        *(rack("".join(forms), rolls) for forms in every("pv", repeat=2) for rolls in (False, True)),
        *SCREW.values(),
        *_all(contact, 2),
        *(angle_about(form, "".join(forms)) for form in ANGLE_ABOUT_FORMS for forms in every("pv", repeat=3)),
        *_all(angle_from_drawing, 2),
        *(distance_along(form, direction) for form in DISTANCE_ALONG_FORMS for direction in "pv"),
    )
}
