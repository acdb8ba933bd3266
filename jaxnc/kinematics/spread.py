"""Batches spread over several devices: every device solves its own part of the lanes.

The part of each device is stated by `jax.shard_map`. Leaving it to the compiler is right too, but it then gathers whole
batches on every device, and nothing is won.
"""

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxnc.calls import public
from jaxnc.compiling import refuse_fork
from jaxnc.errors import InputError, brief
from jaxnc.records import by_identity
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.types import Array, PyTree

if TYPE_CHECKING:
    from jaxnc.system.equations import Equations

Device: TypeAlias = Any
"""A `jax.Device`, which type checkers do not know as a type."""

Devices: TypeAlias = str | int | Device | Sequence[Device] | None
"""Devices by number, as ``"all"`` of this process or ``"global"``, those of all processes, or themselves."""

_FORMS = '"all", "global", a number, or jax devices such as jax.devices()[:2]'
_AXIS = "lanes"


@public
def shard(f: Callable, devices: Devices = "all", in_axes: int | Sequence[int | None] | None = 0) -> Callable:
    """Make a function of batches run on several devices at once, each with its own part of the batch.

    ``nc.shard(jax.vmap(cost))(designs)`` is ``jax.vmap(cost)(designs)``, faster. The batch is filled up to a multiple
    of the devices with its last element, and the result cut to its length again. Make the function once and keep it:
    it is compiled for every shape it meets, as by ``jax.jit``.

    Args:
        f: a function of arrays and pytrees of them (a `System` is one) whose leaves have the batch as their first axis,
            and that returns such a pytree. It can be traced by JAX and treats every element on its own.
        devices: ``"all"``: every device of this process; ``"global"``: every device of every process started by
            ``jax.distributed``, each of which gives the same whole batch and gets the whole result; a number; or a
            sequence of jax devices.
        in_axes: as in ``jax.vmap``: 0 for arguments that carry the batch, None for those that all elements share; one
            for all arguments or one for each.

    Returns:
        A function of the same arguments (positional) and result. It may be differentiated, and used in jit and vmap.

    Raises:
        InputError: devices that are not there. When it is called: arguments without a batch, or of different lengths;
            a result without it; a call from inside of another function that is spread.
    """
    if not callable(f):
        raise InputError(f"shard() takes a function, such as jax.vmap(f); got {type(f).__name__}")
    each = in_axes if isinstance(in_axes, list | tuple) else (in_axes,)
    if not all(a is None or (isinstance(a, int) and a == 0) for a in each):
        raise InputError(
            f"in_axes={brief(in_axes)}; give 0 (carries the batch) or None (shared), or one for each argument"
        )
    chosen = choose(devices)

    @functools.wraps(f)
    def spread(*arguments):
        refuse_fork()
        axes = tuple(in_axes) if isinstance(in_axes, Sequence) else (in_axes,) * len(arguments)
        if len(axes) != len(arguments):
            raise InputError(f"in_axes has {len(axes)} entries, but {len(arguments)} arguments were given")
        if not _batch_length(axes, arguments):
            return f(*arguments)
        return run(axes, *_place_arguments(chosen, axes, arguments))

    @functools.partial(jax.jit, static_argnums=0)
    def run(axes, *arguments):
        return _run_over(chosen, f, axes, arguments)

    return spread


def solve_on(
    devices: tuple[Device, ...],
    view: Plan,
    method: str,
    eq: "Equations",
    q0: Array,
    values: Array,
    orders: tuple[Array, ...],
    repair: bool,
) -> PoseBatch:
    """Solve for poses with the lanes spread over devices; arguments and result as of `traced.analyse_traced`.

    Few poses come in one array, very many as `Columns`.
    """
    return _solve_on_devices(
        devices, view, method, repair, *_place_arguments(devices, _lane_axes(method), (eq, q0, values, orders))
    )


def _lane_axes(method: str) -> tuple[int | None, ...]:
    """Mark what carries the lanes among the arguments of an analysis: values, their rates, and guesses."""
    return None, 0 if method == "guess" else None, 0, 0


@functools.partial(jax.jit, static_argnums=(0, 1, 2, 3))
def _solve_on_devices(devices, view, method, repair, eq, q0, *lanes):
    from jaxnc.kinematics import traced  # with all that XLA needs, and the host does not
    from jaxnc.solvers.kernel import writes_out

    axes = _lane_axes(method)

    def solve(*arguments):
        return traced.analyse_traced(view, method, *arguments, repair)

    if view.large or method == "guess" or not writes_out(view):
        return _run_over(devices, solve, axes, (eq, q0, *lanes))

    def part(*arguments):
        found = solve(*arguments)
        return found._replace(q=(found.q.lanes, found.q.driven))

    found = _run_over(devices, part, axes, (eq, q0, *lanes))
    poses = traced.columns_of(view, eq, q0, *found.q)
    return found._replace(q=poses if len(found.status) >= traced.fill.LEAST else poses.whole())


