"""Interruptions (Ctrl-C) that stay interruptions, also where compiled code is at work."""

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Within it an interruption ends in a `KeyboardInterrupt`.

    JAX makes another error of one that comes while it compares or traces what Python tells it, and none of one that
    comes while it collects garbage: that one is raised at the end.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    seen = False

    def handle(number: int, frame: Any) -> None:
        nonlocal seen
        seen = True
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
