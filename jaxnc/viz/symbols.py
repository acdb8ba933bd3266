"""Symbols of springs, dampers, stops and torques in the plane."""

import numpy as np

from jaxnc.viz.scene import Item, Span, Vertex


def arc(radius: float, first: float, last: float, share: float = 0.0, growth: float = 0.0) -> tuple[Vertex, ...]:
    """An arc about one end of a span, or about a place between, units; its radius may grow, for a spiral."""
    turn = np.linspace(first, last, 2 + round(9 * (last - first)))
    r = radius + growth * (turn - first)
    return tuple((share, float(x), float(y)) for x, y in zip(r * np.cos(turn), r * np.sin(turn), strict=True))


def torque(arm: tuple[int, ...], share: float = 0.0) -> list[Item]:
    """The arrow of a torque, counter-clockwise."""
    ends, r, tip = (arm[0], arm[1]), 3.4, 5.2
    way = np.array([-np.sin(tip), np.cos(tip)])
    at, out = r * np.array([np.cos(tip), np.sin(tip)]), np.array([np.cos(tip), np.sin(tip)])
    head = [at + 1.5 * way, at - 0.75 * out - 0.3 * way, at + 0.75 * out - 0.3 * way]
    corners = tuple((share, float(x), float(y)) for x, y in head)
    return [Span("torque", ends, arc(r, 0.8, tip, share)), Span("torque head", ends, corners, closed=True)]


def spiral(arm: tuple[int, int]) -> Item:
    """A spring that turns about the start of an arm."""
    return Span("spring", arm, arc(1.5, 0.0, 4.5 * np.pi, growth=0.13))


def coil(ends: tuple[int, int], beside: float) -> list[Item]:
    """A spring between two points, some units beside their line."""
    coils, height = 6, 1.25
    shares = 0.2 + 0.6 * (np.arange(2 * coils) + 0.5) / (2 * coils)
    zigzag = [(float(s), 0.0, beside + height * (1 if k % 2 else -1)) for k, s in enumerate(shares)]
    lead = [(0.0, 0.0, 0.0), (0.06, 0.0, beside), (0.2, 0.0, beside)]
    back = [(0.8, 0.0, beside), (0.94, 0.0, beside), (1.0, 0.0, 0.0)]
    return [Span("spring", ends, (*lead, *zigzag, *back))]


def dashpot(ends: tuple[int, int], beside: float) -> list[Item]:
    """A damper between two points: a piston in a cylinder."""
    h, y = 1.1, beside
    rod = ((0.0, 0.0, 0.0), (0.06, 0.0, y), (0.5, 0.0, y), (0.5, 0.0, y + 0.8 * h), (0.5, 0.0, y - 0.8 * h))
    case = ((0.35, 0.0, y + h), (0.66, 0.0, y + h), (0.66, 0.0, y - h), (0.35, 0.0, y - h))
    tail = ((0.66, 0.0, y), (0.94, 0.0, y), (1.0, 0.0, 0.0))
    return [Span("dashpot", ends, part) for part in (rod, case, tail)]


def stop(ends: tuple[int, int], beside: float) -> list[Item]:
    """A stop between two points: a rod and the plate that it meets."""
    y = beside
    rod = ((0.0, 0.0, 0.0), (0.06, 0.0, y), (0.46, 0.0, y))
    plate = ((0.54, 0.0, y + 1.4), (0.54, 0.0, y - 1.4), (0.54, 0.0, y), (0.94, 0.0, y), (1.0, 0.0, 0.0))
    return [Span("dashpot", ends, rod), Span("dashpot", ends, plate)]


BETWEEN = {"spring": coil, "damper": dashpot, "stop": stop}
"""What is drawn between two points, by a word in the name of a kind of force."""
