"""The independent spatial mechanisms checked by themselves: closure, rates, and facts known in closed form."""

import numpy as np
import pytest

from independent import chains, linkages, loops, platforms, shafts, suspensions
from independent.closure import hardpoint_gradient
from independent.jets import Jet

TURN = np.linspace(0.0, 2 * np.pi, 25)
CLOSURE = 1e-13  # relative to the mechanism's size: a few roundings
RATE, ACCELERATION = 1e-8, 1e-7  # what differences of the sixth order over 1e-2 leave

WEIGHTS = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
WEIGHTS_2 = ((1, 3 / 2), (2, -3 / 20), (3, 1 / 90))


def assert_rates(f, u, h=4e-3):
    """Velocities and accelerations of everything f returns against differences of positions, along u̇ = 1.3, ü = 0.7."""
    v, a = 1.3, 0.7
    t = h * np.arange(-3, 4)[:, None]
    for name, q in f(Jet(u + v * t + 0.5 * a * t * t, v + a * t, a)).items():
        if not isinstance(q, Jet) or q.shape[:2] != (7, len(u)):
            continue
        first = sum(w * (q.x[3 + k] - q.x[3 - k]) for k, w in WEIGHTS) / h
        second = sum(w * (q.x[3 + k] + q.x[3 - k] - 2 * q.x[3]) for k, w in WEIGHTS_2) / h**2
        np.testing.assert_allclose(q.v[3], first, atol=RATE * max(1.0, np.max(np.abs(first))), err_msg=name)
        np.testing.assert_allclose(q.a[3], second, atol=ACCELERATION * max(1.0, np.max(np.abs(second))), err_msg=name)


def constant(values, want, size=1.0):
    """A length or scalar product that the joints keep."""
    assert np.max(np.abs(values - want)) <= CLOSURE * size


def distance(p, q):
    return np.linalg.norm(np.asarray(p) - np.asarray(q), axis=-1)


def volume_change(points, drawn):
    """Of the signed volume of four points: tells a rigid body from its mirror image."""
    return np.linalg.det(np.stack([p - points[0] for p in points[1:]], -2)) - np.linalg.det(
        np.stack([p - drawn[0] for p in drawn[1:]], -2)
    )


@pytest.mark.parametrize(
    "f, drawn", [(getattr(linkages, n.lower()), getattr(linkages, n)) for n in ("RSCR", "RSSR", "RSSP", "RCCC")]
)
def test_linkage_starts_and_ends_its_turn_in_the_drawing(f, drawn):
    out = f(phi=TURN)
    for name in set(out) & set(drawn):
        constant(out[name].x[[0, -1]], drawn[name])
    assert_rates(f_of(f), TURN[1:-1:3])


def f_of(f):
    return lambda phi: f(phi=phi)


def test_rscr_meets_the_twelve_equations():
    d, out = linkages.RSCR, {k: j.x for k, j in linkages.rscr(phi=TURN).items()}
    p1, p2, p3, v1 = (out[k] for k in ("1", "2", "3", "v1"))
    constant(distance(p1, d["A"]), distance(d["1"], d["A"]))
    constant((p1 - d["A"]) @ d["vA"], (d["1"] - d["A"]) @ d["vA"])
    constant(distance(p1, p2), distance(d["1"], d["2"]))
    constant(np.sum((p2 - p1) * v1, -1), (d["2"] - d["1"]) @ d["v1"])
    constant(np.linalg.norm(v1, axis=-1), 1.0)
    constant(np.cross(p3 - p2, v1), 0.0)
    constant(distance(p3, d["B"]), distance(d["3"], d["B"]))
    constant(np.sum((p3 - d["B"]) * v1, -1), (d["3"] - d["B"]) @ d["v1"])
    constant((p3 - d["B"]) @ d["vB"], (d["3"] - d["B"]) @ d["vB"])
    constant(v1 @ d["vB"], d["v1"] @ d["vB"])


