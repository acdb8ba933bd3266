"""Links that keep clear of regions and of each other: against directions one by one, differences and many poses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.synthesis.clearance import all_pairs, convex_pieces, inside, ring, signed_distance, swept_distance
from jaxnc.synthesis.conditions import Seen
from jaxnc.synthesis.evaluate import Evaluator
from jaxnc.synthesis.search.goal import Goal

S = nc.synthesis
WAYS = np.exp(1j * np.linspace(0.0, 2 * np.pi, 20_001))
WAYS = np.stack([WAYS.real, WAYS.imag])  # (2, directions)
TURN = np.linspace(0.0, 2 * np.pi, 8, endpoint=False) + 1.0
HOOK = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [0, 1]], float)  # an L


def widest_gap(one, other):
    """The signed distance of convex shapes by its definition: the widest gap that a strip of some direction has."""
    return float(np.max(np.min(other @ WAYS, axis=0) - np.max(one @ WAYS, axis=0)))


def four_bar():
    return nc.library.four_bar(coupler_point=(0.06, 0.03), explicit=False)


def seen(system, poses):
    turn = nc.sweep(system, {"phi": 1.0 + np.linspace(0.0, 2 * np.pi, poses)})
    return Seen(system, turn, turn, 0.1)


@pytest.mark.parametrize(("count", "corners"), [(1, 4), (2, 4), (3, 5), (4, 2), (2, 2)])
def test_distances_are_those_of_the_widest_strip(count, corners):
    rng = np.random.default_rng(count)
    turn = np.sort(rng.uniform(0.0, 2 * np.pi, (40, corners)))
    other = np.stack([np.cos(turn), np.sin(turn)], axis=2) * [1.0, 0.7]
    one = rng.normal(size=(40, count, 2)) + rng.normal(size=(40, 1, 2))
    look = jax.jit(lambda one, other: signed_distance(one, other, all_pairs(count), ring(corners)))
    found = look(one.transpose(1, 2, 0), other.transpose(1, 2, 0))
    wanted = [widest_gap(a, b) for a, b in zip(one, other, strict=True)]
    assert min(wanted) < -0.02 or count == 1 or corners == count == 2
    over = np.asarray(found) - wanted
    assert over.min() > -1e-12 and over.max() < 2e-3  # no direction between those that were tried is missed by more


def test_regions_are_cut_into_convex_pieces():
    pieces = convex_pieces(HOOK)
    assert 1 < len(pieces) <= 3
    at = np.random.default_rng(0).uniform(-1.0, 4.0, (500, 2))
    np.testing.assert_array_equal(inside(at, HOOK), np.any([inside(at, p) for p in pieces], axis=0))
    assert inside(np.array([[1.0, 0.5], [1.0, 2.0]]), HOOK).tolist() == [True, False]


WIDTH = 0.008
BOX = np.array([[0.02, -0.06], [0.05, -0.03]])  # the crank runs through it


@pytest.fixture(scope="module")
def problem():
    """A four-bar's own curve, with a region in its way; all tests of whole problems share what is compiled."""
    target = np.asarray(nc.sweep(four_bar().compile(), {"phi": TURN})["P"])
    asked = [S.crank_turns(), S.clear_of(BOX, width=WIDTH, margin=0.001)]
    known = {"timing": TURN, "offset": True}  # few unknowns: along each of them the region is differentiated
    return S.PathGeneration(four_bar(), "P", target, **known, subject_to=asked, free=["A", "B", "C", "D"])


def test_slopes_are_those_of_the_numbers(problem):
    """Against differences, with the region overlapped and not."""
    look, goal = Evaluator(Goal.of(problem)), Goal.of(problem)
    rng = np.random.default_rng(3)
    x = goal.start + 1e-3 * goal.scale * rng.normal(size=goal.count)
    way = rng.normal(size=(4, goal.count))
    every = np.stack([x, *(x + h * w * goal.scale for w in way for h in (1e-6, -1e-6))])
    _, numbers, slopes, good = look(every, np.tile(goal.arguments, (len(every), 1)))
    assert good.all() and (numbers[0] < 0.0).any() and (numbers[0] > 0.0).any()
    own = slopes[0][-numbers.shape[1] :]
    for k, w in enumerate(way):
        apart = np.abs(own @ w - (numbers[1 + 2 * k] - numbers[2 + 2 * k]) / 2e-6)
        assert np.sort(apart)[-4] < 1e-5 * np.abs(own).max()  # a nearest corner may change within the step


def test_what_is_told_holds_between_the_poses():
    """A bound, and no looser than it needs to be: against 20 times as many poses."""
    system, poses = four_bar().compile(), 49
    few, many = seen(system, poses), seen(system, 20 * (poses - 1) + 1)
    places = np.random.default_rng(5).uniform(-0.13, 0.13, (6, 2))
    ready = [S.clear_of([tuple(at), tuple(at + 0.02)], width=0.004).prepare(system, "phi") for at in places]
    look = jax.jit(lambda ready, seen: ready.values(seen))
    for one in ready:
        told = np.asarray(look(one, few)).reshape(3, poses - 1)
        fine = np.asarray(look(one, many)).reshape(3, poses - 1, 20).min(axis=2)
        assert (told < fine + 1e-12).all() and (fine - told).max() < 0.03


