"""What a command does about the process that it runs in: its streams, its warnings, Ctrl-C, JAX's devices."""

import _thread
import contextlib
import io
import os
import sys
import threading
import warnings
from collections.abc import Iterator
from typing import Any

from jaxnc.errors import InputError

_AGAIN = 0.01  # seconds after which an interruption that was lost is asked for again


@contextlib.contextmanager
def settled() -> Iterator[None]:
    """Within it what is printed can be printed, a warning is one line, and no Ctrl-C is lost.

    Letters that the screen, or the file behind it, does not have become question marks; without a standard output
    nothing is printed. Pictures are drawn for files, whatever matplotlib is told to show windows with.
    """
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (stands for the process's own)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")
    before, backend = sys.unraisablehook, os.environ.get("MPLBACKEND")

    def lost(problem: Any) -> None:
        """JAX is called by Python's collector, where an exception is printed and forgotten."""
        if issubclass(problem.exc_type, KeyboardInterrupt):
            threading.Timer(_AGAIN, _thread.interrupt_main).start()
        else:
            before(problem)

    os.environ["MPLBACKEND"], sys.unraisablehook = "agg", lost
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: print(f"jaxnc: warning: {message}", file=sys.stderr)
            yield
    finally:
        sys.unraisablehook = before
        os.environ.pop("MPLBACKEND")
        if backend is not None:
            os.environ["MPLBACKEND"] = backend


def check_devices() -> None:
    """Raise if JAX was told to use what this machine does not have."""
    import jax

    told = os.environ.get("JAX_PLATFORMS")
    if told:
        try:
            jax.devices()
        except (RuntimeError, AssertionError):
            raise InputError(
                f"JAX_PLATFORMS={told}: JAX has no such device here; unset the variable, or set it to cpu"
            ) from None
