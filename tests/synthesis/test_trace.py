"""From a drawn curve to linkages: chains counted, moved, fitted, and written as mechanisms."""

import dataclasses
import json
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tracing import LANES, shorten, small_atlas
from turning_chains import count_chains

import jaxnc as nc
from jaxnc.cli.main import main
from jaxnc.errors import ModelFileError
from jaxnc.io.curve_files import load_curve
from jaxnc.synthesis import conditions as S
from jaxnc.synthesis.clearance import clear_of
from jaxnc.synthesis.tracing import atlas as making
from jaxnc.synthesis.tracing import fit
from jaxnc.synthesis.tracing import trace as searching
from jaxnc.synthesis.tracing.atlas import ChainDesign, closed_coefficients, lay_closed, normalise, to_mechanism
from jaxnc.synthesis.tracing.chains import Chain, Hung, dyadic_chains
from jaxnc.synthesis.tracing.trace import Curve, curve_distance, space_evenly
from jaxnc.viz.pages import page as page_module


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A folder like that in which a user's atlas is kept."""
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def small(cache):
    """An atlas of a few thousand linkages."""
    with pytest.MonkeyPatch.context() as patch:
        yield small_atlas(patch, cache / "atlas")


@pytest.fixture
def brief(monkeypatch):
    """Rounds of a search that are shorter: fewer candidates, and fewer steps for each."""
    shorten(monkeypatch)


def unseen(bars, count, seed=1):
    """Designs that no atlas has, over the chains in turns."""
    shelf = making.make(bars, np.random.default_rng(seed))
    kept = {int(c): k for k, c in enumerate(shelf.chain)}
    for k in list(kept.values())[:count]:
        chain = shelf.chains[shelf.chain[k]]
        yield ChainDesign(
            chain, shelf.sign[k].astype(float), shelf.design[k].astype(float), 0.3j, 1.4 - 0.5j, 0.4, 6.28
        )


@pytest.mark.parametrize(("bars", "chains", "inversions"), [(4, 1, 1), (6, 2, 5), (8, 16, 71)])
def test_chains_are_those_of_the_literature(bars, chains, inversions):
    """And those of dyads come out alike whether they are hung up or sorted out of all."""
    census = count_chains(bars)
    assert (census.chains, census.inversions) == (chains, inversions)
    assert census.dyadic == len(dyadic_chains(bars, sliders=False))


def test_known_linkages_are_called_by_their_names():
    names = {chain.name for chain in dyadic_chains(6, sliders=False)}
    assert names == {"Watt I", "Watt II", "Stephenson I", "Stephenson III"}  # no crank-driven Stephenson II is of dyads
    assert Chain((Hung("RRP", 1, 0),), 2).name == "slider-crank"
    assert "Jansen" in {chain.name for chain in dyadic_chains(8, sliders=False)}


@pytest.mark.parametrize("bars", [4, 6, 8])
def test_designs_move_as_mechanisms(bars):
    """By the closed form and by the library's own solver, with turning and with sliding joints."""
    turn = np.linspace(0.0, 2.0 * np.pi, 25)
    for drawn in unseen(bars, 8 if bars > 4 else 5):
        mechanism, begin = to_mechanism(drawn)
        motion = nc.sweep(mechanism.compile(), {"phi": begin + turn})
        found = np.asarray(motion["P"]) @ [1, 1j]
        wanted = drawn.trace(drawn.begin + turn)
        assert np.abs(found - wanted).max() < 1e-9 * np.ptp(wanted.real), drawn.chain


def heart(count=200):
    t = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    y = 13 * np.cos(t) - 5 * np.cos(2 * t) - 2 * np.cos(3 * t) - np.cos(4 * t)
    return 0.01 * np.stack([16 * np.sin(t) ** 3, y], axis=1) + [3.0, 1.0]


def test_a_curve_is_known_in_any_place_size_turn_and_mirror():
    points = space_evenly(np.vstack([heart(), heart()[:1]]), 129)[:-1]
    turned = (points @ [1, 1j]) * 0.3 * np.exp(0.7j) + 5
    goal = normalise(closed_coefficients(points))
    for z, mirrored in ((turned, False), (np.conj(turned), True), (np.roll(turned, 31)[::-1], False)):
        found = normalise(closed_coefficients(np.stack([z.real, z.imag], axis=1)))
        left, _, flipped = lay_closed(goal, found[None])
        assert left[0] < 2e-3
        assert mirrored == flipped[0] or left[0] < 1e-5  # a heart is its own mirror image


