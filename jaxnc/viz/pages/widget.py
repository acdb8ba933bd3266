"""A mechanism in a notebook: the page as a widget, from which drags come back as a system, with exact values.

Where a curve is dragged, it finds the smallest change of the dimensions by which a point comes to lie elsewhere.
"""

import functools
import json
import re
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import AssemblyError, InputError, JaxncError
from jaxnc.kinematics.motion import Motion, drawn_motion
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.sensitivity import Outputs, Sensitivity, sensitivity
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.assembly import derive, settle
from jaxnc.synthesis.tracing.trace import space_evenly
from jaxnc.system.host import from_jax
from jaxnc.system.system import System, characteristic_length
from jaxnc.types import Inputs
from jaxnc.validate import as_array
from jaxnc.viz.pages.content import fill_template, page_part
from jaxnc.viz.pages.page import page_colours, page_parts
from jaxnc.viz.poses import default_motion
from jaxnc.viz.svg import draw_pixels

if TYPE_CHECKING:
    from jaxnc.synthesis.path import PathGeneration


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


# -- the widget --------------------------------------------------------------------------------------------------------


_PYTHON = "python"  # sender of a message; a page has a name of its own
_NUMBERS = ("c", "k", "d")  # of equations, markers, explicit dimensions


@public
def widget(
    thing: Mechanism | System | Motion,
    inputs: Inputs | None = None,
    trace: str | Iterable[str] = (),
    watch: Sequence[str] | None = None,
    free: Sequence[str] | None = None,
    title: str | None = None,
    **options: Any,
) -> "Widget":
    """Show a mechanism in a notebook, to be dragged: the page of `Motion.to_html`, and Python has what is done there.

    Args:
        thing: a mechanism, a system, or a motion.
        inputs: values of each driven coordinate over the motion; if not given those of the model's run section, or the
            whole range of a coordinate from which the others follow; of several freedoms the pose that is drawn.
        trace: points and markers whose curve is drawn at first; such a curve can be dragged.
        watch: names whose values `Widget.values` holds; inputs, angles, distances and traced points if not given.
        free: design variables that may change when a curve is dragged; all if not given.
        title: heading; the mechanism's name if not given.
        **options: `velocities`, `accelerations`, `fps`, `view`, `unit` as `Motion.to_html` takes them; `rates`, `hold`
            as `jaxnc.sweep` does.

    Returns:
        The widget, which a notebook shows; see `Widget`.

    Raises:
        InputError: unknown names, a thing that is none of these.
        JaxncError: anywidget is not installed: ``pip install "jaxnc[widget]"``.
    """
    made = _class()
    driving = {name: options.pop(name) for name in ("rates", "hold") if name in options}
    motion = default_motion(thing, inputs, driving)
    if np.ndim(motion.status) > 1:
        raise InputError(f"widget: {motion.system.name!r} has a batch of motions; index one")
    trace = (trace,) if isinstance(trace, str) else tuple(trace)
    look: dict[str, object] = {"velocities": (), "accelerations": (), "fps": 25.0, "view": None, "unit": None}
    unknown = [name for name in options if name not in look]
    if unknown:
        raise InputError(f"widget: no option {unknown[0]!r}; there are {', '.join([*look, 'rates', 'hold'])}")
    model = thing if isinstance(thing, Mechanism) else None
    parts = page_parts(motion, trace, title=title, model=model, scripted=True, **{**look, **options})
    return made(motion, _module(parts), bool(parts["LIVE"]), trace, watch, free)


