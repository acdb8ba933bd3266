"""One of two processes with two devices each: solves the whole batch with the other, and its own part alone."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from mechanisms import slider_crank

import jaxnc as nc

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", 2)
address, rank, out = sys.argv[1], int(sys.argv[2]), sys.argv[3]
jax.distributed.initialize(address, num_processes=2, process_id=rank)

system = slider_crank()
U = np.linspace(0.2, 5.9, 7)
assert len(jax.devices()) == 4 and len(jax.local_devices()) == 2

together = nc.solve_position(system, {"phi": U}, devices="global")
own = nc.solve_position(system, {"phi": np.array_split(U, 2)[rank]}, devices="all")


def cost(s):
    return jnp.sum(nc.solve_position(s, {"phi": U}, devices="global")["S.x"] ** 2)


gradient = jax.grad(cost)(system)
squares = nc.shard(lambda x: x * x, devices="global")(np.arange(8.0))
assert len(together.q.sharding.device_set) == 4
np.savez(
    out,
    q=together.q,
    status=together.status,
    asked=together.asked,
    own=own.q,
    gradient=gradient.parameters.dimensions,
    squares=squares,
)
jax.distributed.shutdown()
