"""Ready spatial mechanisms: counts, default drives, and formulations that know nothing of natural coordinates.

The drawing of every mechanism is handed to `independent`, which moves it by rotations.
"""

import functools
import math

import numpy as np
import pytest
from independent import linkages, loops, platforms, shafts
from independent.jets import Jet
from mechanisms import reference

import jaxnc as nc
from jaxnc import library
from jaxnc.solvers.assembly import derive

POSES = 25
TURNS = np.arange(0.0, 6.0 * np.pi + 0.1, np.pi / 12)  # three turns in steps of 15°, those of the reference solution
POSITION, VELOCITY, ACCELERATION = 1e-12, 1e-11, 1e-10  # of L, L ω and L ω²; measured: 5e-15 at most
RESIDUAL = 1e-13  # of the size: what a solved pose may leave
RATE, SECOND = 1.3, 0.7  # of the inputs, so that accelerations see both

# name: (what makes it, n, rows, rank, g, Grübler's count)
CASES = {
    "rscr": (library.rscr, 12, 12, 11, 1, 1),
    "rscr, angle": (lambda: library.rscr(crank_angle=True), 13, 13, 12, 1, 1),
    "bevel-gears": (library.bevel_gears, 8, 7, 7, 1, 1),
    "bevel-gears, 60°": (lambda: library.bevel_gears(shaft_angle=math.pi / 3), 8, 7, 7, 1, 1),
    "steering-column": (library.steering_column, 17, 16, 16, 1, 1),
    "cardan-joint": (library.cardan_joint, 8, 7, 7, 1, 1),
    "cardan-shafts": (library.cardan_shafts, 15, 14, 14, 1, 1),
    "rssr": (library.rssr, 8, 7, 7, 1, 1),
    "rssp": (library.rssp, 8, 8, 7, 1, 1),
    "rccc": (library.rccc, 24, 26, 23, 1, 1),
    "spherical-four-bar": (library.spherical_four_bar, 8, 7, 7, 1, 1),  # its links share O: the count knows the sphere
    "wobble-plate": (library.wobble_plate, 26, 25, 25, 1, 1),
    "bennett": (library.bennett, 14, 16, 13, 1, -2),
    "bricard": (library.bricard, 26, 26, 25, 1, 0),
    "four-bar-in-space": (library.four_bar_in_space, 13, 16, 12, 1, -2),
    "double-hinged-door": (library.double_hinged_door, 16, 22, 15, 1, -4),
    "stewart-platform": (library.stewart_platform, 24, 18, 18, 6, 6),
    "delta-robot": (library.delta_robot, 39, 36, 36, 3, 3),
    "general-body": (library.general_body, 25, 24, 24, 1, 1),
    "general-body, free": (lambda: library.general_body(hinged=False), 30, 24, 24, 6, 6),
    "general-body, text": (lambda: library.general_body(form="text"), 25, 24, 24, 1, 1),
}
RATED = {"rscr, angle", "bevel-gears", "bevel-gears, 60°", "cardan-joint", "cardan-shafts", "rssr", "steering-column"}
SEVERAL_TURNS = RATED - {"rscr, angle", "rssr", "steering-column"}
ELSEWHERE = {"macpherson", "double-wishbone", "five-link"}  # tested with the suspensions


@functools.cache
def built(name):
    mechanism = CASES[name][0]()
    return mechanism, mechanism.compile()


def turned_through(system, phi):
    return nc.sweep(system, {"phi": phi}, rates={"phi": RATE}, accelerations={"phi": SECOND})


@functools.cache
def moved(name):
    """The default drive in fewer poses; rates, which take long to compile, only where they are looked at."""
    mechanism, system = built(name)
    run = mechanism.model.run
    if name in SEVERAL_TURNS:
        return turned_through(system, TURNS)
    inputs = {k: np.linspace(d.start, d.end, POSES) for k, d in run.inputs.items()}
    if name in RATED:
        return turned_through(system, inputs["phi"])
    return nc.sweep(system, inputs, hold=run.hold)


def drawn(mechanism):
    """Every point, vector and marker as drawn."""
    model = mechanism.model
    places = {**model.ground, **{k: getattr(p, "at", p) for k, p in model.points.items()}}
    places |= {**model.ground_vectors, **model.vectors, **{k: p.at for k, p in model.markers.items()}}
    return {k: np.array(p) for k, p in places.items()}