@jax.jit  # one program for all tests
def look(lanes, at, target, feet):
    """Poses along the curves of designs, and what designs that may differ a little, `at`, cost in these poses."""

    def one(chain, sign, row, at):
        go = jnp.all(jnp.isfinite(at))
        share = fit._spread_poses(chain, sign, row, target, go)
        cost, _, slope, _ = fit._look(chain, sign, share, target, go, feet, at)
        return share, cost, slope

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit, "_NEAR", 1e-9)  # nearer ones count by squares, where distances count rather than squares
        return jax.lax.map(lambda lane: one(*lane), (*lanes, at))


NO_BOX = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])


@pytest.mark.parametrize("both, mean, feet", [(False, False, 20), (True, False, 0), (True, True, 0)])
def test_slopes_are_those_of_the_cost(small, both, mean, feet):
    """Against differences: feet of perpendiculars move, and with the chords the weights of poses change."""
    t = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    target = Curve.of(np.stack([np.cos(t), 0.6 * np.sin(t) + 0.1 * np.sin(2 * t)], axis=1), True)  # without cusps
    points = target.target(both, -1.0, NO_BOX, 1e6, mean)
    found = small.find(target.even, True, 6, 1)
    lane = fit.start_lanes(target.even, True, found, making.chain_arrays(6).at(found.shelf.chain))
    lanes = jax.tree.map(lambda x: np.repeat(x, LANES, axis=0), lane)
    changed = np.arange(0, lane.row.shape[1] - 2, 3)
    at = np.array(lanes.row)
    for way, first in ((1.0, 1), (-1.0, 1 + len(changed))):
        at[first + np.arange(len(changed)), changed] += way * 1e-6
    _, cost, slope = (np.asarray(a) for a in look(lanes, at, points, feet))
    numeric = (cost[1 : 1 + len(changed)] - cost[1 + len(changed) : 1 + 2 * len(changed)]) / 2e-6
    # Of distances that are weighted by themselves the slope is that of their sum, not of half its square.
    told = (1.0 if mean else 2.0) * slope[0, changed]
    assert np.abs(told - numeric).max() < 1e-5 * np.abs(slope[0]).max()


def test_poses_are_spread_along_the_curve(small):
    """Where the point of a linkage is quick it is looked at more often; costs are those of such poses."""
    target = Curve.of(heart(), True)
    goal = target.target(True, -1.0, NO_BOX, 1e6)
    shelf = small.shelves[6].at(np.argsort(small.shelves[6].sine)[:16])  # near the limit of transmission
    row = np.concatenate([shelf.design, np.tile([0.0, 0.0, 1.0, 0.0, 0.3, 2.0 * np.pi], (16, 1))], axis=1)
    lanes = fit.Lanes(making.chain_arrays(6).at(shelf.chain), shelf.sign.astype(float), row)
    lanes = jax.tree.map(lambda x: np.resize(x, (LANES, *x.shape[1:])), lanes)
    moved, _, cost = (np.asarray(a) for a in fit.refine(lanes, goal, 3, 0))
    share, again, _ = (np.asarray(a)[:16] for a in look(lanes._replace(row=moved), moved, goal, 0))
    assert (share[:, 0] == 0.0).all() and (np.diff(share) > 0.0).all() and (share[:, -1] < 1.0).all()
    for shares, least, most in ((share, 1.0, 1.7), (np.tile(np.arange(fit.COUNT) / fit.COUNT, (16, 1)), 3.0, np.inf)):
        uneven = []
        for k, at in enumerate(shares):
            drawn = ChainDesign(shelf.chains[shelf.chain[k]], shelf.sign[k], moved[k, :-6], 0j, 1.0, 0.0, 6.28)
            path = drawn.trace(moved[k, -2] + 2.0 * np.pi * at)
            chords = np.abs(path - np.roll(path, 1))
            uneven.append(chords.max() / chords.mean())
        assert least < np.median(uneven) < most
    apart = np.sort(np.abs(again / cost[:16] - 1.0))  # feet that four steps do not settle multiply what rounding does
    assert apart[4] < 1e-12 and apart[-1] < 1e-2


def test_a_pool_has_few_designs_of_one_candidate(small, brief):
    target, terms = Curve.of(heart(), True), searching._Terms.of([], (6,))
    search = searching._Search(target, terms, small, 6, None, np.random.default_rng(0))
    for _ in range(4):
        search.round()
    assert len(search.line) == len(search.cost) == len(search.pool.row)
    _, count = np.unique(search.line, return_counts=True)
    assert 1 < count.max() <= searching._OF_LINE and search.lines > len(count) > 20


