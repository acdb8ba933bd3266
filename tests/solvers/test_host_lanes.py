"""Poses of many designs at once in NumPy: the same as of each design by itself, and from there on nothing of JAX."""

import dataclasses
import functools
import gc
import os
import sys
from collections.abc import Sequence

import jax
import numpy as np
import pytest
from mechanisms import unreadable

import jaxnc as nc
from jaxnc.kinematics import host_solve
from jaxnc.kinematics.inputs import make_plan
from jaxnc.solvers import host
from jaxnc.solvers.assembly import derive, settle
from jaxnc.solvers.host import HostView, poses
from jaxnc.solvers.host.lockstep import solve_at_once
from jaxnc.system.host import from_jax
from jaxnc.system.system import System

STATUS = nc.Status
CASES = ("four-bars", "near Grashof", "parallelograms", "rockers", "MacPherson", "six-bars", "redundant", "two inputs")


class Designs:
    """Designs of one structure, each by itself and all together."""

    def __init__(self, systems: list[System], names: tuple[str, ...], hold: tuple[str, ...] = ()):
        self.view = make_plan(systems[0], names, hold)
        self.each = [derive(s) for s in systems]
        self.start = np.stack([np.asarray(settle(eq, np.zeros(eq.home.shape)).q) for eq in self.each])
        self.together = from_jax(jax.tree.map(lambda *x: np.stack(x), *self.each))
        known = self.view.known[: len(names)]
        self.home = self.start[:, known]


def spread(system: System, count: int, size: float, rng: np.random.Generator) -> list[System]:
    """The design and others whose points lie a little elsewhere."""
    points = np.asarray(system.parameters.points)
    names = system.topology.points
    moved = [points] + [points + size * rng.normal(size=points.shape) for _ in range(count - 1)]
    return [system.replace(**dict(zip(names, x, strict=True))) for x in moved]


def joint(crank, coupler, rocker, base, phi, side):
    """Ends of the crank and of the coupler, ``(2, ...)``, the latter by two circles, left of B -> D for a side of 1."""
    at, ground = crank * np.array([np.cos(phi), np.sin(phi)]), np.array([base, np.zeros_like(base)])
    far = ground.reshape(2, *[1] * (at.ndim - ground.ndim), *ground.shape[1:]) - at
    square = np.sum(far * far, axis=0)
    along = (coupler**2 - rocker**2 + square) / (2 * square)
    high = np.sqrt(coupler**2 / square - along**2)
    return at, at + along * far + side * high * np.array([-far[1], far[0]])


def four_bar(crank, coupler, rocker, base, phi, side, like: System) -> System:
    B, C = joint(crank, coupler, rocker, base, phi, side)
    return like.replace(A=(0.0, 0.0), B=B, C=C, D=(base, 0.0))


@functools.cache
def plain() -> System:
    return nc.library.four_bar(explicit=False).compile()


@functools.cache
def designs(case: str) -> Designs:
    rng = np.random.default_rng(11)
    if case == "four-bars":
        systems = []
        while len(systems) < 40:
            lengths, phi, side = rng.uniform(0.3, 1.5, 4), rng.uniform(-3, 3), rng.choice([-1, 1])
            far = np.hypot(lengths[0] * np.cos(phi) - lengths[3], lengths[0] * np.sin(phi))
            if abs(lengths[1] - lengths[2]) * 1.03 < far < 0.97 * (lengths[1] + lengths[2]):
                systems.append(four_bar(*lengths, phi, side, plain()))
        return Designs(systems, ("phi",))
    if case == "near Grashof":  # crank + base against coupler + rocker, on either side, and exactly
        gaps = [0.0, *(s * 10.0**-k for k in range(2, 10) for s in (-1, 1))]
        return Designs([four_bar(0.4, 1.0, 0.9, 1.5 + g, 0.7, 1, plain()) for g in gaps], ("phi",))
    if case == "parallelograms":
        sizes = [(0.1, 0.3), (0.2, 0.5), (0.5, 0.4)]
        return Designs([four_bar(r, b, r, b, 0.6, 1, plain()) for r, b in sizes], ("phi",))
    if case == "rockers":  # driven at the rocker of a drag link, whose travel is more than half a turn, and others
        lengths = [(1.0, 1.2, 1.0, 0.4), (1.0, 0.9, 0.8, 0.95), (0.9, 1.3, 1.4, 1.5)]
        return Designs([four_bar(*x, phi, 1, plain()) for x in lengths for phi in (2.0, -1.9)], ("phi",))
    if case == "MacPherson":
        system = nc.library.macpherson().compile()
        return Designs(spread(system, 3, 2e-3, rng), ("6.z",), ("10.y", "7.x"))
    if case == "six-bars":  # with a block of eight
        system = nc.library.stephenson_six_bar("II").compile()
        return Designs(spread(system, 6, 4e-3, rng), ("phi",))
    if case == "redundant":
        drawn = [nc.library.bennett(twist=x, angle=1.0).compile() for x in (0.5, 0.7, 0.9)]
        return Designs([dataclasses.replace(drawn[0], parameters=s.parameters) for s in drawn], ("phi",))
    system = nc.library.five_bar().compile()
    return Designs(spread(system, 8, 5e-3, rng), ("phi", "psi"))


