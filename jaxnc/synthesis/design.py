"""`Design`: a mechanism that a search has found, judged from how it really moves, and written as a description."""

import copy
import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.kinematics.mobility import grashof_type
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.synthesis.conditions import (
    LEAST_TRANSMISSION,
    AnyTransmission,
    OnlyCircuit,
    Own,
    TransmissionAngle,
    is_four_bar,
)
from jaxnc.synthesis.evaluate import MEETS, MovedDesign, follow_again, meeting_sines, move_designs, violation
from jaxnc.synthesis.loops import four_bar_loop, link_lengths
from jaxnc.synthesis.problem import Problem
from jaxnc.system.identity import Owner, Thing
from jaxnc.system.precision import limits
from jaxnc.system.system import System
from jaxnc.types import Array, Numbers

if TYPE_CHECKING:
    from jaxnc.synthesis.search.basins import Basin
    from jaxnc.synthesis.search.sqp import End

NAMED = 4  # conditions that are named in a sentence
BLUNT = "has a transmission angle of"


def is_rounding(problem: Problem, error: float, dtype: np.dtype | type = np.float64) -> bool:
    """Return whether an error, in units of the target, is rounding of numbers as large as the target's.

    That of angles is at least rounding of a radian, however little they change. What has no target has no such size.
    """
    target = getattr(problem, "target", None)
    if target is None:
        return False
    size = max(problem.size, float(np.max(np.abs(target))), 1.0 if problem.unit == "rad" else 0.0)
    # 4096 units of rounding: no error that is smaller can be told from none
    return bool(error <= 4096 * float(np.finfo(dtype).eps) * size)


@public
@dataclasses.dataclass(frozen=True, eq=False)
class Design:
    """A design that was found.

    Attributes:
        system: the mechanism.
        motion: through the targets.
        turn: its motion over the range of the input; through the targets where there is no range.
        x: the unknowns, see `Problem.names`.
        error: what was made small: the sum of the squares of the errors (the largest error, of a minimax problem).
        rms: root of the mean of the squares of the errors without their weights, in units of the target.
        largest: the largest error without weights (of a pose with its angle as a length, see `MotionGeneration`).
        errors: at the targets, ``(targets, …)``, with their weights.
        inputs: values of the input at the targets.
        type: Grashof type of the four-bar loop at the input, "" if there is none.
        transmission: least angle at which the constraints of a loop meet over the range, or between the targets if the
            input does not go through the range, radians; NaN in space.
        turns: whether the input goes through its whole range.
        size: width and height (and depth) of the box around all points, the ground's too, over the range.
        lengths: of its links, by the names of two points: ``"B-C"``.
        defects: what is wrong with it, in words; empty if nothing.
        binding: conditions that it just meets, unknowns at their bounds: what may hold it back.
        converged: whether its refinement came to an end: no step of second order makes it better.
        optimality: what is left of the error's gradient along all directions that conditions and bounds leave, as a
            cosine; see `jaxnc.synthesis.search.sqp`.
        feasibility: the largest violation of a condition where the search looked, in parts of the problem's size.
        iterations: of second order at the end of its refinement.
        reason: why its refinement did not come to an end, in words.
        starts: how many of the starts that were followed to their ends ended in this design, or in its continuum.
        exact: whether the targets are met but for rounding.
        freedom: in how many directions an exact design can change and still meet the targets; 0 if it stands alone. Of
            such a continuum only the best design that was found is listed.
    """

    system: System
    motion: Motion
    turn: Motion
    x: np.ndarray
    error: float
    rms: float
    largest: float
    errors: np.ndarray
    inputs: np.ndarray
    type: str
    transmission: float
    turns: bool
    size: tuple[float, ...]
    lengths: dict[str, float]
    defects: tuple[str, ...]
    binding: tuple[str, ...]
    converged: bool
    optimality: float
    feasibility: float
    iterations: int
    reason: str
    starts: int
    exact: bool = False
    freedom: int = 0

    @property
    def rank(self) -> tuple[float, ...]:
        """Key by which designs are ordered: those without defects first, then by error.

        The errors of exact designs are rounding: they come first, by their transmission angle and then by their size.
        """
        defects = 1.0 if self.defects else 0.0
        if not self.exact:
            return (defects, self.error, 0.0, 0.0)
        return (defects, 0.0, -float(np.nan_to_num(self.transmission)), max(self.size, default=0.0))

    @property
    def shape_words(self) -> tuple[str, str, str]:
        """Type, transmission angle and size, as tables show them."""
        angle = "-" if np.isnan(self.transmission) else f"{np.degrees(self.transmission):.1f} deg"
        return self.type or "-", angle, " x ".join(f"{s:.3g}" for s in self.size)

    @property
    def ending(self) -> str:
        """How its refinement ended, in words."""
        end = "converged" if self.converged else self.reason
        return f"{end}, of a continuum" if self.freedom else end