def assert_same(motion, got, want, size, turns=False):
    """A point, vector or coordinate of a motion against an independent one, with its rates if it has any."""
    error = np.asarray(motion[got]) - want.x
    if turns:
        error = (error + np.pi) % (2.0 * np.pi) - np.pi
    assert np.max(np.abs(error)) <= POSITION * size, got
    if motion.rates:
        assert np.max(np.abs(motion.velocity(got) - want.v)) <= VELOCITY * size * RATE, got
        assert np.max(np.abs(motion.acceleration(got) - want.a)) <= ACCELERATION * size * RATE**2, got


def size_of(name):
    return derive(built(name)[1]).length


# ---------------------------------------------------------------------------------------------------------------
# every mechanism


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_counts(name):
    mechanism, system = built(name)
    _, n, rows, rank, g, grubler = CASES[name]
    m = nc.mobility(system)
    assert (m.n, m.rows, m.rank, m.dof, m.grubler) == (n, rows, rank, g, grubler)
    assert len(m.redundant) == rows - rank and m.overconstrained == max(g - grubler, 0)
    assert not m.conflicting and not m.momentary and m.gap <= RESIDUAL * size_of(name)
    assert mechanism.model.description


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CASES if name != "general-body, text"])
def test_default_drive_runs(name):
    mechanism, system = built(name)
    motion = moved(name).check()
    run = mechanism.model.run
    assert len(run.inputs) == system.degrees_of_freedom
    assert np.max(motion.residual) <= RESIDUAL * size_of(name)
    assert np.min(motion.conditioning) > 1e-3
    for output in run.outputs:
        assert np.all(np.isfinite(motion[output])) and np.ptp(motion[output]) > 0.05 * size_of(name)


def test_catalogue_has_every_function():
    spatial = {name for name, make in library.CATALOGUE.items() if make().model.dim == 3}
    assert spatial - ELSEWHERE <= set(CASES)
    assert all(library.CATALOGUE[name] is CASES[name][0] for name in spatial - ELSEWHERE)


def test_default_cranks_turn_through():
    for make, *_ in CASES.values():
        if make not in (library.bricard, library.double_hinged_door):
            drive = make().model.run.inputs.get("phi")
            assert drive is None or drive.end - drive.start >= 2.0 * np.pi


def test_a_crank_that_does_not_turn_is_driven_within_its_range():
    for make, places in ((library.rssr, {"1": (0.3, 0.0, 0.0)}), (library.rssp, {"1": (0.35, 0.0, 0.0)})):
        drive = make(places).model.run.inputs["phi"]
        assert 0.1 < drive.end - drive.start < 2.0 * np.pi
    p = {"1": np.array((0.15, 0.0, 0.03))}
    drive = library.rscr(p, crank_angle=True).model.run.inputs["phi"]
    known = {k: np.array(v) for k, v in drawn(library.rscr(p)).items()}
    assert np.all(np.isfinite(linkages.rscr(known, phi=np.linspace(drive.start, drive.end, 9))["psi"].x))
    assert -1.1 < drive.start < -0.9 and 0.25 < drive.end < 0.4


# ---------------------------------------------------------------------------------------------------------------
# shafts


def assert_cardan(motion, beta, theta):
    want = shafts.cardan(theta, beta, RATE, SECOND)
    assert_same(motion, "psi", want, 1.0)


def test_cardan_joint_over_three_turns():
    assert_cardan(moved("cardan-joint"), math.pi / 6, TURNS)


def wrapped(error):
    return np.abs((np.asarray(error) + np.pi) % (2.0 * np.pi) - np.pi)


@pytest.mark.parametrize("beta", [15, 30, 45])
def test_cardan_joint_against_the_reference(beta):
    data = reference("universal_joint")
    omega = data["definition"]["omega_in"]
    system = library.cardan_joint(shaft_angle=math.radians(beta)).compile()
    motion = nc.sweep(system, {"phi": TURNS}, rates={"phi": omega}, accelerations={"phi": 0.0})
    want = data["reference"]["single"][f"beta_{beta}"]
    assert np.allclose(np.degrees(TURNS[:24]), want["theta_deg"])
    angle, rate, acceleration = np.array(want["output"]).T
    for turn in range(3):
        now = slice(24 * turn, 24 * (turn + 1))
        assert np.max(wrapped(motion["psi"][now] - angle)) <= POSITION
        assert np.max(np.abs(motion.velocity("psi")[now] - rate)) <= VELOCITY * omega
        assert np.max(np.abs(motion.acceleration("psi")[now] - acceleration)) <= ACCELERATION * omega**2


