"""``python -m jaxnc``, and the command `jaxnc`: Ctrl-C is understood from the first import on."""

import sys


def main() -> int:
    """Run the command line; see `jaxnc.cli.main`."""
    try:
        from jaxnc.cli.main import main as command

        return command()
    except KeyboardInterrupt:
        print("jaxnc: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
