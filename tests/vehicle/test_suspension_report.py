"""What a suspension is judged by: centres by construction with lines, exact gradients, the report, plots, the tyre."""

import functools
import json
import math

import numpy as np
import pytest
from independent import suspensions
from independent.jets import Jet

import jaxnc as nc
from jaxnc.errors import InputError
from jaxnc.library.suspensions import double_wishbone, five_link, macpherson
from jaxnc.vehicle.report import _turn_differences, suspension_report
from jaxnc.viz.poses import poses
from jaxnc.viz.spatial.scene import Solid
from jaxnc.viz.spatial.sketch import sketch_space

LENGTH, ANGLE = 1e-8, 1e-11  # mm, rad; measured: 3e-10 of 3000 mm, 1e-14
GRADIENT = 1e-7  # of the gradient: what differences of the sixth order over millimetres leave
RADIUS = 310.0
INPUT = {"macpherson": ("6.z", "10.y", "7.x"), "double_wishbone": ("wheel_centre.z", "tie_inner.y", "rim.x")}
MADE = {"macpherson": macpherson, "double_wishbone": double_wishbone}
both = pytest.mark.parametrize("name", MADE)


@functools.cache
def system(name):
    return MADE[name]().compile()


@functools.cache
def bump(name, *travel):
    height, rack, spin = INPUT[name]
    s = system(name)
    return nc.sweep(s, {height: float(s[height[:-2]][2]) + np.array(travel)}, hold=[rack, spin])


@functools.cache
def steered(name):
    height, rack, spin = INPUT[name]
    s = system(name)
    return nc.sweep(s, {rack: float(s[rack[:-2]][1]) + np.linspace(-60.0, 60.0, 9)}, hold=[height, spin])


# -- centres --------------------------------------------------------------------------------------------------------


def plane(a, b, c):
    """Normal and offset of the plane through three points."""
    normal = np.cross(b - a, c - a)
    return normal, normal @ a


def pierced(*planes):
    """Where three planes meet."""
    return np.linalg.solve(np.array([n for n, _ in planes]), np.array([d for _, d in planes]))


def test_centres_of_a_double_wishbone_by_construction():
    """The knuckle turns about the line in which the planes of the arms meet, if the tie rod points at that line.

    Milliken, Race Car Vehicle Dynamics, ch. 17: where it pierces the transverse plane through the contact centre and
    the plane of the wheel are the instant centres of the front and the side view.
    """
    at = {
        "lower_front": (130, 360, 170), "lower_rear": (-190, 370, 165), "lower_ball": (8, 720, 155),
        "upper_front": (90, 440, 480), "upper_rear": (-150, 450, 445), "upper_ball": (-22, 655, 500),
        "wheel_centre": (0, 765, RADIUS), "spindle": (0, 865, RADIUS), "tie_outer": (120, 705, 200),
    }  # fmt: skip
    at = {name: np.array(place, float) for name, place in at.items()}
    arms = [plane(at[f"{arm}_front"], at[f"{arm}_rear"], at[f"{arm}_ball"]) for arm in ("lower", "upper")]
    front = pierced(*arms, (np.eye(3)[0], 0.0))
    side = pierced(*arms, (np.eye(3)[1], 765.0))
    at["tie_inner"] = at["tie_outer"] + 0.2 * (front + 0.1 * (side - front) - at["tie_outer"])
    s = double_wishbone({name: tuple(place) for name, place in at.items()}).compile()
    found = nc.suspension(nc.solve_position(s, {"wheel_centre.z": RADIUS}, hold=["tie_inner.y", "rim.x"]))
    for name, want in {
        "swing_arm_length": 765.0 - front[1],
        "instant_centre_height": front[2],
        "roll_centre_height": front[2] * 765.0 / (765.0 - front[1]),
        "side_swing_arm_length": -side[0],
        "side_instant_centre_height": side[2],
        "track": 2 * 765.0,
    }.items():
        assert float(getattr(found, name)) == pytest.approx(want, abs=LENGTH * max(1.0, abs(want))), name
    assert float(found.brake_support_angle) == pytest.approx(math.atan(side[2] / -side[0]), abs=ANGLE)
    assert float(found.drive_support_angle) == pytest.approx(math.atan((side[2] - RADIUS) / -side[0]), abs=ANGLE)