def same(found, wanted, size, near=1e-12):
    """Statuses equal, poses to 1e-12 of the size; where a branch ends, to what a root of rounding leaves."""
    np.testing.assert_array_equal(found.status, wanted.status)
    good, conditioning = wanted.status == 0, wanted.conditioning
    slack = near * size / np.minimum(1.0, np.maximum(conditioning, 1e-9))  # what rounding is magnified to there
    assert np.all(np.abs(found.q - wanted.q)[good] <= 10 * slack[good, None])
    np.testing.assert_allclose(found.q[~good], wanted.q[~good], atol=2e-3 * size)
    np.testing.assert_allclose(found.conditioning[good], conditioning[good], rtol=1e-6)
    assert np.all(found.size[good] <= 1e-12 * size)


def asked(case: str, d: Designs, total: int, rng: np.random.Generator) -> np.ndarray:
    """Ways to and fro of each design, with values that come twice in succession."""
    many, inputs = d.home.shape
    size = {"MacPherson": 12.0, "two inputs": 0.15, "six-bars": 0.2, "rockers": 0.6}.get(case, 0.5)
    steps = rng.normal(size=(many, total, inputs)) * size * rng.choice([0.0, 0.3, 1.0, 2.0], (many, 1, 1), True)
    steps *= rng.random((many, total, 1)) < 0.8
    values = d.home[:, None] + np.cumsum(steps, axis=1)
    smooth = np.linspace(0.0, 1.0, total)[:, None] * (12 * size * np.sign(rng.normal(size=(many, 1, inputs))))
    values[::2] = (d.home[:, None] + smooth)[::2]
    return values


@pytest.mark.parametrize("case", CASES)
def test_sequences_are_those_of_each_design(case):
    d, rng = designs(case), np.random.default_rng(5)
    values = asked(case, d, 31, rng)
    found = host_solve.solve_sequences(d.view, d.together, d.start, values)
    alone = [
        host_solve.analyse_on_host(d.view, "continuation", *x, ()) for x in zip(d.each, d.start, values, strict=True)
    ]
    for k, eq in enumerate(d.each):
        same(found.each(lambda x, k=k: x[k]), alone[k], float(eq.length))
    # From a pose on: the last that was found before the first that was not.
    first = np.array([int(np.argmax(np.append(w.status != 0, True))) for w in alone])
    first = np.where(first < 31, first, rng.integers(0, 31, len(first)))
    start = np.where(first[:, None] > 0, found.q[np.arange(len(first)), first - 1], d.start)
    rest = host_solve.solve_sequences(d.view, d.together, start, values, first)
    for k, eq in enumerate(d.each):
        after = alone[k].each(lambda x, k=k: x[first[k] :])
        own = rest.each(lambda x, k=k: x[k, first[k] :])
        same(own, after, float(eq.length))


