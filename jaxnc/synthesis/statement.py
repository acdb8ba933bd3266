"""The part of a problem's statement that all kinds share: names, bounds and conditions, checked and completed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.kinematics.design import geometry_components, geometry_vector
from jaxnc.kinematics.inputs import check_system
from jaxnc.kinematics.position import sweep
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.plan import plan
from jaxnc.synthesis.conditions import LARGE, Condition, Equal, Length, Links, Own, Size
from jaxnc.synthesis.evaluate import move_designs
from jaxnc.synthesis.loops import four_bar_loop, ground_points, links
from jaxnc.synthesis.problem import Extras, Problem, Variables, home_value
from jaxnc.synthesis.validate import as_interval, as_names, check_name, check_radians
from jaxnc.system.system import System, characteristic_length, drivable


def check_lengths(what: str, system: System, driven: str, conditions: Sequence[Condition]) -> None:
    """See that bounds of lengths leave something: each length by itself, and the loop at the input."""
    box: dict[frozenset[str], tuple[float, float]] = {}
    for c in conditions:
        if isinstance(c, Length):
            pair = frozenset((c.start, c.end))
            low, high = box.get(pair, (0.0, np.inf))
            box[pair] = low, high = max(low, c.low), min(high, c.high)
            if not low <= high:
                raise InputError(f"{what}: length {c.start}-{c.end} is to be at least {low:g} and at most {high:g}; "
                                 f"these conditions contradict each other")  # fmt: skip
    loop = four_bar_loop(system, driven)
    names = loop.names(system) if loop is not None else ()
    bars = [
        (a, b, *box.get(frozenset((a, b)), (0.0, np.inf))) for a, b in zip(names, names[1:] + names[:1], strict=True)
    ]
    for a, b, low, _ in bars:
        rest = [bar for bar in bars if bar[:2] != (a, b)]
        most = sum(bar[3] for bar in rest)
        if low > most:
            raise InputError(
                f"{what}: the bounds exclude every assembly: {a}-{b} is at least {low:g}, and the other sides of the "
                f"loop, {', '.join(f'{c}-{d}' for c, d, *_ in rest)}, are at most {most:g} together"
            )


def compile_idea(what: str, mechanism: Mechanism | System) -> System:
    """The starting idea, compiled."""
    system = mechanism.compile() if isinstance(mechanism, Mechanism) else mechanism
    check_system(system, what)
    return system


def check_spans(what: str, system: System, driven: str, hold: Sequence[str], conditions: Sequence[Condition]) -> None:
    """See that lengths are lengths: distances that do not change as the mechanism moves."""
    top = system.topology
    bodies = {body.name: [top.points[i] for i in body.points] for body in top.bodies}
    bodies["ground"] = [top.points[i] for i in sorted(ground_points(system))]
    for marker in top.markers:
        bodies.setdefault(marker.body, []).append(marker.name)
    motion = None
    for c in conditions:
        for a, b in c.spans:
            if any(a in names and b in names for names in bodies.values()):
                continue
            if motion is None:
                step = 0.05 * (  # radians, or parts of the size: an input is moved to see which distances stay
                    1.0 if driven in top.scalars else float(characteristic_length(system.parameters.points))
                )
                home = float(home_value(system, driven))
                motion = sweep(system, {driven: home + step * np.linspace(0.0, 1.0, 3)}, hold=hold, repair=False)
            far = np.linalg.norm(np.asarray(motion[a]) - np.asarray(motion[b]), axis=1)[np.asarray(motion.converged)]
            if np.ptp(far) > 1e-7 * np.max(far) if len(far) else False:  # 1e-7 of a distance: less is no change
                shown = ", ".join(f"{name} {'-'.join(names)}" for name, names in bodies.items() if len(names) > 1)
                raise InputError(
                    f"{what}: {c.name}: {a} and {b} are not on one body, and their distance is no length of the design "
                    f"but changes as it moves; the bodies are {shown}. For a distance in some pose write a "
                    f"condition(…) of your own"
                )


def complete(problem: Problem, **fields: object) -> None:
    """Give a problem fields of its own kind; refuse a user's conditions that are not finite for the starting idea."""
    vars(problem).update(fields)
    if not problem.at_rest:
        vars(problem).update(conditions=(*problem.conditions, *_link_limits(problem)))
    if not any(isinstance(c, Own) for c in problem.conditions):
        return
    one = move_designs(problem, [problem.start])[0]
    for c, values in zip(problem.conditions, _compiled_met(problem, one.motion, one.turn), strict=True):
        reached = np.asarray((one.turn if c.over_range else one.motion).converged).all()
        bad = ~np.isfinite(np.asarray(values))
        if isinstance(c, Own) and reached and bad.any():
            raise InputError(
                f"{problem.name}: condition {c.name!r} is not finite for the starting idea ({int(bad.sum())} of its "
                f"{bad.size} numbers, the first of them number {int(np.argmax(bad)) + 1}); keep its divisions, roots "
                f"and logarithms away from where they are not defined"
            )


