"""Searches that can be stopped: saved in a file after every round and taken up again, and interrupted by Ctrl-C."""

import contextlib
import dataclasses
import hashlib
import io
import json
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import jax
import numpy as np

from jaxnc.errors import InputError, ModelFileError
from jaxnc.kinematics.redesign import flattened
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.pytree import Leaves

_FORM = 3  # of the file; another number when its contents change


class Resumable(Protocol):
    """A search that can be kept: everything that decides how it goes on, as arrays by name."""

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Write the state as arrays."""
        ...

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go back to what `to_arrays` returned."""
        ...


def search_terms(problem: Problem, **settings: Any) -> dict[str, Any]:
    """The settings that a search and the one that resumes it must have in common."""
    own = {"form": _FORM, "problem": problem.name, "unknowns": list(problem.names)}
    return {**own, **settings, "numbers": _problem_digest(problem)}


def check_writable(path: str | Path) -> None:
    """See before a long search that its file can be written."""
    from jaxnc.io import target

    if Path(path).is_dir():
        raise InputError(f"checkpoint={str(path)!r} is a folder; name a file in it")
    target.folder(Path(path).parent)


def save_run(path: str | Path, terms: Mapping[str, Any], run: Resumable, history: Sequence[Any]) -> None:
    """Write a search between two rounds."""
    from jaxnc.io import target

    out = io.BytesIO()
    rows = np.array([tuple(h) for h in history], dtype=float).reshape(-1, 3)
    np.savez(out, **run.to_arrays(), history=rows, terms=np.array(json.dumps(terms)))  # pyright: ignore[reportArgumentType]
    target.write(path, out.getvalue())


def resume_run(path: str | Path, terms: Mapping[str, Any], run: Resumable) -> list[tuple[float, int, float]]:
    """Bring a search to where it was saved; its history: seconds, designs finished and best error, round by round."""
    from jaxnc.io import archive

    arrays = archive.read(path, "a file that a search with checkpoint= wrote")
    try:
        begun = json.loads(str(arrays["terms"]))
    except (KeyError, ValueError):
        raise ModelFileError(f"{path} is not a file that a search with checkpoint= wrote; give another") from None
    for name, value in terms.items():
        if begun.get(name) != value:
            if name == "numbers":
                raise InputError(f"{path} is a search for {begun['problem']} with other targets, bounds or conditions")
            raise InputError(f"{path} was begun with {name} = {begun.get(name)}; it cannot go on with {value}")
    run.restore(arrays)
    return [(float(s), int(n), float(e)) for s, n, e in arrays["history"]]


def _problem_digest(problem: Problem) -> str:
    """Digest of all numbers and names that make a problem."""
    out = hashlib.sha256(np.asarray(flattened(problem.system), dtype=float).tobytes())
    _add_to_digest(out, problem)
    return out.hexdigest()


def _add_to_digest(out: Any, value: Any) -> None:
    """Add numbers and names, also inside tuples and records; functions and systems do not count."""
    if isinstance(value, np.ndarray):
        out.update(np.asarray(value, dtype=float).tobytes())
    elif value is None or isinstance(value, (str, int, float)):
        out.update(repr(value).encode())
    elif isinstance(value, tuple):
        for one in value:
            _add_to_digest(out, one)
    elif isinstance(value, Leaves):
        out.update(type(value).__name__.encode())
        for field in dataclasses.fields(value):  # pyright: ignore[reportArgumentType]
            _add_to_digest(out, getattr(value, field.name))


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
        seen, traced = True, traced or _in_jax(frame)
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


def _in_jax(frame: Any) -> bool:
    """Tell whether a frame of JAX's own Python is at work."""
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] == "jax":
            return True
        frame = frame.f_back
    return False
