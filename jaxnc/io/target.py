"""Writing a file, and saying so when it cannot be written.

npz archives whose arrays lie in them as they are in memory: written array by array or chunk by chunk, mapped.
"""

import csv
import errno
import io
import itertools
import json
import os
import re
import shutil
import struct
import unicodedata
import uuid
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from jaxnc.errors import InputError, ModelFileError, OutputError

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


def remove_rest(paths: Iterable[Path]) -> None:
    """Remove numbered files that an earlier, longer result left, up to the first that is not there."""
    for path in itertools.takewhile(Path.is_file, paths):
        try:
            path.unlink()
        except OSError as error:
            raise unwritable(path, error) from None


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


# -- archives ----------------------------------------------------------------------------------------------------------


_INDEX = "index.json"
_LOCAL = struct.Struct("<26xHH")  # what stands before a member: 26 bytes, lengths of its name and of what is added


@dataclass(frozen=True)
class Column:
    """An array that lies in a file of its own, row after row."""

    file: Path  # the file, nothing but numbers
    dtype: np.dtype  # type of a number
    shape: tuple[int, ...]  # shape of the array, row number first


def write_archive(path: Path, contents: Mapping[str, np.ndarray | Column]) -> None:
    """Write an npz archive; arrays that lie in files are never held in memory."""
    with path.open("wb") as file, zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, array in contents.items():
            # Whether a member is larger than 4 GiB must be known when it is begun.
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                member.write(_npy_header(array.dtype, array.shape, file.tell()))
                if isinstance(array, Column):
                    with array.file.open("rb") as column:
                        shutil.copyfileobj(column, member, 1 << 20)  # a mebibyte at a time
                else:
                    member.write(array.tobytes())


