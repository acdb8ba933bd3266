"""Writing a file, and saying so when it cannot be written."""

import errno
import os
from pathlib import Path

from jaxnc.errors import OutputError

_REMEDIES = {
    errno.EACCES: "you may not write there; choose another folder or change its permissions",
    errno.EPERM: "you may not write there; choose another folder or change its permissions",
    errno.EROFS: "the file system is read-only; choose another folder",
    errno.ENOSPC: "the disk is full; free some space or choose another disk",
    errno.EDQUOT: "your quota is used up; free some space or choose another disk",
    errno.EISDIR: "there is a folder of that name; choose another file name",
    errno.ENOTDIR: "a part of the path is a file, not a folder; choose another folder",
    errno.EEXIST: "a part of the path is a file, not a folder; choose another folder",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
}


def write(path: str | Path, content: bytes) -> Path:
    """Write a whole file, creating the folders it needs.

    Args:
        path: where to; a file that is there is replaced.
        content: what to write.

    Returns:
        The path.

    Raises:
        OutputError: naming the path, why it cannot be written and what to do.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise unwritable(path, error) from None
    return path


def replace(path: str | Path, content: bytes) -> Path:
    """Write a whole file in one step: whoever reads it finds the old one or the new one, never a part.

    Args:
        path: where to; a file that is there is replaced.
        content: what to write.

    Returns:
        The path.

    Raises:
        OutputError: as in `write`.
    """
    path = Path(path)
    new = write(path.with_name(path.name + ".new"), content)
    try:
        os.replace(new, path)
    except OSError as error:
        new.unlink(missing_ok=True)
        raise unwritable(path, error) from None
    return path


def folder(path: str | Path) -> Path:
    """Create a folder to write into, and those above it, before any work is done for the sake of its files.

    Args:
        path: the folder; it may exist.

    Returns:
        The path.

    Raises:
        OutputError: naming the path, why nothing can be written there and what to do.
    """
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise unwritable(path, error) from None
    return path


def unwritable(path: Path, error: OSError) -> OutputError:
    """The error that says why a path cannot be written and what to do."""
    reason = (error.strerror or str(error)).lower()
    remedy = _REMEDIES.get(error.errno or 0, "check the path, or choose another folder")
    return OutputError(f"cannot write {path} ({reason}): {remedy}")
