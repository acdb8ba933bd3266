"""Reactions in space by each body's own balance, which of them are unique, steady motions, friction of balls and rails."""

import functools

import numpy as np
import pytest

import jaxnc as nc
from jaxnc.library import benchmarks

G = 9.81
BALANCED = 1e-10  # of the largest force: linear systems solved to rounding


@functools.cache
def turning_crank():
    """Haug's slider-crank, its crank driven: hinge on the ground, shared points B and C, a point fixed in part."""
    system = benchmarks.spatial_slider_crank().compile()
    motion = nc.motion(system, {"phi": lambda t: 6.0 * t + 2.0 * t**2}, np.linspace(0, 1, 7))
    return motion, nc.inverse_dynamics(system, motion)


def test_every_body_in_space_is_in_balance():
    """Newton's and Euler's laws with the bodies' own masses, written without coordinates of the library."""
    motion, result = turning_crank()
    r, a = result.reactions, motion.acceleration
    weight = np.array([0, 0, -G])
    crank, rod_b, rod_c = r.at("A", on="crank"), r.at("B", on="conrod").force, r.at("C", on="conrod").force
    size = np.abs(rod_b).max() + np.abs(crank.force).max()
    # The rod: its mass centre, and its spin, d/dt (m L² / 12 u × u̇).
    rod = motion["C"] - motion["B"]
    assert np.abs(rod_b + rod_c + 0.5 * weight - 0.25 * (a("B") + a("C"))).max() <= BALANCED * size
    spin = 0.5 / 12 * np.cross(rod, a("C") - a("B"))
    assert np.abs(np.cross(rod / 2, rod_c - rod_b) - spin).max() <= BALANCED * size
    # The slider, a point that rests in part on the ground.
    slider = -rod_c + r.support("C") + 2.0 * weight - 2.0 * a("C")
    assert np.abs(slider).max() <= BALANCED * size and np.abs(r.support("C")[:, 0]).max() == 0.0
    # The crank, whose centre rests: turning about x with the torque of the input.
    assert np.abs(crank.force - rod_b + 0.12 * weight).max() <= BALANCED * size
    arm = motion["B"] - motion["A"]
    turn = np.cross(arm, -rod_b)
    turn[:, 0] += result["phi"] - 1e-4 * motion.acceleration("phi")
    assert np.abs(crank.moment + turn).max() <= BALANCED * size
    assert np.abs(crank.moment[:, 0]).max() <= BALANCED * size  # a hinge holds no moment about its line
    turned = r.at("A", on="crank", frame="crank")
    assert np.allclose(np.linalg.norm(turned.moment, axis=1), np.linalg.norm(crank.moment, axis=1), rtol=1e-10)


def test_what_holds_the_whole_mechanism_is_the_rate_of_its_momentum():
    """All that comes from outside, the ground and the weight, against d/dt of linear and angular momentum."""
    motion, result = turning_crank()
    r, a = result.reactions, motion.acceleration
    force = np.asarray(r.at("A", on="crank").force + r.support("C"))
    outside = force + np.array([0, 0, -G * 2.62])
    momentum = 0.25 * (a("B") + a("C")) + 2.0 * a("C")  # the crank's centre rests
    assert np.abs(outside - momentum).max() <= BALANCED * np.abs(force).max()
