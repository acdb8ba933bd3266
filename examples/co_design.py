"""A walking leg whose links and motor are designed together, through ten seconds of its motion under weight.

`python examples/co_design.py` compares three descents (the motor's torque alone, the links alone, both), prints what
each saves, and writes co_design.gif, the leg before and after, into this folder, or where a name says. It takes some
three minutes; `--steps 20` is a short try. Needs optax. The same in small steps: notebooks/12_co_design.ipynb.
"""

import argparse
import io
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

import jaxnc as nc

jax.config.update("jax_enable_x64", True)

SPEED = 2 * np.pi  # of the crank, rad/s
KNOTS = 12  # of the motor's torque over a turn
GAIN, CARRIED, FADE = 0.3, 40.0, 0.02  # of the feedback, N m s; weight on the foot, N; height in which it fades out, m
JOINTS = ("D", "G", "B", "C", "E", "F", "P")  # that are moved; A stays
TURN = np.pi + 2 * np.pi * np.arange(48) / 48
TIMES, STEP = np.linspace(0.0, 10.0, 1001), 0.01  # s; with fewer times the mean power depends on when they are
SETTLED = 200  # times that are not judged
RATES = {"links": 2e-3, "knots": 0.1}  # of Adam, m and N m


def spline(knots: jax.Array, phi: jax.Array) -> jax.Array:
    """Periodic cubic B-spline of the crank's angle."""
    x = phi / (2 * jnp.pi) * KNOTS
    i = jnp.floor(x)
    u = x - i
    a, b, c, d = (knots[(i.astype(int) + k) % KNOTS] for k in (-1, 0, 1, 2))
    return ((1 - u) ** 3 * a + (3 * u**3 - 6 * u**2 + 4) * b + (1 + 3 * u + 3 * u**2 - 3 * u**3) * c + u**3 * d) / 6


def torque(knots: jax.Array, phi: jax.Array, speed: jax.Array) -> jax.Array:
    """The motor's profile, with a little feedback that holds the speed, N m."""
    return spline(knots, phi) - GAIN * (speed - SPEED)


def motor(t: jax.Array, state: Any, knots: jax.Array) -> jax.Array:
    """Drive the crank."""
    return torque(knots, state["phi"], state.velocity("phi"))


def ground(t: jax.Array, state: Any, height: jax.Array) -> jax.Array:
    """Carry the machine while the foot is low."""
    return jnp.stack([0.0, CARRIED * jax.nn.sigmoid((height - state["P"][1]) / FADE)])


def describe_leg() -> nc.Mechanism:
    """Describe Klann's leg with masses, ground and a motor, both still without numbers."""
    m = nc.library.klann_leg(scale=0.4)
    m.mass("crank", 0.5, com=m.compile()["A"], inertia=0.03)
    for body, mass in (("rod", 0.8), ("leg", 1.0)):
        m.mass(body, mass, shape="plate")
    for body, mass in (("lower_rocker", 0.3), ("upper_rocker", 0.4)):
        m.mass(body, mass)
    m.gravity = (0, -9.81)
    m.damper("bearing", "phi", damping=0.002)
    m.torque("motor", "phi", motor, jnp.zeros(KNOTS))
    m.force("ground", "P", ground, jnp.asarray(0.0))
    return m


def make_leg() -> nc.System:
    """Put the ground below the foot's path, and give the motor the torque of a constant speed, as far as it goes."""
    leg = describe_leg().compile()
    lowest = np.asarray(nc.sweep(leg, {"phi": TURN})["P"])[:, 1].min()
    leg = leg.replace({"ground": jnp.asarray(lowest + FADE)})
    even = nc.motion(leg, {"phi": lambda t: np.pi + SPEED * t}, np.arange(240) / 240)
    phi = np.asarray(even["phi"])
    basis = np.stack([np.asarray(spline(jnp.asarray(row), phi)) for row in np.eye(KNOTS)], axis=1)
    knots = np.linalg.lstsq(basis, np.asarray(nc.inverse_dynamics(leg, even)["phi"]), rcond=None)[0]
    return leg.replace({"motor": jnp.asarray(knots)})


