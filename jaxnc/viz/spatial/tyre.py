"""The tyre of a suspension with the usual names, and the piece of road that it stands on."""

import numpy as np

from jaxnc.kinematics.hardpoints import usual
from jaxnc.viz.poses import Poses
from jaxnc.viz.spatial.mesh import Mesh, joined, sheet, shell
from jaxnc.viz.spatial.scene import Frame, Item, Solid, Way

_WIDTH = 0.62  # of the loaded radius: 195/65 R 15 has 195 mm on 310 mm
_PROFILE = ((0.84, 0.63), (0.98, 0.74), (1.0, 0.85), (0.86, 0.97), (0.5, 1.0))  # shares of half width and radius
_SIDES = 40
_PAD, _PATCH = (0.75, 0.55), (0.2, 0.24)  # half lengths and widths of the road and of the tyre's print, in radii
_ALONG, _UP = Way(fixed=(1.0, 0.0, 0.0)), Way(fixed=(0.0, 0.0, 1.0))


def tyre(poses: Poses, x: np.ndarray) -> list[Item]:
    """What is drawn of a wheel and its road.

    `x` are all columns of some of its poses, ``(S, columns, 3)``.

    Returns:
        A shell about the spin axis, as wide as a car's tyre of its radius, which is the distance from the wheel's
        centre to where the road is drawn to be touched; and a level plate there, which rises with the wheel as that of
        a test rig does. Nothing where the usual names are missing.
    """
    columns = {name: k for k, name in enumerate((*poses.names, *poses.directions))}
    names = usual(columns)
    if names is None or names.contact not in columns:
        return []
    centre, contact = columns[names.wheel_centre], columns[names.contact]
    radius = float(np.linalg.norm(x[0, contact] - x[0, centre]))
    if not radius > 0:
        return []
    line = (names.spin_axis,) if isinstance(names.spin_axis, str) else names.spin_axis
    half = 0.5 * _WIDTH * radius
    side = [(-half * along, radius * out) for along, out in _PROFILE]
    profile = (*side, *((-along, out) for along, out in reversed(side)))
    road = joined(*(_plate(radius * length, radius * width) for length, width in (_PAD, _PATCH)))
    return [
        Solid("tyre", Frame(centre, Way(tuple(columns[name] for name in line))), shell(profile, _SIDES)),
        Solid("road", Frame(contact, _UP, _ALONG), road),
    ]


def _plate(length: float, width: float) -> Mesh:
    """A level plate about the frame's origin, its axis pointing up, seen from both sides."""
    around = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return sheet(tuple((0.0, 0.0, length * x, width * y, 0.0, 0.0, 0.0) for x, y in around))
