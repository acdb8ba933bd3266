"""In a process with two devices: prints, as JSON, how far results of both are from those of one."""

import json
import os

import jax
import jax.numpy as jnp
import numpy as np
from mechanisms import slider_crank

import jaxnc as nc

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", 2)

system = slider_crank()
drawn = float(system["S"][0])
X = drawn * np.array([1.0, 1.01, 3.0, 0.99, 0.97, 0.1, 1.02])  # two of them are out of reach
found = {"devices": len(jax.devices()), "off": {}, "said": {}}


def off(name, got, want):
    """Largest difference of two pytrees, relative to the largest number; 0 means the same bits, NaN included."""
    worst = 0.0
    for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(want), strict=True):
        a, b = np.asarray(a), np.asarray(b)
        assert a.shape == b.shape and a.dtype == b.dtype, (name, a.shape, b.shape, a.dtype, b.dtype)
        if not np.array_equal(a, b, equal_nan=True):
            worst = max(worst, float(np.max(np.abs(a - b)) / np.max(np.abs(b))))
    found["off"][name] = worst


def said(name, call):
    try:
        call()
    except nc.InputError as error:
        found["said"][name] = str(error)


def solve(s, x, devices=None):
    return nc.solve_position(s, {"S.x": x}, devices=devices)


one = solve(system, X, 1)
assert one.status.tolist().count(0) == 5, "some are found, some are not"
off("uneven batch", solve(system, X, "all"), one)
even = solve(system, np.append(X, X[0]), 2)
off("even batch", even.pose(slice(0, 7)), one)
found["spread"] = len(even.q.sharding.device_set) == 2 and not even.q.sharding.is_fully_replicated
found["empty"] = solve(system, np.zeros(0), "all").status.shape == (0,)


designs = jax.tree.map(lambda x: jnp.stack([x * (1 + 0.01 * k) for k in range(3)]), system)
angle = jax.vmap(lambda s, x: nc.solve_position(s, {"S.x": x})["phi"], in_axes=(0, None))
spread = nc.shard(angle, in_axes=(0, None))


def with_gradient(f):
    """Of all designs the gradient of the sum of squares, and the angles themselves."""

    def total(d):
        found = f(d, X)
        return jnp.sum(found**2), found

    return nc.jit(jax.grad(total, has_aux=True))(designs)


(gradients, angles), (want, wanted) = with_gradient(spread), with_gradient(angle)
off("designs", angles, wanted)
off("gradient of designs", gradients, want)


def walked(s):
    """One design on each device, alone: its matrices are factorised by LAPACK, on both devices at once."""
    return nc.sweep(jax.tree.map(lambda x: x[0], s), {"phi": np.linspace(0.2, 5.9, 20)})["S.x"][None]


walk = nc.shard(walked)
pair = jax.tree.map(lambda x: x[:2], designs)
first = np.asarray(walk(pair))
for _ in range(50):
    off("walks at once", walk(pair), first)

off("one argument", nc.shard(lambda x: {"y": x + 1})(np.arange(5.0)), {"y": np.arange(5.0) + 1})
off("no lanes", nc.shard(lambda x: x + 1)(np.zeros((0, 2))), np.zeros((0, 2)))
for devices in (1, [jax.devices()[1]], jax.devices()[1], jax.devices()[::-1], "global"):
    off(f"on {devices}", nc.shard(jnp.sin, devices=devices)(X), jnp.sin(X))
on_second = jax.device_put(X, jax.devices()[1])
off("moved", nc.shard(lambda x, y: x + y, in_axes=(0, None))(on_second, 1.0), X + 1.0)

said("too many", lambda: solve(system, X, 3))
said("twice", lambda: solve(system, X, [jax.devices()[0]] * 2))
said("inside", lambda: nc.shard(lambda x: solve(system, x, "all").q)(X))
said("no batch out", lambda: nc.shard(jnp.sum)(np.ones(4)))
print(json.dumps(found), flush=True)
os._exit(0)  # taking apart what was compiled takes 4 s
