"""A mechanism made of plates: its stack in plan, and from the side with its layers."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Curve

from jaxnc.errors import InputError
from jaxnc.viz.picture import Picture, finish
from jaxnc.viz.style import HEADING, INK, LIGHT, NUMBERS, TEXT, colour_of, furnish, mix, wide, wrap

if TYPE_CHECKING:
    from jaxnc.workshop.assembly import Assembly
    from jaxnc.workshop.stock import Contour, Part

_LARGE = (7.2, 6.4)  # the most that the plan takes, inches
_EDGE = 0.62  # at the left and below, for numbers and names of axes
_ARC = 16  # stretches that an arc is drawn by
_GROUND = 0  # number of the ground plate


def draw_plates(assembly: "Assembly", path: str | Path | None = None, pose: int = 0) -> Figure:
    """Draw the plates of a mechanism in one pose, from above and from the side.

    Args:
        assembly: what `Motion.to_parts` returned.
        path: file to write as well: PNG, SVG, PDF or JPG.
        pose: which pose of the motion, counted from the end if negative.

    Returns:
        The figure: in the plan at scale, from the side with heights of their own scale.

    Raises:
        InputError: no such pose.
        OutputError: a file that cannot be written.
    """
    count = len(assembly.z)
    if not isinstance(pose, (int, np.integer)) or not -count <= pose < count:
        raise InputError(f"pose={pose!r}: this motion has poses 0 to {count - 1}")
    pose = int(pose) % count
    shop, half = assembly.shop, 0.5 * assembly.shop.width
    stands = [assembly.places(part, pose) for part in assembly.parts]
    corners = [o + part.corners * d for part, (o, d) in zip(assembly.parts, stands, strict=True)]
    z = np.concatenate(corners)
    low = np.array([z.real.min(), z.imag.min()]) - 1.6 * half
    span = np.array([z.real.max(), z.imag.max()]) + 1.6 * half - low
    scale = float(np.min(np.array(_LARGE) / span))  # inches per mm
    plan, side = span * scale, 0.2 * (assembly.layers + 1.6)  # inches for a layer from the side
    room = max(plan[0], 3.2)
    size = np.array([room + _EDGE + 0.15, plan[1] + side + 2 * _EDGE + 0.75])
    figure = Picture(figsize=tuple(size))
    left = (_EDGE + 0.5 * (room - plan[0])) / size[0]
    above = figure.add_axes((left, (side + 2 * _EDGE + 0.12) / size[1], plan[0] / size[0], plan[1] / size[1]))
    edge = figure.add_axes((left, _EDGE / size[1], plan[0] / size[0], side / size[1]))
    for ax in (above, edge):
        furnish(ax, grid="")
        ax.set_xlim(low[0], low[0] + span[0])
    above.set_ylim(low[1], low[1] + span[1])
    above.set_ylabel("y [mm]")
    edge.set_xlabel("x [mm]")
    order = np.argsort(assembly.levels, kind="stable").tolist()
    for k in order:
        part, (origin, direction) = assembly.parts[k], stands[k]
        fill, line = _colours(k)
        above.add_patch(
            PathPatch(_outline(assembly, part, origin, direction), facecolor=fill, edgecolor=line, linewidth=0.8,
                      alpha=0.82, zorder=2 + assembly.levels[k], gid=f"part {part.name}")
        )  # fmt: skip
    for pin in assembly.pins:
        origin, direction = stands[pin.part]
        at = origin + pin.at * direction
        top = assembly.span(pin)[1]
        disc = _plane(_circle(at, 0.5 * shop.pin))
        above.add_patch(PathPatch(Curve(disc, closed=True), facecolor=LIGHT["paper"], edgecolor=LIGHT["ink"],
                                  linewidth=0.7, zorder=2.5 + top, gid=f"pin {pin.name}"))  # fmt: skip
    _names(above, assembly, corners, [stands[p.part][0] + p.at * stands[p.part][1] for p in assembly.pins], scale)
    _from_the_side(edge, assembly, stands, corners)
    title = f"{assembly.plain_name}: {len(assembly.parts)} plates in {assembly.layers} layers on the ground plate"
    note = ""
    if assembly.passing:
        near = assembly.passing[0]
        note = f"{near.clearance:.4g} mm between {near.one} and {near.other} at least"
    room, down = 72 * (size[0] - 0.3), 0.16
    lines = [(line, HEADING, "ink") for line in wrap(title, HEADING, room)]
    lines += [(line, NUMBERS, "soft") for line in wrap(note, NUMBERS, room)]
    for line, letters, colour in lines:
        look: dict[str, Any] = {"fontsize": letters, "color": LIGHT[colour], "va": "top", "parse_math": False}
        figure.text(0.12 / size[0], 1 - down / size[1], line, **look)
        down += 1.45 * letters / 72
    return finish(figure, path)


def _colours(k: int) -> tuple[str, str]:
    """Choose the colours of a part's area and edge."""
    own = colour_of("ink", INK) if k == _GROUND else colour_of("body", k - 1)
    return mix(own, LIGHT["paper"], 0.1 if k == _GROUND else 0.34), LIGHT["soft"] if k == _GROUND else own


