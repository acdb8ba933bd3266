"""What is asked to hold of a motion, as it is written: ``"psi range > 30"``; read before there is anything to hold."""

import re
from collections.abc import Sequence

from jaxnc.errors import InputError

_FORM = re.compile(r"\s*(.+?)(?:\s+(smallest|largest|range))?\s*(<=|>=|<|>)\s*([-+.\deE]+)\s*")
_HELP = "write QUANTITY [smallest|largest|range] < NUMBER (or <=, >, >=), such as 'psi range > 30'"


def readable(texts: Sequence[str]) -> None:
    """Refuse expectations that cannot be read."""
    for text in texts:
        read(text)


def read(text: str) -> tuple[str, str, str, float]:
    """Quantity, word (or ""), comparison and number of an expectation."""
    found = _FORM.fullmatch(text) if isinstance(text, str) else None
    try:
        if found is None:
            raise ValueError
        return found[1], found[2] or "", found[3], float(found[4])
    except ValueError:
        raise InputError(f"--expect {text!r}: {_HELP}") from None
