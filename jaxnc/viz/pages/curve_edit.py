"""A curve that is dragged: the smallest change of the dimensions by which a point comes to lie elsewhere."""

from collections.abc import Mapping, Sequence

import numpy as np

from jaxnc.errors import InputError, JaxncError
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.sensitivity import Sensitivity, sensitivity
from jaxnc.system.system import System, characteristic_length

_STEPS = 3  # of Gauss and Newton; a drag asks again
_LONGEST = 0.15  # of the mechanism's size, one step
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)  # of the way, until no pose is lost


def edit_curve(
    motion: Motion,
    system: System,
    point: str,
    place: Sequence[float],
    inputs: Mapping[str, float],
    free: Sequence[str] | None = None,
) -> System:
    """Change the dimensions so that a point of the curve comes nearer to a place.

    Of all changes that do it, the one is taken that is least in the drawing and in the rest of the curve, by exact
    derivatives. Steps that lose poses of the motion are shortened.

    The motion's inputs say what poses there are; the point should be at the place, ``(dim,)``, at the `inputs`. The
    design variables that are `free` may change; if not given, all points, markers and dimensions.

    Returns:
        The new design; the same object, if the point can come no nearer.
    """
    goal = np.asarray(place, float)
    if goal.shape != (system.topology.dim,) or not np.isfinite(goal).all():
        raise InputError(f"pull: a place of {point!r} is {system.topology.dim} finite numbers, got {place!r}")
    asked = np.asarray(motion.asked, float).reshape(-1, len(motion.driven))
    count = 8  # poses at which the curve had rather stay where it is
    some = np.linspace(0, len(asked) - 1, count + 1).astype(int)[:-1] if len(asked) > count else np.arange(len(asked))
    rows = asked[some] if len(asked) > 1 else asked[:0]
    here = np.array([[float(inputs[name]) for name in motion.driven]])
    size = float(characteristic_length(system.parameters.points))

    one, every = dict(inputs), dict(zip(motion.driven, np.concatenate([here, rows]).T, strict=True))

    def pose_of(design: System) -> Motion:
        return solve_position(design, one, hold=motion.held, throw=True)

    def led(design: System, pose: Motion, slopes: Sensitivity, aim: np.ndarray) -> System:
        """Lead the point of a design as near to a place as a few steps do, whatever becomes of the other poses."""
        by = slopes[point]
        for turn in range(_STEPS):
            left = aim - np.asarray(pose[point])
            gap = float(np.linalg.norm(left))
            if not gap > 1e-9 * size:
                break
            if turn:  # the slopes of the beginning are good enough for the rest of the curve
                by = np.concatenate([sensitivity(pose, point, variables=free, throw=False)[point][None], by[1:]])
            step = _step(by, lengths, left * min(1.0, _LONGEST * size / gap))
            try:
                trial = _apply_step(design, slopes.variables, step)
                there = pose_of(trial)
            except JaxncError:  # a length would not be positive, or the design or its drawing does not assemble
                break
            if not np.linalg.norm(aim - np.asarray(there[point])) < gap:
                break
            design, pose = trial, there
        return design

    found, kept, share = pose_of(system), None, 0.0
    for _ in range(_STEPS):
        start = np.asarray(found[point])
        far = float(np.linalg.norm(goal - start))
        if share == 1.0 or not far > 1e-9 * size:
            break
        kept = solve_position(system, every, hold=motion.held, throw=False) if kept is None else kept
        slopes = sensitivity(kept, point, variables=free, throw=False)
        lengths = np.array([1.0 if unit == system.topology.length_unit else size for unit in slopes.variable_units])
        if not np.any(np.abs(slopes[point][0]) > 1e-9 * lengths):  # slopes that are rounding
            raise InputError(f"pull: no dimension of {system.name!r} moves {point!r}{_alone(slopes.exists)}")
        for share in _SHARES:
            whole = min(1.0, _STEPS * _LONGEST * size / far)
            design = led(system, found, slopes, start + share * whole * (goal - start))
            if design is system:
                continue
            there = solve_position(design, every, hold=motion.held, throw=False)
            right = np.asarray(there.converged)[np.asarray(kept.converged)].all()
            if right and np.linalg.norm(goal - np.asarray(there[point])[0]) < far:
                system, found, kept = design, there.pose(0), there
                break
        else:
            break
    return system


def _step(slopes: np.ndarray, lengths: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Find the least change of the variables that moves the first pose's point by `left`.

    `slopes` are those of the points, ``(poses, dim, variables)``; `lengths` say what a unit of a variable counts for.
    """
    first, rest = slopes[0] / lengths, (slopes[1:] / lengths).reshape(-1, len(lengths))
    # A square length there weighs three tenths of a square length of the dimensions.
    stiff = np.eye(len(lengths)) + 0.3 * rest.T @ rest
    soft = np.linalg.solve(stiff, first.T)
    block = first @ soft
    # A direction in which the point hardly moves is left alone.
    return soft @ np.linalg.solve(block + 1e-4 * np.trace(block) * np.eye(len(block)), left) / lengths


def _alone(exists: np.ndarray) -> str:
    """Explain what hinders, where some variables cannot change by themselves."""
    if exists.all():
        return ""
    if not exists.any():
        return ": none of its dimensions can change alone and let it assemble"
    return (
        f": {np.sum(~exists)} of {len(exists)} cannot change alone and let it assemble, and the others do not move it"
    )


def _apply_step(system: System, variables: Sequence[str], step: np.ndarray) -> System:
    """Change design variables of a system, by component."""
    values: dict[str, np.ndarray] = {}
    for name, by in zip(variables, step, strict=True):
        part, dot, axis = name.rpartition(".")
        whole = part if dot and axis in ("x", "y", "z") and name not in system.design_variables else name
        value = values.setdefault(whole, np.array(system[whole], float))
        value[("xyz".index(axis),) if whole != name else ()] += by
    return system.replace(values)