@pytest.mark.parametrize("case", CASES)
def test_scattered_values_are_those_of_each_design(case):
    d, rng = designs(case), np.random.default_rng(6)
    values = asked(case, d, 13, rng)
    each, every = np.repeat(np.arange(len(d.each)), 13), rng.permutation(13 * len(d.each))
    found = host_solve.solve_lanes(d.view, d.together, d.start, values.reshape(-1, values.shape[2])[every], each[every])
    back = np.argsort(every).reshape(-1, 13)
    for k, eq in enumerate(d.each):
        wanted = host_solve.analyse_on_host(d.view, "lanes", eq, d.start[k], values[k], ())
        same(found.each(lambda x, k=k: x[back[k]]), wanted, float(eq.length))
        one = host_solve.solve_lanes(d.view, from_jax(eq), d.start[k : k + 1], values[k, :3], np.zeros(3, int))
        same(found.each(lambda x, k=k: x[back[k, :3]]), one, float(eq.length))


CLOSED = {  # of four-bars: lengths, where they are drawn, where to, and whether no singular position lies between
    "a whole turn": ((0.4, 1.2, 0.8, 1.0), 1.0, 1.0 + 2 * np.pi, True),
    "the other way": ((0.4, 1.2, 0.8, 1.0), 1.0, -9.0, True),
    "a parallelogram between its change points": ((0.2, 0.5, 0.2, 0.5), 0.6, 2.6, True),
    "a parallelogram over its change point": ((0.2, 0.5, 0.2, 0.5), 0.6, 3.8, False),
    "a parallelogram that ends on it": ((0.2, 0.5, 0.2, 0.5), 0.6, np.pi, False),
    "a rocker within its limit": ((1.0, 0.9, 0.8, 0.95), 0.9, 1.4, True),
    "a rocker beyond its limit": ((1.0, 0.9, 0.8, 0.95), 0.9, 3.0, False),
    "a gap of 5e-6 rad": ((0.4, 1.0, 0.9, 1.5 + 1e-12), 0.7, 5.0, False),
    "a gap of 0.005 rad": ((0.4, 1.0, 0.9, 1.5 + 1e-6), 0.7, 5.0, False),
}


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("total", [1, 2, 91])
def test_ways_are_solved_all_at_once_only_between_singular_positions(total, side):
    lengths, drawn, end, wanted = (np.array(x) for x in zip(*CLOSED.values(), strict=True))
    d = Designs([four_bar(*x, phi, side, plain()) for x, phi in zip(lengths, drawn, strict=True)], ("phi",))
    view, start = HostView(d.view, d.together), d.start.T
    values = (drawn + np.linspace(0.0, 1.0, total + 1)[1:, None] * (end - drawn))[:, None]
    q, right = solve_at_once(view, start, values, np.full(len(drawn), total))
    np.testing.assert_array_equal(right, wanted)
    position = plain().topology.position
    with np.errstate(invalid="ignore"):
        C = joint(*lengths.T, values[:, 0], side)[1]
    found = np.stack([q[position[f"C.{x}"]] for x in "xy"])
    np.testing.assert_allclose(found[..., right], C[..., right], atol=1e-13)
    # Lengths that do not close where they begin: none of them is.
    off = start + 1e-3 * (np.arange(len(start)) == position["C.x"])[:, None]
    assert not solve_at_once(view, off, values, np.full(len(drawn), total))[1].any()


def test_where_nothing_is_driven_the_drawing_is_the_pose():
    m = nc.Mechanism("truss")
    m.ground("A", (0.0, 0.0))
    m.ground("B", (1.0, 0.0))
    m.point("C", (0.4, 0.7))
    for one in "AB":
        m.body(f"bar {one}", [one, "C"])
    np.testing.assert_allclose(nc.solve_position(m.compile(), {})["C"], (0.4, 0.7), atol=1e-14)


@pytest.mark.parametrize("case", ["four-bars", "near Grashof", "parallelograms", "rockers"])
def test_what_is_solved_all_at_once_is_what_is_followed(case, monkeypatch):
    d = designs(case)
    values = asked(case, d, 31, np.random.default_rng(9))
    found = host_solve.solve_sequences(d.view, d.together, d.start, values)
    monkeypatch.setattr(poses, "solve_at_once", lambda view, start, *_: (start, np.zeros(start.shape[1], bool)))
    followed = host_solve.solve_sequences(d.view, d.together, d.start, values)
    for k, eq in enumerate(d.each):
        same(*(batch.each(lambda x, k=k: x[k]) for batch in (found, followed)), float(eq.length))