def test_rssr_with_parallel_axes_is_freudensteins_four_bar():
    a, b, c, g = 0.1, 0.34, 0.25, 0.3
    start = np.array([a, 0.0])
    x = (b * b - c * c + (g - a) ** 2) / (2 * (g - a))
    pin = np.array([a + x, np.sqrt(b * b - x * x)])
    z = np.array([0.0, 0.0, 1.0])
    points = {"A": np.zeros(3), "vA": z, "1": [*start, 0.0], "2": [*pin, 0.0], "B": [g, 0.0, 0.0], "vB": z}
    out = linkages.rssr(points, TURN)
    psi = out["psi"].x + np.arctan2(pin[1], pin[0] - g)
    k1, k2, k3 = g / a, g / c, (a * a - b * b + c * c + g * g) / (2 * a * c)
    constant(k1 * np.cos(psi) - k2 * np.cos(TURN) + k3, np.cos(TURN - psi), 10.0)


def test_angle_from_a_direction_is_the_angle_of_the_crank():
    zero = np.array([0.0, 1.0, 0.0])
    out = linkages.rssr(phi=TURN, zero=zero)
    constant(out["1"].x @ zero, 0.1 * np.cos(TURN))


def test_rssp_slides_along_its_line():
    d, out = linkages.RSSP, linkages.rssp(phi=TURN)
    constant(distance(out["1"].x, out["2"].x), distance(d["1"], d["2"]))
    constant(np.cross(out["2"].x - d["2"], d["v2"]), 0.0)


def test_rccc_closes():
    d, out = linkages.RCCC, {k: j.x for k, j in linkages.rccc(phi=TURN).items()}
    vB, vC, vD = (np.asarray(v) / np.linalg.norm(v) for v in (d["vB"], d["vC"], d["vD"]))
    constant(np.sum(out["vB"] * out["vC"], -1), vB @ vC)
    constant(out["vC"] @ vD, vC @ vD)
    constant(np.cross(out["C_coupler"] - out["C"], out["vC"]), 0.0)
    constant(np.cross(out["B_coupler"] - out["B"], out["vB"]), 0.0)
    constant(distance(out["B_coupler"], out["C_coupler"]), distance(d["B"], d["C"]))
    constant(distance(out["C"], out["D"]), distance(d["C"], d["D"]))
    for name, v in (("B", vB), ("C", vC)):
        bar = out["C_coupler"] - out["B_coupler"]
        constant(np.sum(bar * out["v" + name], -1), (d["C"] - d["B"]) @ v)


CARDAN = {  # θ = 60°, ω = 10 rad/s: angle, rate and acceleration of the output shaft, from the published closed form
    15: (1.0620777700053343, 9.823775304100593, -5.796103815263515),
    30: (1.1071487177940904, 9.237604307034012, -21.333333333333332),
}


@pytest.mark.parametrize("beta", CARDAN)
def test_cardan_joint_has_the_known_angle_rate_and_acceleration(beta):
    got = shafts.cardan(np.deg2rad(60.0), np.deg2rad(beta), 10.0)
    np.testing.assert_allclose(np.stack(tuple(got)), CARDAN[beta], rtol=1e-14)


def test_two_cardan_joints_have_the_known_angles_in_series():
    """Published row: 60° and 10 rad/s in, joints of 25° and 35° with the forks between them 20° apart."""
    middle = shafts.cardan(Jet(np.deg2rad(60.0), 10.0), np.deg2rad(25.0))
    outlet = shafts.cardan(middle + np.deg2rad(20.0), np.deg2rad(35.0))
    np.testing.assert_allclose(tuple(middle), (1.0887166591074862, 9.48667248989609, -15.359576956620973), rtol=1e-13)
    np.testing.assert_allclose(tuple(outlet), (1.46162639265539, 7.816255653072713, -19.10576893591882), rtol=1e-13)


def test_cardan_joint_turns_on_without_a_jump():
    theta = np.linspace(-9.0, 9.0, 400)
    out = shafts.cardan(theta, 1.2, 1.0)
    assert np.max(np.abs(out.x - theta)) < np.pi / 2
    assert np.min(out.v) >= np.cos(1.2) * (1 - 1e-12) and np.max(out.v) <= (1 + 1e-12) / np.cos(1.2)


