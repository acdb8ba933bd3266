"""What a change of the design does to poses that the host has found, in NumPy: numbers carry their changes along."""

import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.redesign import FITS, SMALL
from jaxnc.kinematics.suspension import NUMBERS, asked_by, suspension
from jaxnc.kinematics.wheel import in_one_pose, tells, within_pose
from jaxnc.kinematics.wheel_on_host import suits as tells_suspensions
from jaxnc.kinematics.wheel_on_host import tangents
from jaxnc.solvers import host
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.plan import Plan
from jaxnc.system.design import Drawn, carry_design
from jaxnc.system.host import from_jax
from jaxnc.system.host_kinds import readable
from jaxnc.system.on_lanes import carrying, reading

_CHUNK = 8192  # numbers at a time: poses times changes

Wanted = Mapping[str, str | Mapping[str, Any]]
"""By label: the name of a point, marker or coordinate; or the options of a `jaxnc.suspension`."""


def read_on_host(motion: Motion, outputs: Any) -> Wanted | None:
    """What is asked for, if the host can differentiate it; None where JAX has to.

    The one rule: the host found the poses, all kinds of constraints can be read, and every output is a name or
    `jaxnc.suspension`, as it is or with options by `functools.partial`. Other functions are the user's own: JAX's.
    """
    if not tells_suspensions(motion, None) or not readable(motion.system.topology):
        return None
    if callable(outputs):
        outputs = {"": outputs}
    elif not isinstance(outputs, Mapping):
        outputs = {name: name for name in ([outputs] if isinstance(outputs, str) else outputs)}
    out: dict[str, Any] = {}
    for label, output in outputs.items():
        options = output.keywords if isinstance(output, functools.partial) and not output.args else {}
        plain = output.func if isinstance(output, functools.partial) and not output.args else output
        if isinstance(output, str):
            out[label] = output
        elif plain is suspension and tells_suspensions(motion, options):
            out[label] = options
        else:
            return None
    return out


class Redesign:
    """The derivatives of solved poses by chosen components of the design.

    `at` are places of the components among those of `jaxnc.kinematics.redesign.components`.
    """

    def __init__(self, view: Plan, motion: Motion, at: np.ndarray):
        self.motion, self.count = motion, len(at)
        self.view = host.HostView(view, from_jax(derive(motion.system)))
        self.drawn = _changing(motion, at)
        poses: Any = motion.poses
        self.good = np.flatnonzero(np.asarray(motion.converged).reshape(-1))
        self.q = poses.reshape(-1, poses.shape[-1])[self.good].T

    def _chunks(self) -> Iterator[np.ndarray]:
        size = max(1, _CHUNK // (1 + self.count))
        for first in range(0, len(self.good), size):
            yield np.arange(first, min(first + size, len(self.good)))

    def assemblable(self) -> np.ndarray:
        """Whether some motion of the unknowns takes up a change of each variable, in every pose, ``(variables,)``."""
        exists = np.ones(self.count, bool)
        for lanes in self._chunks():
            size, rest = host.taken_up(self.view, self.drawn, self.q[:, lanes])
            least = SMALL * np.max(size, axis=1, initial=0.0, keepdims=True)
            exists &= (rest <= FITS * np.maximum(size, least)).all(axis=0)
        return exists

    def derivatives(self, wanted: Wanted) -> dict[str, np.ndarray]:
        """Derivatives of what is asked for by label, ``(*poses, ..., variables)``; zero where a pose was not found."""
        out: dict[str, np.ndarray] = {}
        for label, output in wanted.items():
            if isinstance(output, str):
                out[label] = self._of(within_pose, (self.motion.system.topology, output), (), (self.drawn.markers,))
            else:
                out |= {f"{label}.{name}" if label else name: x for name, x in self._suspension(output).items()}
        return out

    def _suspension(self, options: Mapping[str, Any]) -> dict[str, np.ndarray]:
        what, radius = asked_by(self.motion, options)
        names = tuple(name for name in NUMBERS if tells(what, name))
        still = np.zeros((1, 1 + self.count))
        still[0, 0] = 0.0 if radius is None else float(radius)
        fixed = (self.motion.system.topology, what, names, radius is None)
        found = self._of(in_one_pose, fixed, what.inputs, (self.drawn.home, self.drawn.markers, still[0]))
        by_name = {name: found[..., k, :] for k, name in enumerate(names) if name != "contact"}
        return by_name | {"contact": found[..., len(names) - 1 :, :]}

    def _of(self, f: Callable, fixed: tuple, inputs: tuple[str, ...], constants: tuple[np.ndarray, ...]) -> np.ndarray:
        """Derivatives of ``f(*fixed, pose and its derivatives by inputs, *constants)``."""
        shapes = ((len(self.q) * (1 + len(inputs)),), *(c.shape[:-1] for c in constants))
        (program, shape), lead = reading(f, fixed, shapes), self.motion.status.shape
        run, size = carrying(program), int(np.prod(shape, dtype=int))
        moved = [tangents(self.motion, {name: 1.0})[0].reshape(-1, len(self.q))[self.good].T for name in inputs]
        out = np.zeros((int(np.prod(lead, dtype=int)), size, self.count))
        given = [x[None] for c in constants for x in c.reshape(-1, 1 + self.count)]
        for lanes in self._chunks():
            q = self.q[:, lanes]
            parts = [host.changes(self.view, self.drawn, q)[0]]
            parts += [host.changes(self.view, self.drawn, q, (rate[:, lanes],))[1][0] for rate in moved]
            for k, value in enumerate(run([*(x for part in parts for x in part), *given])):
                out[self.good[lanes], k] = value[..., 1:]
        return out.reshape(*lead, *shape, self.count)


def _changing(motion: Motion, at: np.ndarray) -> Drawn:
    """What follows from the drawing, with its derivatives by the chosen components."""
    par = motion.system.parameters
    leaves = [np.asarray(x) for x in (par.points, par.vectors, par.markers, par.dimensions)]
    flat = np.zeros((sum(x.size for x in leaves), 1 + len(at)))
    flat[:, 0] = np.concatenate([x.reshape(-1) for x in leaves])
    flat[at, 1 + np.arange(len(at))] = 1.0
    ends = np.cumsum([x.size for x in leaves])[:-1]
    parts = [part.reshape(*x.shape, 1 + len(at)) for part, x in zip(np.split(flat, ends), leaves, strict=True)]
    points, vectors, markers, dimensions = parts
    with np.errstate(all="ignore"):
        return carry_design(motion.system.topology, points, vectors, markers, dimensions)
