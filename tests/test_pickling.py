"""Pickled and copied: the same numbers, an equal topology, nothing compiled anew; what cannot be sent says so."""

import copy
import functools
import json
import pickle
from itertools import chain

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from coordinate_families import every_spatial_joint, worked
from processes import child, ended

import jaxnc as nc
from jaxnc import constraints, forces
from jaxnc.library.catalogue import CATALOGUE
from jaxnc.synthesis.design import judge
from jaxnc.synthesis.evaluate import move_designs
from jaxnc.synthesis.result import Progress
from jaxnc.synthesis.search.basins import Basin
from jaxnc.synthesis.search.sqp import End

S = nc.synthesis


def midway(p, v, s, c):
    return p[2][0] - 0.5 * (p[0][0] + p[1][0]), p[2][1] - 0.5 * (p[0][1] + p[1][1])


def wind(t, state, parameters):
    return parameters * jnp.array([1.0, 0.5])


def height(motion):
    return motion["C"][:, 1]


MIDWAY = nc.constraints.Kind("midway", midway, rows=("x", "y"), powers=(1, 1), points=3)


def again(record):
    return pickle.loads(pickle.dumps(record))


def same(a, b) -> bool:
    """Equal in structure, which holds the topology and its hash, and in every number with its type."""
    return jax.tree.structure(a) == jax.tree.structure(b) and all(
        np.array_equal(x, y, equal_nan=True) and np.asarray(x).dtype == np.asarray(y).dtype
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    )


def mechanism(kind=MIDWAY, force=wind) -> nc.Mechanism:
    m = nc.library.four_bar()
    drawn = m.compile()
    m.point("M", np.asarray(0.5 * (drawn["B"] + drawn["C"])))
    m.constrain("kind", kind, points=["B", "C", "M"])
    m.point_mass("mass at C", "C", 2.0)
    m.force("force on C", "C", force, 3.0)
    return m


@functools.cache
def system() -> nc.System:
    return mechanism().compile()


def test_the_librarys_kinds_are_themselves_again():
    known = chain(constraints.CATALOGUE.values(), constraints.RATES.values(), forces.CATALOGUE.values())
    made = (constraints.cable(7), constraints.relation(5), constraints.rack("pv", True))
    for kind in (*known, *made):
        assert again(kind) is kind and copy.copy(kind) is kind and copy.deepcopy(kind) is kind, kind.name


def test_every_mechanism_of_the_library_is_equal_again():
    for name, make in CATALOGUE.items():
        m = make()
        system = m.compile()
        for other in (again(system), copy.copy(system), copy.deepcopy(system)):
            assert same(system, other) and hash(system.topology) == hash(other.topology), name
        assert again(m).model == m.model, name


def test_families_are_equal_again():
    asked = [(worked(), "relative", {}), (worked(), "reference", {}), (every_spatial_joint(), "relative", {})]
    asked += [(every_spatial_joint(), "reference", {"orientation": o}) for o in ("bryant angles", "rotation matrix")]
    for m, family, options in asked:
        found = nc.formulate(m, family, **options)
        assert same(found, again(found)), (family, options)


def test_what_was_made_of_a_system_is_equal_again():
    angles = np.linspace(0.0, 1.0, 5)
    motion = nc.sweep(system(), {"phi": angles}, rates={"phi": 1.0})
    run = nc.simulate(system(), np.linspace(0.0, 0.1, 3))
    for found in (motion, motion.pose(1), run, nc.reactions(run)):
        for other in (again(found), copy.copy(found), copy.deepcopy(found)):
            assert type(other) is type(found) and same(found, other)
    assert str(again(run).report()) == run.report()


def test_a_loaded_system_traces_nothing_anew():
    traced = []

    @jax.jit
    def ends(system):
        traced.append(system.name)
        return nc.solve_position(system, {"phi": 0.3})["M"]

    first = ends(system())
    for other in (again(system()), copy.deepcopy(system()), again(again(system()))):
        assert np.array_equal(ends(other), first)
    assert len(traced) == 1


@functools.cache
def problem():
    return S.Objective(mechanism(), height, np.linspace(0.0, 1.0, 5), input="phi", free=["C"], bounds={"C": (0, 5)})


