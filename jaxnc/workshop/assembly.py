"""A mechanism made of plates in layers: its parts, pins, spacers and tables, and drawings in DXF and SVG."""

import io
import itertools
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.sax.saxutils import escape

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, JaxncError
from jaxnc.io.target import csv_text, folder, replacing, stem
from jaxnc.notebooks import align_columns
from jaxnc.viz.svg import element
from jaxnc.workshop.stock import Contour, Part, Pin, Shop

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FORMATS = ("dxf", "svg")
_COLOURS = (7, 3, 4, 6, 2, 30)  # of outlines by their level, in AutoCAD's index
_HOLES, _NAMES = 1, 8


@public
@dataclass(frozen=True)
class Passing:
    """Two things that pass each other in a layer.

    Attributes:
        one: the first.
        other: the second.
        clearance: what stays between them over the whole motion at least, mm, between its poses too.
        pose: number of the pose where they are closest; a fraction lies between two of them.
    """

    one: str
    other: str
    clearance: float
    pose: float


@public
@dataclass(frozen=True)
class Spacer:
    """A washer or spacer on a pin, between two parts.

    Attributes:
        pin: name of the pin.
        below: the part below it.
        above: the part above it.
        length: mm.
        washer: whether it lies between neighbouring layers.
    """

    pin: str
    below: str
    above: str
    length: float
    washer: bool