# -- judged from its motions -------------------------------------------------------------------------------------------


def judge(problem: Problem, basins: Sequence["Basin"], ranked: bool = True) -> list[Design]:
    """Judge designs by how they move through their targets and their range; best first if `ranked`."""
    designs = [_judge_one(problem, follow_again(problem, v.one), v.end, v.starts) for v in basins]
    return sorted(designs, key=lambda d: d.rank) if ranked else designs


def largest_error(problem: Problem, one: MovedDesign) -> float:
    """The largest error of a design, with weights, in units of the target."""
    return float(_error_sizes(_read_numbers(problem, one).errors).max())


def shortfalls(problem: Problem, one: MovedDesign) -> dict[int, float]:
    """By how much a design that moves through the whole range misses inequalities over it, by their `id`."""
    if not np.asarray(one.turn.converged).all():
        return {}
    found = zip(problem.conditions, _read_numbers(problem, one).conditions, strict=True)
    least = {id(c): float(np.min(v, initial=0.0)) for c, v in found if c.over_range and not c.equality}
    return {key: -low for key, low in least.items() if low < -10 * MEETS}


def describe_nonfinite(problem: Problem, x: np.ndarray) -> str:
    """Name what of a design is not finite: errors, conditions by name, or derivatives."""
    told = _read_numbers(problem, move_designs(problem, [x[: problem.count]])[0])
    words = ["errors"] if not np.isfinite(told.errors).all() else []
    pairs = zip(problem.conditions, told.conditions, strict=True)
    names = [c.name for c, values in pairs if not np.isfinite(values).all()]
    words += ["conditions (" + ", ".join(dict.fromkeys(names)) + ")"] if names else []
    return " and ".join(words) or "derivatives of errors or conditions"


class _Numbers(NamedTuple):
    """Numbers that the problem's functions return of a design: errors with and without weights, orders, conditions."""

    errors: Any
    misses: Any
    own: Any
    conditions: Sequence[Numbers]


def _read_numbers(problem: Problem, one: MovedDesign) -> _Numbers:
    return jax.tree.map(np.asarray, _compiled_numbers(problem, one.x, one.motion, one.turn))


@jit
def _compiled_numbers(problem: Problem, x: Array, motion: Motion, turn: Motion) -> _Numbers:
    extra = problem.split(x)[1]
    errors, misses = problem.errors(motion, extra), problem.misses(motion, extra)
    return _Numbers(errors, misses, problem.own(extra), problem.condition_values(motion, turn))


def _error_sizes(errors: np.ndarray) -> np.ndarray:
    """The size of the error at each target."""
    return np.linalg.norm(errors.reshape(len(errors), -1), axis=1)


