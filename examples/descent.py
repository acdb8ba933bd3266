"""A walking leg goes down the gradient: from one that stumbles to one that walks as Theo Jansen's does.

`python examples/descent.py` writes descent.gif, the picture in the README, into this folder, or where a name says, in
about a minute. Needs optax.
"""

import io
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

import jaxnc as nc

jax.config.update("jax_enable_x64", True)

STEPS, FRAMES, STILL = 300, 54, 24  # of the descent, of the film while it goes down, and of a last turn of the crank
TURN = np.linspace(0.0, 2 * np.pi, 73)  # the last pose is the first again


WANTED = np.asarray(nc.sweep(nc.library.jansen_leg().compile(), {"phi": TURN})["F"])  # where the foot is to go


def beside(points: jax.Array, path: jax.Array) -> jax.Array:
    """Mean square of the distances from points to a path, ``(n, 2)`` each."""
    start, way = path[:-1], jnp.diff(path, axis=0)
    from_start = points[:, None] - start
    part = jnp.clip(jnp.sum(from_start * way, axis=-1) / jnp.sum(way * way, axis=-1), 0.0, 1.0)
    return jnp.mean(jnp.min(jnp.sum((from_start - part[..., None] * way) ** 2, axis=-1), axis=1))


def apart(system: nc.System) -> jax.Array:
    """How far the foot's path and the wanted one are apart, each seen from the other: mean squares of distances."""
    motion = nc.sweep(system, {"phi": TURN}, repair=False)
    far = beside(motion["F"], jnp.asarray(WANTED)) + beside(jnp.asarray(WANTED), motion["F"])
    return jnp.where(motion.failures == 0, far, jnp.inf)


def descent() -> tuple[list[nc.System], list[float]]:
    """Every design of the descent, and how far the two paths are apart on average, metres."""
    loss = nc.synthesis.Loss(nc.library.jansen_leg(), apart, free=["X", "U", "L", "V", "K", "F"])
    spoiled = loss.start + np.random.default_rng(2).uniform(-0.07, 0.07, len(loss.names))
    going = nc.synthesis.Descent(loss, optax.adam(optax.cosine_decay_schedule(5e-3, STEPS)))
    step, lane, designs, values = jax.jit(going), going.begin(spoiled), [], []
    for _ in range(STEPS):
        designs.append(going.design(lane))
        lane = step(lane)
        values.append((float(lane.value) / 2) ** 0.5)
        if len(values) % 50 == 1:
            print(f"step {len(values) - 1}: the paths are {1e3 * values[-1]:.1f} mm apart", flush=True)
    return [*designs, going.design(lane)], [*values, values[-1]]


def film(designs: list[nc.System], values: list[float], path: Path) -> None:
    """The leg walks while it is changed; slowly at first, where most happens."""
    shown = [round(STEPS * (k / FRAMES) ** 2) for k in range(FRAMES)] + [STEPS] * STILL
    motions = {k: nc.sweep(designs[k], {"phi": TURN}) for k in dict.fromkeys(shown)}
    frames = []
    for frame, k in enumerate(shown):
        figure = Figure(figsize=(3.8, 4.4), dpi=100)
        FigureCanvasAgg(figure)
        ax = figure.add_axes((0, 0, 1, 1))
        nc.viz.draw(motions[k], pose=3 * frame % (len(TURN) - 1), ax=ax, trace="F", title="", labels=False, frame=False)
        ax.plot(*WANTED.T, color=nc.viz.style.TARGET, linewidth=1.4, linestyle=(0, (2, 2)), zorder=0.5)
        ax.set(xlim=(-1.08, 0.28), ylim=(-1.04, -1.04 + 1.36 * 4.4 / 3.8))
        ax.axis("off")
        for row, text in enumerate((f"step {k}", f"{1e3 * values[k]:.1f} mm off")):
            ax.text(0.04, 0.97 - 0.055 * row, text, transform=ax.transAxes, va="top", fontsize=12, color="#22272e")
        raw = io.BytesIO()
        figure.savefig(raw, format="png")
        frames.append(Image.open(raw).convert("RGB"))
    palette = frames[-1].quantize(28, dither=Image.Dither.NONE)
    pictures = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=60, loop=0, optimize=True)


if __name__ == "__main__":
    target = Path(*sys.argv[1:2] or ["descent.gif"])
    print("compiling, for some seconds", flush=True)
    film(*descent(), target)
    print(f"{target}: the leg while it is changed")