def test_designs_that_are_mirrored_or_have_left_their_class_or_do_not_assemble():
    m = nc.Mechanism("hinge", dim=3)
    for name, at in (("A", (0, 0, 0)), ("B", (1, 0, 0))):
        m.ground(name, at)
    m.point("C", (0.2, 1, 0.1))
    m.point("P", (0.3, 0.4, 0.8))
    m.body("tetrahedron", ["A", "B", "C", "P"], form="text")
    m.point("K", (2.5, 0, 0))
    m.body("rod", ["A", "B", "K"])
    system = m.compile()
    d = Designs([system, system.replace(K=(2.5, 0.01, 0.0)), system, system], ("C.z",))
    p = len(system.topology.points[: system.topology.points.index("P")]) * 3
    q = d.start[0]
    normal = np.cross(q[3:6] - q[:3], q[6:9] - q[:3])
    normal /= np.linalg.norm(normal)
    d.start[2, p : p + 3] -= 2 * normal * (q[p : p + 3] @ normal)
    d.start[3, p : p + 3] = np.nan
    values = np.stack([np.array([[0.2], [0.5], [0.9], [5.0], [0.3]])] * 4)
    found = host_solve.solve_sequences(d.view, d.together, d.start, values)
    left, mirrored, lost = (int(x) for x in (STATUS.LEFT_CLASS, STATUS.MIRRORED, STATUS.DID_NOT_ASSEMBLE))
    ended = [0, 0, 0, int(STATUS.SINGULAR), int(STATUS.NOT_REACHED)]
    np.testing.assert_array_equal(found.status, [ended, [left] * 5, [mirrored] * 5, [lost] * 5])
    each = host_solve.solve_lanes(d.view, d.together, d.start, values[0, :4], np.arange(4))
    np.testing.assert_array_equal(each.status, [0, left, mirrored, lost])
    assert np.isfinite(found.q[:3]).all() and np.isfinite(each.q[:3]).all()


def test_numbers_of_32_bits_are_calculated_with_32():
    like = nc.library.four_bar(explicit=False).compile(dtype="float32")
    lengths = [(0.4, 1.0, 0.9, 1.2), (0.5, 0.8, 0.9, 1.0), (1.0, 0.5, 0.7, 0.9)]
    d, wide = (Designs([four_bar(*x, 0.7, 1, base) for x in lengths], ("phi",)) for base in (like, plain()))
    values = np.stack([np.linspace(0.7, 5.7, 40)[:, None]] * 3)
    found = host_solve.solve_sequences(d.view, d.together, d.start, values)
    exact = host_solve.solve_sequences(wide.view, wide.together, wide.start, values)
    assert all(x.dtype == np.float32 for x in (found.q, found.size, found.conditioning))
    np.testing.assert_array_equal(found.status, exact.status)
    assert {0, 2, 4} == set(found.status.ravel().tolist())
    good = found.status == 0
    np.testing.assert_allclose(found.q[good], exact.q[good], atol=3e-5)
    for k, eq in enumerate(d.each):
        status = host_solve.analyse_on_host(d.view, "continuation", eq, d.start[k], values[k], ()).status
        np.testing.assert_array_equal(found.status[k], status)


def test_once_ready_nothing_of_jax_is_called():
    """A callback of a compiled program must not call JAX: only functions of it that read settings are entered."""
    d = designs("parallelograms")
    assert host.read_kinds(d.view)
    values = np.stack([np.linspace(0.6, 7.0, 23)[:, None]] * 3)
    inside = []

    def seen(frame, event, _):
        file = frame.f_code.co_filename
        if event == "call" and f"{os.sep}jax{os.sep}" in file and not file.endswith(f"{os.sep}config.py"):
            inside.append(frame.f_code.co_qualname)

    gc.collect()
    gc.disable()  # jax has a part in it
    sys.setprofile(seen)
    try:
        found = host_solve.solve_sequences(d.view, d.together, d.start, values)
        host_solve.solve_lanes(d.view, d.together, d.start, values.reshape(-1, 1), np.repeat(np.arange(3), 23))
    finally:
        sys.setprofile(None)
        gc.enable()
    assert not inside
    assert np.mean(found.status == 0) > 0.9


