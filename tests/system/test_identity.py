"""Results do not depend on names: also where bodies, joints and coordinates share one, or it contains " and "."""

import dataclasses

import jax
import numpy as np
import pytest
from renaming import Renamed

import jaxnc as nc
from jaxnc.constraints import Kind
from jaxnc.forces import ForceKind
from jaxnc.library.catalogue import CATALOGUE
from jaxnc.system.assemble import assemble
from jaxnc.viz.poses import poses
from jaxnc.viz.sketch import sketch_plane

CRANK, ROD, SPEED, PHI, G = 0.3, 0.8, 4.0, 0.7, 9.81
MASSES = {"crank": 2.0, "rod": 3.0, "slider": 1.5}
PLAIN = {"crank": "crank", "rod": "rod", "slider": "slider", "guide": "guide", "phi": "phi", "rub": "rub"}
CHANGED = {
    "plain": {},
    "a crank called as its angle": {"crank": "phi"},
    "a joint called as the rod": {"guide": "rod"},
    "a joint called as two bodies": {"guide": "rod and slider"},
    "a slider called nut and bolt": {"slider": "nut and bolt"},
    "everything called the same": {"crank": "a and b", "guide": "a and b", "rub": "a and b", "rod": "a", "slider": "b"},
}


def slider_crank(friction: float = 0.0, **changed: str) -> nc.Mechanism:
    """A crank, a rod and a slider of two points on a guide along the x axis; all of them uniform."""
    at = PLAIN | changed
    A = CRANK * np.array([np.cos(PHI), np.sin(PHI)])
    B = np.array([A[0] + np.sqrt(ROD**2 - A[1] ** 2), 0.0])
    m = nc.Mechanism("slider-crank")
    m.ground("O", (0, 0))
    m.ground("E", (1, 0))
    m.point("A", A)
    m.point("B", B)
    m.point("C", B + np.array([0.1, 0.2]))
    m.body(at["crank"], ["O", "A"], mass=MASSES["crank"])
    m.body(at["rod"], ["A", "B"], mass=MASSES["rod"])
    m.body(at["slider"], ["B", "C"], mass=MASSES["slider"], com=B, inertia=0.01)
    m.prismatic(at["guide"], ("O", "E"), ("B", "C"))
    m.angle(at["phi"], at="O", to="A")
    m.gravity = (0, -G)
    if friction:
        m.friction(at["rub"], coefficient=friction, joint=at["guide"], speed=1e-2)
    return m


def newton_euler() -> tuple[np.ndarray, np.ndarray]:
    """Forces on the crank at O and on the slider in its guide, from the free bodies alone."""
    s, c = np.sin(PHI), np.cos(PHI)
    theta = np.arcsin(-CRANK * s / ROD)
    w = -CRANK * SPEED * c / (ROD * np.cos(theta))
    dw = (CRANK * SPEED**2 * s + ROD * w**2 * np.sin(theta)) / (ROD * np.cos(theta))
    a, b = CRANK * np.array([c, s]), ROD * np.array([np.cos(theta), np.sin(theta)])
    of_a = -(SPEED**2) * a
    middle = of_a + 0.5 * (dw * np.array([-b[1], b[0]]) - w**2 * b)
    of_b = of_a + dw * np.array([-b[1], b[0]]) - w**2 * b
    weight = np.array([0.0, -G])
    # Unknown: the forces on the crank at O, on the rod at A and on the slider at B, and the guide's push on it.
    matrix, right = np.zeros((7, 7)), np.zeros(7)
    matrix[0:2, 0:2], matrix[0:2, 2:4] = np.eye(2), -np.eye(2)
    right[0:2] = MASSES["crank"] * (0.5 * of_a - weight)
    matrix[2:4, 2:4], matrix[2:4, 4:6] = np.eye(2), -np.eye(2)
    right[2:4] = MASSES["rod"] * (middle - weight)
    matrix[4, 2:6] = [b[1] / 2, -b[0] / 2, b[1] / 2, -b[0] / 2]  # about the rod's middle
    right[4] = MASSES["rod"] * ROD**2 / 12 * dw
    matrix[5:7, 4:6], matrix[6, 6] = np.eye(2), 1.0
    right[5:7] = MASSES["slider"] * (of_b - weight)
    found = np.linalg.solve(matrix, right)
    return found[0:2], np.array([0.0, found[6]])


