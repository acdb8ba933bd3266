"""Arrays that grow chunk by chunk on disk, and outlive an interruption."""

import json
import os
import shutil
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.errors import InputError, ModelFileError
from jaxnc.io.archive import Column, pack
from jaxnc.io.target import replacing, unwritable, write

_INDEX = "index.json"


class Parts:
    """What has been written of a long table: one file for each array, and an index that says how far they are valid.

    They lie in a folder beside the table, which is made of them at the end. The index is replaced after every chunk, so
    that it is always that of a whole number of chunks, whatever happened after it.

    `question` is what the table is the answer to, as words and numbers that say whether two of them are the same. What
    an interrupted call has left is thrown away, unless it is to `go_on`.

    Raises:
        InputError: what is there is of another question.
        ModelFileError: what is there is damaged.
        OutputError: the folder cannot be written.
    """

    def __init__(self, path: Path, question: Mapping[str, Any], go_on: bool = True):
        self.path, self.folder = path, path.with_name(path.name + ".part")
        self.rows: int = 0
        self.inputs: dict[str, int] = {}
        self.counts: dict[str, int] = {}
        self._question = json.loads(json.dumps(question))
        self._columns: dict[str, tuple[str, list[int]]] = {}
        with self._writing():
            if not go_on and self.folder.exists():
                shutil.rmtree(self.folder)
            self.folder.mkdir(parents=True, exist_ok=True)
            if (self.folder / _INDEX).exists():
                self._read()

    def _read(self) -> None:
        try:
            index = json.loads((self.folder / _INDEX).read_text(encoding="utf-8"))
            self.rows, self.inputs, self.counts = index["rows"], index["inputs"], index["counts"]
            self._columns, question = index["columns"], index["question"]
            for k, (dtype, shape) in enumerate(self._columns.values()):
                if (self.folder / f"{k}.bin").stat().st_size < self.rows * _size(dtype, shape):
                    raise ValueError
        except (ValueError, KeyError, TypeError, FileNotFoundError):
            raise ModelFileError(
                f"{self.folder} is what an interrupted call left, and it is damaged; delete it, or pass resume=False"
            ) from None
        keys = {**question, **self._question}
        if other := [key for key in keys if question.get(key) != self._question.get(key)]:
            raise InputError(
                f"{self.folder} is what an interrupted call left, and that was another question ({', '.join(other)} "
                f"differ); finish that one, or delete the folder, or pass resume=False to begin anew"
            )

    def append(self, arrays: Mapping[str, np.ndarray], inputs: dict[str, int], counts: Mapping[str, int]) -> None:
        """Write a chunk."""
        if not self._columns:
            self._columns = {name: (a.dtype.str, list(a.shape[1:])) for name, a in arrays.items()}
        with self._writing():
            for k, (name, (dtype, shape)) in enumerate(self._columns.items()):
                # What lies beyond the index was written by a call that did not come as far as to count it.
                with (self.folder / f"{k}.bin").open("r+b" if self.rows else "wb") as file:
                    file.seek(self.rows * _size(dtype, shape))
                    file.write(np.ascontiguousarray(arrays[name]).data)
                    file.truncate()
            self.rows += len(next(iter(arrays.values())))
            self.inputs, self.counts = inputs, dict(counts)
            index = {
                "rows": self.rows,
                "inputs": inputs,
                "counts": self.counts,
                "columns": self._columns,
                "question": self._question,
            }
            write(self.folder / _INDEX, json.dumps(index).encode())

    def finish(self, more: Mapping[str, np.ndarray]) -> None:
        """Put the table together, and clear away what it was made of."""
        columns = {
            name: Column(self.folder / f"{k}.bin", np.dtype(dtype), (self.rows, *shape))
            for k, (name, (dtype, shape)) in enumerate(self._columns.items())
        }
        with self._writing():
            whole = self.folder / "whole.npz"  # in there, so that nothing stays beside the table if this is ended
            with replacing(whole) as new:
                pack(new, {**more, **columns})
            os.replace(whole, self.path)
            shutil.rmtree(self.folder)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise unwritable(self.path, error) from None


def checksums(arrays: Mapping[str, np.ndarray], before: Mapping[str, int]) -> dict[str, int]:
    """Checksums of arrays by name, going on from those of what came before: chunks of any length give the same."""
    return {name: zlib.crc32(np.ascontiguousarray(a).data, before.get(name, 0)) for name, a in arrays.items()}


def _size(dtype: str, shape: Sequence[int]) -> int:
    """Bytes of a row."""
    return np.dtype(dtype).itemsize * int(np.prod(shape, dtype=int))
