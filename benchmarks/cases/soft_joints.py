"""Ten seconds of a driven leg and their gradient: joints that are constraints, beside MuJoCo's soft ones.

The leg is that of ``examples/co_design.py``, off the ground. What is judged is the mean power that its motor puts in,
and its gradient by the twelve knots of the motor's torque; ours is by the places of seven joints as well.
"""

import functools
import importlib.util
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks.clock import Way
from benchmarks.record import OURS
from benchmarks.suite import Suite

CASE = "soft joints"
EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "co_design.py"
VALUE, GRADIENT = f"{OURS}: ten seconds", f"{OURS}: and their gradient"
STEP = 0.01  # ours, s
SOFT = 1e-3  # MuJoCo's, s: what the written file says
WIDTH = 1e-4  # of central differences, N m
RIGHT = 1e-2  # a gradient is right that is off by less, of its size, from that of steps of a quarter,
EXACT = 1e-8  # and ours if it is that of the steps that are made: by differences, extrapolated


@functools.cache
def _example() -> Any:
    spec = importlib.util.spec_from_file_location("co_design", EXAMPLE)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@functools.cache
def _leg() -> nc.System:
    return _example().make_leg().replace({"ground": -10.0})  # far below


def _power(knots: Any, phi: Any, speed: Any) -> Any:
    """Mean power that the motor puts in, with a softened corner, W."""
    return jnp.mean(2.0 * jax.nn.softplus(_example().torque(knots, phi, speed) * speed / 2.0))


def _run(x: dict, step: float, times: np.ndarray) -> nc.dynamics.Simulation:
    example, leg = _example(), _leg()
    places = {name: leg[name] + x["links"][k] for k, name in enumerate(example.JOINTS)}
    start = {"phi": example.SPEED}
    moved = leg.replace({**places, "motor": x["knots"]})
    return nc.simulate(moved, times, rates=start, method="rk4", step=step, throw=False)


def _objective(x: dict, step: float, times: np.ndarray) -> jax.Array:
    run = _run(x, step, times)
    return _power(x["knots"], run["phi"], run.velocity("phi"))


