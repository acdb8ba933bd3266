"""Choosing the devices that a batch is spread over."""

from collections.abc import Sequence
from typing import Any, TypeAlias

import jax

from jaxnc.compiling import refuse_fork
from jaxnc.errors import InputError

Device: TypeAlias = Any
"""A `jax.Device`, which type checkers do not know as a type."""

Devices: TypeAlias = str | int | Device | Sequence[Device] | None
"""Devices by number, as ``"all"`` of this process or ``"global"``, those of all processes, or themselves."""

_FORMS = '"all", "global", a number, or jax devices such as jax.devices()[:2]'


def choose(devices: Devices) -> tuple[Device, ...]:
    """The devices that a user means.

    Args:
        devices: ``"all"``: every device of this process; ``"global"``: every device of every process; a number: the
            first so many of this process; or the devices themselves.
    """
    refuse_fork()
    if isinstance(devices, str):
        if devices not in ("all", "global"):
            raise InputError(f"devices={devices!r}; give {_FORMS}")
        return tuple(jax.local_devices() if devices == "all" else jax.devices())
    if isinstance(devices, int) and not isinstance(devices, bool):
        return _first(devices)
    some = (devices,) if isinstance(devices, jax.Device) else devices
    if isinstance(some, bool) or not isinstance(some, Sequence):
        raise InputError(f"devices={devices!r}; give {_FORMS}")
    chosen = tuple(some)
    for device in chosen:
        if not isinstance(device, jax.Device):
            raise InputError(f"devices: {device!r} is not a jax device; give {_FORMS}")
    if not chosen:
        raise InputError(f"devices is empty; give {_FORMS}, or None for one device")
    if len(set(chosen)) < len(chosen):
        raise InputError(f"devices: {', '.join(map(str, chosen))}; name each device once")
    if not any(d.process_index == jax.process_index() for d in chosen):
        raise InputError(
            f"devices: none of {', '.join(map(str, chosen))} belongs to this process; take some of jax.local_devices() "
            f'too, or "global"'
        )
    return chosen


def several_processes(devices: Sequence[Device]) -> bool:
    """Whether some of the devices belong to another process."""
    return any(d.process_index != jax.process_index() for d in devices)


def _first(number: int) -> tuple[Device, ...]:
    there = jax.local_devices()
    if number < 1:
        raise InputError(f"devices={number}; give at least 1, or None for one device")
    if number > len(there):
        have = f"are {len(there)} {there[0].platform} devices" if len(there) > 1 else f"is 1 {there[0].platform} device"
        hint = ""
        if there[0].platform == "cpu":
            # JAX counts a whole processor as one device unless it is told otherwise, before it starts.
            hint = (
                f". For a device a core, before anything is computed: jax.config.update('jax_num_cpu_devices', "
                f"{number}), or in the environment XLA_FLAGS=--xla_force_host_platform_device_count={number}"
            )
        raise InputError(f"devices={number}, but there {have} in this process{hint}")
    return tuple(there[:number])