@public
@dataclass(frozen=True)
class Assembly:
    """A planar mechanism made of plates; ``print()`` shows its table.

    Attributes:
        name: of the mechanism.
        shop: the sizes.
        parts: plates, the ground first.
        pins: pins that join parts.
        levels: layer of each part, 0 the ground, counted upward.
        passing: what passes in one layer, the closest first.
        poses: how many poses were looked at.
        z: places of all points in all poses of the motion, complex, ``(T, points)``, mm.
        unsure: whether poses were too far apart somewhere: what might meet there is kept apart, and clearances may be
            larger than is said, and slots too short.
    """

    name: str
    shop: Shop
    parts: tuple[Part, ...]
    pins: tuple[Pin, ...]
    levels: tuple[int, ...]
    passing: tuple[Passing, ...]
    poses: int
    z: np.ndarray
    unsure: bool = False

    @property
    def plain_name(self) -> str:
        """The name in one line."""
        return one_line(self.name)

    @property
    def layers(self) -> int:
        """How many layers there are above the ground plate."""
        return max(self.levels)

    @property
    def layer_of(self) -> dict[str, int]:
        """Layer of each link by its name, as `jaxnc.synthesis.clear_links` takes them."""
        parts = zip(self.parts[1:], self.levels[1:], strict=True)
        return {name: level for part, level in parts for name in part.name.split(" + ")}

    @property
    def clearance(self) -> float:
        """What stays between all that passes in one layer at least, mm; infinite if nothing does."""
        return min((p.clearance for p in self.passing), default=np.inf)

    def level(self, part: Part) -> int:
        """Return the layer of a part."""
        return self.levels[next(k for k, other in enumerate(self.parts) if other is part)]

    def span(self, pin: Pin) -> tuple[int, int]:
        """Return the lowest and the highest layer of a pin."""
        levels = [self.levels[p] for p in pin.parts]
        return min(levels), max(levels)

    def length(self, pin: Pin) -> float:
        """Measure a pin from the outer face of its lowest part to that of its highest, mm."""
        low, high = self.span(pin)
        return (high - low) * self.shop.pitch + self.shop.thickness

    @property
    def spacers(self) -> tuple[Spacer, ...]:
        """Washers and spacers, those of length zero left out."""
        out = []
        for pin in self.pins:
            for low, high in itertools.pairwise(sorted(pin.parts, key=lambda p: self.levels[p])):
                step = self.levels[high] - self.levels[low]
                length = step * self.shop.pitch - self.shop.thickness
                if length > 0:
                    names = self.parts[low].name, self.parts[high].name
                    out.append(Spacer(pin.name, *names, length, step == 1))
        return tuple(out)

    def size(self, part: Part) -> tuple[float, float]:
        """Measure length and width of a part, mm."""
        z = part.corners * part.lying
        return float(np.ptp(np.real(z))) + self.shop.width, float(np.ptp(np.imag(z))) + self.shop.width

    def places(self, part: Part, pose: int) -> tuple[complex, complex]:
        """Return origin and direction of a part in a pose: a place w of it is at ``origin + w direction``."""
        z = self.z[pose : pose + 1]
        origin = 0.0 if part.frame.origin is None else complex(z[0, part.frame.origin])
        return complex(origin), complex(part.frame.direction(z)[0])

    # -- tables -------------------------------------------------------------------------------------------------

    def mass(self, part: Part) -> float:
        """Weigh a plate, g; nan without a density."""
        density = np.nan if self.shop.density is None else self.shop.density
        outline, *cuts = part.contours(self.shop)
        return 1e-6 * density * self.shop.thickness * (outline.area - sum(cut.area for cut in cuts))

    def rows(self) -> list[list[str]]:
        """List everything to be made or bought, equal pins and spacers in one row, under a header with units."""
        shop = self.shop
        head = ["item", "name", "count", "layer", "thickness [mm]", "length [mm]", "width [mm]", "diameter [mm]"]
        rows = [[*head, "hole [mm]", "holes", "slots [mm]"]]
        for part, level in zip(self.parts, self.levels, strict=True):
            long, wide = self.size(part)
            slots = ", ".join(mm(s.length + shop.hole) for s in part.slots)
            holes = ", ".join(h.name for h in part.holes)
            rows.append([part.kind, part.name, "1", str(level), mm(shop.thickness), mm(long), mm(wide), "",
                         mm(shop.hole), holes, slots])  # fmt: skip
        if shop.density is not None:
            rows[0].append("mass [g]")
            for row, part in zip(rows[1:], self.parts, strict=True):
                row.append(f"{self.mass(part):.4g}")

        def add(item: str, names: list[str], thickness: str, length: str, diameter: float, hole: str) -> None:
            row = [item, ", ".join(dict.fromkeys(names)), str(len(names)), "", thickness, length, "", mm(diameter)]
            rows.append([*row, hole] + [""] * (len(rows[0]) - len(row) - 1))

        for length in sorted({mm(self.length(p)) for p in self.pins}, key=float):
            add("pin", [p.name for p in self.pins if mm(self.length(p)) == length], "", length, shop.pin, "")
        if washers := [s.pin for s in self.spacers if s.washer]:
            add("washer", washers, mm(shop.washer), "", shop.spacer, mm(shop.hole))
        spacers = [s for s in self.spacers if not s.washer]
        for length in sorted({mm(s.length) for s in spacers}, key=float):
            names = [s.pin for s in spacers if mm(s.length) == length]
            add("spacer", names, "", length, shop.spacer, mm(shop.hole))
        return rows

    def stacks(self) -> list[list[str]]:
        """List what lies on each pin, from the ground plate upward, under a header with units."""
        rows = [["pin", "layers", "length [mm]", "on it, from below (washers and spacers in mm)"]]
        spacers = {(s.pin, s.below): s for s in self.spacers}
        for pin in self.pins:
            low, high = self.span(pin)
            on = []
            for part in sorted(pin.parts, key=lambda p: self.levels[p]):
                name = self.parts[part].name
                on.append(name)
                if (pin.name, name) in spacers:
                    s = spacers[pin.name, name]
                    on.append(f"{'washer' if s.washer else 'spacer'} {mm(s.length)}")
            rows.append([pin.name, f"{low}-{high}", mm(self.length(pin)), ", ".join(on)])
        return rows

    def __str__(self) -> str:
        counts = {"pin": len(self.pins)}
        counts |= {k: sum(s.washer == (k == "washer") for s in self.spacers) for k in ("washer", "spacer")}
        head = f"{self.plain_name}: {len(self.parts)} plates of {mm(self.shop.thickness)} mm in {self.layers} "
        head += f"layer{'s' * (self.layers != 1)} on the ground plate, "
        head += ", ".join(f"{n} {kind}{'s' * (n != 1)}" for kind, n in counts.items())
        if self.shop.density is not None:
            head += f"; the plates weigh {sum(map(self.mass, self.parts)):.4g} g"
        return "\n".join([head, self.said, "", *align_columns(self.rows()), "", *align_columns(self.stacks())])

    __repr__ = __str__

    @property
    def said(self) -> str:
        """The clearance that remains, in a sentence."""
        more = (
            "; poses are far apart, and more of them may need fewer layers, longer slots, or show more clearance"
            if self.unsure
            else ""
        )
        if not self.passing:
            return f"nothing passes anything else in a layer ({self.poses} poses, and between them){more}"
        p = self.passing[0]
        return (
            f"{p.one} and {p.other} come closest: {mm(round(p.clearance, 2))} mm stay between them, near pose "
            f"{p.pose:.4g} ({self.poses} poses looked at; the number holds between them too){more}"
        )

    # -- files --------------------------------------------------------------------------------------------------

    def draw(self, path: str | Path | None = None, pose: int = 0) -> "Figure":
        """Draw the stack in plan and from the side; see `jaxnc.viz.plates.draw_plates`."""
        from jaxnc.viz.plates import draw_plates

        return draw_plates(self, path, pose)

    def save(self, where: str | Path, formats: Sequence[str] = _FORMATS) -> Path:
        """Write drawings of all parts and the table of parts into a folder.

        Args:
            where: the folder; created if it is not there.
            formats: ``"dxf"`` (needs ezdxf), ``"svg"``, or both.

        Returns:
            The folder. In it there are for each part a file of its name, ``parts`` with all of them side by side and
            their names beside them, ``assembly`` with all of them in the first pose, at true scale in mm; the table
            ``parts.csv``, what lies on each pin in ``pins.csv``, both in ``parts.txt``; and the picture
            ``assembly.png``. Names of parts that are no names of files are changed until they are.

        Raises:
            InputError: an unknown format.
            OutputError: a file cannot be written; then none is.
            JaxncError: ezdxf is not installed.
        """
        files: dict[str, bytes] = {}
        for ending in check_formats(formats):
            for drawing in self.drawings():
                files[f"{drawing.name}.{ending}"] = drawing.dxf(self) if ending == "dxf" else drawing.svg(self)
        files |= {"parts.csv": csv_text(self.rows()), "pins.csv": csv_text(self.stacks())}
        files["parts.txt"] = f"{self}\n".encode()
        where = folder(where)
        with ExitStack() as stack:  # nothing is put in place before everything is written
            for name, content in files.items():
                stack.enter_context(replacing(where / name)).write_bytes(content)
            self.draw(stack.enter_context(replacing(where / "assembly.png")))
        return where

    def drawings(self) -> "list[PartDrawing]":
        """Return a drawing of each part, of all side by side, and of all in the first pose."""
        out, taken = [], {"parts", "assembly"}
        for part in self.parts:
            name = base = stem(part.name, "part")
            for k in itertools.count(2):
                if name not in taken:
                    break
                name = f"{base}-{k}"
            taken.add(name)
            out.append(PartDrawing(name, part.name, [PlacedPart(part, 0j, part.lying)]))
        side, row = [], 0.0
        for part in self.parts:
            z = part.corners * part.lying
            low = complex(np.real(z).min(), np.imag(z).min()) - 0.5 * self.shop.width * (1 + 1j)
            side.append(PlacedPart(part, complex(-low.real, row - low.imag), part.lying))
            row += self.size(part)[1] + self.shop.width
        whole = [PlacedPart(part, *self.places(part, 0)) for part in self.parts]
        return [*out, PartDrawing("parts", self.name, side, labelled=True), PartDrawing("assembly", self.name, whole)]


