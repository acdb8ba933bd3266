"""A spatial loop with redundant rows: branches kept, gradients exact, transformations agreeing.

RSCR (fig. 24) stands for all of them: its cylindrical joint writes three rows of which two are independent.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from independent.closure import hardpoint_gradient
from independent.linkages import RSCR, rscr

import jaxnc as nc
from jaxnc import Status

DIGITS = 1e-10  # of the size: poses of random mechanisms, some near dead points
GRADIENT = 1e-8  # against central differences of the sixth order
TURN = np.linspace(0.0, 2 * np.pi, 49)
FINE = 6  # poses of the reference between two of TURN, so that it cannot jump


@functools.cache
def system():
    m = nc.Mechanism("RSCR", dim=3)
    for name in ("A", "B"):
        m.ground(name, RSCR[name])
    for name in ("vA", "vB"):
        m.ground_vector(name, RSCR[name])
    for name in ("1", "2", "3"):
        m.point(name, RSCR[name])
    m.vector("v1", RSCR["v1"])
    m.body("crank", ["A", "1"], vectors=["vA"])
    m.body("coupler", ["1", "2"], vectors=["v1"])
    m.body("rocker", ["B", "3"], vectors=["v1", "vB"])
    m.cylindrical("C", line=("2", "v1"), on="3")
    m.angle("phi", at="A", to="1", about="vA")
    return m.compile()


def unit(v):
    return v / np.linalg.norm(v)


def design(rng):
    """Random hardpoints; about two thirds of them let the crank turn fully."""
    out = {name: unit(rng.normal(size=3)) for name in ("vA", "vB", "v1")}
    out |= {"A": np.zeros(3), "B": 2 * rng.normal(size=3), "2": 2 * rng.normal(size=3)}
    out["1"] = 0.35 * rng.uniform(0.3, 1.0) * unit(rng.normal(size=3))
    out["3"] = out["2"] + rng.normal() * out["v1"]
    return out


def walked(points, start, end):
    """The reference between two poses of TURN, in small steps; None where a dead point is in between."""
    try:
        return rscr(points, np.linspace(TURN[start], TURN[end], FINE * (end - start) + 1))
    except ArithmeticError:
        return None


@pytest.mark.slow
def test_random_designs_stay_on_their_branch():
    rng = np.random.default_rng(11)
    turning = stopped = 0
    for _ in range(18):
        points = design(rng)
        motion = nc.sweep(system().replace(points), {"phi": TURN})
        good = int(np.sum(np.asarray(motion.converged)))
        assert np.all(np.asarray(motion.converged)[:good]), "the poses before a dead point are all there"
        size = max(np.linalg.norm(points[k]) for k in "123B")
        reference = walked(points, 0, good - 1)
        assert reference is not None, "a pose was found beyond the dead point"
        off = np.abs(np.asarray(motion["3"])[:good] - reference["3"].x[::FINE])
        assert off[-1].max() < 1e-6 * size
        if good == len(TURN):
            turning += 1
            assert off.max() < DIGITS * size
        else:
            stopped += 1
            assert int(motion.status[good]) == Status.SINGULAR
            assert walked(points, good - 1, good) is None, "stopped before the dead point"
    assert turning > 8 and stopped > 3


@pytest.mark.slow
def test_gradients_of_every_hardpoint():
    angles = np.array([0.4, 0.9])
    inputs = {"phi": angles}

    def place(s):
        return nc.sweep(s, inputs, rates={"phi": 2.0}).velocity("3")

    # Each by the host, and all of them together in compiled code.
    rng, whole = np.random.default_rng(2), system()
    way = jax.tree.map(lambda x: rng.normal(size=x.shape), whole)
    found, steps, top = jax.jacrev(place)(whole).parameters, way.parameters, whole.topology
    expected = hardpoint_gradient(lambda p: rscr(p, angles, 2.0)["3"].v, RSCR)
    scale, along = max(np.abs(v).max() for v in expected.values()), 0.0
    for name, value in expected.items():
        (leaf, step), names = (
            ((found.vectors, steps.vectors), top.vectors)
            if name in top.vectors
            else ((found.points, steps.points), top.points)
        )
        assert np.abs(leaf[..., names.index(name), :] - value).max() < GRADIENT * scale, name
        along = along + value @ step[names.index(name)]
    change = nc.jit(lambda s, d: jax.jvp(place, (s,), (d,))[1])(whole, way)
    assert np.abs(change - along).max() < GRADIENT * np.abs(along).max()


def test_both_ways_with_redundant_rows_agree():
    inputs = {"phi": np.linspace(0.0, 1.2, 49)}
    every = nc.sweep(system(), inputs, rates={"phi": 3.0})
    chosen = nc.sweep(system(), inputs, rates={"phi": 3.0}, redundancy="independent rows")
    assert bool(every.converged.all()) and bool(chosen.converged.all())
    assert np.abs(every.q - chosen.q).max() < 1e-14
    for mine, other in zip(every.rates, chosen.rates, strict=True):
        assert np.abs(mine - other).max() < 1e-12 * max(1.0, float(np.abs(other).max()))


def test_unknown_way_is_refused():
    with pytest.raises(nc.InputError, match="independent rows"):
        nc.sweep(system(), {"phi": TURN}, redundancy="independent")


def test_designs_in_a_batch():
    """vmap over designs is a loop; two factorisations at once used to wait for each other for ever."""
    rng = np.random.default_rng(3)
    designs = [system().replace({"1": RSCR["1"] * (1 + 0.02 * rng.normal())}) for _ in range(12)]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *designs)
    inputs = {"phi": np.linspace(0.0, 1.2, 9)}
    together = nc.jit(jax.vmap(lambda s: nc.sweep(s, inputs)))(batch)
    assert bool(together.converged.all())
    for k in (0, 7):
        alone = nc.sweep(designs[k], inputs)
        assert np.abs(together.q[k] - alone.q).max() < 1e-13
