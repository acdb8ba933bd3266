"""Suspensions and sensitivities against a formulation by rotations (`independent.suspensions`) and closed forms."""

import csv
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from independent import suspensions
from independent.closure import hardpoint_gradient
from independent.jets import Jet

import jaxnc as nc
from jaxnc.kinematics import design
from jaxnc.kinematics.inputs import doubtful_size
from jaxnc.library import bennett
from jaxnc.library.suspensions import double_wishbone, macpherson
from jaxnc.vehicle.suspension import SIZES

POSITION, VELOCITY, ACCELERATION = 1e-12, 1e-11, 1e-10  # of a metre and its rates; measured: 1e-14 at most
ANGLE = 1e-12  # rad; measured: 2e-15
GRADIENT = 1e-8  # of an output's largest derivative: what central differences of the sixth order leave
POSES = 13
TRAVEL = np.linspace(-80.0, 80.0, POSES)  # mm
RACK = 30.0 * np.sin(np.linspace(-2.0, 2.0, POSES))  # mm
RISE, SHIFT = 1000.0, 200.0  # mm/s
MADE = {"macpherson": macpherson, "double_wishbone": double_wishbone}
HEIGHT = {"macpherson": ("6.z", "10.y", "7.x"), "double_wishbone": ("wheel_centre.z", "tie_inner.y", "rim.x")}
DRAWN = {"macpherson": suspensions.MACPHERSON, "double_wishbone": suspensions.DOUBLE_WISHBONE}
PLACES = {
    "macpherson": {"2": "lower_ball", "3": "strut_lower", "5": "tie_outer", "6": "wheel_centre", "10": "tie_inner"},
    "double_wishbone": {
        name: name for name in ("lower_ball", "upper_ball", "tie_outer", "wheel_centre", "spindle", "damper_lower")
    },
}
ANGLES = ("camber", "toe", "steer", "caster", "kingpin_inclination")
LENGTHS = ("scrub_radius", "caster_trail", "half_track_change", "roll_centre_height")
both = pytest.mark.parametrize("name", MADE)


@functools.cache
def system(name):
    return MADE[name]().compile()


@functools.cache
def moved(name):
    """A motion over bump and steer together, with rates, and what it has to be."""
    height, rack, spin = HEIGHT[name]
    s = system(name)
    inputs = {height: float(s[height[:-2]][2]) + TRAVEL, rack: float(s[rack[:-2]][1]) + RACK}
    motion = nc.solve_position(s, inputs, hold=[spin], rates={height: RISE, rack: SHIFT})
    expected = getattr(suspensions, name)(
        travel=Jet(TRAVEL / 1e3, RISE / 1e3), rack=Jet(RACK / 1e3, np.full(POSES, SHIFT / 1e3))
    )
    return motion, expected


# -- the two of the library -----------------------------------------------------------------------------------------


@both
def test_the_library_is_drawn_as_the_independent_formulation(name):
    numbers = {"lower_front": "1", "strut_top": "8"} | {v: k for k, v in PLACES[name].items()}
    for place, at in DRAWN[name].items():
        known = place if name == "double_wishbone" else numbers.get(place)
        if known is not None:
            np.testing.assert_allclose(np.asarray(system(name)[known]), 1e3 * at, rtol=1e-14)


@pytest.mark.parametrize("form", ["text", pytest.param("exact", marks=pytest.mark.slow)])
def test_macpherson_has_the_counts_of_the_text(form):
    found = nc.mobility(system("macpherson") if form == "text" else macpherson(form=form).compile())
    assert (found.n, found.rows, found.rank, found.dof) == (29, 28, 26, 3)
    assert [row.partition(":")[0] for row in found.redundant] == ["damper", "damper"]  # two of six alignments


def test_double_wishbone_counts():
    found = nc.mobility(system("double_wishbone"))
    assert (found.n, found.rows, found.rank, found.dof) == (23, 20, 20, 3)


