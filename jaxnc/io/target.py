"""Writing a file, and saying so when it cannot be written."""

import csv
import errno
import io
import os
import re
import shutil
import unicodedata
import uuid
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from jaxnc.errors import InputError, OutputError

_REMEDIES = {
    errno.EACCES: "you may not write there; choose another folder or change its permissions",
    errno.EPERM: "you may not write there; choose another folder or change its permissions",
    errno.EROFS: "the file system is read-only; choose another folder",
    errno.ENOSPC: "the disk is full; free some space or choose another disk",
    errno.EDQUOT: "your quota is used up; free some space or choose another disk",
    errno.EISDIR: "there is a folder of that name; choose another file name",
    errno.ENOTDIR: "a part of the path is a file, not a folder; choose another folder",
    errno.EEXIST: "a part of the path is a file, not a folder; choose another folder",
    errno.EFBIG: "it is larger than a file may be here; raise the limit (ulimit -f) or write less",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
}


_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(?![^.])")  # are no files on Windows, whatever follows the dot


def stem(name: str, fallback: str = "mechanism") -> str:
    """Make the beginning of file names, of at most 120 bytes, of what somebody called a thing.

    Slashes, colons and what else is no letter, digit, ``.``, ``_`` or ``-`` become dashes; `fallback` is taken if
    nothing is left.
    """
    name = unicodedata.normalize("NFC", name).lower().encode("utf-8", "replace").decode()
    name = re.sub(r"[^\w.-]+", "-", name).strip("-.") or fallback
    # bytes: with endings it stays below the 255 that file systems have
    name = name.encode()[:120].decode("utf-8", "ignore").rstrip("-.")
    return f"{fallback}-{name}" if _DEVICES.match(name) else name


def file_name(path: str | Path) -> Path:
    """Read the name of a file from a user, with ``~`` for the home folder."""
    if isinstance(path, str) and not path.strip():
        raise InputError(f"path={path!r} names no file; give one")
    try:
        return Path(path).expanduser()
    except (TypeError, RuntimeError):  # of another type; a home that nobody knows
        raise InputError(f"a file is named by text or a pathlib.Path, got {path!r}") from None


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Write a file in one step: whoever reads it finds the old one or the whole new one, also when writing fails.

    A file that is there is replaced, the folders it needs are made. Where a link leads, the link stays; what is no file
    (``/dev/stdout``) is written as it is.

    Yields:
        Another path of the same suffix, to be written to.
    """
    path = file_name(path)
    new = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not os.access(path if path.exists() else path.parent, os.W_OK):  # before the work, not after
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        if path.exists() and not path.is_file():
            yield path
            return
        real = Path(os.path.realpath(path))
        new = real.with_name(f".jaxnc-{os.getpid()}-{uuid.uuid4().hex[:8]}{real.suffix}")
        yield new
        if real.exists():
            shutil.copymode(real, new)
        os.replace(new, real)
    except OutputError:
        raise
    except OSError as error:
        raise unwritable(path, error) from None
    except UnicodeEncodeError:
        raise OutputError(f"cannot write {str(path)!r}: a text holds half of a character (a lone surrogate)") from None
    finally:
        if new is not None:
            new.unlink(missing_ok=True)


def write(path: str | Path, content: bytes) -> Path:
    """Write a whole file in one step, see `replacing`."""
    with replacing(path) as new:
        new.write_bytes(content)
    return file_name(path)


def csv_text(rows: Iterable[Sequence[object]]) -> bytes:
    """Lay out rows of cells as a table in CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def folder(path: str | Path) -> Path:
    """Create a folder to write into, and those above it, before any work is done for the sake of its files."""
    path = file_name(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise unwritable(path, error) from None
    return path


def unwritable(path: Path, error: OSError) -> OutputError:
    """Make the error that says why a path cannot be written and what to do."""
    reason = (error.strerror or str(error)).lower()
    remedy = _REMEDIES.get(error.errno or 0, "check the path, or choose another folder")
    return OutputError(f"cannot write {path} ({reason}): {remedy}")


@contextmanager
def writing(path: str | Path, suffixes: Sequence[str], what: str) -> Iterator[Path]:
    """Check a file name, and write beside the file, which is replaced when the new one is whole.

    Yields:
        Where to write.
    """
    target = file_name(path)
    if target.suffix.lower() not in suffixes:
        kinds = " or ".join(suffixes)
        given = repr(target.suffix) if target.suffix else "no suffix"
        raise OutputError(f"{target}: {what} is written as {kinds}, and the name has {given}; end it in {kinds}")
    with replacing(target) as new:
        yield new
