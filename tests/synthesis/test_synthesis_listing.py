"""What a search lists: exact designs as such, a continuum of them once, and blunt transmission as a defect."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.synthesis.design import judge
from jaxnc.synthesis.search import basins
from jaxnc.synthesis.search.basins import as_they_are, distinct_basins
from jaxnc.synthesis.search.goal import Goal
from jaxnc.synthesis.search.sqp import End, Sqp

S = nc.synthesis
TURN = np.radians([10.0, 45.0, 80.0, 115.0, 150.0, 185.0, 220.0, 255.0, 290.0, 325.0])


def four_bar(B=(0.5, 1.0), C=(3.3, 2.9), D=(4.0, 0.0), P=(1.8, 3.2), A=(0.0, 0.0)):
    m = nc.Mechanism("four-bar")
    m.ground("A", A)
    m.ground("D", D)
    for name, at in (("B", B), ("C", C), ("P", P)):
        m.point(name, at)
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C", "P"])
    m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B", start="D")
    return m


def own_path(m, inputs, **options):
    """The problem of a mechanism's own path: its drawing is an exact design."""
    path = np.asarray(nc.sweep(m.compile(), {"phi": inputs})["P"])
    return S.PathGeneration(m, "P", path, timing=np.asarray(inputs), **options)


def result_of(problem, *xs):
    """What a search lists that has come to these designs."""
    designs = judge(problem, as_they_are(problem, list(xs), len(xs)))
    return S.Result(problem, tuple(basins.list_once(problem, designs)), (), len(xs), len(xs), 0, None)


def put(problem, m, timing):
    """Unknowns of a four-bar, as it is drawn, at values of its input."""
    system, x = m.compile(), problem.start.copy()
    for k, name in enumerate(problem.variables.names):
        point, axis = name.split(".")
        x[k] = np.asarray(system[point])["xy".index(axis)]
    x[len(problem.variables.names) :] = [timing[0], *np.diff(timing)]
    return x


# -- transmission ---------------------------------------------------------------------------------------------------

# Sides 1.5, 2.5, 3 and 3.999: a thousandth from the Grashof limit, beside which coupler and rocker come into one line.
BLUNT = {"B": (0.0, 1.5), "C": (2.3023890, 2.4741688), "D": (3.999, 0.0), "P": (1.0, 3.0)}


def test_a_transmission_angle_below_five_degrees_is_a_defect():
    m = four_bar(**BLUNT)
    found = result_of(own_path(m, TURN), own_path(m, TURN).start)
    (design,) = found.designs
    assert design.turns and design.exact and 0.0 < design.transmission < np.radians(5)
    (defect,) = design.defects
    assert "transmission angle" in defect and "5 deg" in defect
    assert not found.found and "transmission_angle(min)" in found.verdict
    assert defect in found.table() and defect in found.to_frame()["defects"].iloc[0]


@pytest.mark.parametrize("least", [0.0, np.radians(0.5)])
def test_who_states_a_transmission_angle_decides_what_is_one(least):
    m = four_bar(**BLUNT)
    problem = own_path(m, TURN, subject_to=[S.transmission_angle(least)])
    found = result_of(problem, problem.start)
    assert found.found and found.designs[0].transmission < np.radians(5)


def test_an_input_that_need_not_turn_is_looked_at_between_the_targets():
    m = four_bar(B=(1.5, 1.5), C=(2.5, 1.9), D=(3.2, 0.0), P=(2.2, 2.4))  # its range ends at dead points
    home = float(np.arctan2(1.5, 1.5))
    problem = own_path(m, home + np.linspace(-0.1, 0.1, 5))
    (design,) = result_of(problem, problem.start).designs
    assert not design.turns and not design.defects and design.transmission > np.radians(5)


def test_a_blunt_design_comes_after_a_worse_one_that_transmits():
    sharp = four_bar()
    problem = own_path(sharp, TURN)
    (good,) = result_of(problem, problem.start).designs
    worse = dataclasses.replace(good, exact=False, error=1.0)
    blunt = dataclasses.replace(good, transmission=0.01, defects=("has a transmission angle of 0.573 deg",))
    assert sorted([blunt, worse, good], key=lambda design: design.rank) == [good, worse, blunt]


# -- exact designs --------------------------------------------------------------------------------------------------


def test_an_error_of_rounding_reads_exact():
    for scale in (1e-3, 1.0, 1e4):  # rounding is of the target's size
        points = {
            n: scale * np.array(p) for n, p in {"B": (0.5, 1), "C": (3.3, 2.9), "D": (4, 0), "P": (1.8, 3.2)}.items()
        }
        problem = own_path(four_bar(**points), TURN)
        off = problem.start.copy()
        off[problem.names.index("P.x")] += 1e-9 * scale
        found, near = result_of(problem, problem.start), result_of(problem, off)
        assert found.table().splitlines()[1].split()[1:4] == ["exact"] * 3 and "exact" in found.verdict
        assert not near.designs[0].exact and "exact" not in str(near)


def test_exact_designs_are_ranked_by_what_tells_them_apart():
    problem = own_path(four_bar(), TURN)
    (one,) = result_of(problem, problem.start).designs

    def like(error, degrees, size, **more):
        return dataclasses.replace(one, error=error, transmission=np.radians(degrees), size=(size, 1.0), **more)

    best = like(3e-28, 40.0, 5.0)
    wide = like(1e-30, 40.0, 9.0)
    blunt = like(1e-31, 20.0, 5.0)
    space = like(0.0, np.nan, 5.0)
    near = like(1e-20, 60.0, 5.0, exact=False)
    wrong = like(0.0, 60.0, 5.0, defects=("misses crank turns by 0.1",))
    ranked = sorted([wrong, near, space, blunt, wide, best], key=lambda design: design.rank)
    assert [id(d) for d in ranked] == [id(d) for d in (best, wide, blunt, space, near, wrong)]