@both
def test_positions_velocities_accelerations(name):
    motion, expected = moved(name)
    assert bool(motion.converged.all())
    for point, other in PLACES[name].items():
        for look, want, tolerance in zip(
            (motion.__getitem__, motion.velocity, motion.acceleration),
            expected[other],
            (POSITION, VELOCITY, ACCELERATION),
            strict=True,
        ):
            scale = max(1.0, float(np.abs(want).max()))
            assert np.abs(np.asarray(look(point)) / 1e3 - want).max() <= tolerance * scale, point


@both
def test_wheel_attitude(name):
    motion, expected = moved(name)
    found = nc.suspension(motion)
    for output in ANGLES:
        assert np.abs(np.asarray(getattr(found, output)) - expected[output].x).max() <= ANGLE, output
    for output in LENGTHS:
        want = getattr(expected[output], "x", expected[output])
        assert np.abs(np.asarray(getattr(found, output)) / 1e3 - want).max() <= POSITION, output
    assert np.abs(np.asarray(found.wheelbase_change) / 1e3 + expected["recession"].x).max() <= POSITION
    assert np.abs(np.asarray(found.wheel_travel) - TRAVEL).max() <= 1e3 * POSITION
    ratio = getattr(expected["motion_ratio"], "x", expected["motion_ratio"])
    assert np.abs(np.asarray(found.motion_ratio) - ratio).max() <= VELOCITY
    assert np.abs(np.asarray(found.contact) / 1e3 - expected["contact"].x).max() <= POSITION


@both
def test_full_travel_converges(name):
    """The default drive's whole range with the rack held, as `jaxnc run` takes it: few of its poses, in order."""
    height, rack, spin = HEIGHT[name]
    z = float(system(name)[height[:-2]][2]) + TRAVEL
    motion = nc.sweep(system(name), {height: z, rack: np.full(POSES, float(system(name)[rack[:-2]][1]))}, hold=[spin])
    assert bool(motion.converged.all())
    run = MADE[name]().model.run
    assert (run.inputs[height].start, run.inputs[height].end) == (z[0], z[-1])
    assert run.hold == [rack, spin]


@pytest.mark.slow
def test_toe_of_a_traced_motion_derives_no_equations(monkeypatch):
    motion, _ = moved("double_wishbone")

    def refused(system):
        raise AssertionError("toe and camber are read off the wheel's axis")

    monkeypatch.setattr(design, "derive", refused)
    for name in ("toe", "camber"):
        assert jax.eval_shape(lambda m, name=name: getattr(nc.suspension(m), name), motion).shape == (POSES,)
    with pytest.raises(AssertionError, match="axis"):
        jax.eval_shape(lambda m: nc.suspension(m).roll_centre_height, motion)


def test_a_grid_of_bump_and_steer_in_one_call():
    s = system("macpherson")
    bump, steer = np.meshgrid(310.0 + np.linspace(-80, 80, 51), 360.0 + np.linspace(-60, 60, 51), indexing="ij")
    motion = nc.solve_position(s, {"6.z": bump, "10.y": steer}, hold=["7.x"])
    assert motion.status.shape == (51, 51)
    assert int(motion.failures) == 0
    expected = suspensions.macpherson(travel=(bump[::10, ::10] - 310.0) / 1e3, rack=(steer[::10, ::10] - 360.0) / 1e3)
    assert np.abs(np.asarray(motion["5"])[::10, ::10] / 1e3 - expected["tie_outer"].x).max() <= POSITION
    toe = jax.jit(lambda mo: nc.suspension(mo).toe)(motion)  # one program
    assert np.abs(np.asarray(toe)[::10, ::10] - expected["toe"].x).max() <= ANGLE


# -- gradients ------------------------------------------------------------------------------------------------------