def check_formats(formats: object) -> tuple[str, ...]:
    """Return formats of drawings as a tuple, checked."""
    given = (formats,) if isinstance(formats, str) else formats
    if not isinstance(given, Sequence) or not given or any(f not in _FORMATS for f in given):
        raise InputError(f"to_parts(): formats={formats!r}; give 'dxf', 'svg' or both")
    return tuple(given)


def mm(value: float) -> str:
    """Write a length as tables have it."""
    return f"{value:.6g}"


# -- drawings ---------------------------------------------------------------------------------------------------------


class PlacedPart(NamedTuple):
    """A part in a drawing: a place w of it is at ``origin + w direction``.

    Attributes:
        part: the part.
        origin: mm, complex.
        direction: a complex number of size 1.
    """

    part: Part
    origin: complex
    direction: complex


class PartDrawing(NamedTuple):
    """A drawing of parts.

    Attributes:
        name: of its file, without an ending.
        title: of the part, or the mechanism.
        parts: what is drawn.
        labelled: whether names stand beside the parts.
    """

    name: str
    title: str
    parts: list[PlacedPart]
    labelled: bool = False

    def dxf(self, assembly: "Assembly") -> bytes:
        """Draw outlines as polylines with arcs, holes as circles, on layers of their own."""
        try:
            import ezdxf
        except ImportError:
            raise JaxncError(
                'DXF needs ezdxf: pip install "jaxnc[dxf]" (or pip install ezdxf); formats="svg" does without, as does '
                "--format svg on the command line"
            ) from None
        document = ezdxf.new("R2010", units=4)  # $INSUNITS of millimetres
        document.header["$MEASUREMENT"] = 1
        document.header.custom_vars.append("title", one_line(self.title).encode("ascii", "replace").decode())
        space: Any = document.modelspace()
        several = len(self.parts) > 1
        for k, placed in enumerate(self.parts):
            level = assembly.level(placed.part)
            prefix = f"{level}-{k}-" if several else ""
            outer = _COLOURS[level % len(_COLOURS)] if several else _COLOURS[0]
            layers = {"OUTLINE": outer, "HOLES": _HOLES} | ({"NAMES": _NAMES} if self.labelled else {})
            for layer, colour in layers.items():
                document.layers.add(f"{prefix}{layer}", color=colour)
            if self.labelled:
                at, height, text = _place_label(assembly, placed)
                look = {"layer": f"{prefix}NAMES", "insert": (at.real, at.imag - 0.5 * height)}
                space.add_text(text, height=height, dxfattribs=look)
            for contour in _contours(assembly, placed):
                look = {"layer": f"{prefix}{'OUTLINE' if contour.kind == 'outline' else 'HOLES'}"}
                if len(contour.corners) == 1:
                    (w,) = contour.corners
                    space.add_circle((w.real, w.imag), contour.radius, dxfattribs=look)
                else:
                    ends = [(w.real, w.imag, bulge) for w, bulge in contour.bulges()]
                    space.add_lwpolyline(ends, format="xyb", close=True, dxfattribs=look)
        text = io.StringIO()
        document.write(text)
        return text.getvalue().encode("utf-8", "replace")

    def svg(self, assembly: "Assembly") -> bytes:
        """Draw with a millimetre as the unit; y points up in the parts, and down in the file."""
        groups, corners, words = [], [], 0.0
        for placed in sorted(self.parts, key=lambda p: assembly.level(p.part)):
            contours = _contours(assembly, placed)
            corners.append(contours[0].corners)
            at, height, text = _place_label(assembly, placed)
            lines = [element("title", escape(text)), *map(_svg_path, contours)]
            if self.labelled:
                words = max(words, at.real + 0.62 * height * len(text))  # a letter is 0.62 of its height wide
                place = {"x": _n(at.real), "y": _n(0.35 * height - at.imag), "font_size": _n(height)}
                look = {"font_family": "sans-serif", "fill": "blue", "stroke": "none"}
                lines.append(element("text", escape(text), class_="name", **place, **look))
            data = {"data_layer": assembly.level(placed.part), "data_part": one_line(placed.part.name)}
            groups.append(element("g", "\n", "\n".join(lines), "\n", **data))
        margin = 5.0  # mm
        z, edge = np.concatenate(corners), 0.5 * assembly.shop.width + margin
        x, y = np.real(z), -np.imag(z)
        left, top = x.min() - edge, y.min() - edge
        wide, high = max(float(np.ptp(x)) + 2 * edge, words + margin - left), float(np.ptp(y)) + 2 * edge
        drawing = element(
            "svg", "\n", element("title", escape(one_line(self.title))), "\n", "\n".join(groups), "\n",
            xmlns="http://www.w3.org/2000/svg", width=f"{_n(wide)}mm", height=f"{_n(high)}mm",
            viewBox=f"{_n(left)} {_n(top)} {_n(wide)} {_n(high)}", fill="none", stroke="black", stroke_width=0.1,
        )  # fmt: skip
        return f"{drawing}\n".encode("utf-8", "replace")