def _outline(assembly: "Assembly", part: "Part", origin: complex, direction: complex) -> Curve:
    """Draw the outline of a part with its holes and slots."""
    outline, *cuts = map(_ring, part.contours(assembly.shop))
    rings = [outline, *(ring[::-1] for ring in cuts)]
    return Curve.make_compound_path(*(Curve(_plane(origin + ring * direction), closed=True) for ring in rings))


def _circle(at: complex, radius: float) -> np.ndarray:
    return at + radius * np.exp(2j * np.pi * np.linspace(0, 1, 3 * _ARC + 1))


def _ring(contour: "Contour") -> np.ndarray:
    """Write a contour as places, closed, complex."""
    if len(contour.corners) == 1:
        return _circle(contour.corners[0], contour.radius)
    out, ends = [], contour.bulges()
    for (w, bulge), (after, _) in zip(ends, [*ends[1:], ends[0]], strict=True):
        out.append(np.array([w]))
        if bulge:
            turn = 4 * np.arctan(bulge)
            centre = (after - w * np.exp(1j * turn)) / (1 - np.exp(1j * turn))
            out.append(centre + (w - centre) * np.exp(1j * turn * np.linspace(0, 1, _ARC)[1:]))
    ring = np.concatenate(out)
    return np.append(ring, ring[0])


def _plane(z: np.ndarray) -> np.ndarray:
    """Write complex places as ``(n, 2)``."""
    return np.stack([np.real(z), np.imag(z)], axis=1)


