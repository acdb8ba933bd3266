"""Sizes from stock against exhaustive enumeration, a front against its closed form; both of one slider-crank."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.synthesis.search.refine import Refinement

S = nc.synthesis
PHI = np.linspace(0.3, 2.8, 12)
CRANKS, RODS = (0.08, 0.1, 0.105, 0.125, 0.15), (0.2, 0.22, 0.25, 0.32, 0.35)
SETTINGS = {"starts": 20, "refine": 20, "iterations": 100}


def slider(crank, rod, phi=PHI):
    return crank * np.cos(phi) + np.sqrt(rod**2 - (crank * np.sin(phi) - 0.02) ** 2)


WANTED = slider(0.1137, 0.2712) + 0.002 * np.sin(5 * PHI)


@pytest.fixture(scope="module")
def mechanism():
    return nc.library.slider_crank(fixed_guide=True)


def problem(mechanism, subject_to):
    return S.FunctionGeneration(
        mechanism,
        "C.x",
        PHI,
        WANTED,
        free=["crank.A-B", "conrod.B-C"],
        output_offset=True,
        bounds={"crank.A-B": (0.02, 0.2), "conrod.B-C": (0.15, 0.6)},
        subject_to=subject_to,
    )


@pytest.mark.slow
def test_stock_sizes_are_those_of_exhaustive_enumeration(mechanism):
    result = S.solve(
        problem(mechanism, [S.stock(("A", "B"), CRANKS), S.stock("conrod.B-C", RODS)]), **SETTINGS, progress=False
    )

    def error(crank, rod):
        off = slider(crank, rod) - WANTED
        return np.sum((off - off.mean()) ** 2)

    table = sorted((error(a, b), a, b) for a in CRANKS for b in RODS)
    assert not result.designs[0].defects
    for design, (least, crank, rod) in zip(result.designs[:4], table, strict=False):
        np.testing.assert_allclose(design.x[:2], (crank, rod), atol=1e-9)
        assert design.error == pytest.approx(least, rel=1e-6)
    # What the sizes cost is said, against the best of all lengths.
    from scipy.optimize import minimize

    free = minimize(
        lambda v: 1e4 * error(*v), (0.11, 0.27), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}
    )
    assert result.relaxed.error == pytest.approx(1e-4 * free.fun, rel=1e-5)
    assert f"cost {result.error - result.relaxed.error:.3g}" in str(result)


def test_a_front_says_whose_end_it_left_out(tmp_path):
    """The stroke nears what is wanted the more, the nearer the rod comes to being straight across its guide."""
    m = nc.Mechanism("slider crank")
    m.ground("O", (0, 0))
    m.point("A", (30, 10))
    m.point("S", (150, 20), fixed="y")
    m.body("crank", ["O", "A"])
    m.body("rod", ["A", "S"])
    m.angle("phi", "O", "A")
    goal = S.Objective(
        m,
        [
            lambda mo: (jnp.ptp(mo["S"][:, 0]) - 80.0) / 10,
            lambda mo: (mo["A"][:, 1] - mo["S"][:, 1]).max() / 50,
        ],
        np.linspace(0, 2 * np.pi, 73),
        input="phi",
        free=["A", "S.x"],
        subject_to=[S.crank_turns(), S.length("A", "S", 50, 200)],
    )
    front = S.pareto(goal, points=4, starts=40, refine=6, key=jax.random.key(0))
    assert len(front.lost) == 1 and front.lost[0].startswith("objective 1, which has a transmission angle of")
    assert "left out is the best in objective 1, which" in str(front) and "transmission_angle(min)" in str(front)
    assert str(S.Front.load(front.save(tmp_path / "front"), goal)) == str(front)


@pytest.mark.slow
def test_a_front_that_is_not_convex(mechanism, tmp_path):
    """C. Fonseca, P. Fleming 1995 in two variables: 1 - exp(-|v ∓ (1, 1)/√2|²), on the line between both centres.

    Its front bulges towards worse values: weighted sums find only its two ends.
    """

    def from_(way):
        def residuals(motion):
            sides = [(motion[a][0] - motion[b][0]) for a, b in ("AB", "BC")]
            v = 20.0 * (jnp.stack([jnp.linalg.norm(s) for s in sides]) - jnp.array([0.1, 0.3]))
            d = v - way / jnp.sqrt(2.0)
            square = jnp.sum(d * d)
            return d * jnp.sqrt(-jnp.expm1(-square) / jnp.maximum(square, 1e-300))

        return residuals

    goal = S.Objective(
        mechanism,
        [from_(1.0), from_(-1.0)],
        PHI,
        free=["crank.A-B", "conrod.B-C"],
        bounds={"crank.A-B": (0.02, 0.2), "conrod.B-C": (0.22, 0.6)},
    )
    front = S.pareto(goal, points=8, key=jax.random.key(0), names=("first", "second"), **SETTINGS)
    f = front.values**2
    assert len(f) >= 7
    # The closed form: |v ∓ centre| add up to 2 along the line between them.
    along = np.sqrt(-np.log1p(-f))
    np.testing.assert_allclose(along.sum(axis=1), 2.0, atol=1e-5)
    assert along[:, 0].max() - along[:, 0].min() > 1.99
    assert np.all(np.diff(f[:, 0]) > 0) and np.all(np.diff(f[:, 1]) < 0)
    assert all(design.converged for design in front.designs) and "converged" in str(front)
    assert f"{len(f)} designs" in str(front) and "first against second" in str(front)
    one = dataclasses.replace(front, values=front.values[:1], designs=front.designs[:1])
    assert "the front is one point" in str(one) and "do not contradict each other" in str(one)
    front.plot(tmp_path / "front.png")
    assert (tmp_path / "front.png").stat().st_size > 10_000
    again = S.Front.load(front.save(tmp_path / "front"), goal)
    assert str(again) == str(front) and (tmp_path / "front" / "designs.txt").read_text() == f"{front}\n"
    np.testing.assert_array_equal(again.values, front.values)
    with pytest.raises(nc.ModelFileError, match=r"Result\.save"):
        S.load(tmp_path / "front", goal)
    with pytest.raises(nc.InputError, match="needs at least 3"):
        S.pareto(goal, points=2)
    with pytest.raises(nc.InputError, match="others={name: function".replace("{", "[{]")):
        S.pareto(problem(mechanism, []))


def test_a_front_does_not_depend_on_the_sizes_of_its_objectives():
    """The same two functions, one in another unit and both weighted; an end is found from between the ends only.

    A grid over both numbers shows where the front is: along C.y = 2.4, from B.x = 0.3 to 0.8.
    """
    m = nc.Mechanism("four-bar")
    a, b, c, d = m.ground("A", (0, 0)), m.point("B", (0.5, 1)), m.point("C", (3.3, 2.9)), m.ground("D", (4, 0))
    for name, ends in (("crank", (a, b)), ("coupler", (b, c)), ("rocker", (c, d))):
        m.body(name, ends)
    m.angle("phi", at=a, to=b, start=d)
    m.angle("psi", at=d, to=c)
    turn = np.radians([30, 60, 90])
    free = {"free": ["B.x", "C.y"], "bounds": {"B.x": (0.3, 0.8), "C.y": (2.4, 3.2)}}
    for two, weights in ((1.0, None), (1e4, (4.0, 25.0))):
        both = [lambda x: x["psi"][0] - 1.2, lambda x, k=two: k * (x["C"][-1, 1] - 2.0)]
        goal = S.Objective(m, both, turn, weights=weights, input="phi", **free)
        front = S.pareto(goal, points=5, starts=30, refine=4, key=jax.random.key(1))
        x, y = np.array([[d.system["B"][0], d.system["C"][1]] for d in front.designs]).T
        assert len(x) == 5 and np.all(np.diff(x) > 0) and (x[0], x[-1]) == pytest.approx((0.3, 0.8), abs=1e-6)
        np.testing.assert_allclose(y, 2.4, atol=1e-6)
        np.testing.assert_allclose(np.diff(front.values[:, 1], 2), 0.0, atol=1e-6 * two)  # evenly spaced
        for design, values in zip(front.designs, front.values, strict=True):
            moved = nc.sweep(design.system, {"phi": turn})
            np.testing.assert_allclose(values, [abs(float(f(moved))) for f in both], rtol=1e-9)


def test_the_least_error_of_a_front_does_not_depend_on_the_unit_of_length():
    """An error in parts of the target's size beside a rod of 0.3 or of 3e4: the rod does not draw its end away."""
    turn, found = np.linspace(1.0, 3.0, 5), []
    for unit in (1.0, 1e5):
        m = nc.Mechanism("four-bar")
        a, d = m.ground("A", (0, 0)), m.ground("D", (0.4 * unit, 0))
        b, c = m.point("B", (0.05 * unit, 0.1 * unit)), m.point("C", (0.33 * unit, 0.29 * unit))
        for name, ends in (("crank", (a, b)), ("rocker", (c, d))):
            m.body(name, ends)
        m.body("coupler", (b, c, m.point("P", (0.2 * unit, 0.4 * unit))))
        m.angle("phi", at=a, to=b)
        path = nc.sweep(m.compile(), {"phi": turn + 0.1})["P"] + 0.01 * unit * np.c_[np.cos(turn), np.sin(2 * turn)]
        goal = S.PathGeneration(m, "P", path, timing=turn, free=["B", "C", "P"])
        rod = {"rod": lambda motion: motion["C"][0] - motion["B"][0]}
        found.append(S.pareto(goal, rod, points=3, starts=30, refine=4, key=jax.random.key(1)).values[0] / unit)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-5)


