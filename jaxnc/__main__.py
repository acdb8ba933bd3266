"""``python -m jaxnc``: the command line."""

import sys

from jaxnc.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
