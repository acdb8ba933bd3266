"""Things that show themselves in a notebook; the pictures are made by `jaxnc.viz` when they are asked for."""

import importlib.util
from typing import TYPE_CHECKING

from jaxnc.doors import door

if TYPE_CHECKING:
    from pathlib import Path


class Shown:
    """A thing that notebooks show as a drawing and a short table; plain text elsewhere."""

    def _repr_html_(self) -> str | None:
        if importlib.util.find_spec("matplotlib") is None:
            return None  # the text does
        return door("show_html")(self)


class Drawn(Shown):
    """A mechanism, as it was typed, assembled or moved."""

    def draw(self, path: "str | Path | None" = None, **options: object):
        """Draw the mechanism in one pose, complete or not; see `jaxnc.viz.draw`."""
        return door("draw")(self, path=path, **options)
