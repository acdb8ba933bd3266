"""Tooth forces of gears, bevel gears and racks: at the pitch point, and so on the bearings of both wheels.

The row of a mesh relates coordinates, and its multiplier alone puts a couple on each wheel and the opposite ones on the
body that carries their bearings. A single force at the pitch point has the same couples about both axes, and does the
same work. What it has more is held by the bearings, and passes through them to the carrier.
"""

from typing import TYPE_CHECKING, Any

from jaxnc.dynamics import sides
from jaxnc.dynamics.moments import cross, library, size, unit
from jaxnc.dynamics.sides import NOBODY, Key, key_of
from jaxnc.system.identity import GROUND

if TYPE_CHECKING:
    from jaxnc.dynamics.wrenches import Ledger
    from jaxnc.system.topology import JointIndex

MESHES = ("gear", "internal gear", "bevel gear", "internal bevel gear", "rack and pinion")
_AT_APEX = 1e-9  # of the wheels' size: closer centres stand where the axes meet, which then point to the wheels
_PARALLEL = 1e-12  # square of the sine below which axes count as parallel


def mesh(ledger: "Ledger", j: int) -> None:
    """Put the tooth force of a joint where it acts, if it is a mesh whose wheels one body carries."""
    top = ledger.top
    joint = top.joints[j]
    if joint.type not in MESHES:
        return
    (b, i) = sides.instances(top, j)[0]
    scalars = top.blocks[b].scalars[i]
    rack = joint.type == "rack and pinion"
    if rack:
        scalars = scalars[::-1]  # the pinion's angle first
    wheels, carriers = zip(*(_turned(ledger, joint, k, c) for k, c in enumerate(scalars)), strict=True)
    bearings = [(bearing(ledger, w, c), bearing(ledger, c, w)) for w, c in zip(wheels, carriers, strict=True)]
    keys = [tuple(k for k in pair if k is not None) for pair in bearings]
    if NOBODY in wheels or carriers[0] in {NOBODY, *wheels} or carriers[0] != carriers[1] or min(map(len, keys)) < 2:
        return
    place, force = (_on_rack if rack else _on_wheel)(ledger, j, b, i)
    key = key_of(joint)
    for sign, wheel, (mine, theirs) in zip((1.0, -1.0), wheels, keys, strict=True):
        before = ledger.wrenches[wheel][key]
        more = sign * force - before[0], sign * cross(place, force) - before[1]
        ledger.add(wheel, key, *more)
        ledger.add(wheel, mine, -more[0], -more[1])
        if carriers[0] == GROUND:
            _bear(ledger, wheel, mine, *more)
        ledger.add(carriers[0], theirs, *more)
        ledger.add(carriers[0], key, -more[0], -more[1])


def _turned(ledger: "Ledger", joint: "JointIndex", k: int, c: int) -> tuple[int, int]:
    """The body whose motion an angle or distance is, and the one that it is counted from."""
    top = ledger.top
    b, i = top.measures[c - ledger.first_scalar]
    block = top.blocks[b]
    if not top.angles[c - ledger.first_scalar]:
        start, to = sides.slots(top)[b][i][:2]
        return int(to), int(start)
    points = block.points[i]
    rest = [points[n : n + 2] for n in range(0, len(points), 2)] + [(~u,) for u in block.vectors[i]]
    rest.remove(joint.sides[2 + k])
    if joint.sides[k][1:]:
        rest.remove(joint.sides[k][1:])
    at = (*points, *(~u for u in block.vectors[i]))
    start = sides.whose_segment(top, rest[0], at) if rest else GROUND
    return sides.whose_segment(top, joint.sides[2 + k], at), start


def bearing(ledger: "Ledger", body: int, other: int) -> "Key | None":
    """Under which name a body's wrench from another one is kept; None if nothing joins them."""
    top = ledger.top
    if body == GROUND:
        return "point", ""
    for group in sides.groups(top, body):
        if other in group.neighbours or (other == GROUND and not group.neighbours):
            return ledger.key(body, group)
    found = sides.between(top, body, other)
    return key_of(top.joints[found[0]]) if found else None


def _bear(ledger: "Ledger", wheel: int, key: "Key", force: Any, moment: Any) -> None:
    """Let the ground's points under a bearing hold a wrench (about the origin): one, or two along a hinge."""
    top = ledger.top
    joint = next((joint for joint in top.joints if key == key_of(joint)), None)
    near = {i for group in sides.groups(top, wheel) if ledger.key(wheel, group) == key for i in group.items}
    near |= {i for side in (joint.sides[:2] if joint else ()) for i in side}
    points = sorted(i for i in near if i >= 0 and GROUND in sides.holders(top).get(i, ()))[:2]
    if not points:
        return
    first = ledger.points[..., points[0], :]
    if len(points) == 2 and top.dim == 3:
        apart = ledger.points[..., points[1], :] - first
        held = cross(moment - cross(first, force), apart) / (apart * apart).sum(-1)[..., None]
        ledger.ground(points[1], held)
        force = force - held
    ledger.ground(points[0], force)