def by_hardpoints(found, output):
    """Derivatives of a MacPherson suspension with respect to its designer's hardpoints, from those of its points."""
    g = functools.partial(lambda variable: found[output, variable])
    at = {k: 1e3 * v for k, v in suspensions.MACPHERSON.items()}
    arm = np.linalg.norm(at["lower_front"] - at["lower_rear"])
    axle = np.linalg.norm(at["spindle"] - at["wheel_centre"])
    return {
        "lower_front": g("1") + g("v1") / arm,
        "lower_rear": -g("v1") / arm,
        "lower_ball": g("2"),
        "strut_lower": g("3") + 0.65 * g("4") + 0.38 * g("9"),  # 4 and 9 are drawn on the line from 3 to 8
        "strut_top": g("8") + 0.35 * g("4") + 0.62 * g("9"),
        "tie_inner": g("10"),
        "tie_outer": g("5"),
        "wheel_centre": g("6") - g("v2") / axle,
        "spindle": g("v2") / axle,
    }


@both
def test_gradients_with_respect_to_every_hardpoint(name):
    motion, _ = moved(name)
    # By the host; test_read_off_host asks JAX for the same.
    found = nc.sensitivity(motion, functools.partial(nc.suspension, radius=310.0))
    assert found.exists.all()
    assert found.failures == 0
    outputs = (*ANGLES, *LENGTHS, "motion_ratio")
    height, rack = (np.asarray(motion.inputs[k]) / 1e3 for k in HEIGHT[name][:2])

    def independent(p):
        pose = getattr(suspensions, name)(
            p, travel=height - p["wheel_centre"][..., 2], rack=rack - p["tie_inner"][..., 1]
        )
        return np.stack([np.broadcast_to(getattr(pose[o], "x", pose[o]), pose["camber"].shape) for o in outputs], -1)

    expected = hardpoint_gradient(independent, DRAWN[name])
    for k, output in enumerate(outputs):
        size = max(np.abs(want[:, k]).max() for want in expected.values())
        if name == "macpherson":
            got = by_hardpoints(found, output)
        else:
            got = {point: found[output, point] for point in expected}
        unit = 1.0 if output in LENGTHS else 1e3  # per millimetre, to per metre
        for point, want in expected.items():
            assert np.abs(unit * got[point] - want[:, k]).max() <= GRADIENT * size, (output, point)


@pytest.fixture(scope="module")
def four_bar():
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0)), m.ground("D", (4, 0))
    m.point("B", (0.6, 0.8)), m.point("C", (3.3, 2.9)), m.point("P", (1.8, 3.0))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C", "P"])
    m.body("rocker", ["C", "D"], lengths={("C", "D"): 3.0})
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="D", to="C")
    return m.compile()


def test_sensitivities_are_the_derivatives_of_the_whole_analysis(four_bar):
    phi = np.array([0.4, 1.0, 1.7])
    found = nc.sensitivity(four_bar, ["P", "psi"], {"phi": phi})
    assert found["P"].shape == (3, 2, len(found.variables))
    exact = jax.jacfwd(lambda s: nc.solve_position(s, {"phi": phi})["psi"])(four_bar)
    for point in "ADBCP":
        np.testing.assert_allclose(found["psi", point], _of(exact, four_bar, point), atol=1e-13)
    k = found.variables.index("rocker.C-D")
    np.testing.assert_allclose(found["psi"][:, k], np.asarray(exact.parameters.dimensions)[:, 0], atol=1e-13)
    assert found.units == {"P": "m", "psi": "rad"}
    # One number: in reverse.
    mean = nc.sensitivity(four_bar, lambda mo: jnp.mean(mo["psi"]), {"phi": phi})
    np.testing.assert_allclose(mean["output"], found["psi"].mean(axis=0), atol=1e-13)


def _of(jacobian, s, point):
    return np.asarray(jacobian.parameters.points)[:, s.topology.points.index(point)]


