"""npz archives whose arrays lie in them as they are in memory: written array by array, mapped instead of read."""

import shutil
import struct
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jaxnc.errors import ModelFileError

_ALIGNED = 64  # bytes: where an array begins, so that it can be used where it lies
_BLOCK = 1 << 20  # bytes copied at a time
_LOCAL = struct.Struct("<26xHH")  # what stands before a member: 26 bytes, lengths of its name and of what is added


@dataclass(frozen=True)
class Column:
    """An array that lies in a file of its own, row after row."""

    file: Path  # the file, nothing but numbers
    dtype: np.dtype  # type of a number
    shape: tuple[int, ...]  # shape of the array, row number first


def pack(path: Path, contents: Mapping[str, np.ndarray | Column]) -> None:
    """Write an npz archive; arrays that lie in files are never held in memory."""
    with path.open("wb") as file, zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, array in contents.items():
            # Whether a member is larger than 4 GiB must be known when it is begun.
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                member.write(_header(array.dtype, array.shape, file.tell()))
                if isinstance(array, Column):
                    with array.file.open("rb") as column:
                        shutil.copyfileobj(column, member, _BLOCK)
                else:
                    member.write(array.tobytes())


def _header(dtype: np.dtype, shape: tuple[int, ...], start: int) -> bytes:
    """The beginning of an npy file at byte `start` of another, filled up so that the numbers are aligned in that."""
    text = repr({"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape})
    room = -(start + 10 + len(text) + 1) % _ALIGNED
    return np.lib.format.magic(1, 0) + struct.pack("<H", len(text) + room + 1) + (text + " " * room + "\n").encode()


def read(path: str | Path, what: str, mmap: bool = False) -> dict[str, np.ndarray]:
    """Arrays of an npz archive by name."""
    try:
        if mmap:
            return _mapped(path)
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as contents:
            return {key: contents[key] for key in contents.files}
    except Exception as error:  # of a damaged archive zipfile, its decompressors and NumPy raise nearly anything
        if isinstance(error, OSError) and error.strerror:
            raise ModelFileError(f"{path} cannot be read ({error.strerror}); give {what}") from None
        reason = " ".join(str(error).split()) or type(error).__name__
        reason = reason if zipfile.is_zipfile(path) else "it is no archive"  # NumPy takes it for a pickle
        raise ModelFileError(f"{path} is not {what}, or is damaged ({reason}); write it again") from None


def _mapped(path: str | Path) -> dict[str, np.ndarray]:
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
                arrays[name] = np.memmap(path, dtype, "r", begin, shape, order)  # pyright: ignore[reportCallIssue, reportArgumentType]
            else:
                with archive.open(info) as member:
                    arrays[name] = np.lib.format.read_array(member, allow_pickle=False)
    return arrays