def _judge_one(problem: Problem, one: MovedDesign, end: "End", starts: int) -> Design:
    told = _read_numbers(problem, one)
    each, plain = _error_sizes(told.errors), _error_sizes(told.misses)
    moves, good = np.asarray(one.motion.converged), np.asarray(one.turn.converged)
    defects = []
    if not moves.all():
        defects.append(f"does not reach target {int(np.flatnonzero(~moves)[0]) + 1} on its branch")
    flat = moves & (np.asarray(one.motion.conditioning) <= limits(one.motion.q).singular)
    if flat.any() and not problem.at_rest:
        defects.append(f"is in a singular position at target {int(np.flatnonzero(flat)[0]) + 1}")
    if problem.turning and not good.all():
        defects.append("cannot go through its whole range")
    if (told.own < -MEETS).any():
        defects.append(problem.rule[1])
    for c, values in zip(problem.conditions, told.conditions, strict=True):
        far = violation(values, c.equality)
        if (far > 10 * MEETS).any() and not (c.over_range and not good.all() and defects):
            defects.append(f"misses {c.name} by {far.max():.2g}")
        if isinstance(c, OnlyCircuit) and good.all() and (wrong := c.defect(one.turn)):
            defects.append(wrong)
    in_space = problem.system.topology.dim == 3 and not problem.at_rest
    if in_space and moves.all() and not _is_followed(problem, one.motion):
        defects.append("is not followed to its targets by a sweep: assemblies meet on the way")
    top, loop, sharp, kind = problem.system.topology, four_bar_loop(problem.system, problem.driven), np.nan, ""
    spots = (*top.points, *(m.name for m in top.markers if not m.direction))
    seen = good if good.any() else np.arange(len(good)) < 1
    places = np.concatenate([np.asarray(one.turn[name])[seen] for name in spots])
    if loop is not None:
        a, b, c, g = (float(v) for v in loop.lengths(one.motion))
        kind = grashof_type(g, a, b, c).type
    if top.dim == 2 and not top.large and good.any():
        sharp = _least_sine(problem, one, moves, good)
    transmission = float(np.arcsin(np.clip(sharp, 0.0, 1.0)))
    stated = any(isinstance(c, (TransmissionAngle, AnyTransmission)) for c in problem.conditions)
    if transmission < LEAST_TRANSMISSION and not stated:
        least = np.degrees(LEAST_TRANSMISSION)
        defects.append(f"{BLUNT} {np.degrees(transmission):.3g} deg, below {least:.3g} deg")
    error = float(each.max() if problem.minimax else np.sum(each**2))
    if problem.at_rest:
        error, each, plain = end.square, np.array([end.square]), np.array([np.nan])
    return Design(
        system=one.motion.system,
        motion=one.motion,
        turn=one.turn,
        x=one.x,
        error=error,
        rms=float(np.sqrt(np.mean(plain**2))),
        largest=float(plain.max()),
        errors=each if problem.at_rest else told.errors,
        inputs=np.asarray(one.motion.inputs[problem.driven]),
        type=kind,
        transmission=transmission,
        turns=bool(good.all()),
        size=tuple(float(v) for v in np.ptp(places, axis=0)),
        lengths=link_lengths(one.motion),
        defects=tuple(defects),
        binding=tuple(_binding(problem, told, one)),
        converged=end.converged,
        optimality=end.optimality,
        feasibility=end.feasibility,
        iterations=end.iterations,
        reason=end.reason,
        starts=starts,
        exact=all(is_rounding(problem, float(np.sqrt(np.mean(e**2))), told.errors.dtype) for e in (told.errors, plain)),
    )


def _is_followed(problem: Problem, motion: Motion) -> bool:
    """Tell whether a sweep from the design's drawing comes to the same poses as the search did."""
    again, poses = problem.sweep(motion.system, np.asarray(motion.asked)[:, 0]), np.asarray(motion.poses)
    places = poses.shape[-1] - len(motion.system.topology.scalars)  # of angles whole turns do not count
    off = np.abs(np.asarray(again.poses) - poses)[:, :places].max()
    return bool(np.asarray(again.converged).all() and off <= 1e-6 * problem.length)


def _least_sine(problem: Problem, one: MovedDesign, moves: np.ndarray, good: np.ndarray) -> float:
    """Return the least sine at which constraints meet: over the range, or between the targets if that ends early."""
    loop = four_bar_loop(problem.system, problem.driven)
    if problem.whole and good.all() and loop is not None and is_four_bar(problem.system):
        return max(0.0, 1.0 - float(np.max(np.square(loop.extreme_cosines(one.turn))))) ** 0.5
    found = np.min(meeting_sines(problem, one.x, one.turn), axis=1)
    if good.all() or problem.at_rest:
        return float(np.min(found[good]))
    through = np.asarray(one.motion.inputs[problem.driven])[moves]
    if not len(through):
        return 1.0
    # The range ends early, on one side of the drawing: targets may lie on the other.
    fine = np.interp(np.linspace(0.0, len(through) - 1.0, 361), np.arange(len(through)), through)
    between = problem.sweep(one.motion.system, np.concatenate([through, fine]))
    sines = np.min(meeting_sines(problem, one.x, between), axis=1)
    return float(np.min(sines[np.asarray(between.converged)], initial=1.0))