def _npy_header(dtype: np.dtype, shape: tuple[int, ...], start: int) -> bytes:
    """Make the head of an npy file at byte `start` of another, filled up so that the numbers are aligned in that."""
    text = repr({"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape})
    # an array begins at a multiple of 64 bytes, so that it can be used where it lies
    room = -(start + 10 + len(text) + 1) % 64
    return np.lib.format.magic(1, 0) + struct.pack("<H", len(text) + room + 1) + (text + " " * room + "\n").encode()


def read_archive(path: str | Path, what: str, mmap: bool = False) -> dict[str, np.ndarray]:
    """Read the arrays of an npz archive by name."""
    try:
        if mmap:
            return _map_arrays(path)
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as contents:
            return {key: contents[key] for key in contents.files}
    except Exception as error:  # of a damaged archive zipfile, its decompressors and NumPy raise nearly anything
        if isinstance(error, OSError) and error.strerror:
            raise ModelFileError(f"{path} cannot be read ({error.strerror}); give {what}") from None
        reason = " ".join(str(error).split()) or type(error).__name__
        reason = reason if zipfile.is_zipfile(path) else "it is no archive"  # NumPy takes it for a pickle
        raise ModelFileError(f"{path} is not {what}, or is damaged ({reason}); write it again") from None


def _map_arrays(path: str | Path) -> dict[str, np.ndarray]:
    arrays = {}
    with open(path, "rb") as file, zipfile.ZipFile(file) as archive:
        for info in archive.infolist():
            name = info.filename.removesuffix(".npy")
            with archive.open(info) as member:
                version = np.lib.format.read_magic(member)
                read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, fortran, dtype = read(member)
                begin = member.tell()
            if begin + int(np.prod(shape)) * dtype.itemsize > info.file_size:
                raise ValueError(f"{name} is shorter than it says")
            if info.compress_type == zipfile.ZIP_STORED and 0 not in shape and not dtype.hasobject:
                file.seek(info.header_offset)
                begin += info.header_offset + _LOCAL.size + sum(_LOCAL.unpack(file.read(_LOCAL.size)))
                order = "F" if fortran else "C"
                arrays[name] = np.memmap(path, dtype, "r", begin, shape, order)
            else:
                with archive.open(info) as member:
                    arrays[name] = np.lib.format.read_array(member, allow_pickle=False)
    return arrays


class _Index(msgspec.Struct):
    """How far the files of a table on its way are valid, and what the table is of."""

    question: dict
    rows: int = 0
    inputs: dict[str, int] = {}  # checksums of what was asked for so far
    counts: dict[str, int] = {}  # of poses, by status
    columns: dict[str, tuple[str, list[int]]] = {}  # by name the type of a number and the shape of a row


class PartialTable:
    """A long table on its way: one file for each array, and an index that says how far the files are valid.

    The files lie in a folder beside the table, which is made of them at the end. The index is replaced after every
    chunk, so that it counts a whole number of chunks, whatever happened after it.

    Args:
        path: the table.
        question: what the table is the answer to, as words and numbers that say whether two questions are the same.
        go_on: go on with what an interrupted call has left, instead of throwing it away.

    Raises:
        InputError: what is there is of another question.
        ModelFileError: what is there is damaged.
        OutputError: the folder cannot be written.
    """

    def __init__(self, path: Path, question: Mapping[str, object], go_on: bool = True):
        self.path, self.folder = path, path.with_name(path.name + ".part")
        self.index = _Index(json.loads(json.dumps(question)))
        with self._writing():
            if not go_on and self.folder.exists():
                shutil.rmtree(self.folder)
            self.folder.mkdir(parents=True, exist_ok=True)
            if (self.folder / _INDEX).exists():
                self._read_index()

    def _read_index(self) -> None:
        try:
            index = msgspec.json.decode((self.folder / _INDEX).read_bytes(), type=_Index)
            for k, (dtype, shape) in enumerate(index.columns.values()):
                if (self.folder / f"{k}.bin").stat().st_size < index.rows * _row_bytes(dtype, shape):
                    raise ValueError
        except (ValueError, TypeError, FileNotFoundError):
            raise ModelFileError(
                f"{self.folder} is what an interrupted call left, and it is damaged; delete it, or pass resume=False"
            ) from None
        before, now = index.question, self.index.question
        if other := [key for key in {**before, **now} if before.get(key) != now.get(key)]:
            raise InputError(
                f"{self.folder} is what an interrupted call left, and that was another question ({', '.join(other)} "
                f"differ); finish that one, or delete the folder, or pass resume=False to begin anew"
            )
        self.index = index

    def append(self, arrays: Mapping[str, np.ndarray], inputs: dict[str, int], counts: Mapping[str, int]) -> None:
        """Write a chunk; its numbers become such as the first chunk has."""
        index = self.index
        index.columns = index.columns or {name: (a.dtype.str, list(a.shape[1:])) for name, a in arrays.items()}
        with self._writing():
            for k, (name, (dtype, shape)) in enumerate(index.columns.items()):
                # What lies beyond the index was written by a call that did not come as far as to count it.
                with (self.folder / f"{k}.bin").open("r+b" if index.rows else "wb") as file:
                    file.seek(index.rows * _row_bytes(dtype, shape))
                    file.write(np.ascontiguousarray(arrays[name], dtype).data)
                    file.truncate()
            index.rows += len(next(iter(arrays.values())))
            index.inputs, index.counts = inputs, dict(counts)
            write(self.folder / _INDEX, msgspec.json.encode(index))

    def finish(self, more: Mapping[str, np.ndarray]) -> None:
        """Put the table together, and clear away the files that it was made of."""
        columns = {
            name: Column(self.folder / f"{k}.bin", np.dtype(dtype), (self.index.rows, *shape))
            for k, (name, (dtype, shape)) in enumerate(self.index.columns.items())
        }
        with self._writing():
            whole = self.folder / "whole.npz"  # in there, so that nothing stays beside the table if this is ended
            with replacing(whole) as new:
                write_archive(new, {**more, **columns})
            os.replace(whole, self.path)
            shutil.rmtree(self.folder)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise unwritable(self.path, error) from None


def checksums(arrays: Mapping[str, np.ndarray], before: Mapping[str, int]) -> dict[str, int]:
    """Return checksums of arrays by name, going on from those `before`: chunks of any length give the same."""
    return {name: zlib.crc32(np.ascontiguousarray(a).data, before.get(name, 0)) for name, a in arrays.items()}


def _row_bytes(dtype: str, shape: Sequence[int]) -> int:
    """Count the bytes of a row."""
    return np.dtype(dtype).itemsize * int(np.prod(shape, dtype=int))
