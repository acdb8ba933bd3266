"""Where the reference points of bodies are: the centre of mass, the middle, or any place of the body (source §2.2)."""

from collections.abc import Mapping

import numpy as np

from jaxnc.dynamics.inertia import body_inertia
from jaxnc.errors import InputError, nearest
from jaxnc.families.bodies import Origin, Part, Parts
from jaxnc.mechanism.model import Place
from jaxnc.solvers.assembly import derive
from jaxnc.system.design import design, design_numbers
from jaxnc.system.system import System

_SAME = 1e-9  # of the mechanism's size: places that are one


def refer(parts: Parts, natural: System, reference: str | Mapping[str, str | Place]) -> None:
    """Set the reference points of all parts."""
    chosen = {} if isinstance(reference, str) else dict(reference)
    if isinstance(reference, str) and reference not in ("mass", "middle"):
        raise InputError(f"reference={reference!r}; use 'mass', 'middle', or points of bodies, {{body: point}}")
    of = {body: part for part in parts.parts[1:] for body in part.bodies}
    for body in chosen:
        if body not in of:
            raise InputError(f"reference={{{body!r}: …}}: no moving body has that name; {nearest(body, of)}")
    top, home = natural.topology, np.asarray(derive(natural).home)
    drawing = design_numbers(top, natural.parameters.in_numpy(), 1)[design(top).drawing]
    for part in parts.parts[1:]:
        if part.turns == "no" or not part.points:
            continue
        drawn = {p: parts.a.home[p] for p in part.points}
        given = next((chosen[b] for b in part.bodies if b in chosen), None)
        if given is not None:
            place = _place(parts, part, given)
        elif reference == "middle":
            continue
        else:
            drawn = {p: drawing[i] for p, i in part.drawn.items()}
            place = _centre(natural, part, home, drawn)
        if place is not None:
            part.origin = _origin(parts, part, place, drawn)


def _place(parts: Parts, part: Part, given: str | Place) -> np.ndarray:
    """A point, a marker or a place of a part, as drawn."""
    if not isinstance(given, str):
        place = np.asarray(given, dtype=float)
        if place.shape != (parts.dim,) or not np.isfinite(place).all():
            raise InputError(
                f"reference point {given!r} of body {part.name!r}: give a point's name or {parts.dim} numbers"
            )
        return place
    names = {parts.point(p): parts.a.home[p] for p in part.points}
    for name, marker in parts.model.markers.items():
        if marker.on in part.bodies and marker.at is not None:
            names[name] = np.asarray(marker.at, dtype=float)
    if given not in names:
        raise InputError(f"reference point {given!r}: body {part.name!r} has no such point; {nearest(given, names)}")
    return names[given]


def _centre(natural: System, part: Part, home: np.ndarray, drawn: Mapping[int, np.ndarray]) -> np.ndarray | None:
    """The centre of mass of a part's bodies as drawn; None without mass."""
    q, dim = home.copy(), natural.topology.dim
    for p, at in drawn.items():
        q[dim * p : dim * p + dim] = at
    moment, mass = np.zeros(dim), 0.0
    for body in part.bodies:
        at, _, first, m = body_inertia(natural, body)
        moment, mass = moment + np.asarray(first) @ q[at], mass + float(m)
    return moment / mass if mass else None


def _origin(parts: Parts, part: Part, place: np.ndarray, drawn: Mapping[int, np.ndarray]) -> Origin:
    """A place of a part as an origin."""
    near = _SAME * parts.a.size
    for p, at in drawn.items():
        if np.linalg.norm(at - place) <= near:
            return Origin((p,))
    if np.linalg.norm(np.mean(list(drawn.values()), axis=0) - place) <= near:
        return Origin(part.points)
    segments = (part.axis,) if parts.dim == 2 else part.segments[:2]
    axes = [drawn[s[1]] - drawn[s[0]] if len(s) == 2 else parts.a.vectors[~s[0]] for s in segments]
    if parts.dim == 2:
        axes.append(np.array([-axes[0][1], axes[0][0]]))
    elif len(axes) == 2:
        axes.append(np.cross(axes[0], axes[1]))
    first = segments[0][0] if len(segments[0]) == 2 else part.points[0]
    factors, *_ = np.linalg.lstsq(np.array(axes).T, place - drawn[first], rcond=None)
    off = np.linalg.norm(np.array(axes).T @ factors + drawn[first] - place)
    if off > near:
        raise InputError(
            f"the reference point of {part.name!r} is {off:.3g} beside its line, and a bar does not know its rotation; "
            f"put it on the line, or give the bar a point or vector across it"
        )
    points = (first, *(p for s in segments if len(s) == 2 for p in s))
    forms = "".join("p" if len(s) == 2 else "v" for s in segments)
    return Origin(points, tuple(~s[0] for s in segments if len(s) == 1), (forms, *map(float, factors)))
