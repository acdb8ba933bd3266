"""What searches say: numbers with their units, counts that agree, and mistakes named before any work."""

import numpy as np
import pytest

import jaxnc as nc
from benchmarks.synthesis.published import ARC, four_bar
from jaxnc.synthesis.refinement import Refinement

S = nc.synthesis
TIMING = np.radians([30, 45, 60, 75, 90])
WEIGHTS = np.array([1e-4, 4e-4, 1e-4, 9e-4, 1e-4])
FEW = {"starts": 60, "refine": 60, "iterations": 40, "keep": 2, "progress": False}


def path(**more):
    settings = {"timing": TIMING, "free": ["B", "C"], "weights": WEIGHTS} | more
    return S.PathGeneration(four_bar(), "P", ARC, **settings)


@pytest.fixture(scope="module")
def weighted():
    return S.solve(path(), **FEW)


# -- numbers and units -----------------------------------------------------------------------------------------------


def test_largest_and_rms_are_lengths_without_weights(weighted):
    best = weighted.designs[0]
    far = np.linalg.norm(np.asarray(nc.sweep(best.system, {"phi": TIMING})["P"]) - ARC, axis=1)
    np.testing.assert_allclose(best.largest, far.max(), rtol=1e-9)
    np.testing.assert_allclose(best.rms, np.sqrt(np.mean(far**2)), rtol=1e-9)
    np.testing.assert_allclose(best.error, WEIGHTS @ far**2, rtol=1e-9)
    words = str(weighted)
    assert f"best error {best.error:.6g} m^2 (weighted; largest {far.max():.3g} m, rms" in words
    assert all(head in words for head in ("error [m^2]", "largest [m]", "rms [m]"))
    # With the largest error made small, that one is with weights and a length.
    level = S.solve(path(minimax=True), **FEW)
    best = level.designs[0]
    far = np.linalg.norm(np.asarray(nc.sweep(best.system, {"phi": TIMING})["P"]) - ARC, axis=1)
    np.testing.assert_allclose(best.error, np.max(np.sqrt(WEIGHTS) * far), rtol=1e-9)
    np.testing.assert_allclose(best.largest, far.max(), rtol=1e-9)
    assert "error [m]  " in str(level)


def test_the_bar_shows_a_sum_of_squares_in_square_metres(capsys):
    S.solve(path(), **(FEW | {"starts": 4, "refine": 4, "iterations": 20, "progress": True}))
    assert "m^2" in capsys.readouterr().err


def test_an_interrupted_search_counts_once(monkeypatch):
    go, rounds = Refinement.go, []

    def interrupted(self, best):
        rounds.append(best)
        if len(rounds) == 2:
            raise KeyboardInterrupt
        go(self, best)

    monkeypatch.setattr(Refinement, "go", interrupted)
    part = S.solve(path(), **FEW)
    assert part.refined == part.history[-1].designs
    assert f"interrupted with {part.refined} of " in part.stopped and " on the way" in part.stopped
    assert f"60 designs screened, {part.refined} refined)" in str(part)


def test_targets_are_counted_from_one():
    bad = [*ARC[:2], (np.nan, 1.0), *ARC[3:]]
    with pytest.raises(nc.InputError, match="target point 3 is not finite"):
        S.PathGeneration(four_bar(), "P", bad)
    with pytest.raises(nc.InputError, match="timing: number 2 is not finite"):
        path(timing=[0.1, np.inf, 0.3, 0.4, 0.5])
