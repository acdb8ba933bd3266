"""What analyses return, inside of traced code: every method answers, or says what it needs."""

import inspect

import jax
import jax.numpy as jnp
import mechanisms
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.solvers.traced import PIECE, ask_host

T = np.linspace(0.0, 0.1, 3)


def pendulum():
    m = mechanisms.pendulum()
    m.spring("coil", "A", "B", stiffness=3.0)
    return m.compile()


def posed(x):
    return nc.solve_position(pendulum(), {"phi": x}, rates={"phi": 1.0}, accelerations={"phi": 0.0})


def wheel(x):
    return nc.suspension(nc.sweep(nc.library.macpherson().compile(), {"6.z": x}, hold=["10.y", "7.x"]))


# What is made of a traced argument, the argument, and how many members need numbers.
# Compiling a mechanism there is answered at once, too.
MADE = {
    "motion": (lambda x: nc.sweep(nc.library.four_bar().compile(), {"phi": x}, rates={"phi": 1.0}), T, 11),
    "simulation": (lambda x: nc.simulate(pendulum(), T, rates={"phi": x}, method="rk4", step=0.05), 1.0, 13),
    "equilibrium": (lambda x: nc.equilibrium(pendulum(), {"phi": x}), -1.0, 0),
    "inverse dynamics": (lambda x: nc.inverse_dynamics(pendulum(), posed(x)), -1.0, 1),
    "reactions": (lambda x: nc.reactions(posed(x)), -1.0, 1),
    "linearisation": (lambda x: nc.linearise(pendulum(), posed(x)), -1.0, 3),
    "suspension": (wheel, np.array([300.0, 310.0]), 2),
}
# Arguments of methods that need some.
ARGUMENTS = {
    "pose": (0,),
    "mode": (0,),
    "at": ("B", "rod"),
    "on": ("rod",),
    "joint": ("phi", "rod"),
    "support": ("A",),
    "load": ("coil",),
    "effort": ("phi",),
    "velocity": ("phi",),
    "acceleration": ("phi",),
    "jerk": ("phi",),
    "plot": ("phi",),
    "animate": ("never.gif",),
    "to_html": ("never.html",),
    "to_csv": ("never.csv",),
    "to_npz": ("never.npz",),
    "__getitem__": ("phi",),
}
BODY = ("position", "orientation", "quaternion", "angular_velocity", "angular_acceleration", "screw_axis")


@pytest.mark.parametrize("name", MADE)
def test_a_method_answers_or_says_what_it_needs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make, x, count = MADE[name]
    said = []

    def asked(x):
        result = make(x)
        body = "rod" if name != "motion" else "crank"
        for member in dir(type(result)):
            if member[0] == "_" and member not in ("__repr__", "__str__", "__getitem__"):
                continue
            arguments = (body,) if member in BODY else ARGUMENTS.get(member, ())
            try:
                found = getattr(result, member)
                if not isinstance(inspect.getattr_static(type(result), member, None), property) and callable(found):
                    found(*arguments)
            except nc.JaxncError as error:  # anything else is JAX's, and a failure
                said.append(f"{member}: {error}")
        return x

    jax.eval_shape(asked, x)  # nothing of it has to be compiled
    about = [text for text in said if "traced code" in text or "inside jit" in text]
    assert all("return" in text for text in about)
    assert len(about) == count, about
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("count", [3, PIECE, 5 * PIECE + 1, 100 * PIECE])
def test_what_the_host_is_given_comes_whole(count):
    numbers, lanes = jnp.arange(2.0 * count).reshape(2, count), jnp.arange(count) % 3 == 0
    like, seen = jax.ShapeDtypeStruct((2,), numbers.dtype), []

    def answer(numbers, rest):
        seen.append((numbers.shape, rest["lanes"].dtype))
        return np.array([numbers[1, rest["lanes"]].sum(), rest["lanes"].sum()])

    ask = jax.jit(lambda a, b: ask_host("added up", like, answer, a, {"lanes": b}, given_up=answer))
    wanted = np.asarray(numbers)[1][np.asarray(lanes)].sum(), np.asarray(lanes).sum()
    np.testing.assert_array_equal(ask(numbers, lanes), wanted)
    assert seen == [((2, count), np.dtype(bool))]


def test_the_host_cannot_be_asked_without_a_cpu_backend(monkeypatch):
    def none(backend):
        raise RuntimeError(f"Unknown backend {backend}")

    monkeypatch.setattr(jax, "local_devices", none)  # as with JAX_PLATFORMS=cuda
    like = jax.ShapeDtypeStruct((), float)
    with pytest.raises(nc.JaxncError, match="JAX_PLATFORMS=cuda,cpu; repair=False"):
        jax.jit(lambda a: ask_host("doubled", like, lambda a: 2 * a, a, given_up=abs))(1.0)
