"""What shows itself in a notebook: one method for everything, made in `jaxnc.viz.repr_html` when it is asked for."""

import importlib.util
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path


class Shown:
    """A thing that notebooks show as a drawing and a short table; plain text elsewhere."""

    def _repr_html_(self) -> str | None:
        if importlib.util.find_spec("matplotlib") is None:
            return None  # the text does
        from jaxnc.viz.repr_html import show_html

        return show_html(self)


class Drawn(Shown):
    """A mechanism, as it was typed, assembled or moved."""

    def draw(self, path: "str | Path | None" = None, **options: Any):
        """Draw the mechanism in one pose, complete or not; see `jaxnc.viz.draw`."""
        from jaxnc import viz

        return viz.draw(self, path=path, **options)  # pyright: ignore[reportArgumentType]