@pytest.mark.slow
def test_two_cardans_in_series_against_the_reference():
    data = reference("universal_joint")
    d, omega = data["definition"]["series"], data["definition"]["omega_in"]
    first, second, delta = (math.radians(d[k]) for k in ("beta1_deg", "beta2_deg", "delta_deg"))
    c = np.array((math.cos(first), 0.0, math.sin(first)))
    end = c + np.array((math.cos(first + second), 0.0, math.sin(first + second)))
    places = {"A": (-1.0, 0.0, 0.0), "B": (0.0, 0.0, 0.0), "C": c, "D": end, "v1": (0.0, 0.0, -1.0)}
    system = library.cardan_shafts(places, phase=delta - math.pi / 2).compile()
    motion = nc.sweep(system, {"phi": TURNS}, rates={"phi": omega}, accelerations={"phi": 0.0})
    want = np.array(data["reference"]["double_series"]).T
    for name, (angle, rate, acceleration) in (("chi", want[:3]), ("psi", want[3:])):
        for turn in range(3):
            now = slice(24 * turn, 24 * (turn + 1))
            assert np.max(wrapped(motion[name][now] - (angle - angle[0]))) <= POSITION
            assert np.max(np.abs(motion.velocity(name)[now] - rate)) <= VELOCITY * omega
            assert np.max(np.abs(motion.acceleration(name)[now] - acceleration)) <= ACCELERATION * omega**2


@pytest.mark.slow
def test_cardan_shafts_out_of_one_plane_over_three_turns():
    motion, p = moved("cardan-shafts"), drawn(built("cardan-shafts")[0])
    want = shafts.cardan_shafts({k: p[k] for k in shafts.CARDAN_SHAFTS}, TURNS, RATE, SECOND)
    for got, key in (("chi", "middle"), ("psi", "outlet"), ("v1", "v1"), ("v2", "v2"), ("v3", "v3"), ("v4", "v4")):
        assert_same(motion, got, want[key], 1.0)


@pytest.mark.parametrize("name", ["bevel-gears", "bevel-gears, 60°"])
def test_bevel_gears_over_three_turns(name):
    motion, p = moved(name), drawn(built(name)[0])
    want = shafts.bevel_gears({k: p[k] for k in shafts.BEVEL_GEARS}, TURNS, RATE, SECOND)
    assert_same(motion, "psi", want["psi"], 1.0)
    for point in "12":
        assert_same(motion, point, want[point], size_of(name))


@pytest.mark.slow
def test_steering_column_from_lock_to_lock():
    motion, p = moved("steering-column"), drawn(built("steering-column")[0])
    hardpoints = {k: p[k] for k in shafts.STEERING_COLUMN}
    want = shafts.steering_column(hardpoints, np.asarray(motion["phi"]), RATE, SECOND)
    for name in ("v1", "v2", "v3", "v4", "1", "2", "s"):
        assert_same(motion, name, want[name], size_of("steering-column"))
    assert_same(motion, "psi", want["psi"], 1.0, turns=True)


# ---------------------------------------------------------------------------------------------------------------
# loops

