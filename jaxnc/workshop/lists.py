"""What has to be made and bought for an assembly, and what lies on each pin."""

from typing import TYPE_CHECKING

import numpy as np

from jaxnc.io.workshop.shop import Shop
from jaxnc.io.workshop.stock import Part

if TYPE_CHECKING:
    from jaxnc.io.workshop.assembly import Assembly


def area(part: Part, shop: Shop) -> float:
    """Area of a plate without its holes and slots, mm²."""
    z, r = part.corners, 0.5 * shop.width
    after = np.roll(z, -1)
    hull = 0.5 * float(np.imag(np.conj(z) * after).sum())
    whole = hull + r * float(np.abs(after - z).sum()) + np.pi * r**2
    slots = [s.length for s in part.slots]
    return whole - sum(slots) * shop.hole - (len(part.holes) + len(slots)) * 0.25 * np.pi * shop.hole**2


def materials(assembly: "Assembly") -> list[list[str]]:
    """Everything that has to be made or bought, equal pins and spacers in one row, under a header with units."""
    shop = assembly.shop
    head = ["item", "name", "count", "layer", "thickness [mm]", "length [mm]", "width [mm]", "diameter [mm]"]
    rows = [[*head, "hole [mm]", "holes", "slots [mm]"]]
    for part, level in zip(assembly.parts, assembly.levels, strict=True):
        long, wide = assembly.size(part)
        slots = ", ".join(mm(s.length + shop.hole) for s in part.slots)
        holes = ", ".join(h.name for h in part.holes)
        rows.append([part.kind, part.name, "1", str(level), mm(shop.thickness), mm(long), mm(wide), "",
                     mm(shop.hole), holes, slots])  # fmt: skip
    if shop.density is not None:
        rows[0].append("mass [g]")
        for row, part in zip(rows[1:], assembly.parts, strict=True):
            row.append(f"{assembly.mass(part):.4g}")
    width = len(rows[0])

    def more(item: str, names: list[str], thickness: str, length: str, diameter: float, hole: str) -> None:
        row = [item, ", ".join(dict.fromkeys(names)), str(len(names)), "", thickness, length, "", mm(diameter), hole]
        rows.append(row + [""] * (width - len(row)))

    for length in sorted({mm(assembly.length(p)) for p in assembly.pins}, key=float):
        more("pin", [p.name for p in assembly.pins if mm(assembly.length(p)) == length], "", length, shop.pin, "")
    between = assembly.spacers
    if washers := [s.pin for s in between if s.washer]:
        more("washer", washers, mm(shop.washer), "", shop.spacer, mm(shop.hole))
    for length in sorted({mm(s.length) for s in between if not s.washer}, key=float):
        names = [s.pin for s in between if not s.washer and mm(s.length) == length]
        more("spacer", names, "", length, shop.spacer, mm(shop.hole))
    return rows


def stacking(assembly: "Assembly") -> list[list[str]]:
    """What lies on each pin, from the ground plate upward, under a header with units."""
    rows = [["pin", "layers", "length [mm]", "on it, from below (washers and spacers in mm)"]]
    spacers = {(s.pin, s.below): s for s in assembly.spacers}
    for pin in assembly.pins:
        low, high = assembly.span(pin)
        on = []
        for part in sorted(pin.parts, key=lambda p: assembly.levels[p]):
            name = assembly.parts[part].name
            on.append(name)
            if (pin.name, name) in spacers:
                s = spacers[pin.name, name]
                on.append(f"{'washer' if s.washer else 'spacer'} {mm(s.length)}")
        rows.append([pin.name, f"{low}-{high}", mm(assembly.length(pin)), ", ".join(on)])
    return rows


def mm(value: float) -> str:
    """A length as tables say it."""
    return f"{value:.6g}"


def lying(part: Part) -> complex:
    """By what a part is turned in a drawing of its own: a bar lies along x, as bars are cut."""
    if len(part.corners) != 2:
        return 1 + 0j
    along = part.corners[1] - part.corners[0]
    return complex(np.conj(along) / abs(along)) * (1 if along.real > -1e-9 * abs(along) else -1)


def label(part: Part, level: int) -> str:
    """What is written beside a part."""
    return f"{plain(part.name)}, layer {level}"


def plain(text: str) -> str:
    """A name in one line, without signs that files do not hold."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def beside(assembly: "Assembly", part: Part, origin: complex, direction: complex) -> tuple[complex, float]:
    """Where the name of a part begins, at half its height, right of the part; and its height, mm."""
    z, width = origin + part.corners * direction, assembly.shop.width
    low, high = float(np.imag(z).min()), float(np.imag(z).max())
    return complex(float(np.real(z).max()) + width, 0.5 * (low + high)), 0.4 * width
