"""Positions, velocities and accelerations against closed forms and independent reference solutions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar, four_bar_joint, reference, shaper, slider_crank, turn

import jaxnc as nc

# Errors are relative to L, L ω, L ω². Rounding of a well-conditioned pose costs a few 1e-15.
POSITION, VELOCITY, ACCELERATION = 1e-12, 1e-12, 1e-10
MANY = 10_000


def check(got, want, scale, tolerance):
    """Largest error relative to a scale."""
    error = np.max(np.abs(np.asarray(got) - np.asarray(want))) / scale
    assert error <= tolerance, f"error {error:.2e} > {tolerance:.0e}"


def along(f, u, rate):
    """Values, first and second time derivatives of a closed form at inputs moving at a constant rate."""
    u = jnp.asarray(u)
    one = jnp.full_like(u, rate)

    def first(u):
        return jax.jvp(f, (u,), (one,))[1]

    return f(u), first(u), jax.jvp(first, (u,), (one,))[1]


@pytest.mark.parametrize("crossed", [False, True])
def test_four_bar_over_ten_thousand_inputs(crossed):
    data = reference("fourbar_planar")
    d = data["definition"]
    omega, L = d["crank_omega"], d["coupler"]
    u = turn(MANY)
    mo = nc.sweep(four_bar(crossed=crossed), {"phi": u}, rates={"phi": omega})
    assert bool(jnp.all(mo.converged))
    side = -1.0 if crossed else 1.0
    O2, O4 = jnp.array(d["O2"], float), jnp.array(d["O4"], float)

    def joint(u):
        return jax.vmap(lambda x: four_bar_joint(d["crank"], d["coupler"], d["rocker"], O2, O4, x, side))(u)

    def point(u):
        A = d["crank"] * jnp.stack([jnp.cos(u), jnp.sin(u)], axis=-1)
        e = (joint(u) - A) / d["coupler"]
        n = jnp.stack([-e[:, 1], e[:, 0]], axis=-1)
        return A + d["coupler_point_local"][0] * e + d["coupler_point_local"][1] * n

    for name, form in (("B", joint), ("P", point)):
        p, v, a = along(form, u, omega)
        check(mo[name], p, L, POSITION)
        check(mo.velocity(name), v, L * omega, VELOCITY)
        check(mo.acceleration(name), a, L * omega**2, ACCELERATION)


def test_four_bar_reference_file():
    data = reference("fourbar_planar")
    d, ref = data["definition"], data["reference"]
    omega, L = d["crank_omega"], d["coupler"]
    u = np.radians(ref["theta_deg"])
    mo = nc.sweep(four_bar(), {"phi": u}, rates={"phi": omega})
    for name, key in (("B", "B"), ("P", "coupler_point"), ("G", "cg2")):
        check(mo[name], ref[key], L, POSITION)
        check(mo.velocity(name), ref[key + "_v"], L * omega, VELOCITY)
        check(mo.acceleration(name), ref[key + "_a"], L * omega**2, ACCELERATION)
    check(mo.angular_velocity("rocker"), ref["theta4_v"], omega, VELOCITY)
    check(mo.angular_acceleration("coupler"), ref["theta3_a"], omega**2, ACCELERATION)
    crossed = nc.sweep(four_bar(crossed=True), {"phi": u}, rates={"phi": omega})
    turned = np.asarray(crossed.orientation("rocker")) - np.asarray(ref["theta4_crossed"])
    check(np.sin(turned), 0.0, 1.0, POSITION)
    check(crossed.angular_velocity("rocker"), ref["theta4_crossed_v"], omega, VELOCITY)
    check(crossed.angular_acceleration("rocker"), ref["theta4_crossed_a"], omega**2, ACCELERATION)


@pytest.mark.parametrize("fixed_guide", [True, False])
def test_slider_crank(fixed_guide):
    data = reference("slidercrank_planar")
    d, ref = data["definition"], data["reference"]
    omega, L = d["crank_omega"], d["crank"] + d["conrod"]
    u = np.radians(ref["theta_deg"])
    mo = nc.sweep(slider_crank(fixed_guide), {"phi": u}, rates={"phi": omega})
    check(mo["S.x"], ref["x"], L, POSITION)
    check(mo.velocity("S.x"), ref["x_v"], L * omega, VELOCITY)
    check(mo.acceleration("S.x"), ref["x_a"], L * omega**2, ACCELERATION)
    check(mo.acceleration("cg"), ref["cg2_a"], L * omega**2, ACCELERATION)

    u = turn(MANY)
    mo = nc.sweep(slider_crank(fixed_guide), {"phi": u}, rates={"phi": omega})
    assert bool(jnp.all(mo.converged))
    r, length, e = d["crank"], d["conrod"], d["offset"]
    p, v, a = along(lambda u: r * jnp.cos(u) + jnp.sqrt(length**2 - (e - r * jnp.sin(u)) ** 2), u, omega)
    check(mo["S.x"], p, L, POSITION)
    check(mo.velocity("S.x"), v, L * omega, VELOCITY)
    check(mo.acceleration("S.x"), a, L * omega**2, ACCELERATION)


def test_quick_return_with_ram():
    data = reference("quick_return")
    d, ref = data["definition"], data["reference"]
    omega, L = d["crank_omega"], d["rocker_length"]
    mo = nc.sweep(shaper(), {"phi": np.radians(ref["theta_deg"])}, rates={"phi": omega})
    for name, key in (("A", "A"), ("C", "C"), ("R.x", "ram_x"), ("slide", "slide")):
        check(mo[name], ref[key], L, POSITION)
        check(mo.velocity(name), ref[key + "_v"], L * omega, VELOCITY)
        check(mo.acceleration(name), ref[key + "_a"], L * omega**2, ACCELERATION)
    check(mo["psi"], ref["rocker_angle"], 1.0, POSITION)
    check(mo.velocity("psi"), ref["rocker_angle_v"], omega, VELOCITY)
    check(mo.acceleration("psi"), ref["rocker_angle_a"], omega**2, ACCELERATION)
    mo = nc.sweep(shaper(), {"phi": turn(MANY)})
    assert bool(jnp.all(mo.converged))
    # Time ratio and extreme angle of the rocker from the located dead points of the rocker as an input.
    rocker = nc.travel(shaper(), "psi")
    half = 0.5 * (rocker.upper - rocker.lower)
    check(half, ref["rocker_extreme_half_angle"], 1.0, POSITION)
    check((np.pi + 2 * half) / (np.pi - 2 * half), ref["time_ratio"], 1.0, 1e-11)


def test_jerk_against_a_closed_form():
    d = reference("slidercrank_planar")["definition"]
    r, length, e, omega = d["crank"], d["conrod"], d["offset"], 3.0

    def x(t):
        u = 0.3 + omega * t + 0.2 * jnp.sin(t)
        return r * jnp.cos(u) + jnp.sqrt(length**2 - (e - r * jnp.sin(u)) ** 2)

    t = np.linspace(0.0, 2.0, 41)
    mo = nc.motion(slider_crank(), {"phi": lambda t: 0.3 + omega * t + 0.2 * jnp.sin(t)}, t, jerk=True)
    place, third = jax.jit(jax.vmap(lambda t: (x(t), jax.grad(jax.grad(jax.grad(x)))(t))))(t)
    check(mo["S.x"], place, 1.0, POSITION)
    check(mo.jerk("S.x"), third, np.max(np.abs(third)), 1e-10)


def test_inputs_as_functions_and_as_arrays_agree():
    t = np.linspace(0.0, 1.0, 41)
    f = nc.motion(slider_crank(), {"phi": lambda t: 0.3 + 2 * t + 0.1 * jnp.sin(t)}, t)
    arrays = (0.3 + 2 * t + 0.1 * np.sin(t), 2 + 0.1 * np.cos(t), -0.1 * np.sin(t))
    g = nc.motion(slider_crank(), {"phi": arrays}, t)
    check(f.acceleration("A"), g.acceleration("A"), 1.0, 1e-13)
    np.testing.assert_allclose(f.time, t)


def test_any_coordinate_can_be_driven_also_a_ground_point():
    system = slider_crank()
    by_angle = nc.sweep(system, {"phi": np.linspace(0.9, 2.0, 41)}, rates={"phi": 1.0})
    by_slider = nc.sweep(
        system,
        {"S.x": np.asarray(by_angle["S.x"])},
        rates={"S.x": by_angle.velocity("S.x")},
        accelerations={"S.x": by_angle.acceleration("S.x")},
    )
    check(by_slider["phi"], by_angle["phi"], 1.0, 1e-12)
    check(by_slider.velocity("phi"), 1.0, 1.0, 1e-12)
    check(by_slider.acceleration("phi"), 0.0, 1.0, 1e-11)
    # Lifting the crank's pivot by h while phi stands still is the same as lowering the guide by h.
    h = np.linspace(0.0, 0.05, 41)
    lifted = nc.sweep(system, {"O.y": h, "phi": np.full(41, 0.9)}, rates={"O.y": 1.0})
    d = reference("slidercrank_planar")["definition"]
    p, v, _ = along(
        lambda h: (
            d["crank"] * jnp.cos(0.9) + jnp.sqrt(d["conrod"] ** 2 - (d["offset"] - h - d["crank"] * jnp.sin(0.9)) ** 2)
        ),
        h,
        1.0,
    )
    check(lifted["S.x"], p, 1.0, 1e-13)
    check(lifted.velocity("S.x"), v, 1.0, 1e-12)
