"""Names of a package that are loaded when they are first asked for."""

import ast
import functools
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def on_demand(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Make the ``__getattr__`` and ``__dir__`` of a package that imports nothing until one of its names is used.

    The names are written once, as imports in the package's ``__init__.pyi``: type checkers and editors read them there,
    and so does this function, which makes ``__all__`` of them (the pattern of Scientific Python's SPEC 1). What is
    imported from the package itself is a package within it. No name may be that of a module of the package: once
    imported, the module would stand in its place.
    """
    inside: Any = sys.modules[package]

    @functools.cache
    def homes() -> dict[str, str]:
        stub = ast.parse(Path(inside.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
        imports = [statement for statement in stub.body if isinstance(statement, ast.ImportFrom)]
        return dict(sorted((name.name, one.module or "") for one in imports for name in one.names))

    def named(name: str) -> Any:
        if name == "__all__":
            return list(homes())
        if name not in homes():
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=inside)
        home = homes()[name]
        if home == package:
            return importlib.import_module(f"{package}.{name}")
        try:
            found = getattr(importlib.import_module(home), name)
        except ModuleNotFoundError as error:
            from jaxnc.errors import not_installed  # with more than an import of jaxnc needs

            missing = not_installed(error)
            if missing is None:
                raise
            raise missing from None
        setattr(inside, name, found)
        return found

    return named, lambda: list(homes())


def version() -> str:
    """Read the version of jaxnc."""
    return sys.modules["jaxnc"].__version__