def test_an_interrupted_front_is_what_was_found(mechanism, monkeypatch):
    goal = S.Objective(
        mechanism,
        [lambda motion: motion["B"][0] - 0.08, lambda motion: motion["C"][0] - 0.3],
        PHI[:3],
        free=["crank.A-B", "conrod.B-C"],
        bounds={"crank.A-B": (0.02, 0.2), "conrod.B-C": (0.22, 0.6)},
    )
    go, rounds = Refinement.go, []

    def interrupted(run, best):
        go(run, best)
        rounds.append(best)
        if len(rounds) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(Refinement, "go", interrupted)
    front = S.pareto(goal, points=4, starts=20, refine=4, names=("first", "second"))
    assert front.stopped == "interrupted" and "the search was interrupted" in str(front)
    assert len(front.designs) >= 1 and len(rounds) == 2
    monkeypatch.setattr(Refinement, "go", go)
    whole = S.pareto(goal, points=4, starts=20, refine=4, names=("first", "second"))
    assert not whole.stopped and all(design.converged for design in whole.designs)


def test_a_condition_is_met_between_the_poses_that_a_search_looks_at(mechanism):
    """How far the crank reaches in one direction, which it points in midway between two of 48 poses."""
    way, most = PHI[0] + 20.5 / 47 * np.ptp(PHI), 0.105

    def reach(motion):
        return 10.0 * (most - motion["B"] @ jnp.array([np.cos(way), np.sin(way)]))

    goal = problem(mechanism, [S.condition(reach, "reach", over_range=True)])
    result = S.solve(goal, **SETTINGS, progress=False)
    assert result.found and result.broken == 0
    crank, rod = result.designs[0].x[:2]
    judged = np.cos(np.linspace(*PHI[[0, -1]], 181) - way).max()
    looked_at = np.cos(np.linspace(*PHI[[0, -1]], 48) - way).max()
    assert judged - looked_at > 3e-4  # of the crank's length, by which it would be too long
    assert crank == pytest.approx(most / judged, rel=1e-4) and crank * judged <= most + 1e-8
    from scipy.optimize import minimize_scalar

    def error(rod):
        off = slider(most / judged, rod) - WANTED
        return 1e4 * np.sum((off - off.mean()) ** 2)

    best = minimize_scalar(error, bounds=(0.15, 0.6), options={"xatol": 1e-10})
    assert rod == pytest.approx(best.x, rel=1e-3) and 1e4 * result.error == pytest.approx(best.fun, rel=1e-3)