def _contours(assembly: "Assembly", placed: PlacedPart) -> list[Contour]:
    return [c.place(placed.origin, placed.direction) for c in placed.part.contours(assembly.shop)]


def _place_label(assembly: "Assembly", placed: PlacedPart) -> tuple[complex, float, str]:
    """Place the name of a part at half its height, right of the part; where it begins, its height in mm, its text."""
    z, width = placed.origin + placed.part.corners * placed.direction, assembly.shop.width
    low, high = float(np.imag(z).min()), float(np.imag(z).max())
    text = f"{one_line(placed.part.name)}, layer {assembly.level(placed.part)}"
    return complex(float(np.real(z).max()) + width, 0.5 * (low + high)), 0.4 * width, text


def _svg_path(contour: Contour) -> str:
    radius = _n(contour.radius)
    if len(contour.corners) == 1:
        (w,) = contour.corners
        return element("circle", class_=contour.kind, cx=_n(w.real), cy=_n(-w.imag), r=radius)
    ends = contour.bulges()
    words = [f"M{_n(ends[0][0].real)} {_n(-ends[0][0].imag)}"]
    for (_, bulge), (w, _) in zip(ends, [*ends[1:], ends[0]], strict=True):
        to = f"{_n(w.real)} {_n(-w.imag)}"
        words.append(f"A{radius} {radius} 0 0 0 {to}" if bulge else f"L{to}")
    return element("path", class_=contour.kind, d=f"{' '.join(words)} Z")


def _n(value: float) -> str:
    return f"{value + 0.0:.12g}"


def one_line(text: str) -> str:
    """Write a name in one line, without signs that files do not hold."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
