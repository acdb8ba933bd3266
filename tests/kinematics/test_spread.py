"""Batches spread over devices and processes: the numbers of one device, whatever they are spread over."""

import gc
import json
import os
import socket
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import slider_crank
from processes import child, ended

import jaxnc as nc
from jaxnc.kinematics import spread
from jaxnc.kinematics.inputs import make_plan
from jaxnc.solvers.assembly import derive, settle

ROUNDING = 2e-14  # a gradient is summed device by device, in another order


def test_equations_are_brought_to_devices_once_and_kept_as_long_as_they_are_there():
    devices, numbers = tuple(jax.devices()[:1]), jnp.arange(3.0)
    lanes = np.arange(5.0)
    (once, first), (again, second) = (
        spread._place_arguments(devices, (None, 0), (numbers, lanes + k)) for k in range(2)
    )
    assert once is again
    np.testing.assert_array_equal(second - first, np.ones(5))  # lanes are brought anew
    np.testing.assert_array_equal(once, np.arange(3.0))
    here, there = weakref.ref(numbers), weakref.ref(once)
    del numbers, once, again
    gc.collect()
    assert here() is None and there() is None


@pytest.mark.slow
def test_two_devices_give_the_numbers_of_one():
    """Equal to the last bit is promised for code as users have it, not for that of this suite (see conftest.py)."""
    found = json.loads(ended(child("two_devices", XLA_FLAGS=""))[0].splitlines()[-1])
    assert found["devices"] == 2 and found["spread"] and found["empty"]
    exact = jax.__version_info__ < (0, 11)  # JAX 0.12 rounds a few numbers otherwise
    for name, off in found["off"].items():
        assert off <= (0.0 if exact and "gradient" not in name else ROUNDING), (name, off)
    assert {"uneven batch", "even batch", "designs", "gradient of designs", "walks at once"} <= {*found["off"]}
    said = found["said"]
    assert "devices=3, but there are 2 cpu devices" in said["too many"]
    assert "jax.config.update('jax_num_cpu_devices', 3)" in said["too many"]
    assert "XLA_FLAGS=--xla_force_host_platform_device_count=3" in said["too many"]
    assert "name each device once" in said["twice"]
    assert "leave devices= out" in said["inside"]
    assert "the batch as the first axis" in said["no batch out"] and "sums and means outside" in said["no batch out"]


@pytest.mark.slow
def test_two_processes_of_two_devices_give_the_numbers_of_one(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    files = [tmp_path / f"{rank}.npz" for rank in range(2)]
    ended(*(child("two_processes", address, str(rank), str(file)) for rank, file in enumerate(files)))

    system, u = slider_crank(), np.linspace(0.2, 5.9, 7)
    one = nc.solve_position(system, {"phi": u}, devices=1)
    gradient = jax.grad(lambda s: jnp.sum(nc.solve_position(s, {"phi": u})["S.x"] ** 2))(system)
    for rank, file in enumerate(files):
        got = np.load(file)
        np.testing.assert_array_equal(got["q"], one.q)
        np.testing.assert_array_equal(got["status"], one.status)
        np.testing.assert_array_equal(got["asked"], one.asked)
        np.testing.assert_array_equal(got["own"], np.array_split(np.asarray(one.q), 2)[rank])
        np.testing.assert_array_equal(got["squares"], np.arange(8.0) ** 2)
        want = np.asarray(gradient.parameters.dimensions)
        np.testing.assert_allclose(got["gradient"], want, rtol=0, atol=ROUNDING * np.abs(want).max())


def test_spread_lanes_do_not_reach_lapack():
    """Its kernels for batches wait for threads of the pool that they run in; two devices at once wait for ever."""
    system, zeros = slider_crank(), np.zeros((4, 1))
    view, eq = make_plan(system, ("phi",), ()), derive(system)
    q0 = settle(eq, np.zeros(len(system.topology.coordinates))).q
    text = spread._solve_on_devices.lower(tuple(jax.devices()), view, "lanes", True, eq, q0, zeros, (zeros,)).as_text()
    assert "while" in text and "lapack" not in text
    assert "lapack" in jax.jit(jnp.linalg.inv).lower(np.eye(3)).as_text(), "or else this test would see nothing"


@pytest.mark.parametrize(
    ("devices", "parts"),
    [
        ("both", ["devices='both'", '"all"', '"global"', "a number"]),
        (True, ["devices=True", "a number"]),
        (1.5, ["devices=1.5", "jax devices"]),
        (0, ["devices=0", "at least 1", "None for one device"]),
        ([], ["devices is empty", "None for one device"]),
        (["cpu:0"], ["'cpu:0' is not a jax device", "jax.devices()[:2]"]),
        (1000, ["devices=1000, but there is 1", "'jax_num_cpu_devices', 1000", "XLA_FLAGS="]),
    ],
)
def test_devices_that_are_not_there(devices, parts):
    for call in (
        lambda: nc.solve_position(slider_crank(), {"phi": np.zeros(3)}, devices=devices),
        lambda: nc.shard(jnp.sin, devices=devices),
    ):
        with pytest.raises(nc.InputError) as caught:
            call()
        assert all(part in str(caught.value) for part in parts), str(caught.value)


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: nc.shard(3), ["takes a function", "got int"]),
        (lambda: nc.shard(jnp.sin, in_axes=1), ["in_axes=1", "0 (carries the batch) or None"]),
        (lambda: nc.shard(jnp.sin, in_axes=(0, 0))(np.ones(2)), ["in_axes has 2 entries", "1 arguments"]),
        (lambda: nc.shard(jnp.sin, in_axes=None)(np.ones(2)), ["none of the arguments carries a batch"]),
        (lambda: nc.shard(jnp.sin)(2.0), ["argument 0 has a number", "None in in_axes"]),
        (lambda: nc.shard(jnp.add)(np.ones(2), np.ones(3)), ["2 (argument 0)", "3 (argument 1)"]),
        (lambda: nc.shard(lambda x: x[:1])(np.ones(3)), ["for 3 elements it returned shape (1,)"]),
    ],
)
def test_batches_that_cannot_be_spread(call, parts):
    with pytest.raises(nc.InputError) as caught:
        call()
    assert all(part in str(caught.value) for part in parts), str(caught.value)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system binds no process to a core")
def test_one_core_is_enough_for_sparse_factors():
    (told,) = ended(child("one_core"))
    assert float(told) == 20_000.0