def _names(ax, assembly: "Assembly", corners: list[np.ndarray], pins: list[complex], scale: float) -> None:
    """Write names of parts with their layers, and of pins, where they do not lie on each other or on pins."""
    low, high = np.array([ax.get_xlim(), ax.get_ylim()]).T
    disc = np.full(2, 0.5 * assembly.shop.pin)
    taken = [(np.array([at.real, at.imag]), disc) for at in pins]
    for k in np.argsort([-float(np.ptp(np.real(c)) + np.ptp(np.imag(c))) for c in corners], kind="stable").tolist():
        text = f"{assembly.parts[k].name} ({assembly.levels[k]})"
        half = 0.5 * np.array([wide(text, NUMBERS), 1.3 * NUMBERS]) / 72 / scale
        z = corners[k]
        shares = (0.5, 0.38, 0.62, 0.26, 0.74, 0.5, 0.38, 0.62)
        ends = (z.mean(), z.mean()) if k == _GROUND or len(z) > 2 else (z[0], z[-1])
        spots = []
        for i, share in enumerate(shares):
            lift = 0.0 if i < 5 else 1.0
            at = ends[0] + share * (ends[1] - ends[0]) if ends[0] != ends[1] else z[i % len(z)] * 0.4 + z.mean() * 0.6
            at += 1j * lift * (0.5 * assembly.shop.width + 1.4 * half[1])
            spots.append(np.array([at.real, at.imag]))
        at = np.clip(_freest(spots, half, taken), low + half, high - half)
        taken.append((at, half))
        ax.text(
            *at, text, fontsize=NUMBERS, color=LIGHT["ink"], ha="center", va="center", parse_math=False, zorder=50,
            gid="label", bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "boxstyle": "round,pad=0.15"},
        )  # fmt: skip
    size = 7.0  # points
    for pin, z in zip(assembly.pins, pins, strict=True):
        half = 0.5 * np.array([wide(pin.name, size), 1.2 * size]) / 72 / scale
        turns = np.exp(0.25j * np.pi * np.array([1, 3, 5, 7, 0, 2, 4, 6]))
        ways = _plane(turns) * (disc + 0.03 / scale + half)  # 0.03 inches between a pin and its name
        spots = [np.clip(np.array([z.real, z.imag]) + way, low + half, high - half) for way in ways]
        at = _freest(spots, half, taken)
        taken.append((at, half))
        ax.text(*at, pin.name, fontsize=size, color=LIGHT["ink"], ha="center", va="center", parse_math=False,
                zorder=49, gid="label")  # fmt: skip


def _freest(spots: list[np.ndarray], half: np.ndarray, taken: list) -> np.ndarray:
    """Choose the place of a text that is taken least; the first of those that are equally free."""

    def over(at: np.ndarray) -> float:
        both = [np.minimum(at + half, o + room) - np.maximum(at - half, o - room) for o, room in taken]
        return sum(float(np.prod(np.maximum(b, 0.0))) for b in both)

    return min(spots, key=over)


def _from_the_side(ax, assembly: "Assembly", stands: list, corners: list[np.ndarray]) -> None:
    """Draw plates from the side, with pins and spacers; one layer is one unit high."""
    shop = assembly.shop
    thick = shop.thickness / shop.pitch
    for k in np.argsort(assembly.levels, kind="stable").tolist():
        fill, line = _colours(k)
        x = corners[k].real
        left, right = x.min() - 0.5 * shop.width, x.max() + 0.5 * shop.width
        ax.add_patch(Rectangle((left, assembly.levels[k]), right - left, thick, facecolor=fill, edgecolor=line,
                               linewidth=0.8, alpha=0.82, zorder=2, gid=f"part {assembly.parts[k].name}"))  # fmt: skip
    for pin in assembly.pins:
        origin, direction = stands[pin.part]
        x = (origin + pin.at * direction).real
        levels = sorted(assembly.levels[p] for p in pin.parts)
        for low, high in itertools.pairwise(levels):
            gap = high - low - thick
            if gap > 0:
                ax.add_patch(Rectangle((x - 0.5 * shop.spacer, low + thick), shop.spacer, gap, facecolor=LIGHT["page"],
                                       edgecolor=LIGHT["ink"], linewidth=0.5, zorder=3, gid="spacer"))  # fmt: skip
        ax.add_patch(Rectangle((x - 0.5 * shop.pin, levels[0]), shop.pin, levels[-1] - levels[0] + thick,
                               facecolor=LIGHT["paper"], edgecolor=LIGHT["ink"], linewidth=0.6, zorder=4,
                               gid=f"pin {pin.name}"))  # fmt: skip
    ax.set_ylim(-0.3, assembly.layers + thick + 0.3)
    ax.set_yticks([level + 0.5 * thick for level in range(assembly.layers + 1)])
    ax.set_yticklabels([str(level) for level in range(assembly.layers + 1)])
    ax.set_ylabel("layer", fontsize=TEXT)