def test_a_link_cannot_jump_over_what_stands_between_two_poses():
    wall = np.array([[0.9, 0.0], [1.1, 0.0], [1.0, 0.02]])[..., None] * np.ones(9)
    angle = np.linspace(-0.45, 0.55, 9)  # the wall lies between the fourth pose and the fifth
    link = np.stack([np.zeros((2, 9)), np.stack([np.cos(angle), np.sin(angle)])])

    @jax.jit
    def look(link, way):
        def f(link):
            return swept_distance(link, wall, all_pairs(2), ring(3))

        found, push = jax.linearize(f, link)
        (back,) = jax.linear_transpose(push, link)(jnp.ones(len(found)))
        return signed_distance(link, wall, all_pairs(2), ring(3)), found, push(way), back

    way = np.random.default_rng(0).normal(size=link.shape)
    in_poses, found, slope, back = (np.asarray(a) for a in look(link, way))
    assert in_poses.min() > 0.02 and found.min() < 0.0
    np.testing.assert_allclose(np.sum(back * way), np.sum(slope), rtol=1e-9)


def clearance_by_points(motion, box, names):
    """The least distance of a link's plate from a box, by points all over the hull of its corners."""
    share = np.random.default_rng(0).dirichlet(np.full(len(names), 0.4), 400)
    low, high = np.min(box, axis=0), np.max(box, axis=0)
    places = np.einsum("sk,ktd->tsd", share, np.stack([np.asarray(motion[n]) for n in names]))
    far = np.maximum(np.maximum(low - places, places - high), 0.0)
    return float(np.linalg.norm(far, axis=2).min()) - 0.5 * WIDTH


def test_a_search_goes_round_a_region(problem):
    """The four-bar of a curve runs through it; of what is found with the condition no link does, in 2,000 poses."""
    result = S.solve(problem, starts=40, refine=4, iterations=12, keep=1, key=jax.random.key(0), progress=False)
    assert result.found and "clear of the region" in str(problem)
    least = []
    for system in (problem.system, result.best):
        motion = nc.sweep(system, {"phi": np.linspace(1.0, 7.27, 2001)})
        links = ("A", "B"), ("B", "C", "P"), ("C", "D")
        least.append(min(clearance_by_points(motion, BOX, names) for names in links))
    assert least[0] < 0.0 and least[1] > 0.00095


def test_links_of_one_layer_pass_each_other():
    """Layers from the workshop: its plates are apart where the condition says so."""
    system = four_bar().compile()
    motion = nc.sweep(system, {"phi": 1.0 + np.linspace(0.0, 2 * np.pi, 91)})
    plates = motion.to_parts(width=8, pin=3, thickness=3)
    assert set(plates.layer_of) == {"crank", "coupler", "rocker"}
    same = plates.layer_of["crank"] == plates.layer_of["rocker"]
    ready = S.clear_links(plates.layer_of if same else ["crank", "rocker"], width=0.008).prepare(system, "phi")
    passing = [p.clearance for p in plates.passing if {p.one, p.other} == {"crank", "rocker"}]
    least = 100.0 * float(np.min(jax.jit(ready.values)(seen(system, 2001))))  # mm: numbers are divided by 0.1 m
    assert same and passing
    np.testing.assert_allclose(least, passing[0], rtol=0.03)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: S.clear_of([[0, 0], [1, 1], [1, 0], [0, 1]]), "edges behind corners 1 and 3 cross"),
        (lambda: S.clear_of([(0, 0), (0, 1)]), "box.*no area"),
        (lambda: S.clear_of([(0, 0), (1, 1), (2, 2)]), "one line"),
        (lambda: S.clear_of([(0, 0), (1, np.nan), (2, 2)]), "corner 2 is not finite"),
        (lambda: S.clear_of(3.0), r"polygon.*or a box"),
        (lambda: S.clear_of([(0, 0), (1, 1)], width=-1), "width must be a length"),
        (lambda: S.clear_of([(0, 0), (1, 1)], links=[3]), "names of links"),
        (lambda: S.clear_of([(0, 0), (1, 1)], links="couple"), "no link 'couple'.*did you mean 'coupler'"),
        (lambda: S.clear_of([(-1, -1), (1, 1)]), "all 8 targets lie inside.*links="),
        (lambda: S.clear_links({"crank": 1, "rocker": 2}), "no two links lie in one layer"),
        (lambda: S.clear_links(["crank", "coupler"]), "crank and coupler are joined at B"),
    ],
)
def test_what_cannot_be_kept_clear_is_told(make, said):
    target = np.asarray(nc.sweep(four_bar().compile(), {"phi": TURN})["P"])
    with pytest.raises(nc.InputError, match=said):
        S.PathGeneration(four_bar(), "P", target, closed=True, subject_to=[make()])