def test_shafts_in_series_keep_their_crosses_square():
    d = shafts.CARDAN_SHAFTS
    out = shafts.cardan_shafts(phi=TURN)
    for a, b in (("v1", "v2"), ("v3", "v4")):
        constant(np.sum(out[a].x * out[b].x, -1), 0.0)
    for pin, shaft in (("v1", "AB"), ("v2", "BC"), ("v3", "BC"), ("v4", "CD")):
        constant(out[pin].x @ (d[shaft[1]] - d[shaft[0]]), 0.0)
    assert_rates(lambda phi: shafts.cardan_shafts(phi=phi, phase=0.3), TURN[::4])


@pytest.mark.parametrize("end", [np.array([2.0, 0.0, 0.0]), np.array([2 * np.cos(0.8), 2 * np.sin(0.8), 0.0])])
def test_two_equal_angles_give_a_constant_velocity(end):
    """Z and W arrangements, with the middle shaft's pins parallel."""
    middle = np.array([np.cos(0.4), np.sin(0.4), 0.0])
    points = {"A": [-1.0, 0, 0], "B": [0.0, 0, 0], "C": middle, "D": middle + end, "v1": [0.0, 0.6, 0.8]}
    out = shafts.cardan_shafts(points, TURN, phase=0.0)
    constant(out["outlet"].x, TURN, 10.0)
    constant(out["outlet"].v, 1.0, 10.0)


def test_bevel_gears_roll_on_their_pitch_line():
    d, out = shafts.BEVEL_GEARS, shafts.bevel_gears(phi=TURN)
    line = d["1"] / np.linalg.norm(d["1"])
    constant(np.cross(d["vA"] - out["psi"].v[0] * d["vB"], line), 0.0)  # no slip: ωA − ωB lies along the line
    constant(np.cos(shafts.pitch_cones(np.pi / 3, 0.5)), np.array([d["vA"] @ line, d["vB"] @ line]))
    constant(distance(out["2"].x, d["B"]), distance(d["2"], d["B"]))
    # (155) with its factor sin σ: φ from the projection of vB, which is where the wheels are drawn in touch
    constant((out["1"].x - d["A"]) @ d["vB"], 0.02 * 3**0.5 * np.sin(np.pi / 3) * np.cos(TURN))
    assert_rates(lambda phi: shafts.bevel_gears(phi=phi), TURN[::4])


def test_steering_column_meets_its_equations():
    d = shafts.STEERING_COLUMN
    out = shafts.steering_column(phi=TURN)
    y = np.array([0.0, 1.0, 0.0])
    constant(out["v4"].x @ y, np.cos(out["psi"].x))
    constant(out["s"].x - out["s"].x[0], shafts.PINION_RADIUS * (out["psi"].x - out["psi"].x[0]))
    constant(distance(out["1"].x, d["E"]), out["s"].x)
    constant(out["s"].x[-1] - out["s"].x[0], 2 * np.pi * shafts.PINION_RADIUS)
    assert_rates(lambda phi: shafts.steering_column(phi=phi, phase=1.0), TURN[::4])


TRAVEL, RACK = (a.ravel() for a in np.meshgrid(np.linspace(-0.08, 0.08, 5), np.linspace(-0.06, 0.06, 5)))
KNUCKLE = ("lower_ball", "tie_outer", "wheel_centre", "spindle")
SUSPENSIONS = pytest.mark.parametrize(
    "f, drawn, fourth",
    [
        (suspensions.double_wishbone, suspensions.DOUBLE_WISHBONE, "upper_ball"),
        (suspensions.macpherson, suspensions.MACPHERSON, "strut_lower"),
    ],
)