@pytest.mark.parametrize("case", ["plain", "everything called the same", "a crank called as its angle"])
def test_reactions_of_a_slider_crank_whatever_things_are_called(case):
    at = PLAIN | CHANGED[case]
    system = slider_crank(**CHANGED[case]).compile()
    motion = nc.motion(system, {at["phi"]: lambda t: PHI + SPEED * t}, [0.0, 0.1])
    r = nc.reactions(nc.inverse_dynamics(system, motion))
    pin, push = newton_euler()
    assert np.asarray(r.at("O", on=at["crank"]).force[0]) == pytest.approx(pin, rel=1e-9, abs=1e-9)
    assert np.asarray(r.joint(at["guide"], on=at["slider"]).force[0]) == pytest.approx(push, rel=1e-9, abs=1e-9)
    assert all(r.unique().values())


def rows(system: nc.System) -> list[list[tuple]]:
    """Which rows belong to what, by the kind of thing and its number."""
    return [[(owner.thing.name, owner.number) for owner in owners] for owners in system.topology.row_owners]


def test_rows_belong_to_the_same_things_whatever_these_are_called():
    plain = rows(slider_crank().compile())
    assert sorted(plain) == [
        [("BODY", 0)], [("BODY", 1)], [("BODY", 2)], [("COORDINATE", 0)], [("JOINT", 0)], [("JOINT", 0)]
    ]  # fmt: skip
    for case, changed in CHANGED.items():
        assert rows(slider_crank(**changed).compile()) == plain, case


def test_friction_is_of_its_joint_and_not_of_a_body_or_point_of_that_name():
    """A simulation with friction in the guide does not depend on what the guide is called."""
    t = np.linspace(0, 0.02, 3)
    ends = []
    for guide in ("guide", "rod"):
        run = nc.simulate(slider_crank(0.3, guide=guide).compile(), t, rates={"phi": SPEED}, method="rk4", step=5e-3)
        ends.append(np.asarray(run["A"]))
    assert np.abs(ends[0] - ends[1]).max() <= 1e-13
    top = slider_crank(0.3, guide="A").compile().topology
    (index,) = top.loads.friction
    assert index.point == -1 and index.joint == top.joints[0].owner


def without_names(what):
    """A structure with every text in it left out; kinds stay, which are no names of the user's."""
    if isinstance(what, str):
        return None
    if isinstance(what, tuple):
        return tuple(map(without_names, what))
    if dataclasses.is_dataclass(what) and not isinstance(what, Kind | ForceKind):
        return {f.name: without_names(getattr(what, f.name)) for f in dataclasses.fields(what) if f.compare}
    return what


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_mechanism_is_the_same_under_any_names(name):
    """Structure, owners, addresses and numbers of what is compiled do not know what anything is called."""
    plain = CATALOGUE[name]()
    system = assemble(plain)
    for seed in range(3):
        found = assemble(Renamed(plain, np.random.default_rng([seed, len(name)])).mechanism)
        assert without_names(found.topology) == without_names(system.topology)
        assert [j.type for j in found.topology.joints] == [j.type for j in system.topology.joints]
        same = zip(jax.tree.leaves(found.parameters), jax.tree.leaves(system.parameters), strict=True)
        assert all(np.array_equal(a, b) for a, b in same)
        assert [found._locate(v) for v in found.design_variables] == [
            system._locate(v) for v in system.design_variables
        ]


def rope() -> nc.System:
    """A point on an ellipse by a cable of 3, as far from one end as from the other by a relation of the same name."""
    m = nc.Mechanism("rope")
    m.ground("O", (0, 0))
    m.ground("E", (2, 0))
    m.point("P", (1.0, 1.1))
    m.distance("length", "O", "P")
    m.distance("other", "P", "E")
    m.relation("rope", {"length": 2.0, "other": -2.0}, 0.0)
    m.cable("rope", ["O", "P", "E"], length=3.0)
    return m.compile()


def test_a_relation_and_a_cable_of_one_name_keep_their_own_numbers():
    system = rope()
    found = nc.solve_position(system, {})
    assert int(found.status) == 0
    assert np.asarray(found["P"]) == pytest.approx([1.0, np.sqrt(1.5**2 - 1.0)], abs=1e-12)
    assert float(system["joint rope.length"]) == 3.0 and float(system["relation rope.length"]) == 2.0
    with pytest.raises(nc.InputError, match=r"'joint rope\.length'"):
        system["rope.length"]
    assert float(system.replace({"relation rope.length": -2.0})["relation rope.length"]) == -2.0
    with pytest.raises(nc.InputError, match="positive"):
        system.replace({"joint rope.length": -3.0})