def test_timings_give_the_range_of_a_crank_in_every_round(small, brief):
    u = np.linspace(0.0, 1.0, 30)
    points = np.stack([3.0 * u, np.sin(5.0 * u) + u**2], axis=1)
    search = searching._Search(Curve.of(points, False, 2.5 * u), searching._Terms.of([], (6,)), small, 6, None,
                               np.random.default_rng(0))  # fmt: skip
    for _ in range(2):
        search.round()
    assert np.ptp(search.pool.row[:, -2]) > 0.1  # where it begins is sought
    np.testing.assert_allclose(search.pool.row[:, -1], 2.5, rtol=1e-12)


def test_what_comes_out_meets_the_transmission_between_the_poses_too(small, brief):
    """Most of what a search keeps does, since the worst place is looked for beside the poses."""
    target, terms = Curve.of(heart(), True), searching._Terms.of([S.transmission_angle(0.5)], (6,))
    search = searching._Search(target, terms, small, 6, None, np.random.default_rng(0))
    for _ in range(4):
        search.round()
    firm = search.finish(64)[1]
    sines = np.asarray(fit.trace_curves(firm, 720, 1.0)[1])
    assert np.mean(sines > 0.999 * np.sin(0.5) ** 2) > 0.5


def test_a_four_bar_is_found_by_its_curve(small, brief):
    drawn = next(d for d in unseen(4, 5, seed=2) if d.chain.name == "four-bar")
    z = drawn.trace(np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False))
    result = nc.synthesis.trace(np.stack([z.real, z.imag], axis=1), bars=(4,), seconds=20, source=small)
    assert result.closed and result.best.exact and "meet all points" in result.stopped
    assert result.best.name == "four-bar" and "4" in str(result).splitlines()[2]
    numbers = result.best.numbers
    turn = numbers.begin + np.linspace(0.0, 2.0 * np.pi, 2001)
    own = numbers.trace(turn)
    assert np.abs(np.asarray(result.best.move(2001)["P"]) @ [1, 1j] - own).max() < 1e-12 * np.ptp(own.real) * 1e3
    for place in drawn.trace(
        np.linspace(0.0, 2.0 * np.pi, 37)
    ):  # between the points too, by Newton's steps to the foot
        angle = turn[np.abs(own - place).argmin()]
        for _ in range(6):
            before, here, after = numbers.trace([angle - 1e-5, angle, angle + 1e-5])
            slope = (after - before) / 2e-5
            angle += ((place - here) * np.conj(slope)).real / abs(slope) ** 2
        assert abs(numbers.trace(angle)[0] - place) < 1e-9 * np.ptp(own.real)


@pytest.mark.parametrize(("turn", "keeps"), [(2 * np.pi, True), (2.5, False)])
def test_a_curve_through_all_points_may_still_be_another_one(turn, keeps):
    """Of points on a part of a closed curve the rest of it is far away: such a linkage does not end a search."""
    drawn = next(d for d in unseen(4, 5, seed=2) if d.chain.name == "four-bar")
    z = drawn.trace(np.linspace(0.0, turn, 60, endpoint=False))
    target = Curve.of(np.stack([z.real, z.imag], axis=1), True)
    place, factor = (drawn.place - target.centre @ [1, 1j]) / target.size, drawn.factor / target.size
    row = [*drawn.design, place.real, place.imag, factor.real, factor.imag, drawn.begin, drawn.span]
    lanes = fit.Lanes(making.ChainArrays.of((drawn.chain,)), drawn.sign[None], np.array(row)[None])
    assert searching._keep_to_line(target, lanes).tolist() == [keeps]


@pytest.mark.parametrize("way", [1, -1])
def test_given_timings_are_met(way, small, brief):
    """The crank goes from the first point to the last, also where it turns backwards."""
    drawn = next(d for d in unseen(4, 5, seed=2) if d.chain.name == "four-bar")
    timing = np.linspace(2.0, 6.5, 15)[::way]
    z = drawn.trace(timing)
    points, more = np.stack([z.real, z.imag], axis=1), {"bars": (4,), "source": small}
    result = nc.synthesis.trace(points, False, timing, seconds=20, **more)
    best = result.best
    assert best.exact and best.distance < 1e-10
    np.testing.assert_array_equal(result.points, points)
    assert best.travel[1] - best.travel[0] == pytest.approx(timing[-1] - timing[0], abs=1e-12)
    motion = nc.sweep(best.system, {"phi": best.travel[0] + timing - timing[0]})
    assert np.abs(np.asarray(motion["P"]) @ [1, 1j] - z).max() < 1e-9 * np.ptp(z.real)
    closed = nc.synthesis.trace(points, True, timing, seconds=0.1, **more).best
    found = np.asarray(nc.sweep(closed.system, {"phi": closed.travel[0] + timing - timing[0]})["P"]) @ [1, 1j]
    error = np.sqrt(np.mean(np.abs(found - z) ** 2)) / Curve.of(points, True).size
    assert closed.distance == pytest.approx(error, rel=1e-9) and way * np.diff(closed.travel) > 6.28