@SUSPENSIONS
def test_suspension_keeps_its_rods_and_its_knuckle(f, drawn, fourth):
    out = {k: getattr(j, "x", j) for k, j in f(travel=TRAVEL, rack=RACK).items()}
    names = (*KNUCKLE, fourth)
    for i, a in enumerate(names):
        for b in names[:i]:
            constant(distance(out[a], out[b]), distance(drawn[a], drawn[b]))
    sides = volume_change([out[n] for n in KNUCKLE], [drawn[n] for n in KNUCKLE])
    constant(sides, 0.0)
    inner = drawn["tie_inner"] + RACK[:, None] * np.array([0.0, 1.0, 0.0])
    constant(distance(out["tie_outer"], inner), distance(drawn["tie_outer"], drawn["tie_inner"]))
    for arm in ("lower", "upper")[: 1 + (fourth == "upper_ball")]:
        for bush in ("front", "rear"):
            a, b = f"{arm}_ball", f"{arm}_{bush}"
            constant(distance(out[a], drawn[b]), distance(drawn[a], drawn[b]))
    if fourth == "strut_lower":
        constant(np.cross(drawn["strut_top"] - out["strut_lower"], out["strut_axis"]), 0.0)
        axis = drawn["strut_top"] - drawn["strut_lower"]
        axis = axis / np.linalg.norm(axis)
        for a, b in (("wheel_centre", "spindle"), ("lower_ball", "tie_outer")):
            constant(np.sum((out[b] - out[a]) * out["strut_axis"], -1), (drawn[b] - drawn[a]) @ axis)
    constant(out["travel"], TRAVEL)
    constant(out["wheel_centre"][:, 2], drawn["wheel_centre"][2] + TRAVEL)


@SUSPENSIONS
def test_suspension_rates(f, drawn, fourth):
    still = {"rack": 0.02, "spin": 0.4}
    assert_rates(lambda u: f(travel=u * 0.1, rack=u * 0.05, spin=u), np.array([-0.4, 0.3]))
    assert_rates(lambda u: f(arm=u, **still), np.array([-0.2, 0.1]))


@SUSPENSIONS
def test_suspension_ratios_are_slopes(f, drawn, fourth):
    h, z = 1e-3, np.array([-0.05, 0.0, 0.04])
    out = {k: f(travel=z + k * h, rack=0.01) for k in range(-3, 4)}

    def slope(pick):
        return sum(w * (pick(out[k]) - pick(out[-k])) for k, w in WEIGHTS) / h

    np.testing.assert_allclose(out[0]["motion_ratio"], -slope(lambda o: o["damper"].x), rtol=1e-9)
    path = slope(lambda o: o["contact"].x)
    want = out[0]["contact"].x[:, 1] * path[:, 1] / path[:, 2]
    np.testing.assert_allclose(out[0]["roll_centre_height"], want, rtol=1e-8)


@SUSPENSIONS
def test_wheel_angles_of_the_drawing(f, drawn, fourth):
    out = f(rack=np.array([0.0, 0.02]))
    axis = drawn["spindle"] - drawn["wheel_centre"]
    upper = drawn["strut_top" if fourth == "strut_lower" else "upper_ball"]
    king = upper - drawn["lower_ball"]
    assert np.tan(out["camber"].x[0]) == pytest.approx(-axis[2] / np.hypot(axis[0], axis[1]), rel=1e-12)
    assert np.tan(out["toe"].x[0]) == pytest.approx(axis[0] / axis[1], rel=1e-12)
    assert np.tan(out["caster"].x[0]) == pytest.approx(-king[0] / king[2], rel=1e-12)
    assert np.tan(out["kingpin_inclination"].x[0]) == pytest.approx(-king[1] / king[2], rel=1e-12)
    ahead = drawn["tie_outer"][0] > drawn["wheel_centre"][0]
    assert (out["steer"].x[1] > out["steer"].x[0]) == ahead  # a tie rod ahead of the axle moved left steers to the left
    assert out["contact"].x[0, 2] == pytest.approx(0.0, abs=1e-4)
    assert np.all(out["caster_trail"].x > 0) and np.all(out["scrub_radius"].x > 0)


