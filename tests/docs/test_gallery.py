"""Every script of examples/gallery runs, moves, and does what its first sentence says."""

import runpy
import sys
from functools import cache

import numpy as np
import pytest
from places import EXAMPLES

import jaxnc as nc

NAMES = sorted(path.stem for path in (EXAMPLES / "gallery").glob("*.py"))


@cache
def shown(name: str) -> dict:
    return runpy.run_path(str(EXAMPLES / "gallery" / f"{name}.py"))


def xy(name: str, point: str) -> np.ndarray:
    return np.asarray(shown(name)["motion"][point])


@pytest.mark.parametrize("name", NAMES)
def test_it_runs_and_moves(name):
    motion = shown(name)["motion"].check()
    assert np.ptp(np.asarray(motion.q), axis=0).max() > 0.02
    assert all(xy(name, point).shape == (len(motion.q), motion.system.topology.dim) for point in shown(name)["trace"])


def straight(p: np.ndarray) -> float:
    """How far points are from a straight line, beside its length."""
    s = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    return s[1] / s[0]


def test_straight_lines_are_straight():
    exact = {"scott_russell": "P", "cardan_circles": "P", "peaucellier": "P", "hart": "Q", "sarrus": "P"}
    assert {n: d for n, p in exact.items() if (d := straight(xy(n, p))) > 1e-13} == {}
    half = xy("hoeken", "P")[:, 1]  # over half of the turn
    assert np.ptp(np.sort(half)[:90]) < 0.01 * np.ptp(xy("hoeken", "P")[:, 0])


def test_curves_are_what_they_are_called():
    p = xy("trammel", "P")  # a rod of 0.5 between the shoes, P as far beyond A again
    np.testing.assert_allclose(p[:, 0] ** 2 + (p[:, 1] / 0.5) ** 2, 1.0, atol=1e-12)
    p = xy("gardeners_ellipse", "P")
    np.testing.assert_allclose((p[:, 0] / 0.6) ** 2 + p[:, 1] ** 2 / (0.36 - 0.16), 1.0, atol=1e-12)
    r = np.linalg.norm(xy("epicycloid", "P"), axis=1)  # from the sun's rim to its rim and two planets, three times
    assert abs(r.min() - 0.3) < 1e-3 and abs(r.max() - 0.5) < 1e-12
    s = xy("rolling_disc", "s")
    np.testing.assert_allclose(xy("rolling_disc", "P1")[:, 0], s, atol=1e-12)
    c = xy("spherical_four_bar", "C")
    assert np.ptp(np.linalg.norm(c - xy("spherical_four_bar", "O"), axis=1)) < 1e-12


def test_couplings_carry_what_they_say():
    phi, psi = xy("oldham", "phi"), xy("oldham", "psi")
    assert np.ptp(psi - phi) < 1e-12
    np.testing.assert_allclose(np.linalg.norm(xy("oldham", "M") - [0.15, 0.0], axis=1), 0.15, atol=1e-12)
    phi, psi = xy("cardan", "phi"), xy("cardan", "psi")
    np.testing.assert_allclose(np.cos(0.7) * np.sin(psi) * np.cos(phi), np.sin(phi) * np.cos(psi), atol=1e-12)
    lean = xy("desk_lamp", "G") - xy("desk_lamp", "F")
    assert np.ptp(lean, axis=0).max() < 1e-12
    assert np.ptp(xy("pantograph", "Q")[:, 0]) > 1.5 * np.ptp(xy("pantograph", "P")[:, 0])


def test_a_flat_follower_shows_the_eccentric():
    motion = shown("eccentric_cam")["motion"]
    np.testing.assert_allclose(
        xy("eccentric_cam", "F")[:, 1], 0.05 + 0.02 * np.sin(xy("eccentric_cam", "phi")), atol=1e-14
    )
    np.testing.assert_allclose(
        np.asarray(motion.velocity("F"))[:, 1], 0.2 * np.cos(xy("eccentric_cam", "phi")), atol=1e-12
    )


def test_sarrus_moves_against_the_count():
    found = nc.mobility(shown("sarrus")["m"].compile())
    assert found.dof == 1 and found.grubler < 1


def test_the_maker_writes_what_there_is_to_see(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    sys.modules.pop("make_gallery", None)
    import make_gallery

    assert make_gallery.make("trammel", str(tmp_path), film=False) == "trammel"
    assert {p.name for p in tmp_path.iterdir()} == {"trammel.png", "trammel.html"}
    found = make_gallery.entries()
    assert len(found) == len(NAMES) >= 40
    assert all(e.tried and e.seen and e.code.startswith("import numpy") for e in found)
    page = make_gallery.overview(found, film=False)
    assert all(f'href="{name}.html"' in page for name in NAMES)
    with pytest.raises(SystemExit, match="no nonesuch in"):
        make_gallery.entries(["nonesuch"])
