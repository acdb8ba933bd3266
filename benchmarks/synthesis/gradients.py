"""Many designs with their gradients: 10,000 four-bars in 36 poses each."""

import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks.synthesis.published import ARC, four_bar

DESIGNS, POSES = 10_000, 36
TARGET = 0.2  # seconds


def run() -> list[dict[str, Any]]:
    """Gradient of the sum of squared distances of the coupler point from a circle, by everything that is drawn."""
    places = np.linspace(0.0, 2 * np.pi, POSES, endpoint=False)
    goal = np.mean(ARC, axis=0) + np.stack([np.cos(places), np.sin(places)], axis=1)
    problem = nc.synthesis.PathGeneration(four_bar(), "P", goal, timing=places)
    rng = np.random.default_rng(0)
    x = jnp.asarray(problem.start + rng.uniform(-0.3, 0.3, (DESIGNS, problem.count)))
    rows = []

    def square(x):
        look = problem.evaluate(x)
        return jnp.sum(look.errors**2), look.ok

    ways = {"values": square, "values and gradients": jax.value_and_grad(square, has_aux=True)}
    for name, one in ways.items():
        f = jax.jit(jax.vmap(one))
        begin = time.process_time()
        out = jax.block_until_ready(f(x))
        first, times, walls = time.process_time() - begin, [], []
        for k in range(5):
            moved = x + 1e-3 * (k + 1)
            begin, wall = time.process_time(), time.perf_counter()
            out = jax.block_until_ready(f(moved))
            times.append(time.process_time() - begin)
            walls.append(time.perf_counter() - wall)
        ok = out[0][1] if name != "values" else out[1]
        bad = 0 if name == "values" else int(np.sum(~np.isfinite(np.asarray(out[1])).all(axis=1)))
        rows.append(
            {
                "case": f"{DESIGNS:,} four-bars × {POSES} poses: {name}",
                "processor_s": float(np.median(times)),
                "wall_s": float(np.median(walls)),
                "compile_s": max(0.0, first - float(np.median(times))),
                "target_s": TARGET,
                "assembled": float(np.mean(np.asarray(ok))),
                "not_finite": bad,
            }
        )
    return rows
