"""Motion in independent coordinates by Lagrange's equations and SciPy: no constraints, no natural coordinates."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

G = 9.81


def motion(lagrangian, z, dz, t, loss=None, method="DOP853", rtol=1e-12, atol=1e-13):
    """Coordinates and rates at all times ``(T, g)``.

    Args:
        lagrangian: ``(z, dz) -> T - V``.
        z: coordinates at the start.
        dz: rates at the start.
        t: times.
        loss: Rayleigh's dissipation function ``(z, dz)``.
        method: of `scipy.integrate.solve_ivp`.
        rtol: its relative tolerance.
        atol: its absolute tolerance.
    """
    g = len(z)

    @jax.jit
    def field(y):
        z, dz = y[:g], y[g:]
        mass = jax.hessian(lagrangian, argnums=1)(z, dz)
        push = jax.grad(lagrangian)(z, dz) - jax.jacfwd(jax.grad(lagrangian, argnums=1))(z, dz) @ dz
        if loss is not None:
            push = push - jax.grad(loss, argnums=1)(z, dz)
        return jnp.concatenate([dz, jnp.linalg.solve(mass, push)])

    slopes = jax.jit(jax.jacfwd(field))
    start = np.concatenate([z, dz]).astype(float)
    found = solve_ivp(
        lambda _, y: np.asarray(field(y)),
        (t[0], t[-1]),
        start,
        method=method,
        t_eval=t,
        rtol=rtol,
        atol=atol,
        **({"jac": lambda _, y: np.asarray(slopes(y))} if method == "Radau" else {}),
    )
    assert found.success, found.message
    return found.y[:g].T, found.y[g:].T


def flyball_governor(stiffness=8e5, damping=4e4):
    """IFToMM's A05 in (spin, angle of the arms from the vertical, height of the slider): Lagrangian, loss, start."""
    along, across = 0.3 / 12 * 2e-4, 0.3 / 12 * (1 + 1e-4)  # of the bars about their own axis and across it

    def length(z):
        return jnp.hypot(0.5 * jnp.sin(z[1]), 1.0 - 0.5 * jnp.cos(z[1]) - z[2])

    def lagrangian(z, dz):
        s, c = jnp.sin(z[1]), jnp.cos(z[1])
        arm = 5.0 * (0.05 + s) ** 2 + 0.3 * (0.05 + 0.5 * s) ** 2 + across * s**2 + along * c**2
        lift = across + 0.3 / 4 + 5.0
        kinetic = 0.5 * (along + 0.005 + 2 * arm) * dz[0] ** 2 + lift * dz[1] ** 2 + 1.5 * dz[2] ** 2
        weight = G * (3.0 * z[2] - 2 * (5.0 + 0.15) * c)
        return kinetic - weight - stiffness * (length(z) - 0.5) ** 2

    def loss(z, dz):
        rate = jax.jvp(length, (z,), (dz,))[1]
        return damping * rate**2

    return lagrangian, loss, np.array([0.0, np.pi / 3, 0.5])


def spatial_slider_crank():
    """Lagrangian of `jaxnc.library.benchmarks.spatial_slider_crank` in the crank's angle.

    The conrod's cross stays across the conrod and the slider's axis x; its spin is read off that cross.
    """

    def pin(phi):
        return jnp.stack([0.0 * phi, 0.1 - 0.08 * jnp.sin(phi), 0.12 + 0.08 * jnp.cos(phi)])

    def slider(phi):
        b = pin(phi)
        return jnp.stack([jnp.sqrt(0.09 - b[1] ** 2 - b[2] ** 2), 0.0 * phi, 0.0 * phi])

    def along(phi):
        return (slider(phi) - pin(phi)) / 0.3

    def cross(phi):
        k = jnp.cross(jnp.array([1.0, 0.0, 0.0]), along(phi))
        return k / jnp.linalg.norm(k)

    def lagrangian(z, dz):
        vb, vc, du, dk = (jax.jvp(f, (z[0],), (dz[0],))[1] for f in (pin, slider, along, cross))
        spin = dk @ jnp.cross(along(z[0]), cross(z[0]))
        rod = 0.25 * (vb + vc) @ (vb + vc) / 4 + 0.5 * (0.004 * du @ du + 0.0004 * spin**2)
        crank = 0.5 * (1e-4 + 0.12 * 0.04**2) * dz[0] ** 2
        return crank + rod + 0.5 * 2.0 * vc @ vc - G * (0.25 + 0.06) * pin(z[0])[2]

    return lagrangian, slider


def n_four_bar(loops):
    """All uprights in parallel: Lagrangian in their angle from the vertical."""
    inertia, weight = (loops + 1) / 3 + loops, G * ((loops + 1) / 2 + loops)

    def lagrangian(z, dz):
        return 0.5 * inertia * dz[0] ** 2 - weight * jnp.cos(z[0])

    return lagrangian


def double_pendulum(z, dz):
    """Lagrangian of two uniform rods of 1 m and 1 kg in their angles from the x axis."""
    mixed = 0.5 * jnp.cos(z[0] - z[1]) * dz[0] * dz[1]
    return dz[0] ** 2 / 6 + 0.5 * dz[0] ** 2 + dz[1] ** 2 / 6 + mixed - G * (1.5 * jnp.sin(z[0]) + 0.5 * jnp.sin(z[1]))


def heavy_top(z, dz):
    """Lagrangian of the heavy top in Euler's angles about x, which it does not come near: it falls through the bottom.

    Its axis is (cos z1, sin z1 cos z0, sin z1 sin z0).
    """
    across, along = 0.234375 + 15.0, 0.46875
    turning = across * (dz[1] ** 2 + (dz[0] * jnp.sin(z[1])) ** 2) + along * (dz[2] + dz[0] * jnp.cos(z[1])) ** 2
    return 0.5 * turning - 15.0 * G * jnp.sin(z[1]) * jnp.sin(z[0])