def _run_over(devices: Sequence[Device], f: Callable, axes: Sequence[int | None], arguments: Sequence[object]) -> Any:
    """Run `f` on every device with its part of the batch; in traced code."""
    if jax.sharding.get_abstract_mesh().manual_axes:
        raise InputError("this is called inside of a function that is spread over devices already; leave devices= out")
    count = _batch_length(axes, arguments)
    each = -(-count // len(devices))
    lanes = np.minimum(np.arange(each * len(devices)), count - 1)
    if len(lanes) > count:
        arguments = [
            x if axis is None else jax.tree.map(lambda leaf: jnp.asarray(leaf)[lanes], x)
            for axis, x in zip(axes, arguments, strict=True)
        ]

    def part(*arguments):
        out = f(*arguments)
        for leaf in jax.tree.leaves(out):
            if not jnp.shape(leaf) or jnp.shape(leaf)[0] != each:
                raise InputError(
                    f"a function that is spread must return the batch as the first axis of every array; for {each} "
                    f"elements it returned shape {jnp.shape(leaf)}. Take sums and means outside of it"
                )
        return out

    mesh = Mesh(np.array(devices), (_AXIS,))
    specs = tuple(PartitionSpec() if axis is None else PartitionSpec(_AXIS) for axis in axes)
    run = jax.shard_map(part, mesh=mesh, in_specs=specs, out_specs=PartitionSpec(_AXIS), check_vma=False)
    out = run(*arguments)
    if len(lanes) > count:
        out = jax.tree.map(lambda x: x[:count], out)
    if several_processes(devices):
        # Whoever asked for the whole batch can look at the whole result.
        out = jax.lax.with_sharding_constraint(out, NamedSharding(mesh, PartitionSpec()))
    return out


def _batch_length(axes: Sequence[int | None], arguments: Sequence[object]) -> int:
    """Count the elements of the batch."""
    shapes = [
        (k, jnp.shape(leaf))
        for k, (axis, argument) in enumerate(zip(axes, arguments, strict=True))
        if axis is not None
        for leaf in jax.tree.leaves(argument)
    ]
    if not shapes:
        raise InputError("none of the arguments carries a batch; give arrays with the batch as their first axis")
    for k, shape in shapes:
        if not shape:
            raise InputError(
                f"argument {k} has a number where an array with the batch as its first axis is needed; stack the "
                f"elements, or mark an argument that they share by None in in_axes"
            )
    lengths = {shape[0]: k for k, shape in shapes}
    if len(lengths) > 1:
        shown = ", ".join(f"{n} (argument {k})" for n, k in lengths.items())
        raise InputError(f"the arguments carry batches of different lengths: {shown}; mark shared ones in in_axes")
    return shapes[0][1][0]


def _place_arguments(
    devices: Sequence[Device], axes: Sequence[int | None], arguments: Sequence[PyTree]
) -> Sequence[PyTree]:
    """The arguments, where they are known, brought to their devices wherever they were before."""
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arguments)):
        return arguments
    mesh = Mesh(np.array(devices), (_AXIS,))
    parts, whole = (NamedSharding(mesh, PartitionSpec(*names)) for names in ((_AXIS,), ()))
    # A batch that does not divide evenly is filled up later, by compiled code.
    wanted = [
        (leaf, whole if axis is None or np.shape(leaf)[0] % len(devices) else parts, axis is None)
        for argument, axis in zip(arguments, axes, strict=True)
        for leaf in jax.tree.leaves(argument)
    ]
    if several_processes(devices):
        placed = [_of_all(leaf, target) for leaf, target, _ in wanted]
    else:
        kept = [_everywhere(target)(leaf) if shared and _keeps(leaf) else None for leaf, target, shared in wanted]
        rest = [pair[:2] for pair, copy in zip(wanted, kept, strict=True) if copy is None]
        moved = iter(jax.device_put([leaf for leaf, _ in rest], [target for _, target in rest]))  # all in one call
        placed = [next(moved) if copy is None else copy for copy in kept]
    return jax.tree.unflatten(jax.tree.structure(arguments), placed)


def _keeps(leaf: Array) -> bool:
    """Say whether copies of an array, such as the equations have, are kept for the next call: it cannot change."""
    # copies of 10_000 numbers on other devices are kept as long as the array is there
    return isinstance(leaf, jax.Array) and len(leaf.sharding.device_set) == 1 and leaf.size <= 10_000


@functools.lru_cache(maxsize=16)
def _everywhere(target: NamedSharding) -> Callable[[Array], Array]:
    """Make the function that brings an array to all devices, once."""
    return by_identity(lambda leaf: jax.device_put(leaf, target))


def _of_all(leaf: Array, target: NamedSharding) -> Array:
    """An array that every process has, on its place among the devices of all."""
    if isinstance(leaf, jax.Array) and not leaf.is_fully_addressable:
        return leaf
    numbers = np.asarray(leaf)
    return jax.make_array_from_callback(numbers.shape, target, lambda index: numbers[index])


# -- which devices -----------------------------------------------------------------------------------------------------


def choose(devices: Devices) -> tuple[Device, ...]:
    """Find the devices that a user means.

    Args:
        devices: ``"all"``: every device of this process; ``"global"``: every device of every process; a number: the
            first so many of this process; or the devices themselves.
    """
    refuse_fork()
    if isinstance(devices, str):
        if devices not in ("all", "global"):
            raise InputError(f"devices={devices!r}; give {_FORMS}")
        return tuple(jax.local_devices() if devices == "all" else jax.devices())
    if isinstance(devices, int | np.integer) and not isinstance(devices, bool):
        return _first_devices(int(devices))
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
    """Say whether some of the devices belong to another process."""
    return any(d.process_index != jax.process_index() for d in devices)


def _first_devices(number: int) -> tuple[Device, ...]:
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
