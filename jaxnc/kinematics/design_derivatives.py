"""Derivatives of solved poses by the design, and of what is read off them: numbers carry their changes along.

The poses are known, so that only the theorem of implicit functions is differentiated, in NumPy. Names and suspensions
are read there too. JAX differentiates what a user's own function makes of the poses, and nothing else.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.redesign import flattened, parts_of, redrawn
from jaxnc.kinematics.suspension import NUMBERS, asked_by, suspension
from jaxnc.kinematics.wheel import in_one_pose, tangents, tells, within_pose
from jaxnc.solvers import host
from jaxnc.solvers.assembly import derive, to_host
from jaxnc.solvers.plan import Plan
from jaxnc.system.design import carry_design
from jaxnc.system.on_lanes import carrying, reading
from jaxnc.system.precision import limits
from jaxnc.types import Array

_FITS = 1e-8  # part of a change of the rows that no motion takes up: above, the changed mechanism does not assemble
_SMALL = 1e-6  # of the largest change of the rows: below, there is nothing to take up
_CHUNK = 8192  # numbers at a time: poses times changes

Wanted = Mapping[str, str | Mapping[str, Any]]
"""By label: the name of a point, marker or coordinate; or the options of a `jaxnc.suspension`."""


def plain_outputs(outputs: Any) -> Wanted | None:
    """Outputs as names and options of suspensions; None if one of them is another function, which JAX differentiates.

    A suspension is `jaxnc.suspension` as it is, or with options by `functools.partial`.
    """
    if callable(outputs):
        outputs = {"": outputs}
    elif not isinstance(outputs, Mapping):
        outputs = {name: name for name in ([outputs] if isinstance(outputs, str) else outputs)}
    out: dict[str, Any] = {}
    for label, output in outputs.items():
        partial = isinstance(output, functools.partial) and not output.args
        if isinstance(output, str):
            out[label] = output
        elif (output.func if partial else output) is suspension:
            out[label] = output.keywords if partial else {}
        else:
            return None
    return out


class DesignDerivatives:
    """The derivatives of solved poses by chosen components of the design.

    `at` are places of the components among those of `jaxnc.kinematics.redesign.components`.
    """

    def __init__(self, view: Plan, motion: Motion, at: np.ndarray):
        self.motion, self.at, self.count = motion, at, len(at)
        self.view = host.HostView(view, to_host(derive(motion.system)))
        flat = np.asarray(flattened(motion.system))
        changes = np.zeros((len(flat), len(at)))
        changes[at, np.arange(len(at))] = 1.0
        with np.errstate(all="ignore"):
            self.drawn = carry_design(motion.system.topology, np.concatenate([flat[:, None], changes], axis=1))
        poses = np.asarray(motion.q)
        self.good = np.flatnonzero(np.asarray(motion.converged).reshape(-1))
        self.q = poses.reshape(-1, poses.shape[-1])[self.good].T

    def _chunks(self) -> Iterator[np.ndarray]:
        size = max(1, _CHUNK // (1 + self.count))
        for first in range(0, len(self.good), size):
            yield np.arange(first, min(first + size, len(self.good)))

    def assemblable(self) -> np.ndarray:
        """Find the variables whose change some motion of the unknowns takes up in every pose, ``(variables,)``.

        With r = Φ_p dp that is: r lies in the range of Φ_q.
        """
        exists = np.ones(self.count, bool)
        for lanes in self._chunks():
            size, rest = host.unabsorbed_changes(self.view, self.drawn, self.q[:, lanes])
            least = _SMALL * np.max(size, axis=1, initial=0.0, keepdims=True)
            exists &= (rest <= _FITS * np.maximum(size, least)).all(axis=0)
        return exists

    def of_names(self, wanted: Wanted) -> dict[str, np.ndarray]:
        """Derivatives of what is asked for by label, ``(*poses, ..., variables)``; zero where a pose was not found."""
        out: dict[str, np.ndarray] = {}
        for label, output in wanted.items():
            if isinstance(output, str):
                out[label] = self._read(within_pose, (self.motion.system.topology, output), (), (self.drawn.markers,))
            else:
                out |= {f"{label}.{name}" if label else name: x for name, x in self._suspension(output).items()}
        return out

    def _suspension(self, options: Mapping[str, Any]) -> dict[str, np.ndarray]:
        what, radius = asked_by(self.motion, options)
        names = tuple(name for name in NUMBERS if tells(what, name))
        still = np.zeros((1, 1 + self.count))
        still[0, 0] = 0.0 if radius is None else float(radius)
        fixed = (self.motion.system.topology, what, names, radius is None)
        found = self._read(in_one_pose, fixed, what.inputs, (self.drawn.home, self.drawn.markers, still[0]))
        by_name = {name: found[..., k, :] for k, name in enumerate(names) if name != "contact"}
        return by_name | {"contact": found[..., len(names) - 1 :, :]}

    def _read(
        self, f: Callable, fixed: tuple, inputs: tuple[str, ...], constants: tuple[np.ndarray, ...]
    ) -> np.ndarray:
        """Derivatives of ``f(*fixed, pose and its derivatives by inputs, *constants)``."""
        shapes = ((len(self.q) * (1 + len(inputs)),), *(c.shape[:-1] for c in constants))
        (program, shape), lead = reading(f, fixed, shapes), self.motion.status.shape
        run, size = carrying(program), int(np.prod(shape, dtype=int))
        slopes = [np.asarray(tangents(self.motion, {name: 1.0})[0]) for name in inputs]
        slopes = [x.reshape(-1, len(self.q))[self.good].T for x in slopes]
        out = np.zeros((int(np.prod(lead, dtype=int)), size, self.count))
        given = [x[None] for c in constants for x in c.reshape(-1, 1 + self.count)]
        for lanes in self._chunks():
            q = self.q[:, lanes]
            parts = [host.changes(self.view, self.drawn, q)[0]]
            parts += [host.changes(self.view, self.drawn, q, (rate[:, lanes],))[1][0] for rate in slopes]
            for k, value in enumerate(run([*(x for part in parts for x in part), *given])):
                out[self.good[lanes], k] = value[..., 1:]
        return out.reshape(*lead, *shape, self.count)

    def of_function(self, output: Callable[[Motion], Any]) -> tuple[dict[str, Array], dict[str, Array]]:
        """Outputs and their Jacobian ``(..., variables)``, forward or in reverse, whichever has fewer passes.

        Compiled once for each `output` that is equal to another one.
        """
        try:
            hash(output)
        except TypeError:  # a callable object that cannot be compared is compiled each time
            output = functools.partial(output)
        given = self.motion, jnp.asarray(self.at), jnp.zeros(self.count), jnp.asarray(self.motion.q), self.motion.rates
        shapes = jax.eval_shape(functools.partial(_outputs, output), *given)
        count = sum(int(np.prod(s.shape, dtype=int)) for s in jax.tree.leaves(shapes))
        derivatives, values = _jacobian(output, count < self.count, *given, self._slopes())
        return values, derivatives

    def _slopes(self) -> tuple[np.ndarray, ...]:
        """Changes of poses and of their rates, ``(variables, *poses, N)`` each; zero where they do not exist."""
        lead, width = self.motion.q.shape[:-1], len(self.q)
        rates = [np.asarray(x).reshape(-1, width)[self.good].T for x in self.motion.rates]
        out = [np.zeros((self.count, int(np.prod(lead, dtype=int)), width), self.q.dtype) for _ in (0, *rates)]
        for lanes in self._chunks():
            first, others = host.changes(self.view, self.drawn, self.q[:, lanes], [x[:, lanes] for x in rates])
            for whole, part in zip(out, (first, *others), strict=True):
                whole[:, self.good[lanes]] = np.where(np.isfinite(part), part, 0.0)[..., 1:].T
        if self.motion.conditioning is not None:
            singular = np.asarray(self.motion.conditioning).reshape(-1) <= limits(self.q).singular
            for whole in out:
                whole[:, singular] = 0.0
        return tuple(x.reshape(self.count, *lead, width) for x in out)


def _outputs(
    output: Callable[[Motion], Any], motion: Motion, at: Array, changes: Array, q: Array, rates: tuple[Array, ...]
) -> dict[str, Array]:
    """Outputs of a changed design, with poses and rates that have changed with it."""
    changed = redrawn(motion.system, at, changes)
    return parts_of(output(dataclasses.replace(motion, system=changed, poses=q, rates=rates)))


@functools.partial(jit, static_argnums=(0, 1))
def _jacobian(
    output: Callable[[Motion], Any],
    back: bool,
    motion: Motion,
    at: Array,
    still: Array,
    q: Array,
    rates: tuple[Array, ...],
    slopes: tuple[Array, ...],
) -> tuple[dict[str, Array], dict[str, Array]]:
    point = still, q, rates

    def outputs(*at_point: Any) -> tuple[dict[str, Array], dict[str, Array]]:
        found = _outputs(output, motion, at, *at_point)
        return found, found

    if not back:

        def along(change: Array, dq: Array, *more: Array) -> tuple[dict[str, Array], dict[str, Array]]:
            _, found, values = jax.jvp(outputs, point, (change, dq, more), has_aux=True)
            return found, values

        return jax.vmap(along, out_axes=(-1, None))(jnp.eye(still.shape[0]), *slopes)
    found, values = jax.jacrev(outputs, argnums=(0, 1, 2), has_aux=True)(*point)

    def total(by: tuple[Array, Array, tuple[Array, ...]]) -> Array:
        own, by_poses, by_rates = by
        for bar, slope in zip((by_poses, *by_rates), slopes, strict=True):
            axes = [*range(bar.ndim - q.ndim, bar.ndim)], [*range(1, slope.ndim)]
            own = own + jnp.tensordot(bar, slope, axes)
        return own

    return {name: total(by) for name, by in found.items()}, values
