"""Two host devices beside one: lanes shared out explicitly, in a process that may use both cores."""

import os

from benchmarks import fresh
from benchmarks.clock import row
from benchmarks.suite import Suite


def two_devices(suite: Suite) -> None:
    """The four-bar's lanes on one and on two devices of the host."""
    if (os.cpu_count() or 1) < 2:
        suite.record.leave_out("two devices", "this machine has one core")
        return
    lanes = suite.size(400_000, 40_000)
    env = {"XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
    for way in ("jaxnc", "by-hand") if suite.peers else ("jaxnc",):
        try:
            found = fresh.measure(f"devices:{way}:{lanes}", env, timeout=300.0)
            bound = fresh.measure(f"devices:{way}:{lanes}:one", env, timeout=300.0)
        except RuntimeError as error:
            suite.record.leave_out(f"two devices, {way}", str(error))
            continue
        name = "jaxnc" if way == "jaxnc" else "JAX by hand, n = 2"
        how = found["how"]
        for case, one, note in (
            ("devices: one on one core", bound["1"], f"1 of 2 host devices, the process bound to one core, {how}"),
            ("devices: one only", found["1"], f"1 of 2 host devices, {how}"),
            ("devices", found["2"], f"2 of 2 host devices, {how}"),
        ):
            suite.record.rows.append(row(case, name, lanes, one["seconds"], one["right"], one["compile_s"], note))