def test_points_that_are_not_looked_at_on_the_way_are_judged(small, brief):
    """Of more points than a search looks at, the others lie beside the curve: not all are met, and it says how far."""
    drawn = next(d for d in unseen(4, 5, seed=2) if d.chain.name == "four-bar")
    timing = np.linspace(2.0, 6.5, 129)
    z = drawn.trace(timing)
    size = Curve.of(np.stack([z.real, z.imag], axis=1), False).size
    aside = np.setdiff1d(np.arange(129), Curve.of(np.stack([z.real, z.imag], axis=1), False).sample)
    moved = z.copy()
    moved[aside] += 0.3 * size
    points, more = np.stack([moved.real, moved.imag], axis=1), {"bars": (4,), "seconds": 1, "source": small}
    best = nc.synthesis.trace(points, False, timing, **more).best
    found = np.asarray(nc.sweep(best.system, {"phi": best.travel[0] + timing - timing[0]})["P"])
    error = np.sqrt(np.mean(np.sum((found - points) ** 2, axis=1))) / Curve.of(points, False).size
    assert not best.exact and best.distance == pytest.approx(error, rel=1e-9) and error > 0.1
    z = drawn.trace(np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False))
    z[1::2] += 0.01 * (z[1::2] - z.mean())
    assert not nc.synthesis.trace(np.stack([z.real, z.imag], axis=1), **more).best.exact