class Task:
    """The task of a leg: least power put in at a wanted speed, with the step that the leg was drawn with."""

    def __init__(self, leg: nc.System):
        self.leg = leg
        self.wanted = np.asarray(self.step(leg))
        self.start = {"links": jnp.zeros((len(JOINTS), 2)), "knots": leg["motor"]}
        self.graded = nc.jit(jax.value_and_grad(self.loss, has_aux=True))

    def drawn(self, x: dict) -> nc.System:
        """Return the leg with joints moved and a torque profile."""
        places = {name: self.leg[name] + x["links"][k] for k, name in enumerate(JOINTS)}
        return self.leg.replace({**places, "motor": x["knots"]})

    def moved(self, x: dict, throw: bool | None = None) -> nc.dynamics.Simulation:
        """Simulate ten seconds."""
        start = {"phi": SPEED}
        return nc.simulate(self.drawn(x), TIMES, rates=start, method="rk4", step=STEP, throw=throw)

    def step(self, system: nc.System) -> jax.Array:
        """Return length, height and lowest place of the foot's path, m."""
        path = nc.sweep(system, {"phi": TURN}, repair=False)["P"]
        return jnp.stack([jnp.ptp(path[:, 0]), jnp.ptp(path[:, 1]), path[:, 1].min()])

    def loss(self, x: dict) -> tuple[jax.Array, jax.Array]:
        """Return the price; and power put in, W, mean speed and its scatter in parts of the wanted one."""
        run = self.moved(x, throw=False)
        speed = run.velocity("phi")[SETTLED:]
        power = torque(x["knots"], run["phi"][SETTLED:], speed) * speed
        mean, scatter = jnp.mean(speed) / SPEED, jnp.std(speed) / SPEED
        form = (self.step(self.drawn(x)) - self.wanted) / self.wanted[0]
        short = jnp.minimum(form[:2], 0.0)
        price = jnp.mean(2.0 * jax.nn.softplus(power / 2.0)) + 2000.0 * (mean - 1.0) ** 2 + 20.0 * scatter**2
        price = price + 1000.0 * (jnp.sum(short**2) + form[2] ** 2)
        return price, jnp.stack([jnp.mean(jnp.maximum(power, 0.0)), mean, scatter])

    def descend(self, free: tuple[str, ...], steps: int) -> tuple[dict, np.ndarray]:
        """Go down by Adam in some of the variables; return these, and what `loss` says there."""
        rules = {
            k: optax.adam(optax.cosine_decay_schedule(rate, steps), b1=0.8, b2=0.95)
            if k in free
            else optax.set_to_zero()
            for k, rate in RATES.items()
        }
        optimiser = optax.multi_transform(rules, {k: k for k in RATES})
        x, state = self.start, optimiser.init(self.start)
        for _ in range(steps):
            _, gradient = self.graded(x)
            change, state = optimiser.update(gradient, state)
            x = optax.apply_updates(x, change)
        return x, np.asarray(self.graded(x)[0][1])


def film(task: Task, designs: dict[str, dict], path: Path) -> None:
    """Film one turn of the last seconds of each design, side by side."""
    runs = {name: task.moved(x) for name, x in designs.items()}
    frames = []
    for pose in range(800, 900, 2):
        figure = Figure(figsize=(3.2 * len(runs), 3.6), dpi=80)
        FigureCanvasAgg(figure)
        for k, (name, run) in enumerate(runs.items()):
            ax = figure.add_axes((k / len(runs), 0, 1 / len(runs), 1))
            nc.viz.draw(run, pose=pose, ax=ax, trace="P", title="", labels=False, frame=False)
            ax.set_aspect("equal", adjustable="box")
            ax.set(xlim=(-0.05, 0.8), ylim=(-0.1, 0.85))
            ax.axis("off")
            ax.text(0.04, 0.97, name, transform=ax.transAxes, va="top", fontsize=12, color="#22272e")
        raw = io.BytesIO()
        figure.savefig(raw, format="png")
        frames.append(Image.open(raw).convert("RGB").quantize(32, dither=Image.Dither.NONE))
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=20, loop=0, optimize=True)


def main() -> None:
    """Compare the descents and write the film."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", nargs="?", type=Path, default=Path("co_design.gif"))
    parser.add_argument("--steps", type=int, default=300)
    options = parser.parse_args()
    task = Task(make_leg())
    say = "{:22s} {:6.3f} W, speed {:.4f}, scatter {:.3f}".format
    print(say("as drawn", *np.asarray(task.graded(task.start)[0][1])), flush=True)
    for name, free in (("torque alone", ("knots",)), ("links alone", ("links",)), ("both", ("links", "knots"))):
        x, found = task.descend(free, options.steps)
        print(say(name, *found), flush=True)
    film(task, {"before": task.start, "after": x}, options.path)
    print(f"{options.path}: the leg before and after")


if __name__ == "__main__":
    main()
