"""Progress on stderr: the one place that decides whether a bar is shown, and makes it."""

import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tqdm import tqdm


def watched() -> bool:
    """Whether someone sees what is written to stderr: a terminal, or a notebook."""
    shell = sys.modules.get("IPython")
    kernel = None if shell is None else shell.get_ipython()
    return sys.stderr.isatty() or type(kernel).__name__ == "ZMQInteractiveShell"


def showing() -> bool:
    """Whether a bar is shown already; what is done within it needs none of its own."""
    module = sys.modules.get("tqdm")
    return bool(module and len(getattr(module.tqdm, "_instances", ())))


def bar(total: int | None, name: str = "", unit: str = "it", shown: bool | None = None, **form: Any) -> "tqdm":
    """A progress bar, also a context manager.

    Args:
        total: how many steps, None if that is not known.
        name: what it is about.
        unit: noun of a step.
        shown: whether it is shown; if not given, where someone is watching.
        **form: further options of ``tqdm.tqdm``.
    """
    from tqdm import tqdm

    hidden = not (watched() if shown is None else shown)
    return tqdm(total=total, desc=name, unit=unit, disable=hidden, file=sys.stderr, **form)