@pytest.mark.parametrize("count", [24, 60, 200])
def test_a_curve_is_closed_wherever_it_begins(count):
    t = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    for curve in ((np.cos(t), 0.2 * np.sin(t)), (np.sin(t), 0.2 * np.cos(t)), (np.sin(t), 0.5 * np.sin(2 * t))):
        assert Curve.of(np.stack(curve, axis=1), None).closed
    assert not Curve.of(np.stack([np.cos(t), 0.2 * np.sin(t)], axis=1)[: -count // 6], None).closed


def test_a_crank_that_turns_at_a_small_transmission_angle_turns(small, brief):
    """Lengths 4, 1, 3, 2.003: the least transmission angle is 4 degrees."""
    t = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    crank = np.exp(1j * t)
    apart, to = np.abs(4 - crank), np.angle(4 - crank)
    coupler = crank + 3 * np.exp(1j * (to + np.arccos((9 + apart**2 - 2.003**2) / (6 * apart))))
    z = crank + (0.4 + 0.3j) * (coupler - crank)
    asked = [S.transmission_angle(0.02), S.crank_turns()]
    points = np.stack([z.real, z.imag], axis=1)
    best = nc.synthesis.trace(points, bars=(4,), subject_to=asked, seconds=10, source=small).best
    assert best.exact and best.turns and best.transmission < np.radians(5)


def test_conditions_are_met(small, brief):
    """Several of a kind count together."""
    box = (2.5, 3.5), (0.3, 1.5)
    asked = [S.transmission_angle(0.5), S.transmission_angle(0.2)]
    asked += [S.within("ground", *box), S.within("ground", x=(0.0, 9.0))]
    result = nc.synthesis.trace(heart(), True, bars=(4,), subject_to=asked, seconds=5, source=small, sliders=False)
    assert result.designs and result.refined > 0
    for design in result.designs:
        assert design.transmission >= 0.499 and design.turns and design.bars == 4 and not design.chain.sliders
        model = design.mechanism.model
        (low, high), pivots = np.array(box).T, np.array(list(model.ground.values()))
        assert ((pivots >= low) & (pivots <= high)).all()
    assert [d.distance for d in result.designs] == sorted(d.distance for d in result.designs)


def test_links_keep_clear_of_a_ceiling(small, brief):
    """Of what is found without a ceiling links run into it; with it none does, by the robust solver in 2,000 poses."""
    high, width = heart()[:, 1].max() + 0.03, 0.02
    ceiling = [(2.0, high), (4.0, high + 1.0)]
    how = {"bars": (4,), "seconds": 0.5, "source": small, "sliders": False}
    before = nc.synthesis.trace(heart(), True, **how)
    after = nc.synthesis.trace(heart(), True, subject_to=[clear_of(ceiling, width=width)], **how)
    told = {}
    for result in (before, after):
        for design in result.designs[:3]:
            motion, least = design.move(2001), np.inf
            for body in design.mechanism.model.bodies.values():
                places = np.stack([np.asarray(motion[name]) for name in body.points])
                # Convex, and the ceiling is wide: its nearest point is a corner, if it is below the ceiling.
                inside = np.abs(places[..., 0] - 3.0) < 1.0
                least = min(least, high - places[..., 1][inside].max(initial=-np.inf) - 0.5 * width)
            told.setdefault(result is after, []).append((least, design.clearance(ceiling, width)))
    assert min(least for least, _ in told[False]) < 0.0
    assert after.designs and min(least for least, _ in told[True]) >= 0.0
    for least, known in told[True]:
        assert 0.0 <= known <= least + 1e-9
        assert least > 0.05 or known == pytest.approx(least, abs=2e-3)


def test_a_crank_may_keep_clear_of_what_encloses_the_curve(small, brief):
    """The crank's circle lies beyond the box, which holds the heart and what traces it."""
    box, how = [(2.5, 0.5), (3.5, 1.5)], {"bars": (4,), "seconds": 1, "source": small, "sliders": False}
    result = nc.synthesis.trace(heart(), True, subject_to=[clear_of(box, links="crank")], **how)
    for design in result.designs:
        pivot, pin = (np.asarray(design.system[p]) for p in design.mechanism.model.bodies["crank"].points[:2])
        beyond = np.linalg.norm(pivot - np.clip(pivot, *box)) - np.linalg.norm(pin - pivot)
        assert beyond > 0.0
    assert result.found
    with pytest.raises(nc.InputError, match="targets lie inside"):  # the coupler of a four-bar
        nc.synthesis.trace(heart(), True, subject_to=[clear_of(box, links="link 3")], **how)


@pytest.mark.parametrize(
    ("hung", "row"),
    [
        (Hung("RRP", 0, 1), [1.0, 0.0, 0.0, 0.0, 3.0, 0.0]),
        (Hung("PRP", 0, 1), [0.0, 2.0, 0.0, 0.0, 0.0, 0.0]),
        (Hung("PRP", 1, 0), [0.0, 0.0, 0.0, 2.0, 0.0, 0.0]),
    ],
)
def test_a_guide_that_moves_goes_to_what_slides_on_it(hung, row):
    """On a crank it is a ray from the pivot: how far a spot is that it comes near is the sine of what is left to it."""
    chain = Chain((hung,), 2 if hung.first else 3)
    drawn = ChainDesign(chain, np.ones(1), np.array([*row, 0.0, 0.0]), 0j, 1 + 0j, 2.0, 0.5)
    design = searching.TracedDesign(chain, 0.0, False, np.zeros((2, 2)), False, 1.0, True, drawn)
    spot = np.array([np.cos(2.8), np.sin(2.8)])
    assert design.clearance([spot - 1e-6, spot + 1e-6]) == pytest.approx(np.sin(0.3), abs=1e-4)


def test_a_search_goes_on_where_it_was_stopped(small, brief, tmp_path, monkeypatch):
    """Interrupted in its second round and gone on with it comes to the designs of a search that never stopped."""
    whole, file = searching._Search.round, tmp_path / "search.npz"

    def stopping(at):
        def round(search):
            if search.rounds == at:
                raise KeyboardInterrupt
            whole(search)

        return round

    how = {"bars": (4,), "seconds": 60, "source": small, "sliders": False}
    monkeypatch.setattr(searching._Search, "round", stopping(3))
    straight = nc.synthesis.trace(heart(), True, **how)
    monkeypatch.setattr(searching._Search, "round", stopping(0))
    early = tmp_path / "early.npz"
    first = nc.synthesis.trace(heart(), True, **how, checkpoint=early)
    assert first.interrupted and first.refined == 0 and first.found  # what the atlas has
    assert early.exists() and f"resume from {early}" in first.stopped
    assert straight.best.distance < 0.85 * first.best.distance
    monkeypatch.setattr(searching._Search, "round", stopping(2))
    part = nc.synthesis.trace(heart(), True, **how, checkpoint=file)
    assert part.interrupted and f"resume from {file}" in part.stopped and part.refined < straight.refined
    monkeypatch.setattr(searching._Search, "round", stopping(3))
    after = nc.synthesis.trace(heart(), True, **how, resume=file)
    assert (after.refined, after.best.distance) == (straight.refined, straight.best.distance)
    np.testing.assert_array_equal(after.best.curve, straight.best.curve)
    for other, said in (({"points": heart()[::2]}, "other targets"), ({"key": jax.random.key(3)}, "begun with key")):
        with pytest.raises(nc.InputError, match=said):
            nc.synthesis.trace(**{"points": heart(), "closed": True, **how, **other}, resume=file)


def test_last_dyads_are_put_where_they_fit_best(small):
    """By linear least squares: no other place, turn, size and tracing point comes nearer, and the dyads close."""
    shelf = small.shelves[6].at(slice(40))
    arrays = making.chain_arrays(6).at(shelf.chain)
    row = np.concatenate([shelf.design, np.tile([0.0, 0.0, 1.0, 0.0, 0.3, 2.0 * np.pi], (40, 1))], axis=1)
    theta = np.tile(np.linspace(0.3, 6.5, 50), (40, 1))
    goal = np.exp(1j * theta) + 0.3 * np.exp(-2j * theta)
    u = np.random.default_rng(0).uniform(size=(40, 8))
    lanes, left = fit.redraw_last(fit.Lanes(arrays, shelf.sign, row), theta, goal, u)
    good = np.flatnonzero(np.isfinite(left))
    assert len(good) > 20
    for k in good[:8]:
        x, chain = lanes.row[k], shelf.chains[shelf.chain[k]]
        np.testing.assert_array_equal(x[:6], shelf.design[k, :6])

        def miss(change, x=x, k=k, chain=chain):
            new = x + np.concatenate([np.zeros(12), change, np.zeros(2)])
            place, factor = complex(*new[-6:-4]), complex(*new[-4:-2])
            drawn = ChainDesign(chain, lanes.sign[k], new[:-6], place, factor, 0.0, 1.0)
            return np.mean(np.abs(drawn.trace(theta[k]) - goal[k]) ** 2)

        assert miss(np.zeros(6)) == pytest.approx(left[k], rel=1e-3, abs=1e-6)
        for side in np.eye(6) * 3e-3:
            assert miss(side) + miss(-side) > 2.0 * miss(np.zeros(6))
            assert abs(miss(side) - miss(-side)) < 0.05 * (miss(side) + miss(-side) - 2.0 * miss(np.zeros(6))) + 1e-6


def test_distances_are_of_polylines_both_ways():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], float)
    assert curve_distance(square, square + np.array([0.1, 0.0])) == pytest.approx(0.1, rel=0.06)
    assert curve_distance(square, space_evenly(square, 4001)) < 2e-3
    assert curve_distance(square[:2], square[:2] + np.array([0, 0.25])) == pytest.approx(0.5, rel=1e-9)


