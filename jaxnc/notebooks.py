"""What shows itself in a notebook: one method for everything, made in `jaxnc.viz.repr_html` when it is asked for."""

import contextlib
import gc
import importlib.util
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path


@contextlib.contextmanager
def at_once() -> Iterator[None]:
    """Put off Python's search for unreachable cycles: it looks through all of JAX, and was half of a first drawing."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class Shown:
    """A thing that notebooks show as a drawing and a short table; plain text elsewhere."""

    def _repr_html_(self) -> str | None:
        if importlib.util.find_spec("matplotlib") is None:
            return None  # the text does
        with at_once():
            from jaxnc.viz.repr_html import show_html

            return show_html(self)


class Drawn(Shown):
    """A mechanism, as it was typed, assembled or moved."""

    def draw(self, path: "str | Path | None" = None, **options: Any):
        """Draw the mechanism in one pose, complete or not; see `jaxnc.viz.draw`."""
        with at_once():
            from jaxnc import viz

            return viz.draw(self, path=path, **options)  # pyright: ignore[reportArgumentType]