def test_the_roll_centre_of_a_strut_by_construction():
    """In one plane: the lower arm's line and the line across the strut at its top meet in the instant centre."""
    s = macpherson({
        "lower_front": (100, 375, 215), "lower_rear": (-100, 375, 215), "lower_ball": (0, 715, 190),
        "strut_lower": (0, 640, 420), "strut_top": (0, 565, 860), "tie_inner": (-130, 375, 215),
        "tie_outer": (-130, 715, 190), "wheel_centre": (0, 760, RADIUS), "spindle": (0, 860, RADIUS),
    }).compile()  # fmt: skip
    found = nc.suspension(nc.solve_position(s, {"6.z": RADIUS}, hold=["10.y", "7.x"]))
    strut = np.array([-75.0, 440.0])
    a = np.array([[25.0, 340.0], strut])  # across the arm, and along the strut, as (y, z)
    y, z = np.linalg.solve(a, [a[0] @ (375.0, 215.0), strut @ (565.0, 860.0)])
    assert float(found.swing_arm_length) == pytest.approx(760.0 - y, abs=LENGTH * 3e3)
    assert float(found.instant_centre_height) == pytest.approx(z, abs=LENGTH * 3e3)
    assert float(found.roll_centre_height) == pytest.approx(760.0 * z / (760.0 - y), abs=LENGTH)
    assert float(found.brake_support_angle) == pytest.approx(0.0, abs=ANGLE)


@both
def test_side_view_and_wheel_offsets_against_the_formulation_by_rotations(name):
    """The knuckle's angular velocity from the velocities of three of its points."""
    travel, rack = np.array([-60.0, 0.0, 25.0, 70.0]), np.array([20.0, 0.0, -15.0, 30.0])
    height, steer, spin = INPUT[name]
    s = system(name)
    inputs = {height: float(s[height[:-2]][2]) + travel, steer: float(s[steer[:-2]][1]) + rack}
    found = nc.suspension(nc.solve_position(s, inputs, hold=[spin]))
    want = getattr(suspensions, name)(travel=Jet(travel / 1e3, np.ones(4)), rack=rack / 1e3)
    centre, contact = want["wheel_centre"], want["contact"]
    for k in range(4):
        r = [want[p].x[k] - centre.x[k] for p in ("lower_ball", "tie_outer", "spindle")]
        v = [want[p].v[k] - centre.v[k] for p in ("lower_ball", "tie_outer", "spindle")]
        cross = np.concatenate([-np.cross(np.eye(3), x).T for x in r])  # ω × r, as a matrix times ω
        omega = np.linalg.lstsq(-cross, np.concatenate(v), rcond=None)[0]
        omega = omega if np.allclose(np.cross(omega, r[0]), v[0]) else -omega
        locked = centre.v[k] + np.cross(omega, contact.x[k] - centre.x[k])
        assert float(found.brake_support_angle[k]) == pytest.approx(math.atan(locked[0] / locked[2]), abs=ANGLE)
        assert float(found.drive_support_angle[k]) == pytest.approx(math.atan2(*centre.v[k][[0, 2]]), abs=ANGLE)
        arm = float(found.side_swing_arm_length[k]) / 1e3
        still = np.array([-arm, 0.0, float(found.side_instant_centre_height[k]) / 1e3])
        assert np.abs((locked + np.cross(omega, still))[[0, 2]]).max() <= 1e-11
        swing = -contact.v[k][2] / (want["camber"].v[k] * math.cos(want["steer"].x[k]))
        assert float(found.swing_arm_length[k]) / 1e3 == pytest.approx(swing, rel=1e-11)
        king = want["upper_ball"].x[k] - want["lower_ball"].x[k]
        level = want["lower_ball"].x[k] + king * (centre.x[k] - want["lower_ball"].x[k])[2] / king[2] - centre.x[k]
        ahead = np.array([math.cos(want["steer"].x[k]), math.sin(want["steer"].x[k]), 0.0])
        assert float(found.caster_offset[k]) / 1e3 == pytest.approx(level @ ahead, abs=1e-12)
        inward = np.array([ahead[1], -ahead[0], 0.0])
        assert float(found.kingpin_offset[k]) / 1e3 == pytest.approx(level @ inward, abs=1e-12)


