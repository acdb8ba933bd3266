"""The cases by name: each takes a `Suite` and adds its rows to the record."""

from collections.abc import Callable

from benchmarks.cases import (
    classes,
    crank_rocker,
    derivatives,
    designs,
    devices,
    dynamics,
    ensemble,
    first_answers,
    first_call,
    growth,
    guises,
    long_rows,
    mechanisms,
    single_pose,
    soft_joints,
    widths,
)
from benchmarks.suite import Suite

CASES: dict[str, tuple[Callable[[Suite], None], str]] = {
    "four-bar": (crank_rocker.turn, "crank-rocker, angles over a full turn, in order"),
    "four-bar-random": (crank_rocker.shuffled, "the same angles in random order"),
    "designs-branch": (designs.every_kind, "random designs up to the Grashof limit, 49 angles each"),
    "guises": (guises.described_differently, "the four-bar turned, renamed and permuted, of a kind from outside"),
    "designs": (ensemble.full_turn, "crank-rocker designs, 360 angles each"),
    "generic": (mechanisms.generic, "generic mechanism of figure 22"),
    "macpherson": (mechanisms.macpherson, "MacPherson suspension over bump and steer, redundant rows"),
    "classes": (classes.thousands, "every mechanism of the library and robots from files, 2,048 lanes"),
    "classes-small": (classes.hundreds, "the same, 256 lanes"),
    "classes-large": (classes.very_many, "the same, 100,000 lanes"),
    "derivatives": (derivatives.of_coupler_point, "value, gradient, Hessian-vector product"),
    "widths-four-bar": (widths.of_four_bar, "32-bit numbers beside 64 bits: crank-rocker"),
    "widths-macpherson": (widths.of_macpherson, "the same: MacPherson suspension"),
    "single": (single_pose.from_python, "one pose of a compiled four-bar, called from Python"),
    "rows": (long_rows.one_pose, "rows of four-bars with up to 10,000 coordinates"),
    "devices": (devices.two_devices, "two host devices beside one"),
    "first-answers": (first_answers.swept, "a new process: compile, first sweep, other numbers, again"),
    "linkages": (first_answers.many_linkages, "50 different small linkages, one after the other"),
    "searches": (first_answers.searches, "a new process: the first designs of a path, a function, a suspension"),
    "compile": (first_call.compiled, "compilation of the first batched call, in fresh processes"),
    "slider-cranks": (dynamics.slider_cranks, "slider-cranks under gravity at once, fixed steps"),
    "soft-joints": (soft_joints.driven_leg, "ten seconds of a leg and their gradient, beside MuJoCo's soft joints"),
    "growth-batch": (growth.with_batch, "time per lane against the size of the batch"),
    "growth-unknowns": (growth.with_unknowns, "time per lane against the number of unknowns"),
    "growth-designs": (growth.with_designs, "time per lane against the number of designs"),
}
