"""Independent poses of the generic mechanism (fig. 22): two equations in two unknowns, in NumPy only.

With the bar's angle b and the distance s of the contact along it, the disc's centre is P1 + s e(b) + R n(b); it keeps
its height, and the link keeps the distance from the bar's end to the slider.
"""

import numpy as np

CRANK, BAR, RADIUS, HEIGHT, PIVOT, CONTACT = 0.1, 0.6, 0.05, 0.05, (0.10, 0.10), 0.4
_STEPS = 400  # grid of the path that the branch is followed along


def _rest(z: np.ndarray, y: np.ndarray, link: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residual ``(N, 2)``, its Jacobian, and the points P2, P5, P6 ``(N, 3, 2)``."""
    b, s = z[:, 0], z[:, 1]
    x = np.sqrt(CRANK**2 - y**2)
    co, si = np.cos(b), np.sin(b)
    p2 = np.stack([x + BAR * co, y + BAR * si], axis=1)
    p5 = np.stack([x + s * co - RADIUS * si, y + s * si + RADIUS * co], axis=1)
    p6 = np.stack([x + s * co, y + s * si], axis=1)
    way = p2 - p5 - np.array(PIVOT)
    rest = np.stack([p5[:, 1] - HEIGHT, np.sum(way**2, axis=1) - link**2], axis=1)
    d5_b = np.stack([-s * si - RADIUS * co, s * co - RADIUS * si], axis=1)
    d_b = np.stack([-BAR * si, BAR * co], axis=1) - d5_b
    d_s = -np.stack([co, si], axis=1)
    jac = np.stack(
        [np.stack([d5_b[:, 1], si], axis=1), 2 * np.stack([np.sum(way * d_b, 1), np.sum(way * d_s, 1)], axis=1)], axis=1
    )
    return rest, jac, np.stack([p2, p5, p6], axis=1)


def _newton(z: np.ndarray, y: np.ndarray, link: float, steps: int) -> np.ndarray:
    for _ in range(steps):
        rest, jac, _ = _rest(z, y, link)
        z = z - np.linalg.solve(jac, rest[..., None])[..., 0]
    return z


def poses(height: np.ndarray) -> np.ndarray:
    """Points P2, P5 and P6, ``(N, 3, 2)``, for heights of the crank pin P1, on the branch of the drawing."""
    reach = np.hypot(CONTACT, RADIUS)
    home = np.array([[np.arcsin(HEIGHT / reach) - np.arctan2(RADIUS, CONTACT), CONTACT]])
    zero = np.zeros(1)
    p2, p5, _ = _rest(home, zero, 0.0)[2][0]
    link = float(np.linalg.norm(p2 - p5 - np.array(PIVOT)))
    table = [(0.0, home[0])]
    for end in (height.min(), height.max()):
        z = home
        for y in np.linspace(0.0, end, _STEPS + 1)[1:]:
            z = _newton(z, np.array([y]), link, 6)
            table.append((float(y), z[0]))
    table.sort(key=lambda pair: pair[0])
    at, states = np.array([t[0] for t in table]), np.array([t[1] for t in table])
    start = np.stack([np.interp(height, at, states[:, k]) for k in range(2)], axis=1)
    return _rest(_newton(start, height, link, 4), height, link)[2]
