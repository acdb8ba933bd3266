"""Seeded random four-bar designs."""

import numpy as np

from benchmarks.circles import FourBars


def any_kind(seed: int, count: int) -> FourBars:
    """Random lengths of every Grashof type, a third of them within one per cent of the limit between two types."""
    rng = np.random.default_rng([seed, 1])
    out: list[np.ndarray] = []
    while sum(len(x) for x in out) < count:
        n = 2 * count + 16
        lengths = rng.uniform(0.3, 1.5, (n, 4))
        near = rng.random(n) < 1 / 3
        # Shortest + longest = the other two, but for up to one per cent either way: the longest is set.
        order = np.sort(lengths[near], axis=1)
        gap = 1.0 + rng.uniform(-0.01, 0.01, near.sum())
        order[:, 3] = (order[:, 1] + order[:, 2]) * gap - order[:, 0]
        order = np.where((order[:, 3] > 0.05)[:, None], order, 1.0)
        lengths[near] = rng.permuted(order, axis=1)
        side, home = rng.choice([-1.0, 1.0], n), rng.uniform(-np.pi, np.pi, n)
        some = np.column_stack([lengths, side, home])
        out.append(some[_drawn_well(_bars(some))])
    return _bars(np.concatenate(out)[:count])


def crank_rockers(seed: int, count: int) -> FourBars:
    """Random designs whose crank turns right round, well away from change points."""
    rng = np.random.default_rng([seed, 2])
    out: list[np.ndarray] = []
    while sum(len(x) for x in out) < count:
        n = 4 * count + 16
        lengths = np.column_stack([rng.uniform(0.2, 0.6, n), rng.uniform(0.7, 2.0, (n, 3))])
        side, home = rng.choice([-1.0, 1.0], n), np.full(n, 1.0)
        some = np.column_stack([lengths, side, home])
        b = _bars(some)
        near, far = b.ground - b.crank, b.ground + b.crank
        turns = (far < 0.97 * (b.coupler + b.rocker)) & (near > 1.03 * np.abs(b.coupler - b.rocker))
        out.append(some[turns & (near > 0.1)])
    return _bars(np.concatenate(out)[:count])


def _bars(table: np.ndarray) -> FourBars:
    return FourBars(*(np.ascontiguousarray(x) for x in table.T))


def _drawn_well(bars: FourBars) -> np.ndarray:
    """Designs that close at home, with the angle between coupler and rocker well away from 0 and pi."""
    b, c = bars.poses(bars.home)
    u, v = c - b, c - np.stack([bars.ground, np.zeros_like(bars.ground)], axis=-1)
    sine = np.abs(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]) / (bars.coupler * bars.rocker)
    return np.nan_to_num(sine) > 0.1
