"""Searches whose designs stay away from flipping, and such as cannot be assembled wrongly."""

from typing import Any

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc import synthesis as S

QUICK: dict[str, Any] = {"starts": 16, "refine": 2, "iterations": 30, "key": jax.random.key(3), "progress": False}


@pytest.fixture(autouse=True)
def cached(tmp_path, monkeypatch):
    """Start sets in a folder of the test's own."""
    monkeypatch.setenv("JAXNC_CACHE", str(tmp_path))


def problem(*conditions, phi=(0.6, 1.0, 1.4, 1.8)):
    """The rocker of a four-bar is to follow a function of its crank, over a part of the crank's turn."""
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0)), m.ground("D", (4, 0)), m.point("B", (0.8, 0.6)), m.point("C", (3.3, 2.9))
    for name, ends in {"crank": "AB", "coupler": "BC", "rocker": "CD"}.items():
        m.body(name, list(ends))
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="D", to="C")
    phi = np.array(phi)
    table = 1.75 + 0.25 * (phi - 0.6) ** 2
    return S.FunctionGeneration(m, "psi", phi, table, "phi", free=["B", "C"], subject_to=list(conditions))


def least(design):
    """How far points move at least to another assembly of `modes`, in every third pose of the design's range."""
    out = []
    for k, phi in list(enumerate(np.asarray(design.turn.asked)[:, 0]))[::3]:
        found = np.asarray(nc.modes(design.system, {"phi": phi}, unit="rad").poses.q)
        count = 2 * len(design.system.topology.points)
        away = (found - np.asarray(design.turn.q[k]))[:, :count].reshape(len(found), -1, 2)
        out.append(np.sort(np.linalg.norm(away, axis=2).max(axis=1))[1])
    return min(out)


def test_a_search_keeps_away_from_other_assemblies():
    free = S.solve(problem(), **QUICK)
    asked = 1.1 * least(free.designs[0])
    kept = S.solve(problem(S.no_flip(distance=asked)), **QUICK)
    assert kept.found and not kept.designs[0].defects
    assert least(kept.designs[0]) > asked - 1e-6


def test_stops_tell_which_circuit_can_be_assembled():
    settings = QUICK | {"starts": 8, "refine": 1, "iterations": 10}
    both = S.solve(problem(S.only_circuit()), **settings)
    assert not both.found and "another circuit, at phi" in both.designs[0].defects[0]
    above = S.solve(problem(S.only_circuit(stops={"C.y": (0.0, None)})), **settings)
    assert above.found and not above.designs[0].defects
    beyond = S.solve(problem(S.only_circuit(stops={"C.y": (40.0, None)})), **settings)
    assert not beyond.found and "never between the stops" in beyond.designs[0].defects[0]
    with pytest.raises(nc.InputError, match=r"no coordinate 'C.z' with a stop"):
        problem(S.only_circuit(stops={"C.z": (0.0, None)}))
    with pytest.raises(nc.InputError, match="give distance"):
        S.no_flip()
