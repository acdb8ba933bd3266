"""Progress: the one place that decides whether a bar is shown, and makes it, on stderr or in a notebook's cell."""

import functools
import html
import io
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tqdm import tqdm

_LINE = "font:12px/1.5 ui-monospace,monospace;white-space:pre-wrap;opacity:.75"
_BAR = "width:160px;vertical-align:middle;margin-right:1ch"


def is_watched() -> bool:
    """Say whether someone sees what is shown, on a terminal or in a notebook."""
    return sys.stderr.isatty() or _in_notebook()


def _in_notebook() -> bool:
    shell = sys.modules.get("IPython")
    return shell is not None and type(shell.get_ipython()).__name__ == "ZMQInteractiveShell"


def showing() -> bool:
    """Say whether a bar is shown already; what is done within it needs none of its own."""
    module = sys.modules.get("tqdm")
    return bool(module and len(getattr(module.tqdm, "_instances", ())))


def bar(total: int | None, name: str = "", unit: str = "it", shown: bool | None = None, **form: Any) -> "tqdm":
    """Make a progress bar, also a context manager.

    It is shown where someone is watching, if `shown` does not say; `unit` is the noun of a step, `form` are options of
    ``tqdm.tqdm``.
    """
    from tqdm import tqdm

    hidden = not (is_watched() if shown is None else shown)
    if hidden or sys.stderr.isatty() or not _in_notebook():
        return tqdm(total=total, desc=name, unit=unit, disable=hidden, file=sys.stderr, **form)
    return _among_results()(total=total, desc=name, unit=unit, file=io.StringIO(), **form)


@contextmanager
def step_bar(total: int) -> Iterator[Callable[[str], None]]:
    """A bar over the steps of a command.

    Yields:
        A function that is called with the name of each step when the step begins.
    """
    form = "{desc}{n_fmt}/{total_fmt} |{bar:30}| {elapsed}"
    with bar(total, leave=False, bar_format=form) as shown:
        done = -1

        def step(name: str) -> None:
            nonlocal done
            done += 1
            shown.update(done - shown.n)
            shown.set_description(name)

        yield step


@functools.cache
def _among_results() -> "type[tqdm]":
    """Bars that are results of a notebook's cell and end as a line of text: stderr would stay there, a strip of red."""
    from tqdm import tqdm

    class Bar(tqdm):
        name: str | None = None  # of the result that is shown anew

        def display(self, msg: str | None = None, pos: int | None = None) -> bool:
            """Show how far it is; a closed one that does not stay is asked to show nothing."""
            from IPython.display import display, update_display

            now: dict[str, Any] = dict(self.format_dict)
            text = "" if msg == "" else self.format_meter(**now | {"ncols": 0, "bar_format": None})
            of = "" if now["total"] is None else f' max="{now["total"]}" value="{min(now["n"], now["total"])}"'
            going = "" if self.disable else f'<progress{of} style="{_BAR}"></progress>'
            page = f'<div style="{_LINE}">{going}{html.escape(text)}</div>' if text else "<span></span>"
            what = {"text/plain": text, "text/html": page}
            if self.name is not None:
                update_display(what, raw=True, display_id=self.name)
            elif made := display(what, raw=True, display_id=True):
                self.name = made.display_id
            return True

    return Bar
