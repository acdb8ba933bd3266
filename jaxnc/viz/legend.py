"""Legend under a drawing, with what is not in the picture, in as many rows as it needs."""

from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.offsetbox import AnnotationBbox, HPacker, TextArea, VPacker

from jaxnc.viz.style import LIGHT, NUMBERS, wide, wrap

_GAP = "    "  # between entries


@dataclass(frozen=True)
class Legend:
    """Entries of texts with their colours."""

    entries: tuple[tuple[tuple[str, str], ...], ...] = ()  # each of one or several texts, (text, colour)

    def _parts(self, room: float) -> list[tuple[tuple[str, str], ...]]:
        """Cut entries of one text that are longer than a row into pieces."""
        out: list[tuple[tuple[str, str], ...]] = []
        for entry in self.entries:
            one = [((part, entry[0][1]),) for part in wrap(entry[0][0], NUMBERS, room)]
            out.extend(one if len(entry) == 1 else [entry])
        return out

    def rows(self, room: float) -> list[list[tuple[str, str]]]:
        """Arrange the texts in rows of a width, points."""
        out: list[list[tuple[str, str]]] = []
        left = 0.0
        for entry in self._parts(room):
            takes = wide("".join(text for text, _ in entry) + _GAP, NUMBERS)
            if not out or takes > left:
                out.append([])
                left = room
            out[-1].extend((*entry, (_GAP, LIGHT["ink"])))
            left -= takes
        return out

    def height(self, room: float) -> float:
        """Measure the height of the rows in a width, points."""
        return 1.5 * NUMBERS * len(self.rows(room))  # a row is 1.5 letters high

    def paint(self, ax: Axes, room: float) -> None:
        """Write the legend under axes of a width, points."""
        rows: list[Any] = [
            HPacker(children=[_text(text, colour) for text, colour in row], pad=0, sep=0) for row in self.rows(room)
        ]
        if rows:
            box = VPacker(children=rows, pad=0, sep=0.3 * NUMBERS)
            # 3.4 letters for numbers and name of the axis above them
            below = -(3.4 * NUMBERS + 6.0) if ax.axison else -2.0
            ax.add_artist(
                AnnotationBbox(
                    box, (0.0, 0.0), (0.0, below), xycoords="axes fraction", boxcoords="offset points",
                    box_alignment=(0.0, 1.0), frameon=False, pad=0.0, annotation_clip=False,
                )
            )  # fmt: skip


def _text(text: str, colour: str) -> TextArea:
    return TextArea(text, textprops={"fontsize": NUMBERS, "color": colour, "parse_math": False})