def rotation(turn):
    """The matrix of a rotation vector."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / angle if angle else turn
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k


def knuckle(at, rise, rack, damper=None):
    """The turn and place of a five-link's knuckle: five lengths and the wheel's height, or a sixth, by Newton."""
    names = ["lower_front", "lower_rear", "upper_front", "upper_rear", "tie"]
    inner, outer = (np.array([at[f"{n}_{end}"] for n in names], float) for end in ("inner", "outer"))
    lengths, centre = np.linalg.norm(outer - inner, axis=1), np.array(at["wheel_centre"], float)
    inner[4, 1] += rack

    def gap(x):
        moved = centre + x[3:] + (outer - centre) @ rotation(x[:3]).T
        own = damper_length(at, rotation(x[:3]), centre + x[3:])
        return np.append(
            np.linalg.norm(moved - inner, axis=1) - lengths, x[5] - rise if damper is None else own - damper
        )

    x = np.array([0.0, 0.0, 0.0, 0.0, 0.0, rise])
    for _ in range(20):
        steps = np.diag([1e-6] * 3 + [1e-3] * 3)
        slopes = np.stack([(gap(x + h) - gap(x - h)) / (2 * h.max()) for h in steps], axis=1)
        x = x - np.linalg.solve(slopes, gap(x))
    assert np.abs(gap(x)).max() < 1e-9
    return rotation(x[:3]), centre + x[3:]


def damper_length(at, turn, centre):
    """Length of the damper between the knuckle and its top."""
    lower = centre + turn @ np.subtract(at["damper_lower"], at["wheel_centre"])
    return float(np.linalg.norm(lower - at["damper_top"]))


def test_five_links_against_their_lengths():
    m = five_link()
    at = {name: getattr(p, "at", p) for name, p in m.model.points.items()} | m.model.ground
    travel, rack = np.array([-70.0, 0.0, 40.0, 80.0]), np.array([20.0, 0.0, -35.0, 10.0])
    inputs = {"wheel_centre.z": RADIUS + travel, "tie_inner.y": at["tie_inner"][1] + rack}
    motion = nc.solve_position(m.compile(), inputs, hold=["rim.x"], throw=True)
    found = nc.suspension(motion, steer="tie_inner.y")
    axle = np.subtract(at["spindle"], at["wheel_centre"])
    for k in range(4):
        turn, centre = knuckle(at, travel[k], rack[k])
        np.testing.assert_allclose(motion["wheel_centre"][k], centre, atol=1e-8)
        axis = turn @ axle / np.linalg.norm(axle)
        assert float(found.camber[k]) == pytest.approx(-math.asin(axis[2]), abs=1e-10)
        assert float(found.toe[k]) == pytest.approx(math.atan2(axis[0], axis[1]), abs=1e-10)
        # The axis of the small turn between two places of the rack, the damper held, by differences: its direction as
        # (caster, kingpin).
        held = damper_length(at, turn, centre)
        one, other = (knuckle(at, travel[k], rack[k] + h, held)[0] for h in (-0.01, 0.01))
        small = other @ one.T
        way = np.array([small[2, 1] - small[1, 2], small[0, 2] - small[2, 0], small[1, 0] - small[0, 1]])
        way *= np.sign(way[2])
        assert float(found.caster[k]) == pytest.approx(math.atan2(-way[0], way[2]), abs=1e-6)
        assert float(found.kingpin_inclination[k]) == pytest.approx(math.atan2(-way[1], way[2]), abs=1e-6)
    mobility = nc.mobility(motion.system)
    assert (mobility.n, mobility.rows, mobility.rank, mobility.dof) == (29, 26, 26, 3)


# -- the report -----------------------------------------------------------------------------------------------------


@both
def test_gradients_are_those_of_the_curves(name):
    steps = tuple(float(k) for k in range(-3, 4))
    report = suspension_report(bump(name, *steps))
    weights = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0
    for row in report.rows:
        slope = float(report.curves[row.name] @ weights)  # per millimetre
        per = 1e3 if row.gradient_unit.endswith("/m") else 1.0
        assert row.gradient == pytest.approx(per * slope, rel=GRADIENT, abs=per * 1e-9), row.name
        assert row.static == pytest.approx(report.curves[row.name][3], abs=1e-9), row.name
        assert (row.smallest, row.largest) == (report.curves[row.name].min(), report.curves[row.name].max())
    assert report["camber"].gradient_unit == "deg/m"
    assert report["track"].gradient == pytest.approx(2.0 * report["half_track_change"].gradient, rel=1e-12)


def test_steering_by_an_angle_is_told_in_degrees():
    """An arm of 100 mm, at a right angle to the rack, moves it by 100 mm per radian."""
    m = double_wishbone()
    m.ground("box", (230.0, 370.0, 205.0))
    m.ground_vector("up", (0.0, 0.0, 1.0))
    m.angle("arm", at="box", to="tie_inner", about="up")
    turns = np.array([-0.02, 0.0, 0.02])
    report = suspension_report(nc.sweep(m.compile(), {"arm": turns}, hold=["wheel_centre.z", "rim.x"]))
    np.testing.assert_allclose(report.along, np.degrees(turns), atol=1e-9)
    assert report.unit == "deg"
    by_rack = suspension_report(steered("double_wishbone"))
    for name, unit in (("steer", "deg/deg"), ("caster_trail", "mm/deg")):
        assert report[name].gradient == pytest.approx(by_rack[name].gradient * -100.0 * math.pi / 180.0, rel=1e-7)
        assert report[name].gradient_unit == unit


def test_steering_with_the_spring_held_is_told_over_the_rack():
    """Numbers along the travel are those with the wheel's height driven: the pose and the rack are the same."""
    s, rack = system("double_wishbone"), {"tie_inner.y": 370.0 + np.array([-20.0, 0.0, 20.0])}
    motion = nc.sweep(s, rack, hold=["damper", "rim.x"])
    report, found = suspension_report(motion), nc.suspension(motion)
    assert (report.over, len(nc.report(motion).verdict.wheels)) == ("rack travel, tie_inner.y", 1)
    np.testing.assert_allclose(report.along, [-20.0, 0.0, 20.0], atol=1e-9)
    want = suspensions.double_wishbone(travel=Jet(0.0, 1.0))
    for name in ("roll_centre_height", "motion_ratio"):
        value = float(np.ravel(getattr(want[name], "x", want[name]))[0])
        unit = 1e3 if name == "roll_centre_height" else 1.0
        assert float(getattr(found, name)[1]) == pytest.approx(unit * value, rel=1e-9)
    slope = (found.steer[2] - found.steer[0]) / 40.0
    assert report["steer"].gradient == pytest.approx(math.degrees(slope), rel=0.01)


