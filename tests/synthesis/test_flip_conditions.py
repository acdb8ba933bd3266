"""Searches whose designs stay away from flipping, and such as cannot be assembled wrongly."""

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc import synthesis as S

QUICK = {"starts": 64, "refine": 6, "iterations": 40, "key": jax.random.key(3), "progress": False}


@pytest.fixture(autouse=True)
def cached(tmp_path, monkeypatch):
    """Start sets in a folder of the test's own."""
    monkeypatch.setenv("JAXNC_CACHE", str(tmp_path))


def problem(*conditions, phi=(0.6, 1.0, 1.4, 1.8)):
    """The rocker of a four-bar is to follow a function of its crank, over a part of the crank's turn."""
    m = nc.library.four_bar()
    phi = np.array(phi)
    return S.FunctionGeneration(m, "psi", "phi", phi, 1.2 + 0.3 * (phi - 0.6) ** 2, subject_to=list(conditions))


def least(design):
    """How far points move at least to another assembly of `modes`, over the design's range."""
    out = []
    for k, phi in enumerate(np.asarray(design.turn.asked)[:, 0]):
        found = np.asarray(nc.modes(design.system, {"phi": phi}, unit="rad").poses.q)
        count = 2 * len(design.system.topology.points)
        away = (found - np.asarray(design.turn.q[k]))[:, :count].reshape(len(found), -1, 2)
        out.append(np.sort(np.linalg.norm(away, axis=2).max(axis=1))[1])
    return min(out)


def test_a_search_keeps_away_from_other_assemblies():
    free = S.solve(problem(), **QUICK)
    asked = 1.3 * least(free.best)
    kept = S.solve(problem(S.no_flip(distance=asked)), **QUICK)
    assert kept.found and not kept.best.defects
    assert least(kept.best) > asked * (1.0 - 1e-6)
    assert "no flip" in problem(S.no_flip(input=0.1)).conditions[-1].name
