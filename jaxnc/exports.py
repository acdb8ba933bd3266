"""Names of a package that are loaded when they are first asked for."""

import functools
import importlib
import sys
from collections.abc import Callable
from typing import Any


def on_demand(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The ``__getattr__`` and ``__dir__`` of a package that re-exports names and imports nothing until one is used.

    What its ``__all__`` is, and where each name is from, is said by the imports that it has for type checkers, under
    ``if TYPE_CHECKING``: they are compiled with it, though never carried out. What is imported from the package itself
    is a package within it. No name may be that of a module of the package: once imported, the module would stand in its
    place.
    """
    inside: Any = sys.modules[package]

    @functools.cache
    def homes() -> dict[str, str]:
        import dis

        found, module = {}, ""
        for step in dis.get_instructions(inside.__spec__.loader.get_code(package)):
            if step.opname == "IMPORT_NAME":
                module = step.argval
            elif step.opname == "IMPORT_FROM" and module not in ("typing", __name__):
                found[step.argval] = module
        return dict(sorted(found.items()))

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
    """The version of jaxnc."""
    return sys.modules["jaxnc"].__version__