def test_support_angles_where_the_driven_spring_shortens_as_the_wheel_rises():
    by_height = bump("double_wishbone", -30.0, 0.0, 30.0)
    by_spring = nc.sweep(by_height.system, {"damper": np.asarray(by_height["damper"])}, hold=["tie_inner.y", "rim.x"])
    found = nc.suspension(by_spring)
    centre = suspensions.double_wishbone(travel=Jet(np.array([-0.03, 0.0, 0.03]), np.ones(3)))["wheel_centre"]
    want = [math.atan(v[0] / v[2]) for v in centre.v]
    np.testing.assert_allclose(found.drive_support_angle, want, atol=1e-9)
    contact = np.asarray(by_height["contact"])
    # Locked, the contact moves as a point of the knuckle does.
    slope = (contact[2] - contact[0])[[0, 2]]
    assert float(found.brake_support_angle[1]) == pytest.approx(math.atan(slope[0] / slope[1]), abs=1e-3)


def test_arguments_that_are_mistakes_are_refused():
    motion = bump("double_wishbone", -10.0, 10.0)
    for options, said in (
        ({"radius": -310.0}, "must be positive"),
        ({"contact": "damper"}, "a point or marker"),
        ({"wheel_centre": "damper"}, "a point or marker"),
        ({"spin_axis": "damper"}, "a unit vector, or two points"),
        ({"spin_axis": ("spindle", "spindle")}, "a unit vector, or two points"),
        ({"steering_axis": ("lower_ball", "upper_ball", "rim")}, "two points of the axis"),
        ({"spring": ("damper_top", "damper_top")}, "a distance, or the two points"),
    ):
        with pytest.raises(InputError, match=said):
            nc.suspension(motion, **options)
    for options in ({"mass_height": 0.0}, {"wheelbase": -1.0}, {"brake_share": 60.0}):
        with pytest.raises(InputError, match=f"{next(iter(options))}=.* must be"):
            suspension_report(motion, **options)
    with pytest.raises(InputError, match="no 'steer'"):
        suspension_report(motion)["steer"]


