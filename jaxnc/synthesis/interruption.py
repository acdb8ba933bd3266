"""Interruptions (Ctrl-C) that stay interruptions, also where compiled code is at work."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any

import jax


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Within it an interruption ends in a `KeyboardInterrupt`.

    JAX makes another error of one that comes while it compares or traces what Python tells it, and none of one that
    comes while it collects garbage: that one is raised at the end. One that comes while it notes what it traces can
    leave a note of its caches open, at which every later call stops ("Recursively calling ..."): they are emptied.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    seen = traced = False

    def handle(number: int, frame: Any) -> None:
        nonlocal seen, traced
        seen, traced = True, traced or _of_jax(frame)
        before(number, frame)

    signal.signal(signal.SIGINT, handle)
    try:
        yield
    except Exception:
        if seen:
            raise KeyboardInterrupt from None
        raise
    else:
        if seen:
            raise KeyboardInterrupt
    finally:
        signal.signal(signal.SIGINT, before)
        if traced:
            jax.clear_caches()


def _of_jax(frame: Any) -> bool:
    """Whether a frame of JAX's own Python is at work in it."""
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] == "jax":
            return True
        frame = frame.f_back
    return False