class _Soft:
    """The leg in MuJoCo: what was written of it, started where ours starts."""

    def __init__(self, times: np.ndarray):
        import mujoco

        leg, example = _leg(), _example()
        with tempfile.TemporaryDirectory() as folder:
            done = example.describe_leg().to_mjcf(Path(folder) / "leg.xml", at=leg)
            model = mujoco.MjModel.from_xml_path(str(done.path))
        begin = nc.solve_position(leg, {"phi": float(np.pi)}, rates={"phi": example.SPEED})
        ahead = nc.solve_position(leg, {"phi": float(np.pi) + 1e-6})
        names = [model.joint(k).name for k in range(model.njnt)]
        values = [np.asarray(done.joint_values(p))[..., [done.joints.index(n) for n in names]] for p in (begin, ahead)]
        self.mujoco, self.model, self.times, self.crank = mujoco, model, times, names.index("A crank")
        self.qpos, self.qvel = values[0], (values[1] - values[0]) * 1e6 * example.SPEED
        model.opt.timestep = SOFT
        self.every = round(float(times[1] - times[0]) / SOFT)

    def torque(self, knots: np.ndarray, phi: float, speed: float) -> float:
        """The motor's, in NumPy."""
        example = _example()
        x = phi / (2 * np.pi) * example.KNOTS
        i = int(np.floor(x))
        u = x - i
        a, b, c, d = (knots[(i + k) % example.KNOTS] for k in (-1, 0, 1, 2))
        own = (1 - u) ** 3 * a + (3 * u**3 - 6 * u**2 + 4) * b + (1 + 3 * u + 3 * u**2 - 3 * u**3) * c + u**3 * d
        return own / 6 - example.GAIN * (speed - example.SPEED)

    def run(self, knots: np.ndarray) -> tuple[float, float]:
        """Return the power, W, and how far joints that are to coincide were apart at most, m."""
        data, k = self.mujoco.MjData(self.model), self.crank
        data.qpos[:], data.qvel[:] = self.qpos, self.qvel
        phi, speed, apart = [], [], 0.0
        for step in range(self.every * (len(self.times) - 1) + 1):
            if step % self.every == 0:
                phi.append(np.pi + data.qpos[k])
                speed.append(data.qvel[k])
            data.qfrc_applied[k] = self.torque(knots, np.pi + data.qpos[k], data.qvel[k])
            self.mujoco.mj_step(self.model, data)
            apart = max(apart, float(np.abs(data.efc_pos).max()))
        return float(_power(jnp.asarray(knots), jnp.asarray(phi), jnp.asarray(speed))), apart

    def differences(self, knots: np.ndarray) -> np.ndarray:
        """Return the gradient by central differences."""
        ends = [[self.run(knots + s * row)[0] for s in (WIDTH, -WIDTH)] for row in np.eye(len(knots))]
        return np.array([(a - b) / (2 * WIDTH) for a, b in ends])

    def in_jax(self) -> Any:
        """Return the power as a function of the knots, by MJX; its loops are differentiated forward only."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from mujoco import mjx
        model, crank, every, torque = mjx.put_model(self.model), self.crank, self.every, _example().torque
        begin = mjx.make_data(model).replace(qpos=jnp.asarray(self.qpos), qvel=jnp.asarray(self.qvel))

        def power(knots: jax.Array) -> jax.Array:
            def once(data: Any, _: Any) -> tuple[Any, None]:
                effort = torque(knots, jnp.pi + data.qpos[crank], data.qvel[crank])
                return mjx.step(model, data.replace(qfrc_applied=data.qfrc_applied.at[crank].set(effort))), None

            def seen(data: Any, _: Any) -> tuple[Any, Any]:
                now = jnp.pi + data.qpos[crank], data.qvel[crank]
                return jax.lax.scan(once, data, None, length=every)[0], now

            return _power(knots, *jax.lax.scan(seen, begin, None, length=len(self.times))[1])

        return power


def driven_leg(suite: Suite) -> None:
    """A thousand steps of the leg and their gradient; of MuJoCo's leg with soft joints ten times as many."""
    example = _example()
    times = np.linspace(0.0, 1.0 if suite.quick else 10.0, 101 if suite.quick else 1001)
    links, knots = jnp.zeros((len(example.JOINTS), 2)), np.asarray(_leg()["motor"])

    def arguments(data: np.ndarray) -> dict:
        return {"links": links, "knots": jnp.asarray(data[0])}

    def objective(x: dict) -> jax.Array:
        return _objective(x, STEP, times)

    value, gradient = nc.jit(objective), nc.jit(jax.value_and_grad(objective))
    finer = nc.jit(jax.grad(lambda x: _objective(x, STEP / 4, times)))
    truth = functools.cache(lambda key: np.asarray(finer({"links": links, "knots": jnp.asarray(key)})["knots"]))

    def off(found: Any, data: np.ndarray) -> float:
        wanted = truth(tuple(data[0]))
        return float(np.abs(np.asarray(found) - wanted).max() / np.abs(wanted).max())

    def right(found: Any, data: np.ndarray) -> float:
        return float(off(found, data) < RIGHT)

    def draw(seed: int, size: int) -> np.ndarray:
        return knots + np.random.default_rng(seed).normal(size=(size, len(knots))) * 0.1

    def differs(found: dict, data: np.ndarray) -> float:
        """Return how far a gradient is from differences along a way of all numbers, relative to its parts."""
        x, draw = arguments(data), np.random.default_rng(0)
        way = {"links": draw.normal(size=links.shape) * 1e-2, "knots": draw.normal(size=len(knots))}

        def difference(h: float) -> float:
            ends = [float(value(jax.tree.map(lambda a, d, s=s: a + s * h * d, x, way))) for s in (1.0, -1.0)]
            return (ends[0] - ends[1]) / (2 * h)

        wide, half, quarter = (difference(4e-4 / 2**k) for k in range(3))
        wanted = (64 * quarter - 20 * half + wide) / 45
        parts = np.concatenate([np.ravel(np.asarray(found[name]) * way[name]) for name in way])
        return float(abs(parts.sum() - wanted) / np.abs(parts).sum())

    def exact(found: Any, data: np.ndarray) -> float:
        return float(off(found[1]["knots"], data) < RIGHT and differs(found[1], data) < EXACT)

    one = draw(0, 1)
    found = jax.jit(jax.grad(objective))(arguments(one))
    closed = float(_run(arguments(one), STEP, times).violation[0])
    ours = f"joints apart by {closed:.1g} m at most; gradient off by {off(found['knots'], one):.1g}"
    ours += f", from differences of the same steps by {differs(found, one):.1g}"

    def peers() -> list[Way]:
        soft = _Soft(times)
        apart, wrong = soft.run(one[0])[1], off(soft.differences(one[0]), one)
        said = f"steps of {SOFT:g} s; joints apart by {apart:.1g} m at most"
        return [
            Way("MuJoCo connect", lambda x: soft.run(x[0]), lambda *_: None, note=said),
            Way("MuJoCo connect: differences", lambda x: soft.differences(x[0]), right,
                note=f"gradient by 12 numbers, 24 runs; off by {wrong:.1g}"),
        ]  # fmt: skip

    def in_jax() -> list[Way]:
        power = _Soft(times).in_jax()
        soft, slope = jax.jit(power), jax.jit(jax.jacfwd(power))
        wrong = off(slope(jnp.asarray(one[0])), one)
        return [
            Way("MJX connect", lambda x: jax.block_until_ready(soft(x)), lambda *_: None, lambda d: jnp.asarray(d[0]),
                True, "the same in JAX"),
            Way("MJX connect: gradient", lambda x: jax.block_until_ready(slope(x)), right, lambda d: jnp.asarray(d[0]),
                note=f"forward, by 12 numbers; off by {wrong:.1g}"),
        ]  # fmt: skip

    ways = [
        Way(VALUE, lambda x: jax.block_until_ready(value(x)), lambda *_: None, arguments, note=f"steps of {STEP:g} s"),
        Way(GRADIENT, lambda x: jax.block_until_ready(gradient(x)), exact, arguments,
            True, f"by 26 numbers; {ours}"),
        *suite.peer("MuJoCo connect", peers, "mujoco"),
        *suite.peer("MJX connect", in_jax, "mujoco.mjx" if "mujoco" in sys.modules else "mujoco"),
    ]  # fmt: skip
    suite.compare(CASE, ways, draw, 1)
