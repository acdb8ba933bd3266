"""Names of a package that are loaded when they are first asked for."""

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def on_demand(
    package: str, homes: Mapping[str, Sequence[str]], packages: Sequence[str] = ()
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The ``__getattr__`` and ``__dir__`` of a package that re-exports names and imports nothing until one is used.

    Args:
        package: its name.
        homes: names by the module that has them. No name may be that of a module of the package: once imported, the
            module would stand in its place.
        packages: packages within it that are imported when they are asked for.
    """
    where = {name: module for module, names in homes.items() for name in names}

    def named(name: str) -> Any:
        if name in packages:
            return importlib.import_module(f"{package}.{name}")
        if name not in where:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = getattr(importlib.import_module(where[name]), name)
        setattr(sys.modules[package], name, found)
        return found

    return named, lambda: sorted([*where, *packages])


def version() -> str:
    """The version of jaxnc."""
    return sys.modules["jaxnc"].__version__