@public
class Widget:
    """A mechanism shown in a notebook. Its traits can be watched: ``w.observe(f, names=["system", "inputs"])``.

    Attributes:
        system: the design as it is now. Assigned (a `System` of the same mechanism), the picture follows.
        inputs: values of the driven coordinates by name, radians and lengths. Assigned, the picture follows.
        target: a curve drawn by hand (*target* in the widget), ``(n, 2)``, lengths; None if there is none. Assigned, it
            is drawn, and closed if it ends where it begins.
    """

    system: System
    inputs: dict[str, float]
    target: Any
    _now: dict[str, object]
    _target: dict[str, object]
    hold_trait_notifications: Callable[[], Any]

    def __init__(
        self,
        motion: Motion,
        module: str,
        live: bool,
        trace: tuple[str, ...],
        watch: Sequence[str] | None,
        free: Sequence[str] | None,
    ):
        self._motion, self._live, self._trace, self._free = motion, live, trace, free
        self._asked = np.asarray(motion.asked, float).reshape(-1, len(motion.driven))
        names = (*motion.driven, *motion.system.topology.scalars, *trace)
        self._watch = tuple(dict.fromkeys(names)) if watch is None else (watch,) if isinstance(watch, str) else watch
        for name in self._watch:
            motion[name]  # an unknown name is refused here
        for name in free or ():
            motion.system[name]
        good = np.flatnonzero(np.asarray(motion.converged).reshape(-1))
        first = int(good[0]) if len(good) else 0
        self._first, self._count, self._closed = motion.system, 0, False
        self._numbers = self._original = _numbers_of(motion.system) if live else {}
        self._hearing = True  # traits are assigned without a message to the page
        self._lock = threading.RLock()  # JupyterLab tells what is dragged in a thread beside the cells
        self._esm = module
        super().__init__()
        self.system, self.inputs = motion.system, self._name_inputs(self._asked[first])
        self._known = self.system, self.inputs, motion.pose(first) if motion.status.shape else motion
        self._hearing = False

    def __repr__(self) -> str:
        at = ", ".join(f"{name} = {value:.6g}" for name, value in self.inputs.items())
        return f"<Widget of {self.system.name!r} at {at or 'the pose that is drawn'}>"

    @property
    def pose(self) -> Motion:
        """The pose that is shown, as the library finds it."""
        with self._lock:
            system, inputs, found = self._known
            if system is not self.system or inputs != self.inputs:
                found = self._find_pose(self.system, self.inputs)
            elif not isinstance(found, Motion):  # the page's coordinates, beside which the library finds its pose
                found = self._find_pose(self.system, self.inputs, found)
            self._known = self.system, self.inputs, found
            return found

    @property
    def values(self) -> dict[str, object]:
        """Values of what is watched, exact at the pose that is shown: numbers, and places ``(dim,)``, by name."""
        pose = self.pose
        found = {name: np.asarray(pose[name]) for name in self._watch}
        return {name: x if x.ndim else float(x) for name, x in found.items()}

    def gradient(self, outputs: Outputs | None = None, variables: Sequence[str] | None = None) -> Sensitivity:
        """Find exact derivatives of what is watched with respect to the design, at the pose that is shown.

        Args:
            outputs: as `jaxnc.sensitivity` takes them; what is watched, if not given.
            variables: names of the design variables; all if not given.

        Returns:
            The derivatives, ``found["C.y"]`` and ``found["C.y", "B.x"]``; printed they are a table.

        Raises:
            InputError: unknown names.
            AssemblyError: there is no such pose.
        """
        return sensitivity(self.pose, self._watch if outputs is None else outputs, variables=variables, throw=False)

    def pull(self, point: str, place: Sequence[float], inputs: Mapping[str, float] | None = None) -> System:
        """Drag a curve: change the dimensions, as little as possible, so that a point comes nearer to a place.

        Args:
            point: name of the point or marker whose curve it is.
            place: where it should be, ``(dim,)``, lengths.
            inputs: the inputs at which it should be there; those of the pose that is shown, if not given.

        Returns:
            The new design, which is also `system`; unchanged, if the point can come no nearer.

        Raises:
            InputError: unknown names, a widget that does not calculate.
            AssemblyError: there is no pose at these inputs.
        """
        return self._pulled_to(point, place, inputs)

    def problem(self, point: str | None = None, **options: Any) -> "PathGeneration":
        """Set up the search for designs whose point follows the curve that was drawn.

        ``w.system = nc.synthesis.solve(w.problem("C")).best`` shows the best of them.

        Args:
            point: name of the point or marker; the first one that is traced, if not given.
            **options: of `jaxnc.synthesis.PathGeneration`.

        Raises:
            InputError: no target, no point, and what `PathGeneration` refuses.
        """
        from jaxnc.synthesis.path import PathGeneration

        if self.target is None:
            raise InputError("problem: there is no target; draw one in the widget (target), or assign w.target")
        if point is None and not self._trace:
            raise InputError("problem: say which point follows the target: w.problem('C')")
        known = {"closed": self._closed, "input": self._motion.driven[0] if len(self._motion.driven) == 1 else None}
        return PathGeneration(self.system, point or self._trace[0], self.target, **{**known, **options})

    def _stored_picture(self) -> str:
        """Draw what is shown as a PNG, for where the notebook is read and no kernel runs: the nearest pose, and curves.

        Empty where that cannot be drawn.
        """
        motion = self._motion
        try:
            if self.system is not self._first:
                every = dict(zip(motion.driven, self._asked.T, strict=True))
                motion = solve_position(self.system, every, hold=motion.held, throw=False)
            here = np.array([self.inputs[name] for name in motion.driven])
            far = np.linalg.norm(self._asked - here, axis=1)
            good = np.asarray(motion.converged).reshape(-1)
            return draw_pixels(motion, int(np.argmin(np.where(good, far, np.inf))), self._trace)
        except JaxncError:
            return ""

    # -- what Python assigns, and what the page tells ------------------------------------------------------------------

    def _pulled_to(self, point: str, place: Sequence[float], inputs: object, **more: Any) -> System:
        if not self._live:
            raise InputError(f"pull: {self._first.name!r} is shown as it is; below it says why")
        inputs = self._check_inputs(self.inputs if inputs is None else inputs)
        found = edit_curve(self._motion, self.system, point, place, inputs, self._free)
        self._assign(found, inputs, self._find_pose(found, inputs))
        self._numbers = _numbers_of(found)
        self._say(**more)
        return found

    def _assign(self, system: System, inputs: dict[str, float], pose: Any) -> None:
        """Assign traits without a word to the page."""
        with self._lock:
            self._known, self._hearing = (system, inputs, pose), True
            try:
                with self.hold_trait_notifications():
                    self.system, self.inputs = system, inputs
            finally:
                self._hearing = False

    def _name_inputs(self, values: np.ndarray) -> dict[str, float]:
        return {name: float(x) for name, x in zip(self._motion.driven, values, strict=True)}

    def _find_pose(self, system: System, inputs: Mapping[str, float], near: np.ndarray | None = None) -> Motion:
        """Find the pose of a design that follows from its drawing, or the one next to some coordinates."""
        driven, held = self._motion.driven, self._motion.held
        start = None if near is None else drawn_motion(system, driven, held, near)
        return solve_position(system, dict(inputs), hold=held, start=start, throw=True)

    def _check_system(self, value: Mechanism | System) -> System:
        """Check a system that is assigned, and find where it stands."""
        value = getattr(value, "system", value)
        value = value.compile() if isinstance(value, Mechanism) else value
        if not isinstance(value, System) or value.topology != self._first.topology:
            raise InputError(
                f"widget: system must be a System of {self._first.name!r} with other dimensions, got "
                f"{value.name if isinstance(value, System) else value!r}; another mechanism needs a widget of its own"
            )
        if self._hearing:
            return value
        if not self._live:
            raise InputError(f"widget: {self._first.name!r} is shown as it is and cannot follow; below it says why")
        inputs = self.inputs
        try:
            pose = self._find_pose(value, inputs)
        except AssemblyError:  # not with these inputs: then next to its drawing
            home, top = np.zeros(len(value.topology.coordinates)), value.topology
            home = np.asarray(settle(derive(value), home).q)
            inputs = self._name_inputs(home[[top.position[name] for name in self._motion.driven]])
            pose = self._find_pose(value, inputs, home)
        self._known = value, inputs, pose
        return value

    def _check_inputs(self, value: object) -> dict[str, float]:
        """Check inputs that are assigned."""
        if not isinstance(value, Mapping) or set(value) != set(self._motion.driven):
            raise InputError(f"widget: inputs are the values of {', '.join(self._motion.driven)}, got {value!r}")
        try:
            found = {name: float(value[name]) for name in self._motion.driven}
        except (TypeError, ValueError):
            raise InputError(f"widget: inputs are numbers, got {value!r}") from None
        if not self._hearing:
            self._known = self.system, found, self._find_pose(self.system, found)
        return found

    def _on_assign(self, change: Any) -> None:
        """Show a system or inputs that Python has assigned in the page."""
        if self._hearing:
            return
        system, inputs, pose = self._known
        self._assign(system, inputs, pose)
        if not self._live:
            asked = np.array([inputs[name] for name in self._motion.driven])
            self._say(pose=int(np.argmin(np.linalg.norm(self._asked - asked, axis=1))))
            return
        if change["name"] == "system":
            self._numbers = _numbers_of(system)
        self._say()

    def _say(self, **more: Any) -> None:
        """Tell the page where things are."""
        self._count += 1
        q = np.asarray(self.pose.q, float).tolist() if self._live else []
        self._now = {"by": _PYTHON, "n": self._count, "q": q, **self._numbers, **more}

    def _on_page(self, change: Any) -> None:
        """Take over what the page tells."""
        now = change["new"]
        if now.get("by", _PYTHON) == _PYTHON:
            return
        if not self._live:
            system, inputs, found = self.system, self._name_inputs(self._asked[now["pose"]]), None
            found = self._motion.pose(now["pose"]) if self._motion.status.shape else self._motion
        else:
            top, system, found = self._first.topology, self.system, np.array(now["q"], float)
            at = [top.position[name] for name in self._motion.driven]
            found[at] -= self._turns(found[at])
            inputs = self._name_inputs(found[at])
            numbers = {name: now[name] for name in _NUMBERS}
            if numbers != self._numbers:
                if numbers == self._original:
                    system = self._first
                elif "drawn" not in now:
                    self._say(say="With these dimensions no pose was found that can be its drawing.")
                    return
                else:
                    system = self._redrawn(np.array(now["drawn"], float), now)
            self._numbers = numbers
        self._assign(system, inputs, found)

    def _turns(self, values: np.ndarray) -> np.ndarray:
        """Count whole turns by which angles lie beyond the motion's, as the page leaves them out."""
        top = self._first.topology
        angles = [top.is_angle(name) for name in self._motion.driven]
        middle = (np.min(self._asked, axis=0) + np.max(self._asked, axis=0)) / 2
        return np.where(angles, 2 * np.pi * np.round(0.999999 * (values - middle) / (2 * np.pi)), 0.0)

    def _redrawn(self, q: np.ndarray, now: Mapping[str, Any]) -> System:
        """Make the design of the page, of which a pose is the drawing."""
        top = self._first.topology
        names, markers = (*top.points, *top.vectors), np.array(now["m"], float).reshape(-1, top.dim)
        values: dict[str, Any] = dict(zip(names, q[: top.dim * len(names)].reshape(-1, top.dim), strict=True))
        values |= {m.name: x for m, x in zip(top.markers, markers, strict=True)}
        values |= dict(zip(top.dimensions, now["d"], strict=True))
        return self.system.replace(values)

    def _on_pull(self, change: Any) -> None:
        """Edit a curve that is dragged in the page."""
        asked, before = change["new"], self.system
        if not asked:
            return
        try:
            inputs = np.array(asked["inputs"], float)
            inputs = self._name_inputs(inputs - self._turns(inputs))
            self._pulled_to(asked["point"], asked["place"], inputs, ack=asked["n"])
        except JaxncError as error:
            self._say(ack=asked["n"], say=f"The curve stays as it is: {error}")
        else:
            if self.system is before:
                self._say(ack=asked["n"], say="The curve goes no further there.")

    def _on_target(self, change: Any) -> None:
        """Take over a target that is drawn in the page."""
        drawn = change["new"]
        if drawn and drawn.get("by") != _PYTHON:
            points = np.array(drawn["points"], float)
            # A drawn curve whose ends are near each other, beside its extent, is closed.
            closed = bool(np.hypot(*(points[-1] - points[0])) < 0.12 * np.max(np.ptp(points, axis=0)))
            count = 24  # points that a drawn curve becomes
            line = np.concatenate([points, points[:1]]) if closed else points
            self.target = space_evenly(line, count + closed)[:count]
            self._closed = closed
            self._show_target()

    def _check_target(self, value: np.ndarray) -> np.ndarray | None:
        """Check a target that is assigned."""
        if value is None:
            return None
        points, dim = as_array(value, "widget: target"), self._first.topology.dim
        if points.ndim != 2 or points.shape[1] != dim:
            raise InputError(f"widget: a target is an array (n, {dim}), got shape {points.shape}")
        if not np.isfinite(points).all():
            raise InputError("widget: a target has numbers that are not finite")
        self._closed = len(points) > 3 and bool(np.all(points[0] == points[-1]))
        return points[:-1] if self._closed else points

    def _show_target(self, change: object = None) -> None:
        points = [] if self.target is None else self.target.tolist()
        self._target = {"by": _PYTHON, "points": points, "closed": self._closed}