def test_sensitivities_of_failed_poses_are_zero_and_counted(four_bar):
    short = four_bar.replace({"rocker.C-D": 1.0})
    found = nc.sensitivity(short, "psi", {"phi": [0.9, 3.0]})
    assert 0 < found.failures < 2
    assert np.isfinite(found["psi"]).all()
    assert not found["psi"][~found.converged].any()
    assert f"{found.failures} of 2 poses were not found" in str(found)
    # One answer that is not there raises, a batch is data; throw= changes either.
    lost = float(np.array([0.9, 3.0])[~found.converged][0])
    for inputs, throw in (({"phi": lost}, None), ({"phi": [0.9, 3.0]}, True)):
        with pytest.raises(nc.AssemblyError, match=r"poses failed.*does not assemble"):
            nc.sensitivity(short, "psi", inputs, throw=throw)
    assert not nc.sensitivity(short, "psi", {"phi": lost}, throw=False).converged


def test_the_table_is_sorted_and_has_units(four_bar, tmp_path):
    found = nc.sensitivity(four_bar, {"output angle": "psi"}, {"phi": 1.0}, variables=["A", "C", "rocker.C-D"])
    assert found.variables == ("A.x", "A.y", "C.x", "C.y", "rocker.C-D")
    lines = found.table(unit="deg", most=4).splitlines()
    rows = [line.split() for line in lines if "deg/m" in line and "smaller" not in line]
    sizes = [abs(float(row[1])) for row in rows]
    assert len(sizes) == 4
    assert sizes == sorted(sizes, reverse=True)
    name, value = rows[0][:2]
    assert float(value) == pytest.approx(math.degrees(float(found["output angle", name])), rel=1e-5)
    assert "rad/m" in found.table()
    path = found.to_csv(tmp_path / "psi.csv")
    header, row = csv.reader(path.read_text().splitlines())
    assert header[:4] == ["output", "unit", "pose", "phi"]
    assert row[:3] == ["output angle", "rad", "0"]
    assert float(row[header.index("C.y [m]")]) == float(found["output angle", "C.y"])
    with pytest.raises(nc.InputError, match="'rad' or 'deg'"):
        found.table(unit="grad")
    with pytest.raises(nc.InputError, match=r"no design variable 'Q'.*known names"):
        found["output angle", "Q"]


def test_an_overconstrained_mechanism_has_no_derivative():
    s = bennett().compile()
    name = s.topology.scalars[0]
    motion = nc.solve_position(s, {name: 1.1}, hold=())
    with pytest.raises(nc.AssemblyError, match=r"overconstrained.*assemble.*throw=False"):
        nc.sensitivity(motion, s.topology.points[-1])
    found = nc.sensitivity(motion, s.topology.points[-1], throw=False)
    assert not found.exists.all()
    assert not found[s.topology.points[-1]][..., ~found.exists].any()
    assert "no derivative exists with respect to" in str(found)


# -- any suspension -------------------------------------------------------------------------------------------------


def semi_trailing(outward: float) -> nc.System:
    m = nc.Mechanism("semi-trailing arm", dim=3, length_unit="mm")
    m.ground("inner", (450, outward * 250, 280)), m.ground("outer", (350, outward * 600, 280))
    m.point("hub", (0, outward * 720, 300))
    m.vector("axle", (0, outward, 0))
    m.body("arm", ["inner", "outer", "hub"], vectors=["axle"])
    return m.compile()