def test_what_cannot_be_read_is_not_ready():
    system = unreadable().compile()
    view = make_plan(system, ("P.x",), ())
    assert not host.read_kinds(view)
    eq = derive(system)
    found = host_solve.solve_lanes(
        view, from_jax(eq), np.asarray(eq.home)[None], np.array([[0.3], [0.8]]), np.zeros(2, int)
    )
    np.testing.assert_allclose(found.q[:, 1], [0.09, 0.64], atol=1e-12)  # through JAX it is found all the same


def three_cranks(pivots: Sequence[float], phi: float) -> nc.System:
    """A parallelogram on cranks of length 1, one of which is redundant; at 0 and pi branches cross."""
    m = nc.Mechanism("three cranks")
    for k, x in enumerate(pivots):
        m.ground(f"A{k}", (x, 0.0)), m.point(f"B{k}", (x + np.cos(phi), np.sin(phi)))
    m.body("coupler", ["B0", "B1", "B2"])
    for k in range(3):
        m.body(f"crank {k}", [f"A{k}", f"B{k}"])
    m.angle("phi", at="A0", to="B0")
    return m.compile()


def test_lanes_at_and_next_to_a_change_point_leave_those_behind_it_alone():
    """A parallelogram on three cranks: next to where branches cross, derivatives are made of rounding."""
    pivots = (0.0, 2.0, 5.0)
    system = three_cranks(pivots, 0.5 * np.pi)
    d = Designs([system], ("phi",))
    rng, home = np.random.default_rng(0), float(d.home[0, 0])
    special = [home, 0.0, np.pi, -np.pi, np.pi + 1e-6, 1e-9]
    near, far = 0.5 * rng.uniform(-1.0, 1.0, 2048)[6:1024], 4.0 * rng.uniform(-1.0, 1.0, 1024)
    values = np.concatenate([special, home + near, home + far])[:, None]
    found = host_solve.analyse_on_host(d.view, "lanes", d.each[0], d.start[0], values, ())
    assert np.all(np.asarray(found.status)[6:] == STATUS.CONVERGED)
    at = system.topology.position
    for k, x in enumerate(pivots):
        place = found.q[6:, [at[f"B{k}.x"], at[f"B{k}.y"]]]
        turned = np.stack([x + np.cos(values[6:, 0]), np.sin(values[6:, 0])], axis=1)
        np.testing.assert_allclose(place, turned, atol=1e-9)


@pytest.mark.parametrize(
    ("pivots", "phi", "values"),
    [
        # Behind the crossing redundant rows contradict each other at the end of a wrong step.
        ((0.0, 2.1840525329804983, 5.006372326031984), 0.514122917859061, (2.0, np.pi - 1e-5, np.pi, 3.3)),
        # The way to the crossing is so short that it is arrived at.
        ((0.0, 1.3383913118081656, 4.363654070501821), 2.557929527287151, (1e-6, 0.0, -1.0)),
        ((0.0, 2.0, 5.0), 1.66, (1.0, 1e-8, 0.0, 0.0, -1e-8, -1.0)),
    ],
)
def test_a_crossing_is_passed_from_right_beside_it(pivots, phi, values):
    system = three_cranks(pivots, phi)
    motion = nc.sweep(system, {"phi": np.array(values)})
    assert motion.status[-1] == STATUS.CONVERGED
    at = system.topology.position
    for k, x in enumerate(pivots):
        place = motion.q[:, [at[f"B{k}.x"], at[f"B{k}.y"]]]
        turned = np.stack([x + np.cos(values), np.sin(values)], axis=1)
        np.testing.assert_allclose(place, turned, atol=1e-6)  # to a root of rounding at the crossing
        np.testing.assert_allclose(place[-1], turned[-1], atol=1e-12)