def test_an_atlas_is_kept_and_mended(tmp_path, monkeypatch):
    monkeypatch.setattr(making, "_PART", 1000)
    first = nc.synthesis.atlas(1500, folder=tmp_path)
    files = sorted(tmp_path.iterdir())
    assert len(first) == 2000 and len(files) == 2 and repr(first).startswith("Atlas(200 of 4 bars")
    files[0].write_bytes(files[0].read_bytes()[:1000])  # cut short
    again = nc.synthesis.atlas(1500, bars=(6,), folder=tmp_path)
    assert len(again) == 600
    np.testing.assert_array_equal(again.shelves[6].design, first.shelves[6].design)


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_cranks_of_an_atlas_turn_between_its_poses_too(seed):
    """Four-bars transmit worst where the crank is in line with the ground."""
    shelf, least = making.make(4, np.random.default_rng(seed)), []
    for which, row in zip(shelf.chain, shelf.design.astype(float), strict=True):
        kind, one, two = shelf.chains[which].dyads[0].kind, np.hypot(*row[:2]), np.hypot(*row[2:4])
        near, far, m, n = abs(one - two), one + two, *row[4:6]
        if kind == "RRR":
            least += [1 - ((m**2 + n**2 - apart**2) / (2 * m * n)) ** 2 for apart in (near, far)]
        elif kind == "RPR":
            least.append(1 - (m / near) ** 2)
    assert len(least) > 1000 and min(least) > np.sin(np.radians(8)) ** 2


def crossing(a, b, p, q):
    """Where circles about a and b meet that as drawn meet at p from one centre and q from the other, on that side."""
    (r, s), d = (np.abs(p), np.abs(q)), np.abs(b - a)
    along, side = (d * d + r * r - s * s) / (2 * d), np.sign((np.conj(p - q) * p).imag)
    return a + (b - a) / d * complex(along, side * np.sqrt(max(r * r - along * along, 0.0)))