def _on_wheel(ledger: "Ledger", j: int, b: int, i: int) -> tuple[Any, Any]:
    """Pitch point and force on the first wheel of a gear pair."""
    top, xp = ledger.top, library(ledger.points)
    constants = [c[:, None] for c in ledger.parts.constants[b][:, i].T]
    pull = ledger.pull(b, i)
    couple = pull[..., -2]
    centres = [ledger.points[..., side[0], :] for side in top.joints[j].sides[:2]]
    apart = centres[1] - centres[0]
    if top.dim == 2:
        # Of both couples, so that the sign of the row is its own: R1 φ1 ± R2 φ2.
        ratio = (1.0 if top.joints[j].type == "gear" else -1.0) * constants[1] / constants[0]
        place = centres[0] + apart / (1.0 + ratio)
        arm = place - centres[0]
        along = xp.stack([-arm[..., 1], arm[..., 0]], -1)
        generator = arm * 0.0
    else:
        axes = [_axis(ledger, side[1:]) for side in top.joints[j].sides[:2]]
        place, arm, generator, ratio = _pitch(xp, centres, axes, constants)
        along = cross(axes[0], arm)
    force = along * (couple / (arm * arm).sum(-1))[..., None]
    pressure = ledger.parts.pressure.get(j)
    if pressure is not None:
        # Away from the other wheel, across the pitch line; inside a ring the other way round.
        across = arm - generator * (arm * generator).sum(-1)[..., None]
        ring = xp.where((ratio < 0.0) & (ratio > -1.0), -1.0, 1.0)[..., 0]
        force = force - unit(across) * (ring * xp.tan(pressure) * size(force))[..., None]
    return place, force


def _pitch(xp: Any, centres: list[Any], axes: list[Any], constants: Any) -> tuple[Any, Any, Any, Any]:
    """Pitch point, its arm from the first axis, direction of the pitch line, and signed ratio of the radii in space."""
    (a, b), w = axes, centres[1] - centres[0]
    ab = (a * b).sum(-1)[..., None]
    wa, wb = (w * a).sum(-1)[..., None], (w * b).sum(-1)[..., None]
    square = 1.0 - ab * ab
    parallel = square <= _PARALLEL
    safe = xp.where(parallel, 1.0, square)
    t1, t2 = (wa - ab * wb) / safe, (ab * wa - wb) / safe
    apex = centres[0] + t1 * a
    ratio = constants[1] / constants[0] * constants[2]
    # Axes that meet: seen from there, each towards its wheel.
    least = _AT_APEX * (size(w)[..., None] + constants[0])
    side1, side2 = (xp.where(t > least, -1.0, 1.0) for t in (t1, t2))
    u1, u2, met = side1 * a, side2 * b, ratio * side1 * side2
    cosine = (u1 * u2).sum(-1)[..., None]
    n = u2 - cosine * u1
    sine = size(n)[..., None]
    n = n / xp.where(parallel, 1.0, sine)
    h = xp.sqrt(sine**2 + (met + cosine) ** 2)
    s = xp.where(parallel, 1.0, sine / xp.where(h > 0, h, 1.0))
    c = (met + cosine) / xp.where(h > 0, h, 1.0)
    half = xp.where(met < 0.0, -1.0, 1.0)  # inside a ring the pitch line is beyond the other axis
    g = half * (c * u1 + s * n)
    crossed_arm = half * constants[0] * n
    # Parallel ones: half way between the wheels along the axes.
    side = xp.where(ab < 0.0, -1.0, 1.0) * ratio
    flat_arm = (w - wa * a) / (1.0 + side)
    arm = xp.where(parallel, flat_arm, crossed_arm)
    place = xp.where(parallel, centres[0] + 0.5 * wa * a + flat_arm, apex + constants[0] / s * g)
    return place, arm, xp.where(parallel, a, g), xp.where(parallel, side, met)


def _on_rack(ledger: "Ledger", j: int, b: int, i: int) -> tuple[Any, Any]:
    """Pitch point and force on the pinion of a rack."""
    top, xp = ledger.top, library(ledger.points)
    (centre, *_), (start, *along) = top.joints[j].sides[:2]
    line = unit(_axis(ledger, along))
    w = ledger.points[..., start, :] - ledger.points[..., centre, :]
    out = unit(w - line * (w * line).sum(-1)[..., None])
    force = -line * ledger.pull(b, i)[..., -2][..., None]
    place = ledger.points[..., centre, :] + out * ledger.parts.constants[b][:, i, :1]
    pressure = ledger.parts.pressure.get(j)
    if pressure is not None:
        force = force - out * (xp.tan(pressure) * size(force))[..., None]
    return place, force


def _axis(ledger: "Ledger", segment: Any) -> Any:
    if len(segment) == 1:
        return ledger.vectors[..., ~segment[0], :]
    return unit(ledger.points[..., segment[1], :] - ledger.points[..., segment[0], :])
