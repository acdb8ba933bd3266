"""Searches that can be stopped: saved in a file after every round and taken up again, and interrupted by Ctrl-C."""

import contextlib
import hashlib
import io
import json
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

import jax
import numpy as np

from jaxnc.errors import InputError, ModelFileError
from jaxnc.kinematics.design import geometry_vector
from jaxnc.pickling import fields_of
from jaxnc.progress import bar
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.pytree import Leaves
from jaxnc.synthesis.result import Progress, format_quantity

_FORM = 3  # of the file; another number when its contents change


class Resumable(Protocol):
    """A search that can be kept: everything that decides how it goes on, as arrays by name."""

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Write the state as arrays."""
        ...

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go back to what `to_arrays` returned."""
        ...


class SavedSearch:
    """A search's history, the time it has, and the file that it is kept in."""

    def __init__(self, name: str, limit: float, path: str | Path | None):
        self.name, self.limit, self.path = name, limit, path
        self.history: list[Progress] = []
        self.begun = self.kept = time.perf_counter()
        self.terms: dict[str, Any] = {}

    def set_common(self, numbers: object, **settings: object) -> None:
        """Note what this search and one that resumes it must have in common, and see that its file can be written."""
        from jaxnc.io import target

        out = hashlib.sha256()
        _add_to_digest(out, numbers)
        self.terms = {"form": _FORM, "problem": self.name, **settings, "numbers": out.hexdigest()}
        if self.path is not None:
            if Path(self.path).is_dir():
                raise InputError(f"checkpoint={str(self.path)!r} is a folder; name a file in it")
            target.folder(Path(self.path).parent)

    def resume(self, path: str | Path, run: Resumable) -> None:
        """Bring a search to where it was saved; it is kept in the same file unless it has another one."""
        from jaxnc.io import archive

        arrays = archive.read_archive(path, "a file that a search with checkpoint= wrote")
        try:
            begun = json.loads(str(arrays["terms"]))
        except (KeyError, ValueError):
            raise ModelFileError(f"{path} is not a file that a search with checkpoint= wrote; give another") from None
        for name, value in self.terms.items():
            if begun.get(name) == value:
                continue
            if name == "numbers":
                raise InputError(f"{path} is a search for {begun['problem']} with other targets, bounds or conditions")
            raise InputError(f"{path} was begun with {name} = {begun.get(name)}; it cannot go on with {value}")
        run.restore(arrays)
        self.history = [Progress(float(s), int(n), float(e)) for s, n, e in arrays["history"]]
        spent = self.history[-1].seconds if self.history else 0.0
        self.begun, self.limit = self.begun - spent, self.limit + spent
        self.path = path if self.path is None else self.path

    def save(self, run: Resumable, every: float = 0.0) -> None:
        """Write a search between two rounds, if it has a file, unless that was done in the last `every` seconds."""
        if self.path is None or time.perf_counter() - self.kept < every:
            return
        from jaxnc.io import target

        out = io.BytesIO()
        rows = np.array([tuple(row) for row in self.history], dtype=float).reshape(-1, 3)
        terms = np.array(json.dumps(self.terms))
        np.savez(out, **run.to_arrays(), history=rows, terms=terms)  # pyright: ignore[reportArgumentType]
        target.write(self.path, out.getvalue())
        self.kept = time.perf_counter()

    @property
    def seconds(self) -> float:
        """How long the search has been going on."""
        return time.perf_counter() - self.begun

    @property
    def hint(self) -> str:
        """How to go on with a search that was stopped, in words; "" if it is not kept in a file."""
        return "" if self.path is None else f"; to go on, resume from {self.path}"


class Course(SavedSearch):
    """The course of a search for designs of a problem: round by round, with a bar."""

    def __init__(self, problem: Problem, limit: float, path: str | Path | None):
        super().__init__(problem.name, limit, path)
        self.problem = problem

    def set_terms(self, **settings: object) -> None:
        """Note what this search and one that resumes it must have in common, all numbers of the problem among it."""
        numbers = np.asarray(geometry_vector(self.problem.system), dtype=float), self.problem
        self.set_common(numbers, unknowns=list(self.problem.names), **settings)

    def show(self, total: int, unit: str, progress: bool | None, done: int) -> None:
        """Show a bar, where someone is watching or as `progress` says."""
        self.bar = bar(total, self.problem.name, unit, progress, initial=done)

    def note(self, done: int, square: float) -> float:
        """Add a line to the history and show it; the error that is reported for the least square so far."""
        error = float(self.problem.reported_error(square))
        self.history.append(Progress(time.perf_counter() - self.begun, done, error))
        self.bar.set_postfix_str(f"best error {format_quantity(error, self.problem.error_unit, 4)}", refresh=False)
        self.bar.update(done - self.bar.n)
        return error

    @property
    def out_of_time(self) -> str:
        """In words, that the search has had all of its time; "" as long as it has not."""
        seconds = self.history[-1].seconds
        return f"stopped after {seconds:.0f} s" if seconds > self.limit else ""


def _add_to_digest(out: Any, value: object) -> None:
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
        for part in fields_of(value).values():
            _add_to_digest(out, part)


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

    def handle(number: int, frame: FrameType | None) -> None:
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