def _binding(problem: Problem, told: _Numbers, one: MovedDesign) -> list[str]:
    """Conditions that are just met, and unknowns at a bound."""
    out = []
    close = 1e-3  # a condition that is met by less may hold a design back; of the size, where it is a length
    # Between the poses of the search, which are fewer, more is in doubt, by the square of their number.
    finer = (len(one.turn.status) / max(problem.poses, 1)) ** 2
    for c, values in zip(problem.conditions, told.conditions, strict=True):
        least = close + max(finer - 1.0, 0.0) * c.sag(one.turn) / problem.length
        if c.equality or (values.size and values.min() < least):
            out.append(c.name)
    if told.own.size and told.own.min() < close:
        out.append(problem.rule[0])
    near = close * problem.scale
    for name, v, low, high, e in zip(problem.names, one.x, problem.low, problem.high, near, strict=True):
        if v <= low + e or v >= high - e:
            out.append(f"the bound of {name}")
    return out


def worst_conditions(problem: Problem, x: np.ndarray) -> str:
    """The conditions that a design misses, worst first, and by how much, in words that say how that is counted."""
    told = _read_numbers(problem, follow_again(problem, move_designs(problem, [x])[0]))
    far = {problem.rule[0]: float(np.max(-told.own, initial=0.0))}
    for c, values in zip(problem.conditions, told.conditions, strict=True):
        far[c.name] = max(far.get(c.name, 0.0), float(np.max(violation(values, c.equality), initial=0.0)))
    worst = sorted((n for n in far if far[n] > MEETS), key=lambda n: -far[n])
    more = f" and {len(worst) - NAMED} more" if len(worst) > NAMED else ""
    own = {c.name: c.equality for c in problem.conditions if isinstance(c, Own)}
    counted = [] if {*worst} <= {*own} else ["of the size; of angles the sine"]
    if missed := [n for n in worst if n in own]:
        sign = "" if all(own[n] for n in missed) else ", which must not be negative"
        counted.append(f"of a condition of your own in its function's numbers{sign}")
    return ", ".join(f"{n} by {far[n]:.2g}" for n in worst[:NAMED]) + f"{more} ({'; '.join(counted)})" if worst else ""


# -- as a description --------------------------------------------------------------------------------------------------


def to_mechanism(mechanism: Mechanism, system: System) -> Mechanism:
    """The mechanism drawn with the numbers of a design, ready to be saved as a model file."""
    top, par = system.topology, system.parameters
    out = copy.copy(mechanism)
    out.model = copy.deepcopy(mechanism.model)
    model = out.model
    if set(top.points) != {*model.ground, *model.points} or [m.name for m in top.markers] != list(model.markers):
        raise InputError(f"{top.name!r} was not compiled from {mechanism!r}")
    points, vectors, markers = (map(tuple, np.asarray(a).tolist()) for a in (par.points, par.vectors, par.markers))
    for name, place in zip(top.points, points, strict=True):
        if name in model.ground:
            model.ground[name] = place
        else:
            old = model.points[name]
            model.points[name] = record.Point(place, old.fixed) if isinstance(old, record.Point) else place
    for name, place in zip(top.vectors, vectors, strict=True):
        (model.ground_vectors if name in model.ground_vectors else model.vectors)[name] = place
    for marker, place in zip(top.markers, markers, strict=True):
        form = "direction" if marker.direction else "at"
        model.markers[marker.name] = record.Marker(model.markers[marker.name].on, **{form: place})
    for dimension, value in zip(top.given, np.asarray(par.dimensions), strict=True):
        _set_dimension(model, dimension.owner, dimension.key, float(value))
    return out


def _set_dimension(model: record.Model, owner: Owner, key: str, value: float) -> None:
    """Put an explicit dimension where the description has it."""
    if owner.thing is Thing.BODY:
        body = list(model.bodies.values())[owner.number]
        assert isinstance(body, record.Body)
        if key in body.lengths:
            body.lengths[key] = value
            return
        point, _, axis = key.rpartition(".")
        place = list(body.local[point])
        place[("along", "across", "normal").index(axis)] = value
        body.local[point] = tuple(place)
    elif owner.thing is Thing.JOINT:
        joint: Any = list(model.joints.values())[owner.number]
        if key in ("radius1", "radius2"):
            radii = list(joint.radii)
            radii[int(key[-1]) - 1] = value
            joint.radii = tuple(radii)
        else:
            setattr(joint, key, value)
    elif owner.thing is Thing.RELATION:
        relation = list(model.relations.values())[owner.number]
        if key in relation.terms:
            relation.terms[key] = value
        else:
            relation.constant = value
    else:
        list(model.constraints.values())[owner.number].constants[key] = value
