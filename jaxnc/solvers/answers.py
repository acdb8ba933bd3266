"""What compiled code asks of the host: errors that say where they come from, and Ctrl-C that is not lost."""

import _thread
import threading
from collections.abc import Callable

import numpy as np

from jaxnc.errors import JaxncError

_AFTERWARDS = 0.05  # seconds after which an interrupted program has returned


def answered(
    doing: str, given_up: Callable[..., np.ndarray], f: Callable[..., np.ndarray], *args: object
) -> np.ndarray:
    """Call a function for compiled code; neither it nor `given_up` may call JAX.

    Args:
        doing: what it does, for messages.
        given_up: what is returned instead where the user has interrupted it, a function of the same arguments.
        f: the function.
        *args: its arguments.

    Raises:
        JaxncError: it failed.
    """
    try:
        return f(*args)
    except KeyboardInterrupt:
        # Compiled code would make an error of its own of it. It is raised again when that has returned.
        later = threading.Timer(_AFTERWARDS, _thread.interrupt_main)
        later.daemon = True
        later.start()
        return given_up(*args)
    except Exception as error:
        raise JaxncError(
            f"the host failed while it {doing} ({type(error).__name__}: {error}); repair=False does without it"
        ) from error