# -- continua and copies --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def six():
    """Six points that a closed curve goes through at any time: exact designs change in three directions."""
    points = [(22, 0), (12, 9), (-11, 8), (-22, 1), (-12, -9), (11, -8)]
    problem = S.PathGeneration(four_bar(), "P", points, closed=True)
    return S.solve(problem, starts=600, refine=24, keep=6, key=jax.random.key(0), progress=False)


def test_a_continuum_of_exact_designs_is_listed_once(six, tmp_path):
    best = six.designs[0]
    assert best.exact and best.freedom == 3  # how many starts led to it, rounding decides
    assert sum(d.starts for d in six.designs if d.freedom) > sum(1 for d in six.designs if d.freedom)
    assert "continuum" in six.table().splitlines()[1] and "3 directions" in str(six) and "targets" in str(six)
    assert S.load(six.save(tmp_path / "six"), six.problem).table() == six.table()


def test_what_is_found_of_a_continuum_is_connected_and_the_best_is_shown(six):
    # Along a curve of exact designs: the coupler point is dragged, and the targets are met again.
    problem, best = six.problem, six.designs[0]
    eye, xs = basins._Continua(problem), [best.x]
    for _ in range(2):
        look = eye.look(xs[-1][None])
        x = xs[-1] + 0.02 * basins._null_space(look.slopes[0])[:, 0] * problem.scale
        xs.append(Sqp(Goal(problem)).run([x], 50)[0].row)
    several = judge(problem, as_they_are(problem, xs, 3))
    assert len(several) == 3 and all(d.exact for d in several)
    (only,) = basins.list_once(problem, several)
    assert only.transmission == max(d.transmission for d in several) and only.starts == 3 and only.freedom == 3


def test_exact_designs_that_stand_alone_stay():
    # A four-bar and its cognate that turns draw the same curve: of twelve of its points both are exact designs, and no
    # change leads from one to the other.
    m, around = four_bar(), np.radians(30.0 * np.arange(12) + 10)
    path = np.asarray(nc.sweep(m.compile(), {"phi": around})["P"])
    problem = S.PathGeneration(m, "P", path, closed=True)
    cousin = next(c for c in S.roberts_cognates(S.FourBar.of(m.compile(), "P")) if c.grashof.type == "crank-rocker")
    at = {n: np.asarray(cousin.system[n]) for n in "ABCDP"}
    other = four_bar(**{n: at[n] for n in "BCDP"}, A=at["A"])
    later = angle(other) + around - angle(m)  # the cranks turn alike
    ends = Sqp(Goal(problem)).run([put(problem, m, around), put(problem, other, later)], 50)
    rows = [end.row for end in ends]
    rows.append(put(problem, turned(m, 1.0), around))  # the first one, drawn in another pose
    ends = [*ends, *Sqp(Goal(problem)).run(rows[2:], 50)]
    valleys = [valley for valley, _ in distinct_basins(problem, [(end, 1) for end in ends])]
    assert len(valleys) == 2
    designs = basins.list_once(problem, judge(problem, valleys))
    assert len(designs) == 2 and all(d.exact and not d.freedom for d in designs)
    assert "continuum" not in str(S.Result(problem, tuple(designs), (), 2, 2, 0, None))
    assert designs[0].transmission >= designs[1].transmission


def angle(m):
    """The angle of a crank in its drawing, from the line of its pivots."""
    a, b, d = (np.asarray(m.compile()[n]) @ [1, 1j] for n in "ABD")
    return float(np.angle((b - a) / (d - a)))


def turned(m, by):
    """The same four-bar with its crank turned."""
    motion = nc.sweep(m.compile(), {"phi": angle(m) + np.linspace(0.0, by, 5)})
    return four_bar(**{n: np.asarray(motion[n])[-1] for n in "BCDP"})


@pytest.mark.parametrize(("apart", "count"), [(1e-6, 1), (1e-2, 2)])
def test_copies_of_a_wide_exact_design_are_one(apart, count):
    # Known to rounding of the errors only, not of the joints: these are as wide as the whole mechanism.
    m = four_bar()
    problem = S.PathGeneration(m, "P", [(0, 0), (0.01, 0), (0.01, 0.01), (0, 0.01)], timing=[0.3, 0.6, 0.9, 1.2])
    x = problem.start.copy()
    x[problem.names.index("C.x")] += apart
    ends = [(End(row, 1e-28, 0.0, 0.0, 0.0, 1, ""), 1) for row in (problem.start, x)]
    assert len(distinct_basins(problem, ends)) == count


def test_a_function_is_listed_once_wherever_a_point_rides_that_nothing_asks_for():
    """One linkage drawn in two poses, its tracing point where it was."""
    m = four_bar()
    m.angle("psi", at="D", to="C")
    values, free = np.linspace(0.9, 1.9, 5), ["B", "C"]
    problem = S.FunctionGeneration(m, "psi", values, 2.0 + 0.1 * values, "phi", free, output_offset=True)
    motion = nc.sweep(m.compile(), {"phi": [0.8, 1.1]})
    rows = [np.append(np.concatenate([motion["B"][k], motion["C"][k]]), 0.1) for k in range(2)]
    assert len(as_they_are(problem, rows, 2)) == 1
    rows[1][3] += 0.01
    assert len(as_they_are(problem, rows, 2)) == 2