LOOPS = {
    "rscr, angle": (linkages.rscr, linkages.RSCR, {k: k for k in ("1", "2", "3", "v1")}),
    "rssr": (linkages.rssr, linkages.RSSR, {k: k for k in ("1", "2", "psi")}),
    "rssp": (linkages.rssp, linkages.RSSP, {"1": "1", "2": "2", "s": "slide"}),
    "rccc": (
        linkages.rccc,
        linkages.RCCC,
        {
            "B1": "B",
            "B2": "B_coupler",
            "C2": "C_coupler",
            "C3": "C",
            "D3": "D",
            "vB": "vB",
            "vC": "vC",
            "psi": "psi",
            "s": "slide_D",
        },
    ),
    "spherical-four-bar": (loops.spherical_four_bar, loops.SPHERICAL_FOUR_BAR, {"vB": "vB", "vC": "vC", "psi": "psi"}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOPS)
def test_loop_against_rotations(name):
    motion, p = moved(name), drawn(built(name)[0])
    formulation, known, names = LOOPS[name]
    if name == "rccc":
        p |= {"B": p["B1"], "C": p["C2"]}
    hardpoints = {k: p[k] for k in known if k in p}
    zero = p["vD"] if name == "spherical-four-bar" else None  # the others count from the drawing
    want = formulation(hardpoints, np.asarray(motion["phi"]), RATE, SECOND, zero=zero)
    for got, key in names.items():
        assert_same(motion, got, want[key], max(size_of(name), 1.0) if got[0] in "vp" else size_of(name))


@pytest.mark.slow
def test_rscr_of_the_text_follows_the_same_path():
    """Without the crank angle: the pin keeps its circle, and the twelve coordinates are those of the angle's pose."""
    motion, p = moved("rscr"), drawn(built("rscr")[0])
    pin = np.asarray(motion["1"]) - p["A"]
    phi = np.arctan2(pin[:, 1], pin[:, 0])  # its axis is z, and it is drawn along x
    want = linkages.rscr({k: p[k] for k in linkages.RSCR}, phi)
    for name in ("1", "2", "3", "v1"):
        assert_same(motion, name, want[name], 1.0)


# ---------------------------------------------------------------------------------------------------------------
# overconstrained


def distance(motion, a, b):
    return np.linalg.norm(np.asarray(motion[a] - motion[b]), axis=-1)


@pytest.mark.slow
def test_bennett_through_a_full_turn():
    motion = moved("bennett")
    phi, psi = np.asarray(motion["phi"]), np.asarray(motion["psi"])
    want = loops.bennett(phi, length=0.2, alpha=0.7, beta=1.2)
    assert np.max(wrapped(psi - want["theta2"].x)) <= POSITION
    assert abs(psi[-1] - psi[0]) == pytest.approx(2.0 * np.pi)
    for a, b, one, two in (("A", "C", "1", "3"), ("B", "D", "2", "4")):
        apart = np.linalg.norm((want[one] - want[two]).x, axis=-1)
        assert np.max(np.abs(distance(motion, a, b) - apart)) <= POSITION


@pytest.mark.slow
def test_bricard_between_its_dead_points():
    motion = moved("bricard")
    phi, psi = np.asarray(motion["phi"]), np.asarray(motion["psi"])
    want = loops.bricard(phi, length=1.0, alpha=np.pi / 2)
    assert np.max(np.abs(np.abs(psi) - np.abs(want["theta2"].x))) <= POSITION
    assert np.max(np.abs(np.cos(phi) + np.cos(psi) + np.cos(phi) * np.cos(psi))) <= POSITION
    for k in range(3):
        apart = np.linalg.norm((want[f"{k + 1}"] - want[f"{k + 4}"]).x, axis=-1)
        assert np.max(np.abs(distance(motion, f"P{k}", f"P{k + 3}") - apart)) <= POSITION


@pytest.mark.slow
def test_four_bar_in_space_moves_like_the_planar_one():
    motion = moved("four-bar-in-space")
    b = 0.04 * np.exp(1j * np.asarray(motion["phi"]))
    way = 0.10 - b
    opening = np.arccos((0.12**2 + np.abs(way) ** 2 - 0.08**2) / (2 * 0.12 * np.abs(way)))
    c = b + 0.12 * np.exp(1j * (np.angle(way) + opening))
    assert_same(motion, "B", Jet(np.stack([b.real, b.imag, 0.0 * b.real], -1)), 0.1)
    assert_same(motion, "C", Jet(np.stack([c.real, c.imag, 0.0 * c.real], -1)), 0.1)
    for axis in ("vB", "vC"):
        assert_same(motion, axis, Jet(np.array((0.0, 0.0, 1.0))), 1.0)


@pytest.mark.slow
def test_door_swings_about_both_hinges():
    motion = moved("double-hinged-door")
    handle = (0.9 + 0.05j) * np.exp(1j * np.asarray(motion["phi"]))
    assert_same(motion, "H", Jet(np.stack([handle.real, handle.imag, 1.0 + 0.0 * handle.real], -1)), 2.0)
    for name, place in (("D1", (0.0, 0.0, 0.25)), ("D2", (0.0, 0.0, 1.75)), ("w1", (0.0, 0.0, 1.0))):
        assert_same(motion, name, Jet(np.array(place)), 2.0)


# ---------------------------------------------------------------------------------------------------------------
# platforms, plates and bodies


@pytest.mark.slow
def test_stewart_platform():
    motion, p = moved("stewart-platform"), drawn(built("stewart-platform")[0])
    points = {f"B{k}": p[f"A{k}"] for k in range(1, 7)} | {f"P{k}": p[f"B{k}"] for k in range(1, 7)} | {"P": p["P"]}
    legs = np.stack([np.asarray(motion[f"s{k}"]) for k in range(1, 7)], -1)
    want = platforms.stewart_pose(points, legs)
    assert_same(motion, "P", want["P"], 1.0)
    for k in range(1, 7):
        assert_same(motion, f"B{k}", want[f"P{k}"], 1.0)


@pytest.mark.slow
def test_delta_robot():
    motion, p = moved("delta-robot"), drawn(built("delta-robot")[0])
    points = {"P": p["T"]}
    for k in "123":
        points |= {f"A{k}": p[f"A{k}"], f"v{k}": p[f"u{k}"]}
        points |= {f"B{k}": (p[f"P{k}"] + p[f"Q{k}"]) / 2, f"C{k}": (p[f"R{k}"] + p[f"S{k}"]) / 2}
    want = platforms.delta_robot(points, *(np.asarray(motion[f"phi{k}"]) - 0.3 for k in "123"))
    assert_same(motion, "T", want["P"], 1.0)
    for k in "123":
        assert np.max(np.abs((motion[f"R{k}"] + motion[f"S{k}"]) / 2 - want[f"C{k}"].x)) <= POSITION
        assert_same(motion, f"R{k}", want[f"C{k}"] + (p[f"R{k}"] - points[f"C{k}"]), 1.0)


@pytest.mark.slow
def test_wobble_plate():
    motion = moved("wobble-plate")
    phi, tilt, radius, rod = np.asarray(motion["phi"]), 0.35, 0.04, 0.08
    n = np.stack([np.sin(tilt) * np.cos(phi), np.sin(tilt) * np.sin(phi), np.full_like(phi, np.cos(tilt))], -1)
    g = np.cross((0.0, 1.0, 0.0), n)  # across the journal, in the plane of the groove
    g = g / np.linalg.norm(g, axis=-1, keepdims=True)
    h = np.cross(n, g)
    assert_same(motion, "G", Jet(0.05 * g), 0.1)
    for k in range(5):
        around = (k + 0.5) * 2 * np.pi / 5
        joint = radius * (np.cos(around) * g + np.sin(around) * h)
        off = joint[:, :2] - radius * np.array((np.cos(around), np.sin(around)))
        assert_same(motion, f"P{k + 1}", Jet(joint), 0.1)
        assert_same(motion, f"Q{k + 1}.z", Jet(joint[:, 2] - np.sqrt(rod**2 - np.sum(off**2, -1))), 0.1)


@pytest.mark.slow
def test_general_body_turns_about_its_hinge():
    motion, p = moved("general-body"), drawn(built("general-body")[0])
    phi = np.asarray(motion["phi"])
    turn = np.array(
        [[np.cos(phi), -np.sin(phi), 0 * phi], [np.sin(phi), np.cos(phi), 0 * phi], [0 * phi, 0 * phi, 0 * phi + 1]]
    )
    for k in range(3, 8):
        assert_same(motion, f"P{k}", Jet(np.einsum("ijt,j->ti", turn, p[f"P{k}"])), 1.0)
    for k in range(1, 4):
        assert_same(motion, f"v{k}", Jet(np.einsum("ijt,j->ti", turn, p[f"v{k}"] / np.linalg.norm(p[f"v{k}"]))), 1.0)


@pytest.mark.slow
def test_a_free_body_stays_rigid():
    motion, p = moved("general-body, free"), drawn(built("general-body, free")[0])
    for a in range(1, 8):
        for b in range(a + 1, 8):
            want = np.linalg.norm(p[f"P{a}"] - p[f"P{b}"])
            assert np.max(np.abs(distance(motion, f"P{a}", f"P{b}") - want)) <= POSITION


# ---------------------------------------------------------------------------------------------------------------
# files and mistakes


@pytest.mark.parametrize("name", CASES)
def test_the_model_survives_a_file(name, tmp_path):
    mechanism = CASES[name][0]()
    assert nc.load(mechanism.save(tmp_path / "model.toml")).model == mechanism.model


MISTAKES = [
    (library.rscr, {"places": {"4": (0.0, 0.0, 0.0)}}, ["no '4'", "known names: 1, 2, 3"]),
    (library.rscr, {"places": {"vB": (0.0, 0.0, 0.0)}}, ["places['vB']", "zero vector"]),
    (library.rscr, {"places": {"vB": (0.36, 0.48, 0.80)}}, ["v1 and vB", "parallel"]),
    (library.rscr, {"places": {"1": (0.0, 0.0, 0.1)}}, ["'1'", "axis", "'vA'", "move it off"]),
    (library.rscr, {"places": {"1": (0.2, 0.0, 0.03)}}, ["dead point", "move its places"]),
    (library.rssr, {"places": {"2": (0.1, 0.2)}}, ["places['2']", "three numbers"]),
    (library.rssr, {"places": {"2": (0.1, 0.0, math.nan)}}, ["places['2'][2]", "finite"]),
    (library.rssr, {"places": {"2": (0.1, 0.0, 0.0)}}, ["'1' and '2'", "same place"]),
    (
        library.rssp,
        {"places": {"1": (0.35, 0.06, 0.0), "2": (0.35, 0.06, 0.1), "v2": (1, 0, 0)}},
        ["rod 1-2", "across"],
    ),
    (library.rccc, {"places": {"vB": (0.0, 0.0, 2.0)}}, ["vA and vB", "parallel"]),
    (library.cardan_joint, {"shaft_angle": 1.6}, ["shaft_angle = 1.6", "π/2"]),
    (library.cardan_shafts, {"places": {"D": (-1.0, 0.08, -0.15)}}, ["B-C and C-D", "90°"]),
    (library.cardan_shafts, {"places": {"v1": (-1.0, 0.0, 0.0)}}, ["v1", "A-B", "parallel"]),
    (library.steering_column, {"pinion_radius": -0.007}, ["pinion_radius", "positive"]),
    (library.bevel_gears, {"shaft_angle": 3.0}, ["shaft_angle = 3", "radius2 = 0.06", "below 2.09"]),
    (library.bennett, {"opposite_twist": 0.7}, ["twist = 0.7", "different"]),
    (library.bennett, {"twist": 4.0}, ["twist = 4", "between 0 and π"]),
    (library.four_bar_in_space, {"ground": 1.0}, ["coupler = 0.12", "rocker = 0.08"]),
    (library.double_hinged_door, {"lower": 1.8}, ["lower = 1.8", "upper = 1.75", "ascend"]),
    (library.stewart_platform, {"base_spread": 0.0}, ["base_spread = 0", "between 0 and 2π/3"]),
    (library.stewart_platform, {"base_spread": math.pi / 3, "platform_spread": math.pi / 3}, ["similar", "change one"]),
    (library.delta_robot, {"forearm": 0.2}, ["forearm = 0.2", "lengthen"]),
    (library.spherical_four_bar, {"crank": 4.0}, ["crank = 4", "between 0 and π"]),
    (library.spherical_four_bar, {"coupler": 0.2, "rocker": 0.2}, ["coupler = 0.2", "do not close"]),
    (library.spherical_four_bar, {"branch": "up"}, ["branch='up'", "'open', 'crossed'"]),
    (library.wobble_plate, {"pistons": 0}, ["pistons", "at least 1"]),
    (library.wobble_plate, {"tilt": 2.0}, ["tilt = 2", "π/2"]),
    (library.wobble_plate, {"rod": 0.001}, ["rod = 0.001", "too short"]),
    (library.general_body, {"form": "best"}, ["form='best'", "'exact', 'text'"]),
    (library.general_body, {"places": {"P3": (0.0, 0.0, 0.1)}}, ["'P3'", "axis"]),
]


@pytest.mark.parametrize(("make", "dimensions", "says"), MISTAKES)
def test_impossible_dimensions_are_named(make, dimensions, says):
    with pytest.raises(nc.MechanismError) as caught:
        make(**dimensions)
    for text in (make.__name__, *says):
        assert text in str(caught.value), str(caught.value)
