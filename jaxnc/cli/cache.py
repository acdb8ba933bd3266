"""Compiled programs kept between commands, so that only the first of a kind waits for the compiler."""

import os
import sys
import warnings
from collections.abc import Mapping
from pathlib import Path

from jaxnc.errors import OutputError
from jaxnc.io.target import folder

VARIABLE = "JAXNC_CACHE"
_OFF = ("off", "no", "none", "0", "false")
_LARGEST = 500_000_000  # bytes; beyond, what was not used for longest goes
_ENDINGS = ("-cache", "-atime")  # of the files that JAX writes


def use(off: bool) -> None:
    """Turn the cache on or off; a folder that cannot be written costs one warning, not the command.

    Where JAX was told of a folder by its own means (``JAX_COMPILATION_CACHE_DIR``), that one is used, as it is.

    Args:
        off: whether the command was given ``--no-cache``.
    """
    import jax

    told = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    where = None if off else place(os.environ, sys.platform, told)
    if where is None:
        jax.config.update("jax_enable_compilation_cache", False)
        return
    # A damaged entry or a full disk: JAX compiles anew, and there is nothing that anyone need do.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")
    if where == told:
        return
    try:
        trim(folder(where))
    except OutputError as error:
        jax.config.update("jax_enable_compilation_cache", False)
        print(
            f"jaxnc: warning: compiled programs are not kept: {error}; {VARIABLE}=FOLDER names one, --no-cache does "
            f"without",
            file=sys.stderr,
        )
        return
    jax.config.update("jax_compilation_cache_dir", str(where))
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        # A command compiles some two dozen programs, half a megabyte in all: everything is worth keeping.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def place(environment: Mapping[str, str], platform: str, told: str | None) -> str | Path | None:
    """Where compiled programs are kept.

    Args:
        environment: environment variables.
        platform: `sys.platform`.
        told: the folder that JAX has been told of by its own means, if any.

    Returns:
        The folder; None if the cache is turned off.
    """
    wish = environment.get(VARIABLE, "").strip()
    if wish.lower() in _OFF:
        return None
    if wish:
        return Path(wish).expanduser()
    if told:
        return told
    home = Path(environment.get("HOME") or Path.home())
    if platform == "win32":
        base = Path(environment.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        # The convention asks that a relative path be ignored.
        given = Path(environment.get("XDG_CACHE_HOME") or "")
        base = given if given.is_absolute() else home / ".cache"
    return base / "jaxnc"


def trim(where: Path, largest: int = _LARGEST) -> None:
    """Remove the programs that were not used for longest, until the rest is half of what is allowed."""
    try:
        files = [(f.stat(), f) for f in where.iterdir() if f.name.endswith(_ENDINGS)]
        size = sum(stat.st_size for stat, _ in files)
        if size <= largest:
            return
        for stat, file in sorted(files, key=lambda pair: max(pair[0].st_atime, pair[0].st_mtime)):
            file.unlink(missing_ok=True)
            size -= stat.st_size
            if size <= largest // 2:
                return
    except OSError:
        return  # another command is at it, or the folder is not ours to clear