def test_problems_and_results_are_again_what_they_were():
    stated = problem()
    for other in (again(stated), copy.deepcopy(stated), copy.copy(stated)):
        assert type(other) is S.Objective and other.names == stated.names and same(other.system, stated.system)
        for name in ("start", "low", "high", "scale", "values"):
            assert np.array_equal(getattr(other, name), getattr(stated, name)), name
        assert same(other.evaluate(jnp.asarray(stated.start)), stated.evaluate(jnp.asarray(stated.start)))
        assert copy.deepcopy(other).values is not other.values
    table = S.FunctionGeneration(nc.library.four_bar(), "C.x", [0.1, 0.2, 0.4], [0.1, 0.2, 0.4], input="phi")
    assert np.array_equal(again(table).target, table.target)
    (one,) = move_designs(stated, [stated.start])
    designs = judge(stated, [Basin(one, End(one.x, np.nan, np.nan, np.nan, np.nan, 0, "given"), 1)])
    found = S.Result(stated, tuple(designs), (Progress(0.1, 1, 2.0),), 1, 1, 0, (0.5, stated.start))
    for other in (again(found), copy.deepcopy(found)):
        assert str(other) == str(found) and same(other.best, found.best)
        assert other.history == found.history and same(other.motion(), found.motion())
        assert np.array_equal(other.designs[0].x, found.designs[0].x)


def test_what_cannot_be_sent_is_named_with_what_to_do():
    def inside(p, v, s, c):
        return midway(p, v, s, c)

    def halfway(**fields):
        return nc.constraints.Kind(
            **{"residual": midway, **fields}, name="halfway", rows=("x", "y"), powers=(1, 1), points=3
        )

    lost = halfway(residual=lambda p, v, s, c: midway(p, v, s, c))
    rate = nc.constraints.RateKind("drift", lambda p, v, s, dp, dv, ds, c: (dp[0][0],), points=1)
    spring = forces.ForceKind("rubber", ("k",), points=1, potential=lambda p, v, s, c: c[0] * p[0][0])
    blown = mechanism(force=lambda t, state, p: wind(t, state, p))
    curve = S.condition(lambda motion: motion["C"][:, 0], "curve")
    aim = S.Objective(system(), lambda motion: motion["C"][:, 1], [0.0, 0.1], input="phi", free=["C"])
    refused = [
        (lost, "kind 'halfway' cannot be pickled, because its residual is a lambda"),
        (halfway(guard=inside), "kind 'halfway' cannot be pickled, because its guard is"),
        (mechanism(lost).compile(), "kind 'halfway'"),
        (nc.sweep(mechanism(lost).compile(), {"phi": np.linspace(0, 0.1, 3)}), "kind 'halfway'"),
        (rate, "kind 'drift' cannot be pickled, because its rate is a lambda"),
        (spring, "kind of force 'rubber' cannot be pickled, because its potential is a lambda"),
        (blown, "force 'force on C' cannot be pickled, because its function is a lambda"),
        (blown.compile(), "force 'force on C' cannot be pickled, because its function is a lambda"),
        (curve, "condition 'curve' cannot be pickled, because its function is a lambda"),
        (aim, "problem \"Objective with 'four-bar'\" cannot be pickled, because its residuals is a lambda"),
    ]
    for record, said in refused:
        with pytest.raises(nc.JaxncError) as error:
            pickle.dumps(record)
        assert said in str(error.value), said
        assert "write it with def at the top level of a module" in str(error.value)
        assert copy.copy(record) is not None and copy.deepcopy(record) is not None
    assert same(copy.deepcopy(blown.compile()), blown.compile())


def test_numbers_of_64_bits_are_not_narrowed_without_a_word():
    wide, narrow = pickle.dumps(system()), pickle.dumps(system().astype("float32"))
    with jax.enable_x64(False):
        with pytest.raises(nc.JaxncError, match=r"'four-bar'.*float64.*jax_enable_x64"):
            pickle.loads(wide)
        assert pickle.loads(narrow).dtype == np.float32
    assert pickle.loads(narrow).dtype == np.float32 and same(pickle.loads(wide), system())


def test_a_pool_of_spawned_processes_sweeps():
    found = json.loads(ended(child("pool"))[0].splitlines()[-1])
    assert found["apart"] > 1e-3, "two designs"
    for asked in ("equal", "known", "same", "converged"):
        assert found[asked] == [True, True], asked