def test_a_semi_trailing_arm_on_either_side():
    rise = np.array([-40.0, 0.0, 40.0])
    sides = {}
    for side, outward in (("left", 1.0), ("right", -1.0)):
        s = semi_trailing(outward)
        motion = nc.solve_position(s, {"hub.z": 300.0 + rise})
        sides[side] = nc.suspension(motion, side, wheel_centre="hub", spin_axis="axle", radius=300.0, axle="rear")
        assert sides[side].caster is None
        assert sides[side].motion_ratio is None
        if side == "left":
            with pytest.raises(nc.InputError, match=r"side='right'.*'hub'.*720.*'left'"):
                nc.suspension(motion, "right", wheel_centre="hub", spin_axis="axle", radius=300.0)
            with pytest.raises(nc.InputError, match=r"usual names.*wheel_centre="):
                nc.suspension(motion)
            with pytest.raises(nc.InputError, match=r"tyre's radius is not known.*radius="):
                nc.suspension(motion, wheel_centre="hub", spin_axis="axle")
    for name, values in sides["left"].degrees().items():
        sign = -1.0 if name == "steer" else 1.0
        np.testing.assert_allclose(sides["right"].degrees()[name], sign * values, atol=1e-10)
    # By hand: rotation about the line inner-outer.
    axis = np.array([-100.0, 350.0, 0.0]) / math.hypot(100.0, 350.0)
    arm = np.array([-350.0, 120.0, 20.0])
    along, across = axis * (arm @ axis), np.cross(axis, arm)
    for k, dz in enumerate(rise):
        p, q = (arm - along)[2], across[2]
        angle = math.asin((20.0 + dz) / math.hypot(p, q)) - math.atan2(p, q)
        turned = axis * axis[1] + math.cos(angle) * (np.eye(3)[1] - axis * axis[1])
        turned = turned + math.sin(angle) * np.cross(axis, np.eye(3)[1])
        assert float(sides["left"].camber[k]) == pytest.approx(-math.asin(turned[2]), abs=ANGLE)
        assert float(sides["left"].toe[k]) == pytest.approx(math.atan2(turned[0], turned[1]), abs=ANGLE)


def test_a_right_wheel_in_traced_code_is_read_as_outside():
    s, rise = semi_trailing(-1.0), np.array([-20.0, 30.0])

    def read(s, **given):
        motion = nc.solve_position(s, {"hub.z": 300.0 + rise})
        return nc.suspension(motion, wheel_centre="hub", spin_axis="axle", radius=300.0, **given)

    want = read(s, side="right")
    for found in (read(s), jax.jit(read)(s)):
        for name in ("camber", "toe", "half_track_change", "track", "swing_arm_length", "roll_centre_height"):
            np.testing.assert_allclose(getattr(found, name), getattr(want, name), rtol=1e-9)
    with pytest.raises(nc.InputError, match=r"no motion_ratio that is known: it needs spring="):
        jax.jit(lambda s: read(s).motion_ratio)(s)
    with pytest.raises(nc.InputError, match=r"no caster that is known: it needs steering_axis="):
        jax.jit(lambda s: read(s).caster)(s)


def test_the_instantaneous_steering_axis_is_the_line_of_the_balls():
    """With the lower arm at rest the knuckle turns about its two ball joints, whatever drives the mechanism."""
    s = system("double_wishbone")
    length = float(np.linalg.norm(np.asarray(s["damper_lower"] - s["damper_top"])))
    for driven in ({"damper": length - 10.0}, {"wheel_centre.z": 320.0}):
        pose = nc.solve_position(s, {**driven, "tie_inner.y": 380.0}, hold=["rim.x"])
        known = nc.suspension(pose)
        found = nc.suspension(pose, carrier="knuckle", steer="tie_inner.y")
        for output in ("caster", "kingpin_inclination"):
            assert float(getattr(found, output)) == pytest.approx(float(getattr(known, output)), abs=ANGLE)
        for output in ("scrub_radius", "caster_trail"):
            assert float(getattr(found, output)) == pytest.approx(float(getattr(known, output)), abs=1e-9)