def test_a_body_and_a_point_mass_of_one_name():
    m = nc.Mechanism("pendulum")
    m.ground("O", (0, 0))
    m.point("B", (1, 0))
    m.body("B", ["O", "B"], mass=2.0)
    m.point_mass("B", "B", 5.0)
    system = m.compile()
    assert (float(system["body B.mass"]), float(system["mass B.mass"])) == (2.0, 5.0)
    assert float(nc.dynamics.total_mass(system)) == 7.0


def test_a_name_taken_is_refused_with_both_named():
    m = slider_crank()
    m.distance("rise", "O", "A")
    m.point("D", (0.5, 0.2))
    for add, said in (
        (lambda: m.body("rod", ["O", "B"]), "body 'rod'.*already taken by another body"),
        (lambda: m.slot("guide", "A", ("O", "E")), "joint 'guide'.*another joint"),
        (lambda: m.angle("A", at="O", to="B"), "angle 'A'.*taken by a point"),
        (lambda: m.distance("phi", "O", "B"), "distance 'phi'.*taken by an angle"),
        (lambda: m.rolling("roll", "D", "A", "B", ("O", "E"), angle="phi", distance="way"), "'roll'.*'phi'"),
        (lambda: m.rolling("roll", "D", "A", "B", ("O", "E"), angle="turn", distance="rise"), "'roll'.*'rise'"),
        (lambda: m.rolling("roll", "D", "A", "B", ("O", "E"), angle="t", distance="t"), "'roll'.*'t'"),
        (lambda: m.relation("ground", {"phi": 1.0, "rise": 1.0}, 0.0) and m.body("ground", ["O", "C"]), "ground"),
    ):
        with pytest.raises(nc.MechanismError, match=said):
            add()
    m.rolling("roll", "D", "A", "B", ("O", "E"), angle="turn", distance="way")
    with pytest.raises(nc.MechanismError, match=r"angle 'way'.*coordinate of joint 'roll'"):
        m.angle("way", at="O", to="B")
    m.distance("constant", "O", "D")
    with pytest.raises(nc.MechanismError, match=r"'tie\.constant'"):
        m.relation("tie", {"constant": 1.0, "rise": 1.0}, 0.0)


def held(kind: str, dim: int = 2) -> nc.Mechanism:
    """A bar whose end is as high as a point of the ground, by a kind of the user's of some name."""
    place = (0.0,) * (dim - 2)
    m = nc.Mechanism("held", dim=dim)
    m.ground("O", (0, 0, *place))
    m.ground("E", (1, 0.3, *place))
    m.point("P", (0.4, 0.3, *place))
    m.body("bar", ["O", "P"])
    m.constrain("c", nc.constraints.Kind(kind, lambda p, v, s, c: (p[0][1] - p[1][1],), points=2), ["E", "P"])
    return m


def test_a_kind_of_the_user_is_not_drawn_as_the_joint_of_its_name():
    for dim, kind in ((2, "slot"), (2, "gear"), (3, "cylindrical"), (3, "aligned pins"), (3, "weld")):
        (joint,) = assemble(held(kind, dim)).topology.joints
        assert (joint.type, joint.drawn, joint.bodies) == (kind, False, ())
    scene = sketch_plane(poses(nc.solve_position(held("slot").compile(), {})))
    assert not {item.role for item in scene.items} & {"slotted bar", "channel"}


@pytest.mark.parametrize("family", ["relative", "reference"])
def test_families_of_a_mechanism_whose_bodies_are_called_as_its_points(family):
    """A sliding point of no body beside bodies of that name, and of the name of the other points."""
    plain = CATALOGUE["slider-crank"]()
    other = Renamed(plain, np.random.default_rng(1))
    for body, point in zip(list(plain.model.bodies), list(plain.all_points)[::-1], strict=False):
        other.mechanism.model.bodies[other.quantities[point]] = other.mechanism.model.bodies.pop(other.bodies[body])
    found, same = (nc.formulate(m, family) for m in (other.mechanism, plain))
    assert (found.n, found.r, found.g) == (same.n, same.r, same.g)
