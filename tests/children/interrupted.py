"""A program whose poses are followed by the host, which takes its time, until somebody interrupts it."""

import signal
import sys
import time

import jax
import numpy as np

import jaxnc as nc
from jaxnc.kinematics import host_solve

signal.signal(signal.SIGINT, signal.default_int_handler)  # also where the parent ignores it
system = nc.library.four_bar().compile().replace({"coupler.B-C": 0.05})
statuses = jax.jit(lambda u: nc.solve_position(system, {"phi": u}).status)
u = np.linspace(-3.0, 3.0, 40)
before = np.asarray(statuses(u))
quick = host_solve.repair_lanes


def slow(*arguments):
    print("following", flush=True)
    time.sleep(2)
    return quick(*arguments)


host_solve.repair_lanes = slow
try:
    jax.block_until_ready(statuses(u))
    time.sleep(5)  # compiled code has returned, and what was interrupted is interrupted
    sys.exit("not interrupted")
except KeyboardInterrupt:
    pass
host_solve.repair_lanes = quick
print("again", np.array_equal(before, statuses(u)), flush=True)
