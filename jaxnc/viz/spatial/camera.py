"""Views of a spatial mechanism: axes of the picture, and a direction in which nothing hides behind anything else."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jaxnc.errors import InputError
from jaxnc.viz.poses import Poses

_ELEVATIONS = (22.0, 34.0)
_AZIMUTHS = (-60, -45, -30, -75, -15, 15, 30, 45, 60, 75, 105, 120, 135, 150, -105, -120, -135, -150)


@dataclass(frozen=True)
class Camera:
    """A direction of view, as matplotlib counts it."""

    elevation: float  # angle above the xy plane, degrees
    azimuth: float  # angle about z from the x axis, degrees

    @cached_property
    def axes(self) -> np.ndarray:
        """Right, up and towards the viewer as rows, ``(3, 3)``."""
        e, a = math.radians(self.elevation), math.radians(self.azimuth)
        right = np.array([-math.sin(a), math.cos(a), 0.0])
        towards = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        return np.stack([right, np.cross(towards, right), towards])


def read_view(data: Poses, view: Sequence[float] | None) -> Camera | None:
    """Read the view that a user asks for, elevation and azimuth; None if there is none to be read."""
    if view is None:
        return None
    if data.dim == 2:
        raise InputError(f"view={view!r}: {data.topology.name!r} is planar, and is seen from the front; leave view out")
    try:
        elevation, azimuth = map(float, view)
    except (TypeError, ValueError, OverflowError):
        elevation = azimuth = math.nan
    if not (abs(elevation) <= 90 and math.isfinite(azimuth)):
        raise InputError(
            f"view={view!r}: a view is its elevation (-90 to 90) and azimuth, in degrees, such as view=(25, -60)"
        )
    return Camera(elevation, azimuth)


def choose_camera(
    poses: np.ndarray, links: tuple[tuple[int, int], ...], columns: tuple[int, ...], axes: tuple[int, ...]
) -> Camera:
    """Choose a view in which links and unit vectors are seen at length and points apart, in all the poses.

    Poses are a few, ``(S, columns, 3)``; there is something between the pairs of columns in `links`.
    """
    x = poses[:, list(columns)]
    pairs = np.array([(i, j) for i in range(len(columns)) for j in range(i)], dtype=int).reshape(-1, 2)
    apart = x[:, pairs[:, 0]] - x[:, pairs[:, 1]]
    along = np.stack([poses[:, b] - poses[:, a] for a, b in links], axis=1) if links else apart[:, :0]
    seen = (2.0, along), (1.0, apart), (1.0, poses[:, list(axes)])  # what is to be seen at length, and how it counts
    best, least = Camera(_ELEVATIONS[0], _AZIMUTHS[0]), -math.inf
    for elevation in _ELEVATIONS:
        for rank, azimuth in enumerate(_AZIMUTHS):
            camera = Camera(elevation, azimuth)
            score = sum(weight * _visibility(d, camera) for weight, d in seen)
            score -= 0.015 * rank + 0.002 * elevation
            if score > least + 1e-9:
                best, least = camera, score
    return best


def _visibility(d: np.ndarray, camera: Camera) -> float:
    """Average the logarithms of the shares of lengths that are seen, bounded below."""
    length = np.linalg.norm(d, axis=-1)
    keep = np.isfinite(length) & (length > 1e-9 * np.nanmax(length, initial=1e-300))
    if not keep.any():
        return 0.0
    share = np.linalg.norm(d[keep] @ camera.axes[:2].T, axis=-1) / length[keep]
    return float(np.mean(np.log(np.maximum(share, 0.05))))