def test_five_links_with_a_drawn_point_of_contact_are_reported():
    m = five_link()
    del m.model.markers["contact"]
    m.point("contact", (0.0, 770.0, 0.0))
    m.model.bodies["knuckle"].points.append("contact")
    motion = nc.sweep(m.compile(), {"wheel_centre.z": np.linspace(300.0, 320.0, 3)}, hold=["tie_inner.y", "rim.x"])
    names = [row.name for row in nc.report(motion).verdict.wheels[0].numbers]
    assert "camber" in names
    assert "caster" not in names


def test_gradients_of_an_instantaneous_steering_axis():
    """Its numbers follow from rates, so that their gradients need mixed second derivatives."""
    motion, steps = bump("double_wishbone", *(float(k) for k in range(-3, 4))), np.array([-1, 9, -45, 0, 45, -9, 1])
    report = suspension_report(motion, steer="tie_inner.y")
    for name in ("caster", "kingpin_inclination", "scrub_radius", "caster_trail"):
        slope = float(report.curves[name] @ steps) / 60.0
        per = 1e3 if report[name].unit == "deg" else 1.0
        assert report[name].gradient == pytest.approx(per * slope, rel=1e-6), name


def test_ackermann():
    wheelbase, track = 2600.0, 1500.0
    rack = np.linspace(-50.0, 50.0, 11)
    inner = np.radians(0.5 * np.abs(rack))
    outer = np.arctan2(np.sin(inner), np.cos(inner) + track / wheelbase * np.sin(inner))  # cot δo = cot δi + t / L
    ideal = np.degrees(np.where(rack < 0, inner, -outer))
    found = _turn_differences(ideal, rack, track, wheelbase, 1.0)
    np.testing.assert_allclose(np.delete(found["ackermann"], 5), 100.0, rtol=1e-9)
    np.testing.assert_allclose(found["toe_out_in_turns"], np.degrees(inner - outer), atol=1e-12)
    parallel = _turn_differences(-0.5 * rack, rack, track, wheelbase, 1.0)
    np.testing.assert_allclose(np.delete(parallel["ackermann"], 5), 0.0, atol=1e-9)
    assert not _turn_differences(-0.5 * rack[:-1], rack[:-1], track, wheelbase, 1.0)  # not as far either way


def test_toe_out_in_turns_needs_no_pose_at_the_drawing():
    s, ends = system("double_wishbone"), {}
    for count in (2, 3):
        rack = 370.0 + np.linspace(-40.0, 40.0, count)
        found = suspension_report(
            nc.sweep(s, {"tie_inner.y": rack}, hold=["wheel_centre.z", "rim.x"]), wheelbase=2600.0
        )
        ends[count] = [found.curves[name][[0, -1]] for name in ("toe_out_in_turns", "ackermann")]
        turned = suspensions.double_wishbone(travel=0.0, rack=np.array([-0.04, 0.0, 0.04]))["steer"].x
        want = np.degrees(turned[0] + turned[2] - 2.0 * turned[1])
        np.testing.assert_allclose(ends[count][0], want, atol=1e-9)
    np.testing.assert_allclose(ends[2], ends[3], atol=1e-9)


