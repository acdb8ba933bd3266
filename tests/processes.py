"""Processes of their own for what needs several devices, or is ended by force; and a process whose disk is full."""

import contextlib
import os
import subprocess
import sys

from places import ROOT, TESTS

LIMIT = 600  # seconds; a process that has not ended then hangs


def environment() -> dict[str, str]:
    """Children find the package and the tests' mechanisms where this process does."""
    path = os.pathsep.join([str(ROOT), str(TESTS), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2"}


def child(name: str, *arguments: str, **more: str) -> subprocess.Popen:
    command = [sys.executable, str(TESTS / "children" / f"{name}.py"), *arguments]
    return subprocess.Popen(
        command, env=environment() | more, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def ended(*children: subprocess.Popen) -> list[str]:
    """What the children print, all of them having ended well and in time."""
    try:
        told = [process.communicate(timeout=LIMIT) for process in children]
    finally:
        for process in children:
            process.kill()
    for process, (_, err) in zip(children, told, strict=True):
        assert process.returncode == 0, err
    return [out for out, _ in told]


@contextlib.contextmanager
def full_disk():
    """No file grows beyond 100 bytes: the system refuses in the middle of writing, as a full disk does."""
    import resource  # not on every system

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