def _link_limits(problem: Problem) -> list[Condition]:
    """The condition that no link is many times as long as the target is wide, of links that no wish of the user names.

    A link that is longer in the idea may be as long as it is there.
    """
    system, var, wishes = problem.system, problem.variables, problem.conditions
    if any(isinstance(c, Size) for c in wishes):
        return []
    top, par = system.topology, system.parameters
    at = {n: np.asarray(p) for n, p in zip(top.points, par.points, strict=True)}
    at |= {m.name: np.asarray(p) for m, p in zip(top.markers, par.markers, strict=True) if not m.direction}
    first = {body.name: top.points[body.points[0]] for body in top.bodies if body.points}
    pairs = [(top.points[i], top.points[j]) for i, j in links(system)]
    pairs += [(first[m.body], m.name) for m in top.markers if not m.direction and m.body in first]
    asked = [v for c in wishes if isinstance(c, Length) for v in (c.low, c.high) if np.isfinite(v)]
    asked += [float(c.second) for c in wishes if isinstance(c, Equal) and not isinstance(c.second, tuple)]
    most = max(LARGE * problem.length, *asked) if asked else LARGE * problem.length
    named = {frozenset(pair) for c in wishes for pair in c.spans}
    given = {frozenset(name.rpartition(".")[2].split("-")): name for name in top.dimensions}
    # Components that are free, with whether they are bounded.
    free = {n: bool(np.isfinite([a, b]).all()) for n, a, b in zip(var.names, var.low, var.high, strict=True)}
    home = dict(zip(var.names, var.home, strict=True))
    out = {}
    for pair in pairs:
        ends = [free[f"{name}.{axis}"] for name in pair for axis in "xyz" if f"{name}.{axis}" in free]
        length = given.get(frozenset(pair))
        if length is not None:
            ends = [free[length]] if length in free else []
        if frozenset(pair) not in named and not all(ends):
            drawn = float(np.linalg.norm(at[pair[0]] - at[pair[1]])) if length is None else float(home[length])
            out[pair] = max(most, drawn)
    return [Links(tuple(out), tuple(out.values()))] if out else []


_compiled_met = jit(Problem.condition_values)


def choose_variables(
    what: str, system: System, free: Sequence[str] | None, bounds: Mapping[str, Sequence]
) -> Variables:
    """Choose design variables.

    Names are of points, vectors, markers, explicit dimensions or single components such as ``"D.x"``, all if none are
    given. Bounds ``(low, high)`` are None for none; of a point one pair for each axis, or one pair for all.
    """
    every = geometry_components(system)
    known = [*dict.fromkeys(n for n, _, _ in every), *(c for n, c, _ in every if c != n)]
    chosen = range(len(every))
    if free is not None:
        free = as_names(free, f"{what}: free=")
        if not free:
            raise InputError(f"{what}: free=() leaves nothing to design; name variables, or leave it out for all")
        for name in free:
            check_name(name, known, f"{what}: {system.name!r} has no design variable {name!r}")
        chosen = [k for k, (name, part, _) in enumerate(every) if name in free or part in free]
    at = np.array(list(chosen), dtype=int)
    names = tuple(every[k][1] for k in at)
    home = np.asarray(geometry_vector(system), dtype=float)[at]
    size = float(characteristic_length(system.parameters.points))
    drawn = len(every) - len(system.topology.dimensions)
    scale = np.where(at < drawn, size, np.maximum(np.abs(home), 1e-3 * size))
    scale = np.where([k < drawn and every[k][2] == "rad" for k in at], 1.0, scale)  # unit vectors have no size
    low, high = np.full(len(at), -np.inf), np.full(len(at), np.inf)
    for name, pair in bounds.items():
        places = [i for i, k in enumerate(at) if name in every[k][:2]]
        if not places:
            check_name(name, known, f"{what}: bounds for {name!r}, which is no design variable")
            raise InputError(f"{what}: bounds for {name!r}, which is not free; add it to free=")
        each = [pair] * len(places)
        if len(places) > 1 and _is_row(pair) and any(_is_row(p) for p in pair):
            if len(pair) != len(places):
                raise InputError(
                    f"{what}: bounds of {name!r} are {len(pair)} pairs for {len(places)} components that are free, "
                    f"{', '.join(every[at[i]][1] for i in places)}; give one pair for each, or one for all"
                )
            each = list(pair)
        for i, one in zip(places, each, strict=True):
            low[i], high[i] = as_interval(one, f"{what}: bounds of {names[i]!r}")
    return Variables(names, at, home, scale, low, high, free is not None)


