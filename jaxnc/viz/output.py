"""Where pictures are written: names are checked first, and what goes wrong on disk says what to do."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from jaxnc.errors import OutputError
from jaxnc.io.target import file_name, replacing


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