def test_the_report_says_all_of_it(tmp_path):
    report = suspension_report(
        steered("double_wishbone"), wheelbase=2600.0, mass_height=550.0, brake_share=0.6, drive_share=1.0
    )
    static = nc.suspension(steered("double_wishbone").pose(4))
    share = 100.0 * 0.6 * math.tan(float(static.brake_support_angle)) * 2600.0 / 550.0
    assert report.vehicle["anti-dive, braking"] == pytest.approx(share)
    assert report["steer"].gradient_unit == "deg/mm"
    text = str(report)
    for said in ("front left wheel", "rack travel, tie_inner.y", "Ackermann [%]", "lower ball joint", "ISO 8855"):
        assert said in text
    rows = [line for line in text.splitlines() if line.startswith("  ") and line.count("deg/mm") == 1]
    assert len(rows) == 4
    assert len({len(row) for row in rows}) == 1  # aligned to the last column
    read = json.loads(report.to_json(tmp_path / "report.json").read_text())
    assert read["rows"][0]["name"] == report.rows[0].name
    assert read["curves"]["ackermann"][4] is None  # straight ahead there is nothing to compare
    with pytest.raises(InputError, match="give a sweep"):
        suspension_report(steered("double_wishbone").pose(0))
    with pytest.raises(InputError, match=r"no number 'cambr'.*camber"):
        report.plot(names=["cambr"])


@pytest.mark.parametrize(
    ("motion", "axes"), [(lambda: bump("macpherson", -40.0, 0.0, 40.0), 12), (lambda: steered("macpherson"), 6)]
)
def test_every_number_has_axes_of_its_own(motion, axes):
    report = suspension_report(motion())
    figure = report.plot()
    assert len(figure.axes) == axes
    for ax in figure.axes:
        marks = [line for line in ax.lines if (line.get_gid() or "").startswith("static ")]
        for mark in marks:
            row = report[mark.get_gid().removeprefix("static ")]
            assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (0.0, row.static)
            assert ax.get_title(loc="left") == f"{row.label} [{row.unit}]" if row.unit else row.label
        assert marks or "toe-out" in ax.get_title(loc="left")
    assert ("bump" in {t.get_text() for t in figure.axes[-1].texts}) == report.travels


# -- pictures and names ---------------------------------------------------------------------------------------------


def test_a_tyre_stands_on_the_road():
    data = poses(bump("macpherson", -40.0, 0.0, 40.0))
    scene, x = sketch_space(data), data.every_column
    tyre, road = (next(i for i in scene.items if isinstance(i, Solid) and i.role == r) for r in ("tyre", "road"))
    centre, contact = (data.names.index(name) for name in ("6", "contact"))
    for pose in x:
        places, plate = tyre.vertices(pose, 0.0), road.vertices(pose, 0.0)
        axis = pose[len(data.names) + data.directions.index("v2")]
        off = places - pose[centre]
        radius = np.linalg.norm(off - np.outer(off @ axis, axis), axis=1).max()
        assert radius == pytest.approx(RADIUS, rel=1e-9)
        np.testing.assert_allclose(plate[:, 2], pose[contact, 2], atol=1e-9)
        assert abs(places[:, 2].min() - pose[contact, 2]) < 0.02 * RADIUS  # its shoulder is a little lower than a disc
    texts = {label.text for label in scene.labels}
    assert {"2 lower ball joint", "8 strut top", "10 tie rod inner", "7"} <= texts
    assert not any(
        i.role == "tyre"
        for i in sketch_space(poses(nc.solve_position(nc.library.rssr().compile(), {"phi": 1.0}))).items
    )


def test_model_files_and_sensitivities_name_hardpoints(tmp_path):
    m = macpherson()
    path = m.save(tmp_path / "strut.toml")
    assert "2 = [12, 715, 190]  # lower ball joint" in path.read_text().splitlines()
    assert nc.load(path).model == m.model
    table = nc.sensitivity(bump("macpherson", 0.0, 20.0), nc.suspension, variables=["2", "5"]).table("toe")
    assert all(
        "ball joint" in line or "tie rod outer" in line
        for line in table.splitlines()
        if "/mm" in line and "…" not in line[:6]
    )
