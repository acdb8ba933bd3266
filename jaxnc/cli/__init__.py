"""The command line: `jaxnc demo`, `jaxnc check`, `jaxnc run`."""

from jaxnc.cli.main import main

__all__ = ["main"]