def test_the_table_is_in_degrees_and_millimetres(tmp_path):
    motion, _ = moved("double_wishbone")
    found = nc.suspension(motion)
    header, *rows = str(found).splitlines()
    assert "camber [deg]" in header
    assert "scrub radius [mm]" in header
    assert len(rows) == POSES
    assert float(rows[0].split()[0]) == TRAVEL[0]
    table = list(csv.reader(found.to_csv(tmp_path / "curves.csv").read_text().splitlines()))
    assert float(table[1][table[0].index("camber [deg]")]) == pytest.approx(math.degrees(float(found.camber[0])))


# -- bad input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "factor", "meant"), [("m", 1.0, "mm"), ("mm", 1e-3, "m")])
def test_millimetres_taken_for_metres_are_suspected(unit, factor, meant):
    m = nc.Mechanism("arm", dim=3, length_unit=unit)
    a, b, c = (tuple(factor * np.array(p)) for p in ((450, 250, 280), (350, 600, 280), (0, 720, 300)))
    m.ground("inner", a), m.ground("outer", b), m.point("hub", c), m.vector("axle", (0, 1, 0))
    m.body("arm", ["inner", "outer", "hub"], vectors=["axle"])
    s = m.compile()
    assert f"its numbers look like {meant}; set the length unit to '{meant}'" in doubtful_size(s)
    motion = nc.solve_position(s, {"hub.z": factor * 310.0})
    with pytest.warns(UserWarning, match=f"hardly meant.*{meant}"):
        nc.suspension(motion, wheel_centre="hub", spin_axis="axle", radius=factor * 300.0)
    assert not doubtful_size(system("double_wishbone"), "suspension", SIZES)


@pytest.mark.parametrize("make", [macpherson, double_wishbone])
def test_bad_hardpoints_are_named(make):
    with pytest.raises(nc.MechanismError, match=r"'lower_bal'.*did you mean 'lower_ball'"):
        make({"lower_bal": (0, 0, 0)})
    with pytest.raises(nc.MechanismError, match=r"\['tie_outer'\]\[1\].*finite"):
        make({"tie_outer": (0, math.nan, 0)})
    with pytest.raises(nc.MechanismError, match="spin axis is drawn vertical"):
        make({"wheel_centre": (0, 760, 310), "spindle": (0, 760, 410)})
    with pytest.raises(nc.MechanismError, match="radius must be positive"):
        make(radius=-1.0)


def test_macpherson_takes_either_name():
    assert macpherson({"2": (10, 710, 190)}).model == macpherson({"lower_ball": (10, 710, 190)}).model
    with pytest.raises(nc.MechanismError, match="'2' and 'lower_ball' are the same"):
        macpherson({"2": (10, 710, 190), "lower_ball": (10, 710, 190)})
    with pytest.raises(nc.MechanismError, match="'lower_rear' is there to draw 'v1'"):
        macpherson({"v1": (1, 0, 0), "lower_rear": (-300, 380, 220)})


def test_each_usual_name_counts_by_itself():
    m = nc.Mechanism("arm", dim=3, length_unit="mm")
    centre = np.array([-40.0, 720.0, 300.0])
    m.ground("A", (300, 350, 330)), m.ground_vector("v", (0.3, 1, 0.1)), m.ground("T", (-60, 500, 700))
    m.point("D", (-30, 520, 280)), m.point("C", centre), m.vector("spin_axis", (0.02, 1, -0.03))
    m.body("arm", ["A", "C", "D"], vectors=["v", "spin_axis"])
    m.distance("damper", "D", "T")
    m.marker("contact", on="arm", at=centre - (0, 0, 300))
    heights = 300.0 + 10.0 * np.linspace(-1, 1, 5)
    motion = nc.sweep(m.compile(), {"C.z": heights})
    found = nc.suspension(motion, wheel_centre="C")
    ratio = -np.gradient(np.asarray(motion["damper"]), heights)
    np.testing.assert_allclose(found.motion_ratio[1:-1], ratio[1:-1], rtol=1e-4)
    np.testing.assert_allclose(found.camber, nc.suspension(motion, None, "C", "spin_axis", radius=300.0).camber)