def test_an_atlas_is_written_for_others(small, tmp_path):
    """Joints and bars, moved by intersections of circles, trace the curves that stand beside them."""
    picked = nc.synthesis.Atlas({bars: shelf.at(slice(40)) for bars, shelf in small.shelves.items()})
    with np.load(picked.save(tmp_path / "links.npz", points=100)) as file:
        x0, bars, fixed, joints, curves = (
            file[n] for n in ("x0", "connectivity", "node_types", "joints", "target_curves")
        )
    assert len(x0) > 30 and curves.shape[1:] == (100, 2)
    for k in range(0, len(x0), 7):
        n = joints[k]
        drawn = x0[k, :n] @ [1, 1j]
        for t in range(20):
            known = {int(i): drawn[i] for i in np.flatnonzero(fixed[k, :n])}
            known[1] = drawn[0] + (drawn[1] - drawn[0]) * np.exp(2j * np.pi * t / 100)
            while len(known) < n:
                i = next(i for i in range(n) if i not in known and sum(bool(bars[k, i, j]) for j in known) == 2)
                a, b = (j for j in known if bars[k, i, j])
                known[i] = crossing(known[a], known[b], drawn[i] - drawn[a], drawn[i] - drawn[b])
            assert abs(known[n - 1] - curves[k, t] @ [1, 1j]) < 1e-6 * np.ptp(curves[k])
    with pytest.raises(nc.InputError, match=r"\.npz"):
        picked.save("links.csv")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"points": [[0, 0]]}, "points.*N >= 3"),
        ({"points": [[0, 0], [1, np.nan], [2, 0]]}, r"points\[1\] is NaN"),
        ({"points": heart() * 1e300}, r"points\[0\] is .* beyond 1e150"),
        ({"points": heart() @ [1, 1j]}, r"real numbers \(x, y\); complex z are np\.c_\[z\.real, z\.imag\]"),
        ({"points": np.zeros((5, 2))}, "same"),
        ({"bars": (5,)}, "bars.*4, 6 or 8"),
        ({"closed": "yes"}, "closed"),
        ({"seconds": -1}, "seconds"),
        ({"keep": 0}, "keep"),
        ({"timing": [0.0, 1.0]}, "timing"),
        ({"timing": np.linspace(0, 9, 200)}, "one turn of the crank"),
        ({"seconds": 0}, "a positive number; a search"),
        ({"seconds": None}, "seconds"),
        ({"only": ["Watts"], "bars": (6,)}, "only.*did you mean"),
        ({"only": np.array(["Watt I"]), "bars": (6,)}, "only"),
        ({"source": 3}, "source.*atlas"),
        ({"subject_to": [S.size(3.0)]}, "PathGeneration"),
        ({"subject_to": [S.crank_turns("double-crank")]}, "'crank turns'.*of any kind and by any margin"),
        ({"subject_to": [S.crank_turns(margin=0.1)]}, "'crank turns'.*PathGeneration"),
        ({"subject_to": [S.within("ground", x=(0, 1), z=(0, 1))]}, "'ground within'.*PathGeneration"),
        ({"subject_to": [S.within("ground", y=(0, 1)), S.within("ground", y=(2, 3))]}, "excludes everything"),
        ({"subject_to": [clear_of([(-9, -9), (9, 9)])]}, "all 200 targets lie inside"),
        ({"subject_to": [clear_of([(8, 8), (9, 9)], links="rocker")]}, "has 'rocker'; known names: crank, link 2"),
    ],
)
def test_what_is_no_curve_is_told(given, said):
    with pytest.raises(nc.InputError, match=said):
        nc.synthesis.trace(**{"points": heart(), "seconds": 1, **given})


def interrupt(search):
    raise KeyboardInterrupt