def test_words_for_a_front_of_one_point():
    from jaxnc.synthesis.search.fronts import _pareto_rows

    values = np.array([[1.0, 2.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0 + 1e-9], [0.5, 3.0]])
    assert _pareto_rows(values) == [0, 1, 4]
    assert _pareto_rows(np.array([[0.0, 1.0], [0.0, 1.0], [3.0, 1.0]])) == [0]
    assert _pareto_rows(np.zeros((0, 2))) == []


def test_sizes_and_symmetry_are_checked(mechanism):
    for make, words in (
        (lambda: S.stock("A-B", []), "must be a list of finite numbers"),
        (lambda: S.stock(("A", "B"), [-1.0]), "a length is positive"),
        (lambda: S.integer("A-B", 0.0), "step must be a positive number"),
        (lambda: S.stock(3, [1.0]), "give two points"),
        (lambda: problem(mechanism, [S.stock("crank", [1.0])]), "did you mean 'crank.A-B'"),
        (lambda: problem(mechanism, [S.stock(("A", "Q"), [1.0])]), "no point 'Q'"),
        (lambda: S.symmetric("B", "C", about=("A", "A")), "two points of a line"),
        (lambda: problem(mechanism, [S.symmetric("B", "Q")]), "no point 'Q'"),
        (lambda: problem(mechanism, [S.length("A", "B", min=5), S.length("B", "A", max=2)]), "contradict each other"),
    ):
        with pytest.raises(nc.InputError, match=words):
            make()
