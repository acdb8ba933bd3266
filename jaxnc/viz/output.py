"""Where pictures are written: names are checked first, and what goes wrong on disk says what to do."""

import errno
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from jaxnc.errors import OutputError


@contextmanager
def writing(path: str | Path, suffixes: Sequence[str], what: str) -> Iterator[Path]:
    """Check a file name, create its folder, and turn errors of the file system into `OutputError`.

    Args:
        path: the file.
        suffixes: those that can be written, ``(".png", …)``.
        what: what is written, for messages.

    Yields:
        The path.

    Raises:
        OutputError: unknown suffix, or a file that cannot be written; names the path and what to do.
    """
    target = Path(path).expanduser()
    if target.suffix.lower() not in suffixes:
        kinds = " or ".join(suffixes)
        given = repr(target.suffix) if target.suffix else "no suffix"
        raise OutputError(f"{target}: {what} is written as {kinds}, and the name has {given}; end it in {kinds}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        if not os.access(target if target.exists() else target.parent, os.W_OK):  # before the work, not after
            raise PermissionError(errno.EACCES, "permission denied")
        yield target
    except OutputError:
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(
            f"{target}: {what} cannot be written ({reason}); choose a folder you may write to, with space left"
        ) from None
