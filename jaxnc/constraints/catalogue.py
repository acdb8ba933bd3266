"""Every kind of constraint the library knows, by name."""

from functools import partial
from itertools import product as every

from jaxnc.constraints import bodies, coordinates, joints
from jaxnc.constraints.kind import Kind, RateKind
from jaxnc.pickling import register_by_name


def _all(make, count: int, *options) -> list[Kind]:
    """Make a kind for every choice of vectors and segments, and of further options."""
    return [make("".join(forms), *chosen) for forms in every("pv", repeat=count) for chosen in every(*options)]


CATALOGUE: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        bodies.DISTANCE,
        bodies.ATTACHED,
        bodies.PROPORTIONAL,
        bodies.COMBINATION,
        joints.COINCIDENT,
        joints.ALIGNED,
        joints.FIXED_ANGLE,
        bodies.SCALAR_PRODUCT,
        joints.PERPENDICULAR,
        joints.CONTACT,
        joints.ROLLING,
        joints.EXTERNAL_GEAR,
        joints.INTERNAL_GEAR,
        *coordinates.ANGLE.values(),
        *coordinates.ANGLE_FROM_X.values(),
        *coordinates.DISTANCE_ALONG.values(),
        coordinates.DISTANCE_ALONG_FREE,
        coordinates.DISTANCE_BETWEEN,
        joints.cable(3),
        joints.relation(2),
        joints.FOLLOWING,
        joints.TOUCHING,
        bodies.UNIT,
        *_all(bodies.product, 2),
        *_all(bodies.carried, 3),
        *_all(bodies.combined, 4),
        *_all(bodies.coplanar, 3),
        *_all(bodies.collinear, 2),
        *_all(bodies.handed, 3),
        joints.COINCIDENT_IN_SPACE,
        *_all(joints.aligned, 1),
        *_all(joints.parallel, 2),
        *_all(joints.no_turn, 3),
        *_all(joints.constant_velocity, 4),
        *_all(joints.bevel, 2, (False, True)),
        *_all(joints.rack, 2, (False, True)),
        *joints.SCREW.values(),
        *_all(joints.contact, 2),
        *(kind for form in coordinates.ANGLE_ABOUT_FORMS for kind in _all(partial(coordinates.angle_about, form), 3)),
        *_all(coordinates.angle_from_drawing, 2),
        *(
            kind
            for form in coordinates.DISTANCE_ALONG_FORMS
            for kind in _all(partial(coordinates.distance_along, form), 1)
        ),
    )
}
register_by_name(__name__, CATALOGUE.values())

RATES: dict[str, RateKind] = {kind.name: kind for kind in (joints.SKATE, joints.ROLLING_DISC)}
"""Every kind of constraint on velocities that the library knows, by name."""
register_by_name(__name__, RATES.values())