def test_upper_arms_instant_centre_gives_the_roll_centre():
    """A wishbone suspension in one transverse plane: the roll centre is found by the theorem of three centres."""
    flat = {n: p * np.array([0.0, 1.0, 1.0]) for n, p in suspensions.DOUBLE_WISHBONE.items()}
    for arm in ("lower", "upper"):
        flat[f"{arm}_front"] = flat[f"{arm}_rear"] + np.array([0.1, 0.0, 0.0])
    flat["tie_inner"] = flat["lower_rear"] + np.array([0.1, 0.0, 0.0])
    flat["tie_outer"] = flat["lower_ball"] + np.array([0.1, 0.0, 0.0])
    out = suspensions.double_wishbone(flat, arm=0.0)

    def cut(p, q, r, s):
        d, e = q - p, s - r
        t = np.cross(r - p, e)[0] / np.cross(d, e)[0]
        return p + t * d

    centre = cut(flat["lower_rear"], flat["lower_ball"], flat["upper_rear"], flat["upper_ball"])
    contact = out["contact"].x
    origin = np.zeros(3)
    roll = cut(contact, centre, origin, np.array([0.0, 0.0, 1.0]))
    constant(out["roll_centre_height"], roll[2] - contact[2], 10.0)


def test_spherical_four_bar_keeps_its_arcs():
    d = {k: v / np.linalg.norm(v) if k[0] == "v" else v for k, v in loops.SPHERICAL_FOUR_BAR.items()}
    out = loops.spherical_four_bar(phi=TURN)
    constant(np.sum(out["vB"].x * out["vC"].x, -1), d["vB"] @ d["vC"])
    constant(out["vC"].x @ d["vD"], d["vC"] @ d["vD"])
    for axis in ("vB", "vC"):
        constant(np.sum(out[axis].x * out["P"].x, -1), d[axis] @ d["P"])
    constant(out["vC"].x[[0, -1]], d["vC"])
    assert_rates(lambda phi: loops.spherical_four_bar(phi=phi), TURN[::4])


@pytest.mark.parametrize("f, theta", [(loops.bennett, 0.4), (loops.bricard, -1.7)])
def test_overconstrained_loop_closes(f, theta):
    theta = np.linspace(theta, -theta if theta < 0 else 2 * np.pi - theta, 9)
    out = f(theta)
    for name, want in (("point", np.zeros(3)), ("axis", np.eye(3)[2]), ("normal", np.eye(3)[0])):
        constant(out[f"closing_{name}"].x, want)
    last = max(k for k in out if k.isdigit())
    constant(out[last].x, out[last].x[0])
    constant(out["v" + last].x, out["v" + last].x[0])
    assert_rates(f, theta[1:-1:3])


def test_bennett_linkage_has_its_links_and_twists():
    d, out = loops.BENNETT, {k: j.x for k, j in loops.bennett(TURN[1:-1]).items()}
    other = d["length"] * np.sin(d["beta"]) / np.sin(d["alpha"])
    links = {("1", "2"): d["length"], ("2", "3"): other, ("3", "4"): d["length"], ("4", "1"): other}
    for (a, b), length in links.items():
        twist = d["alpha"] if length == d["length"] else d["beta"]
        constant(distance(out[a], out[b]), length)
        constant(np.sum(out["v" + a] * out["v" + b], -1), np.cos(twist))
        constant(np.sum((out[b] - out[a]) * out["v" + a], -1), 0.0)


def test_orthogonal_bricard_linkage_is_drawn_on_a_cube():
    drawn = loops.drawing(loops.bricard())
    corners = np.stack([drawn[k] for k in "123456"]) / loops.BRICARD["length"]
    constant(corners, np.round(corners))
    assert len(np.unique(np.round(corners), axis=0)) == 6


def as_a_loop(name):
    """Joints of a linkage from the frame round to the frame, its closed form, and a link with one of its points."""
    if name in ("bennett", "bricard"):
        f, start = getattr(loops, name), getattr(loops, name.upper())["theta"]
        d = loops.drawing(f())
        joints = [("R", d[str(k)], d[f"v{k}"]) for k in range(1, 5 if name == "bennett" else 7)]
        return joints, lambda phi: f(start + phi, acceleration=0.5), (2, "3", d["3"])
    f, d = getattr(linkages, name), getattr(linkages, name.upper())
    joints = [("R", d["A"], d["vA"])]
    if name == "rscr":
        joints += [("S", d["1"], np.eye(3)[0]), ("C", d["3"], d["v1"]), ("R", d["B"], d["vB"])]
        point = 2, "2", d["2"]
    else:
        joints += [("C", d[k], d[f"v{k}"]) for k in "BCD"]
        point = 3, "C", d["C"]
    return joints, lambda phi: f(phi=phi, acceleration=0.5), point