def test_the_command_reads_files_and_writes_models(small, cache, brief, tmp_path, monkeypatch, capsys):
    """The atlas is the one that is kept."""
    monkeypatch.setattr(making, "_PART", 3000)
    monkeypatch.setattr(making, "make", None)
    monkeypatch.setattr(searching, "_ATLAS", 1)
    monkeypatch.setenv("JAXNC_CACHE", str(cache))
    file = tmp_path / "heart.csv"
    file.write_text("x,y\n" + "\n".join(f"{x},{y}" for x, y in heart(80)))
    arguments = ["trace", str(file), "--bars", "4", "--seconds", "0.5", "--closed", "--no-cache", "--no-pictures"]
    kept = str(tmp_path / "search.npz")
    assert main([*arguments, "--out", str(tmp_path / "out"), "--checkpoint", kept]) == 0
    assert "a curve of 80 points" in capsys.readouterr().out
    assert main([*arguments, "--resume", kept]) == 0 and f"resume from {kept}" in capsys.readouterr().out
    monkeypatch.setattr(searching._Search, "round", interrupt)
    assert main([*arguments, "--resume", kept]) == 130 and f"--resume {kept}" in capsys.readouterr().err
    model = nc.load(tmp_path / "out" / "heart-1.toml")
    assert "P" in model.all_points and main(["run", str(tmp_path / "out" / "heart-1.toml"), "--no-cache"]) == 0
    trace = nc.synthesis.trace
    monkeypatch.setattr(
        nc.synthesis, "trace", lambda *a, **k: dataclasses.replace(r := trace(*a, **k), designs=r.designs[:1])
    )
    main([*arguments, "--resume", kept, "--out", str(tmp_path / "out")])
    assert [path.name for path in (tmp_path / "out").glob("*.toml")] == ["heart-1.toml"]
    file.write_text("x,y\n1,2\nthree,4\n")
    assert main(["trace", str(file)]) == 2 and "line 3" in capsys.readouterr().err
    page = tmp_path / "page.html"
    monkeypatch.setattr(page_module, "trace_page", lambda path: page.write_text("drawn") and page)
    assert main(["trace", "--page", str(page), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"][0]["path"] == str(page)
    assert main(["trace", "--page", str(page), "--bars", "4"]) == 2 and "--bars" in capsys.readouterr().err
    for option, value in (("--key", "9" * 20), ("--port", "99999999")):
        assert main(["trace", str(file), option, value]) == 2 and "a whole number from" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        "0,5;1,5\n2;3\n",
        "\ufeff0.5,1.5\n2,3\n",
        "pose,P.x [m],P.y [m]\n0,0.5,1.5\n1,2,3\n",
        '"0.5"\t"1.5"\n2\t3\n',
        "t x y\n0 0.5 1.5\n1 2 3\n",
        "The foot\nt [s] P.x [in m] P.y (m)\n0  0.5  1.5\n1  2  3\n",
        "x and y in mm\n0.5 1.5 7\n2 3 7\n",
        '"x pos" "y pos"\n0.5 1.5\n2 3\n',
        "t,y,x\n[s],[m],[m]\n0,1.5,0.5,,\n,3,2,,\n,,,,\n",
        "pose 1, pose 2\n0.5 1.5\n2, 3\n",
    ],
)
def test_tables_of_spreadsheets_are_read(text, tmp_path):
    (tmp_path / "curve.csv").write_text(text, encoding="utf-8")
    assert load_curve(tmp_path / "curve.csv")[0].tolist() == [[0.5, 1.5], [2.0, 3.0]]


@pytest.mark.parametrize("text", ["0x1,2\n3,4\n5,6\n", "1.000,5;2\n3;4\n5;6\n", "NACA 0012\n1 0\n0 0\n"])
def test_a_row_with_a_number_is_no_heading(text, tmp_path):
    (tmp_path / "curve.csv").write_text(text)
    with pytest.raises(ModelFileError, match=r"line 1: .* is not a row of numbers; a comment begins with #"):
        load_curve(tmp_path / "curve.csv")


@pytest.mark.parametrize("shape", [(2, 24), (3, 24), (24, 3), (24, 1), (24,), (24, 2, 1)])
def test_an_array_of_another_shape_than_a_curve_is_refused(shape, tmp_path):
    np.save(tmp_path / "curve.npy", np.zeros(shape))
    with pytest.raises(ModelFileError, match=rf"the file has the shape {re.escape(str(shape))}: save points\.T"):
        load_curve(tmp_path / "curve.npy")


def test_an_array_of_a_curve_is_read_as_it_is(tmp_path):
    np.save(tmp_path / "curve.npy", points := np.arange(48).reshape(24, 2))
    np.testing.assert_array_equal(load_curve(tmp_path / "curve.npy")[0], points)
    np.save(tmp_path / "curve.npy", points.astype(str))
    with pytest.raises(ModelFileError, match="real numbers"):
        load_curve(tmp_path / "curve.npy")
    (tmp_path / "curve.csv").write_text("x,y\n")
    with pytest.raises(ModelFileError, match=r"curve\.csv holds no numbers"):
        load_curve(tmp_path / "curve.csv")


def test_columns_of_several_curves_are_refused(tmp_path):
    (tmp_path / "curve.csv").write_text("P.x,P.y,Q.x,Q.y\n1,2,3,4\n")
    with pytest.raises(ModelFileError, match=r"P\.x, P\.y, Q\.x, Q\.y"):
        load_curve(tmp_path / "curve.csv")
