"""A curve that is dragged: the smallest change of the dimensions by which a point comes to lie elsewhere."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jaxnc.errors import InputError, JaxncError
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.sensitivity import sensitivity
from jaxnc.system.system import System, characteristic_length

_STEPS = 3  # of Gauss and Newton; a drag asks again
_LONGEST = 0.15  # of the mechanism's size, one step
_KEPT = 8  # poses at which the curve had rather stay where it is
_ROUNDING = 1e-9  # slopes as small are none
_STIFF = 0.3  # weight of a square length there, beside one of the dimensions


def pulled(
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

    Args:
        motion: the motion whose curve it is; its inputs say what poses there are.
        system: the design as it is.
        point: name of the point or marker.
        place: where it should be, ``(dim,)``, lengths.
        inputs: the inputs at which it should be there.
        free: names of the design variables that may change; all points, markers and dimensions if not given.

    Returns:
        The new design; the same object, if the point can come no nearer.

    Raises:
        InputError: unknown names, a place of the wrong shape, a point that no dimension moves.
        AssemblyError: the design has no pose at these inputs.
    """
    goal = np.asarray(place, float)
    if goal.shape != (system.topology.dim,) or not np.isfinite(goal).all():
        raise InputError(f"pull: a place of {point!r} is {system.topology.dim} finite numbers, got {place!r}")
    asked = np.asarray(motion.asked, float).reshape(-1, len(motion.driven))
    rows = asked[np.unique(np.linspace(0, len(asked) - 1, _KEPT + 1).astype(int)[:-1])] if len(asked) > 1 else asked[:0]
    here = np.array([[float(inputs[name]) for name in motion.driven]])
    values = dict(zip(motion.driven, np.concatenate([here, rows]).T, strict=True))
    size = float(characteristic_length(system.parameters.points))

    def solved(design: System) -> Motion:
        one = {name: float(x[0]) for name, x in values.items()}
        solve_position(design, one, hold=motion.held, throw=True)  # this one decides, the others take longer
        return solve_position(design, values, hold=motion.held, throw=False)

    found = solved(system)
    for _ in range(_STEPS):
        left = goal - np.asarray(found[point])[0]
        far = float(np.linalg.norm(left))
        if not far > 1e-9 * size:
            break
        slopes = sensitivity(found, point, variables=free, throw=False)
        lengths = np.array([1.0 if unit == system.topology.length_unit else size for unit in slopes.variable_units])
        if not np.any(np.abs(slopes[point][0]) > _ROUNDING * lengths):
            raise InputError(f"pull: no dimension of {system.name!r} moves {point!r}{_alone(slopes.exists)}")
        step = _step(slopes[point], lengths, left * min(1.0, _LONGEST * size / far))
        good, better = np.asarray(found.converged), None
        for share in (1.0, 0.5, 0.25, 0.1):
            trial = _moved(system, slopes.variables, share * step)
            there = None if trial is None else _found(solved, trial)
            if trial is None or there is None or not np.asarray(there.converged)[good].all():
                continue
            if np.linalg.norm(goal - np.asarray(there[point])[0]) < far:
                better = trial, there
                break
        if better is None:
            break
        system, found = better
    return system


def _step(slopes: np.ndarray, lengths: np.ndarray, left: np.ndarray) -> np.ndarray:
    """The least change of the variables that moves the first pose's point by `left`.

    `slopes` are those of the points, ``(poses, dim, variables)``; `lengths` say what a unit of a variable counts for.
    """
    first, rest = slopes[0] / lengths, (slopes[1:] / lengths).reshape(-1, len(lengths))
    stiff = np.eye(len(lengths)) + _STIFF * rest.T @ rest
    soft = np.linalg.solve(stiff, first.T)
    block = first @ soft
    # A direction in which the point hardly moves is left alone.
    return soft @ np.linalg.solve(block + 1e-4 * np.trace(block) * np.eye(len(block)), left) / lengths


def _alone(exists: np.ndarray) -> str:
    """What hinders, where some variables cannot change by themselves."""
    if exists.all():
        return ""
    if not exists.any():
        return ": none of its dimensions can change alone and let it assemble"
    return (
        f": {np.sum(~exists)} of {len(exists)} cannot change alone and let it assemble, and the others do not move it"
    )


def _moved(system: System, variables: Sequence[str], step: np.ndarray) -> System | None:
    """A system whose design variables, by component, are changed; None where a length would not be positive."""
    values: dict[str, np.ndarray] = {}
    for name, by in zip(variables, step, strict=True):
        part, dot, axis = name.rpartition(".")
        whole = part if dot and axis in ("x", "y", "z") and name not in system.design_variables else name
        value = values.setdefault(whole, np.array(system[whole], float))
        value[("xyz".index(axis),) if whole != name else ()] += by
    try:
        return system.replace(values)
    except InputError:
        return None


def _found(solved: Callable[[System], Motion], trial: System) -> Motion | None:
    """The poses of a design, None if its drawing does not assemble."""
    try:
        return solved(trial)
    except JaxncError:
        return None