@pytest.mark.parametrize("name", ["bennett", "bricard", "rscr", "rccc"])
def test_closed_forms_agree_with_joint_variables(name):
    phi = np.array([-0.5, 0.3, 0.45])
    joints, f, (link, point, drawn) = as_a_loop(name)
    _, carry = chains.loop(joints, phi, acceleration=0.5)
    for got, want, tolerance in zip(carry(link, drawn), f(phi)[point], (1e-13, 1e-12, 1e-11), strict=True):
        assert np.max(np.abs(got - want)) <= tolerance


POSE = np.array([[0.1, 0.05, 0.1], [0.0, -0.1, 0.05]]), np.array([[0.1, 0.2, -0.3], [0.2, 0.0, 0.4]])


def test_stewart_platform_both_ways():
    shift, angles = Jet(POSE[0], 0.3, 0.1), Jet(POSE[1], -0.2, 0.5)
    out = platforms.stewart_platform(shift=shift, angles=angles)
    back = platforms.stewart_pose(legs=out["legs"])
    for got, want in ((back["shift"], shift), (back["angles"], angles)):
        for g, w, tolerance in zip(got, want, (1e-13, 1e-12, 1e-11), strict=True):
            constant(g, w, tolerance / CLOSURE)
    d = platforms.STEWART_PLATFORM
    for k, name in enumerate(f"P{n}" for n in range(1, 7)):
        constant(distance(out[name].x, out["P"].x), distance(d[name], d["P"]))
        along = (out[name].x - d["B" + name[1]]) / out["legs"].x[:, k, None]
        constant(np.sum(along * out[name].v, -1), out["legs"].v[:, k], 10.0)


def test_delta_robot_both_ways():
    shift = Jet(POSE[0], 0.3, 0.1)
    out = platforms.delta_angles(shift=shift)
    back = platforms.delta_robot(None, *(out[f"theta{k}"] for k in (1, 2, 3)))
    for got, want, tolerance in zip(back["P"], out["P"], (1e-13, 1e-12, 1e-11), strict=True):
        constant(got, want, tolerance / CLOSURE)
    d = platforms.DELTA_ROBOT
    for k in "123":
        constant(distance(out["B" + k].x, out["C" + k].x), 0.8)
        constant(distance(out["B" + k].x, d["A" + k]), 0.3)


@SUSPENSIONS
def test_shifting_every_hardpoint_changes_no_angle(f, drawn, fourth):
    """Derivatives along x add up to zero; this also holds them to 1e-9."""
    gradient = hardpoint_gradient(lambda p: f(p, travel=np.array([0.04, -0.06]), rack=0.02)["toe"].x, drawn)
    total = sum(gradient.values())
    assert total.shape == (2, 3)
    size = max(np.max(np.abs(g)) for g in gradient.values())
    assert np.max(np.abs(total)) <= 1e-9 * size


def test_hardpoint_gradient_of_a_closed_form():
    def f(p):
        return linkages.rssr(p, np.array([0.7, 2.0]))["psi"].x

    def along(name, k):  # the exact derivative: the hardpoint itself as a jet
        from independent.closure import crank_angle, drawn_side, revolved, solved_angle, swing
        from independent.jets import norm, unit

        p = {n: Jet(v, np.eye(3)[k] if n == name else 0.0) for n, v in linkages.RSSR.items()}
        vA, vB, length = unit(p["vA"]), unit(p["vB"]), norm(p["2"] - p["1"])
        turn = crank_angle(Jet([0.7, 2.0]), vA, p["1"] - p["A"], None)
        side = drawn_side(swing(p["B"], vB, p["2"], p["1"], length))
        return solved_angle(*swing(p["B"], vB, p["2"], revolved(p["A"], vA, p["1"], turn), length), side).v

    gradient = hardpoint_gradient(f, linkages.RSSR)
    size = max(np.max(np.abs(g)) for g in gradient.values())
    for name, got in gradient.items():
        want = np.stack([along(name, k) for k in range(3)], -1)
        assert np.max(np.abs(got - want)) <= 1e-9 * size, name