@functools.cache
def _class() -> type:
    """Make the widget's class, for which anywidget is imported as late as this."""
    try:
        import anywidget
        import traitlets
    except ImportError:
        raise JaxncError('nc.widget needs anywidget: pip install "jaxnc[widget]" (or pip install anywidget)') from None

    class Given(traitlets.Any):
        allow_none = False  # or None would be taken unchecked

    class Dragged(Widget, anywidget.AnyWidget):
        system = Given()  # pyright: ignore[reportAssignmentType]
        inputs = Given()  # pyright: ignore[reportAssignmentType]
        target = traitlets.Any(None, allow_none=True)
        _now = traitlets.Dict().tag(sync=True)  # pyright: ignore[reportAssignmentType]
        _pull = traitlets.Dict().tag(sync=True)
        _target = traitlets.Dict().tag(sync=True)  # pyright: ignore[reportAssignmentType]

        def __init__(self, *arguments: Any):
            super().__init__(*arguments)
            for name, heard in (("_now", self._on_page), ("_pull", self._on_pull), ("_target", self._on_target)):
                self.observe(heard, names=name)
            self.observe(self._on_assign, names=["system", "inputs"])
            self.observe(self._show_target, names="target")

        def _repr_mimebundle_(self, **options: Any) -> Any:
            """Bundle the widget's view with a picture, which stored notebooks show."""
            bundle: Any = super()._repr_mimebundle_(**options)
            if bundle and (stored := self._stored_picture()):
                data = bundle[0] if isinstance(bundle, tuple) else bundle  # the metadata stand behind
                data["image/png"] = stored
            return bundle

        _valid_system = traitlets.validate("system")(lambda self, proposal: self._check_system(proposal["value"]))
        _valid_inputs = traitlets.validate("inputs")(lambda self, proposal: self._check_inputs(proposal["value"]))
        _valid_target = traitlets.validate("target")(lambda self, proposal: self._check_target(proposal["value"]))

    return Dragged


def _numbers_of(system: System) -> dict[str, list[float]]:
    """List the numbers that the page's equations take beside the coordinates."""
    eq = from_jax(derive(system))
    numbers = (eq.numbers, eq.markers, system.parameters.dimensions)
    return {name: np.asarray(x, float).reshape(-1).tolist() for name, x in zip(_NUMBERS, numbers, strict=True)}


def _module(parts: dict[str, str]) -> str:
    """Write the widget's JavaScript: that of the page, with the page's body and style."""
    page = page_part("page.html")
    style, body = (page.split(f"<{tag}>", 1)[1].split(f"</{tag}>")[0] for tag in ("style", "main"))
    style = fill_template(style, {**parts, "COLOURS": page_colours(":host([data-look=dark]){#}")})
    body = re.sub(r"<noscript>.*</noscript>", "", body, flags=re.DOTALL)
    script = page_part("notebook.js").replace(
        "{{PROGRAM}}", fill_template("{{PROGRAM}}", {**parts, "MORE": f"{{{page_part('widget.js')}}}"})
    )
    given = {
        "STYLE": json.dumps(style),
        "BODY": json.dumps(f"<main>{fill_template(body, parts)}</main>"),
        "DATA": parts["DATA"],
    }
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda found: given[found[1]], script)
