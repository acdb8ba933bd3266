"""Results that show themselves, as text and in a notebook; `jaxnc.viz` makes the pictures when they are asked for."""

import importlib.util
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from jaxnc.doors import door

if TYPE_CHECKING:
    from pathlib import Path


def align_columns(rows: Sequence[Sequence[str]], left: Collection[int] | None = None, indent: str = "") -> list[str]:
    """Write rows of words in columns, each as wide as its widest word.

    Words stand at the left of the columns `left`, of all if not given, and at the right of the others.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]

    def cell(k: int, word: str) -> str:
        return word.ljust(widths[k]) if left is None or k in left else word.rjust(widths[k])

    return [indent + "  ".join(cell(k, word) for k, word in enumerate(row)).rstrip() for row in rows]


class Shown:
    """A thing that notebooks show as a drawing and a short table; plain text elsewhere."""

    def _repr_html_(self) -> str | None:
        if importlib.util.find_spec("matplotlib") is None:
            return None  # the text does
        return door("show_html")(self)


class Reported(Shown):
    """A result whose ``repr`` is its report, as ``print`` writes it; a dataclass of it has ``repr=False``."""

    def __repr__(self) -> str:
        return str(self)


class Drawn(Shown):
    """A mechanism, as it was typed, assembled or moved."""

    def draw(self, path: "str | Path | None" = None, **options: object):
        """Draw the mechanism in one pose, complete or not; see `jaxnc.viz.draw`."""
        return door("draw")(self, path=path, **options)
