"""What every case gets: how large, how thoroughly, with which peers, and where to put what it finds."""

import dataclasses
import importlib.util
from collections.abc import Callable, Sequence
from typing import Any

from benchmarks.clock import Pace, Way, compare
from benchmarks.record import Record


@dataclasses.dataclass
class Suite:
    """One run of the suite.

    Args:
        record: where results go.
        quick: small sizes and few repeats, to see that everything runs.
        peers: whether to run the opponents too.
        only: of the classes of mechanisms those that are run; all, if none is named.
    """

    record: Record
    quick: bool = False
    peers: bool = True
    only: Sequence[str] = ()

    @property
    def pace(self) -> Pace:
        """How thoroughly to measure."""
        return Pace(repeats=3, budget=4.0) if self.quick else Pace()

    def size(self, full: int, quick: int) -> int:
        """The size of a case in this run."""
        return quick if self.quick else full

    def peer(self, name: str, make: Callable[[], Sequence[Way]], needs: str | None = None) -> list[Way]:
        """The ways of a peer, or none, said to be left out, if it is not there.

        Args:
            name: what it is called.
            make: makes its ways.
            needs: package that it needs.
        """
        if not self.peers:
            self.record.leave_out(name, "peers were not asked for")
            return []
        if needs is not None and importlib.util.find_spec(needs) is None:
            self.record.leave_out(name, f"{needs} is not installed (pip install 'jaxnc[bench]')")
            return []
        try:
            return list(make())
        except Exception as error:  # a peer that is broken here must not stop the run
            self.record.leave_out(
                name, f"{type(error).__name__}: {str(error).splitlines()[0][:160] if str(error) else ''}"
            )
            return []

    def compare(self, case: str, ways: Sequence[Way], draw: Callable[[int, int], Any], size: int, per: int = 1) -> None:
        """Time the ways of a case and keep the rows; arguments as for `clock.compare`."""
        rows, broken = compare(case, ways, draw, size, self.pace, per)
        self.record.rows += rows
        for line in broken:
            self.record.leave_out(case, line)