def _is_row(value: Any) -> bool:
    """Tell whether a value is a list or array; of an uneven list NumPy makes no array."""
    return isinstance(value, list | tuple) or np.ndim(value) > 0


def set_up(
    problem: Problem,
    what: str,
    mechanism: Mechanism | System,
    driven: str | None,
    free: Sequence[str] | None,
    bounds: Mapping[str, object] | None,
    subject_to: Sequence[Condition] | Condition,
    hold: Sequence[str],
    travel: tuple[float, float] | None = None,
    table: np.ndarray | None = None,
) -> None:
    """Give a problem the fields that all kinds have, checked; a `table` has values of the input in order."""
    description = mechanism if isinstance(mechanism, Mechanism) else None
    system = compile_idea(what, mechanism)
    top = system.topology
    if driven is None:
        named = description.model.run.inputs if description is not None else {}
        names = list(named) or [s for s in top.scalars]
        if len(names) != 1:
            raise InputError(
                f"{what}: say which coordinate is driven: input=, one of {', '.join(drivable(system.topology))}"
            )
        (driven,) = names
    check_name(driven, drivable(top), f"{what}: {top.name!r} has no coordinate {driven!r} to drive")
    hold = (hold,) if isinstance(hold, str) else tuple(hold)
    plan(top, (driven,), hold, system.degrees_of_freedom)
    if bounds is not None and not isinstance(bounds, Mapping):
        raise InputError(f"{what}: bounds= takes a dict such as {{'A-B': (0, 2), 'C.x': (1, None)}}, got {bounds!r}")
    lengths, box = [], {}
    for name, pair in (bounds or {}).items():
        start, dash, end = name.partition("-")
        if dash and name not in top.dimensions and start in top.points and end in top.points:
            low, high = as_interval(pair, f"{what}: bounds of {name!r}")
            lengths.append(Length(start, end, low, high))
        else:
            box[name] = pair
    variables = choose_variables(what, system, free, box)
    wanted = (subject_to,) if isinstance(subject_to, Condition) else subject_to
    if not isinstance(wanted, Sequence) or isinstance(wanted, str):
        raise InputError(f"{what}: subject_to= takes a list of conditions such as crank_turns(), got {wanted!r}")
    for c in wanted:
        if not isinstance(c, Condition):
            raise InputError(f"{what}: subject_to= takes conditions such as crank_turns(), got {c!r}")
    conditions = tuple(c.prepare(system, driven) for c in (*wanted, *lengths))
    check_spans(what, system, driven, hold, conditions)
    check_lengths(what, system, driven, conditions)
    turning = driven in top.scalars and bool(top.periodic[top.scalars.index(driven)])
    dense = False
    if table is not None:
        travel, steps = (float(np.min(table)), float(np.max(table))), np.diff(table)
        dense = bool((steps > 0).all() or (steps < 0).all())
    elif travel is None:
        home = float(home_value(system, driven))
        travel = (home, home + 2 * np.pi) if turning else (home, home)
        if not turning and any(c.over_range for c in conditions):
            raise InputError(f"{what}: say over which range {driven!r} moves: travel=(low, high)")
    else:
        travel = as_interval(travel, f"{what}: travel")
        if top.is_angle(driven):
            # An input that travels further is doubted to be in radians.
            check_radians(np.array(travel), f"{what}: travel", 40 * np.pi, "state fewer turns")
    whole = bool(np.isclose(travel[1] - travel[0], 2 * np.pi))
    conditions = tuple(c.over_turn(system, driven) for c in conditions) if whole else conditions
    vars(problem).update(
        system=system,
        driven=driven,
        variables=variables,
        extras=Extras(),
        conditions=conditions,
        hold=hold,
        travel=travel,
        whole=whole,
        size=1.0,
        length=float(characteristic_length(system.parameters.points)),
        minimax=False,
        dense=dense,
        mechanism=description,
    )
