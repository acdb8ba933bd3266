"""Every kind of constraint the library knows, by name."""

from itertools import product as every

from jaxnc.constraints import coordinates, joints, rates, rigid, spatial_bodies, spatial_coordinates, spatial_joints
from jaxnc.constraints.kind import Kind
from jaxnc.pickling import register_by_name


def _all(make, count: int):
    """A kind for every choice of vectors and segments."""
    return [make("".join(forms)) for forms in every("pv", repeat=count)]


CATALOGUE: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        rigid.DISTANCE,
        rigid.ATTACHED,
        rigid.PROPORTIONAL,
        rigid.COMBINATION,
        joints.COINCIDENT,
        joints.ALIGNED,
        joints.FIXED_ANGLE,
        spatial_bodies.SCALAR_PRODUCT,
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
        rates.TOUCHING,
        spatial_bodies.UNIT,
        *_all(spatial_bodies.product, 2),
        *_all(spatial_bodies.carried, 3),
        *_all(spatial_bodies.combined, 4),
        *_all(spatial_bodies.coplanar, 3),
        *_all(spatial_bodies.collinear, 2),
        *_all(spatial_bodies.handed, 3),
        spatial_joints.COINCIDENT_IN_SPACE,
        *_all(spatial_joints.aligned, 1),
        *_all(spatial_joints.parallel, 2),
        *_all(spatial_joints.no_turn, 3),
        *_all(spatial_joints.constant_velocity, 4),
        *(
            spatial_joints.bevel("".join(forms), internal)
            for forms in every("pv", repeat=2)
            for internal in (False, True)
        ),
        *(spatial_joints.rack("".join(forms), rolls) for forms in every("pv", repeat=2) for rolls in (False, True)),
        *spatial_joints.SCREW.values(),
        *_all(spatial_joints.contact, 2),
        *(
            spatial_coordinates.angle_about(form, "".join(forms))
            for form in spatial_coordinates.ANGLE_ABOUT_FORMS
            for forms in every("pv", repeat=3)
        ),
        *_all(spatial_coordinates.angle_from_drawing, 2),
        *(
            spatial_coordinates.distance_along(form, direction)
            for form in spatial_coordinates.DISTANCE_ALONG_FORMS
            for direction in "pv"
        ),
    )
}
register_by_name(__name__, CATALOGUE.values())
