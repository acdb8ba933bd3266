"""Pictures of spatial mechanisms: the right solids at the right places, what is near over what is far."""

import dataclasses
import itertools
import json

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure
from pages import unpacked
from PIL import Image, ImageSequence
from scipy.spatial import ConvexHull

import jaxnc as nc
from jaxnc import viz
from jaxnc.errors import InputError
from jaxnc.library.catalogue import CATALOGUE
from jaxnc.system.assemble import assemble
from jaxnc.vehicle.report import suspension_report
from jaxnc.viz.bodies import outline, rank
from jaxnc.viz.poses import poses
from jaxnc.viz.spatial import mesh
from jaxnc.viz.spatial.camera import Camera, choose_camera
from jaxnc.viz.spatial.drawing import Projection, Solids
from jaxnc.viz.spatial.scene import Ball, Painter, Plate, Solid, SpaceFrame, SpaceScene, Turn, Way
from jaxnc.viz.spatial.sketch import sketch_space

DRAWN = 1e-12  # of the size: solids take their places from the motion unchanged
QUANTUM = 1e-6  # of what pages are drawn from: a ten millionth of ten times the size, or less


def mechanism(name: str = "RSCR") -> nc.Mechanism:
    """Crank on the ground, ball, coupler whose line carries a sleeve, rocker on the ground."""
    a, b = np.array([1.5, 0.4, 1.6]), np.array([3.0, 1.5, 1.9])
    m = nc.Mechanism(name, dim=3, length_unit="mm", angle_unit="deg")
    m.ground("A", (0, 0, 0))
    m.ground("B", (3, 1.5, 0))
    m.ground_vector("vA", (0, 0, 1))
    m.ground_vector("vB", (0, 1, 0))
    m.point("P1", (0.4, 0, 0))
    m.point("P2", a)
    m.point("P3", b)
    m.vector("v1", b - a)
    m.body("crank", ["A", "P1"], vectors=["vA"])
    m.body("coupler", ["P1", "P2"], vectors=["v1"])
    m.body("rocker", ["B", "P3"], vectors=["vB", "v1"])
    m.cylindrical("C", line=("P2", "v1"), on="P3")
    m.angle("phi", at="A", to="P1", about="vA")
    m.marker("G", on="coupler", at=(1.2, 0.6, 0.9))
    return m


@pytest.fixture(scope="module")
def turning():
    """One turn of the crank, with rates."""
    return nc.sweep(mechanism().compile(), {"phi": np.linspace(0.0, 2 * np.pi, 13)}, rates={"phi": 2.0}).check()


@pytest.fixture(scope="module")
def failing(turning):
    """The same with two poses that are not right."""
    status = np.zeros(13, int)
    status[4:6] = int(nc.Status.SINGULAR)
    return dataclasses.replace(turning, status=jnp.asarray(status))


def still(m: nc.Mechanism, driven: tuple[str, ...] = ()) -> nc.Motion:
    """A mechanism as drawn, as one pose; nothing is solved."""
    system = assemble(m)
    par, top = system.parameters, system.topology
    vectors = np.asarray(par.vectors)
    vectors = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True) if vectors.size else vectors
    q = np.concatenate([np.ravel(par.points), vectors.reshape(-1), np.zeros(len(top.scalars))])
    zero = np.zeros(())
    return nc.Motion(system, driven, (), q, (), np.zeros(len(driven)), np.zeros((), int), zero, zero)


def drawn(motion: nc.Motion) -> SpaceScene:
    return sketch_space(poses(motion))


def of(scene: SpaceScene, *roles: str) -> list:
    return [item for item in scene.items if item.role in roles]


def names(scene: SpaceScene) -> list[str]:
    return [label.text for label in scene.labels]


def at(motion: nc.Motion, item) -> str:
    """The point at which an item stands."""
    where = item.at if isinstance(item, (Ball, Turn)) else item.frame.at
    return poses(motion).names[where]


def places(motion: nc.Motion, name: str) -> np.ndarray:
    return np.asarray(motion[name])


def only(items: list):
    assert len(items) == 1, items
    return items[0]


def middle(name) -> np.ndarray:
    """Where the middle of a name is, pixels."""
    name.get_window_extent()
    return name.get_transform().transform(name.get_position())


def artists(figure: Figure, role: str) -> list:
    return [a for ax in figure.axes for a in ax.get_children() if a.get_gid() == role]


# ---------------------------------------------------------------------------------------------------------------
# what is drawn for what


def test_bars_hinges_balls_and_sleeves(turning):
    scene = drawn(turning)
    pose = poses(turning).every_column[3]
    ends = set()
    for bar in of(scene, "bar"):
        x = bar.vertices(pose, 1e-9)
        if len(bar.frame.along.columns) == 2:
            ends.add(tuple(sorted(poses(turning).names[c] for c in bar.frame.along.columns)))
            np.testing.assert_allclose(x[:10].mean(axis=0), pose[bar.frame.along.columns[0]], atol=1e-8)
            np.testing.assert_allclose(x[-10:].mean(axis=0), pose[bar.frame.along.columns[1]], atol=1e-8)
    assert ends == {("A", "P1"), ("P1", "P2"), ("B", "P3")}
    assert sorted(at(turning, h) for h in of(scene, "ground hinge")) == ["A", "B"]
    assert sorted(at(turning, s) for s in of(scene, "support")) == ["A", "B"]
    assert [at(turning, b) for b in of(scene, "ball")] == ["P1"]
    sleeve = only(of(scene, "block"))
    assert at(turning, sleeve) == "P3"
    axis = sleeve.frame.stand(pose)[1][0]
    np.testing.assert_allclose(axis, places(turning, "v1")[3], atol=1e-9)
    rod = only([bar for bar in of(scene, "bar") if len(bar.frame.along.columns) == 1])
    along = (rod.vertices(pose, 1e-9) - places(turning, "P2")[3]) @ axis
    travel = np.sum((places(turning, "P3") - places(turning, "P2")) * places(turning, "v1"), axis=1)
    np.testing.assert_allclose([along.min(), along.max()], [0.0, travel.max()], atol=1e-7)  # over the whole motion


def test_colours_and_vectors(turning):
    scene = drawn(turning)
    bodies = {item.body for item in of(scene, "bar")}
    assert bodies == {0, 1, 2}
    axes = of(scene, "axis", "ground axis")
    assert sorted(item.role for item in axes) == ["axis", "ground axis", "ground axis"]
    assert sorted(at(turning, item) for item in axes) == ["A", "B", "P2"]
    assert sorted(names(scene)) == ["A", "B", "G", "P1", "P2", "P3", "v1", "vA", "vB"]


def test_bodies_of_many_points_are_translucent_solids():
    m = nc.Mechanism("solid", dim=3)
    corners = {"P": (0, 0, 0), "Q": (1, 0, 0), "R": (0, 1, 0), "S": (0, 0, 1), "T": (1, 1, 0), "U": (0.3, 0.3, 0.2)}
    for name, x in corners.items():
        m.point(name, x)
    m.body("block", list(corners))
    m.point("V", (3, 0, 0))
    m.point("W", (3, 1, 0))
    m.point("X", (3, 2, 0))
    m.body("bar", ["V", "X", "W"])
    scene = drawn(still(m))
    plate = only(of(scene, "plate"))
    assert plate.style.opacity < 0.5
    assert {c for face in plate.faces for c in face} == {0, 1, 2, 3, 4}  # U is inside
    edges = {tuple(sorted(e.frame.along.columns)) for e in of(scene, "edge")}
    assert (0, 4) not in edges and (1, 2) not in edges  # no diagonal of the square
    assert {(0, 1), (0, 2), (0, 3), (1, 3), (2, 3), (1, 4), (2, 4), (3, 4)} == edges
    assert {b.frame.along.columns for b in of(scene, "bar")} == {(6, 7), (7, 8)}  # in order along it
    flat, line = np.eye(3)[:, [0, 1, 1]] @ np.diag([1.0, 1.0, 0.0]), np.outer(np.arange(3.0), np.ones(3))
    assert (rank(np.vstack([flat, [[1, 1, 0]]])), rank(line), rank(np.zeros((1, 3)))) == (2, 1, 0)
    faces, sides = outline(np.array([[0.0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]))
    assert len(faces) == 1 and len(sides) == 4
    cube = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    faces, sides = outline(np.vstack([cube, [[0.5, 0.5, 0.5], [0.5, 0.5, 1.0]]]))  # one within, one on a face
    assert sorted(map(len, faces)) == [4] * 6 and len(sides) == 12
    assert all(np.ptp(cube[list(f)], axis=0).min() == 0.0 for f in faces)
    for seed in range(5):
        x = np.random.default_rng(seed).normal(size=(9, 3))
        assert {frozenset(f) for f in outline(x)[0]} == {frozenset(f.tolist()) for f in ConvexHull(x).simplices}


def test_hinges_between_bodies_by_vector_or_by_two_points():
    m = nc.Mechanism("hinges", dim=3)
    m.ground("A", (0, 0, 0))
    m.point("P", (1, 0, 0))
    m.point("Q", (1, 1, 0))
    m.point("R", (2, 0, 1))
    m.vector("h", (0, 0, 1))
    m.point("S", (3, 0, 1))
    m.body("one", ["A", "P", "Q"])
    m.body("two", ["P", "Q", "R"], vectors=["h"])
    m.body("three", ["R", "S"], vectors=["h"])
    motion = still(m)
    scene = drawn(motion)
    hinges = of(scene, "hinge")
    assert sorted(at(motion, h) for h in hinges) == ["P", "Q", "R"]
    pose = poses(motion).every_column[0]
    for hinge in hinges:
        along = hinge.frame.stand(pose)[1][0]
        expected = (0, 0, 1) if at(motion, hinge) == "R" else (0, 1, 0)
        np.testing.assert_allclose(np.abs(along), expected, atol=1e-12)
    assert [at(motion, b) for b in of(scene, "ground ball")] == ["A"]


def test_universal_prismatic_screw_and_gears():
    m = nc.Mechanism("joints", dim=3)
    m.ground("E", (-2, 0, 0))
    m.ground("O", (0, 0, 0))
    m.ground_vector("a", (1, 0, 0))
    m.vector("u", (0, 1, 0))
    m.vector("w", (0, 0, 1))
    m.point("F", (2, 1, 0))
    m.body("input", ["E", "O"], vectors=["a", "u"])
    m.body("output", ["F", "O"], vectors=["w"])
    m.universal("cross", axes=("u", "w"))
    motion = still(m)
    scene = drawn(motion)
    arms = of(scene, "cross")
    assert [at(motion, arm) for arm in arms] == ["O", "O"]
    pose = poses(motion).every_column[0]
    np.testing.assert_allclose([arm.frame.stand(pose)[1][0] for arm in arms], [(0, 1, 0), (0, 0, 1)], atol=1e-12)
    assert [at(motion, s) for s in of(scene, "support")] == ["E"]  # the cross is held by its shafts

    m = nc.Mechanism("slides", dim=3)
    m.ground("A", (0, 0, 0))
    m.ground_vector("e", (0, 0, 1))
    m.ground_vector("x", (1, 0, 0))
    m.point("S", (0, 0, 0.8))
    m.point("Q", (0.9, 0, 0.8))
    m.body("nut", ["S", "Q"], vectors=["e"])
    m.screw("thread", line=("A", "e"), on="S", directions=("x", ("S", "Q")), angle="phi", distance="s", lead=0.5)
    motion = still(m, ("phi",))
    scene = drawn(motion)
    assert at(motion, only(of(scene, "block"))) == "S" and at(motion, only(of(scene, "rail"))) == "A"
    turn = only(of(scene, "arc"))
    assert (turn.text, turn.scalar) == ("φ", list(motion.system.topology.scalars).index("phi"))

    m = nc.Mechanism("bevel", dim=3)
    m.ground("A", (1, 0, 0))
    m.ground("B", (0, 2, 0))
    m.ground_vector("vA", (1, 0, 0))
    m.ground_vector("vB", (0, 1, 0))
    m.point("P", (1, 2, 0))
    m.point("Q", (1, 2, 0))
    m.body("pinion", ["A", "P"], vectors=["vA"])
    m.body("wheel", ["B", "Q"], vectors=["vB"])
    m.angle("phi", at="A", to="P", about="vA")
    m.angle("psi", at="B", to="Q", about="vB")
    m.bevel_gear("mesh", "phi", "psi")
    motion = still(m)
    pose = poses(motion).every_column[0]
    for wheel, centre, radius in zip(of(drawn(motion), "wheel"), ((1, 0, 0), (0, 2, 0)), (2.0, 1.0), strict=True):
        x = wheel.vertices(pose, 0.0)
        np.testing.assert_allclose(np.linalg.norm(x - centre, axis=1), radius, atol=1e-12)
        np.testing.assert_allclose((x - centre) @ np.array(centre), 0.0, atol=1e-12)
    low, high = drawn(motion).box(pose[None])
    np.testing.assert_allclose(high - low, (2.0, 4.0, 4.0), atol=0.05)  # the wheels are in view


def test_the_axis_of_a_slide_may_be_two_points_beside_vectors_for_the_turn():
    m = nc.Mechanism("prismatic", dim=3)
    m.ground("A", (0, 0, 0))
    m.ground("B", (3, 4, 0))
    m.ground_vector("k", (0, 0, 1))
    m.point("S", (0.6, 0.8, 0))
    m.point("Q", (0.6, 0.6, 0.7))
    m.point("R", (0.1, 1.2, 0.4))
    m.point("T", (1.2, 1.6, 0))
    m.body("carriage", ["S", "Q", "R", "T"])
    m.prismatic("slide", line=("A", "B"), on=("S", "T"), directions=("k", ("S", "Q")))
    scene = drawn(still(m))
    block = only(of(scene, "block"))
    np.testing.assert_allclose(block.frame.stand(poses(still(m)).every_column[0])[1][0], (0.6, 0.8, 0), atol=1e-12)
    assert len(of(scene, "rail")) == 1 and at(still(m), block) == "S"


def strut() -> nc.Mechanism:
    """A telescope that hangs from the ground: its tube ends at P, its rod at Q."""
    m = nc.Mechanism("strut", dim=3)
    m.ground("O", (0, 0, 8))
    for name, x in {"Q": (0, 0, 6), "P": (0, 0, 3), "R": (0, 0, 0), "S": (2, 0, 0)}.items():
        m.point(name, x)
    m.vector("u", (1, 0, 0))
    m.body("tube", ["R", "P", "S"], vectors=["u"])
    m.body("rod", ["O", "Q"], vectors=["u"])
    m.cylindrical("slide", line=("R", "P"), on=("O", "Q"))
    m.distance("s", "P", "Q")
    return m


def test_a_telescope_has_its_sleeve_where_the_rod_enters():
    motion = still(strut())
    scene, pose = drawn(motion), poses(motion).every_column[0]
    sleeve, spring = only(of(scene, "block")), only(of(scene, "spring"))
    names_ = poses(motion).names
    assert at(motion, sleeve) == "P" and sleeve.body == only(of(scene, "plate")).body
    height = sleeve.vertices(pose, 0.1)[:, 2]
    assert 2.5 < height.min() < height.max() < 3.1  # on the tube
    rods = [bar for bar in of(scene, "bar") if bar.frame.along.columns == (names_.index("Q"), names_.index("P"))]
    reach = only(rods).vertices(pose, 0.1)[:, 2]
    assert 2.9 < reach.min() < 3.1 and 5.9 < reach.max() < 6.1  # from its own body into the sleeve
    assert [names_[c] for c in spring.frame.along.columns] == ["P", "Q"]
    ball, support = only(of(scene, "ground ball")), only(of(scene, "support"))
    assert (at(motion, ball), at(motion, support)) == ("O", "O")
    assert support.vertices(pose, 0.1)[:, 2].min() > 7.9  # everything hangs from it
    label = next(label for label in scene.labels if label.text == "s")
    np.testing.assert_allclose(label.foot(pose, 0.1), (0, 0, 4.5), atol=1e-12)


def test_distances_that_no_body_joins_can_be_seen():
    m = nc.Mechanism("distances", dim=3)
    m.ground("A", (0, 0, 0))
    m.ground("B", (0, 0, 5))
    m.ground("C", (3, -2, 0))
    m.ground_vector("y", (0, 1, 0))
    m.point("P", (3, 0, 0))
    m.point("Q", (2, 1, 0))
    m.point("R", (3, 3, 0))
    m.body("arm", ["A", "P", "Q"])
    m.body("link", ["P", "R"])
    m.distance("damper", "Q", "B")  # points of its own: a spring and a damper
    m.distance("actuator", "R", "B")  # driven: a cylinder
    m.distance("seen", "P", "B")  # P is a joint already
    m.distance("length", "A", "P")  # of a bar
    m.distance("way", "C", "P", along="y")
    motion = still(m, ("actuator",))
    scene, data = drawn(motion), poses(motion)

    def ends(role: str) -> list[tuple[str, ...]]:
        return sorted(tuple(data.names[c] for c in item.frame.along.columns) for item in of(scene, role))

    assert ends("spring") == [("Q", "B")] and ends("distance") == [("C", "P"), ("P", "B")]
    assert ends("rod") == ends("block") == [("Q", "B"), ("R", "B")]
    assert {"damper", "actuator", "seen", "way"} <= set(names(scene)) and "length" not in names(scene)
    spring = only(of(scene, "spring")).vertices(data.every_column[0], 0.01)
    a, b = places(motion, "Q"), places(motion, "B")
    off = np.linalg.norm(np.cross(spring - a, (b - a) / np.linalg.norm(b - a)), axis=1)
    np.testing.assert_allclose(off, 0.016, rtol=1e-9)
    seen = of(drawn(still(m)), "spring")  # nothing is driven: both are springs, which share a point
    assert len(seen) == 2


def test_welded_bodies_are_one_and_links_about_a_point_are_webs():
    m = nc.Mechanism("welded", dim=3)
    m.ground("O", (0, 0, 0))
    for name, x in {"P": (1, 0, 0), "Q": (0, 1, 0), "R": (0, 0, 1), "S": (1, 1, 1)}.items():
        m.point(name, x)
    m.body("one", ["O", "P", "Q"])
    m.body("two", ["O", "R", "S"])
    m.weld("both", "one", "two")
    m.vector("u", (1, 0, 0))
    m.vector("v", (0, 0.6, 0.8))
    m.body("link", ["O"], vectors=["u", "v"])
    motion = still(m)
    scene = drawn(motion)
    assert len({plate.body for plate in of(scene, "plate")}) == 1
    web = only(of(scene, "web"))
    assert at(motion, web) == "O" and web.body != of(scene, "plate")[0].body
    x = web.vertices(poses(motion).every_column[0], 0.1)
    d = x[1:] / np.linalg.norm(x[1:], axis=1, keepdims=True)
    np.testing.assert_allclose(d, [(1, 0, 0), (0, 0.6, 0.8)], atol=1e-12)


@pytest.mark.slow
def test_links_about_a_point_reach_their_markers():
    data = poses(nc.library.spherical_four_bar(radius=0.3))
    webs = [i for i in sketch_space(data).items if i.role == "web"]
    x = [web.vertices(data.every_column[0], 0.001) for web in webs]
    assert len(x) == 3
    for corners in x:  # from the centre along a great circle of the markers' sphere
        np.testing.assert_allclose(np.linalg.norm(corners, axis=1), [0.0, *[0.3] * (len(corners) - 1)], atol=1e-12)
    tips = np.concatenate(x)
    for k in range(len(data.topology.points), len(data.names)):
        assert np.linalg.norm(tips - data.places[0, k], axis=1).min() < 1e-12


def test_every_spatial_mechanism_of_the_library_can_be_shown(tmp_path):
    shown = []
    for name, make in CATALOGUE.items():
        m = make()
        if m.model.dim == 3:
            motion = still(m)
            scene = drawn(motion)
            numbers = {text.split()[0] for text in names(scene)}  # of a suspension, what the trade says stands behind
            assert {point for point in motion.system.topology.points} <= {*names(scene), *numbers}, name
            assert len(of(scene, "bar", "edge", "web", "rod")) > 0, name
            read(viz.to_html(motion, tmp_path / f"{name}.html"))
            shown.append(viz.draw(motion, title=name, size=(3.2, 2.9), frame="scale"))
    assert len(shown) > 15


def test_a_point_on_a_rail():
    m = nc.Mechanism("slider", dim=3)
    m.ground("A", (0, 0, 0))
    m.point("P", (3, 0, 0))
    m.point("S", (2, 9, 1), fixed="xz")
    m.body("crank", ["A", "P"])
    m.body("rod", ["P", "S"])
    motion = still(m)
    scene = drawn(motion)
    rail, block = only(of(scene, "rail")), only(of(scene, "block"))
    assert at(motion, block) == "S"
    np.testing.assert_allclose(rail.frame.at, (2, 0, 1))
    np.testing.assert_allclose(rail.frame.along.fixed, (0, 1, 0))
    assert len(of(scene, "support")) == 3  # of the crank, and both ends of the rail
    assert scene.box(poses(motion).every_column)[1][1] >= 9.0


# ---------------------------------------------------------------------------------------------------------------
# solids and what hides what


@pytest.mark.parametrize(
    "made",
    [
        mesh.tube(0.5, 6),
        mesh.drum(-1.5, 1.5, 0.9),
        mesh.drum(-2.0, 2.0, 1.2, 4, prism=True),
        mesh.revolve((mesh.Ring(units=-0.4, radius=1.0), mesh.Ring(units=0.4, radius=1.0)), 40),
        mesh.arrow(9.0, 0.2, 0.6),
        mesh.reach(0.2, 0.6),
        mesh.stand(2.9, 1.5),
        mesh.Mesh((mesh.Coil(3, 1.5, 0.5, 0.5),)),
        mesh.dashes(4),
    ],
)
def test_faces_look_outward(made):
    x = Solid("bar", SpaceFrame(0, Way((0, 1))), made).vertices(np.array([[0.0, 0, 0], [4, 5, 6]]), 0.5)
    made = made.polygons
    for part in set(made.face_parts):
        faces = [f for f, p in zip(made.faces, made.face_parts, strict=True) if p == part]
        middle = x[sorted({i for f in faces for i in f})].mean(axis=0)
        for face in faces:
            corners = x[list(face)]
            normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
            assert normal @ (corners.mean(axis=0) - middle) > 0
    for a, b, f, g, _ in made.edges:
        for side in (f, g):
            assert side < 0 or {a, b} <= set(made.faces[side])


def test_a_camera_looks_as_matplotlib_does(turning):
    for view in ((20.0, -60.0), (0.0, 0.0), (90.0, -90.0), (-30.0, 140.0)):
        ax = viz.draw(turning, view=view).axes[0]
        assert (ax.elev, ax.azim) == view
        np.testing.assert_allclose(Projection(ax).axes, Camera(*view).axes, atol=1e-6)
        low, high = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()]).T
        shape = np.array(ax._box_aspect) / (high - low)
        np.testing.assert_allclose(shape, shape[0], rtol=1e-9)  # lengths are equal along all axes


def test_a_view_is_chosen_in_which_lengths_can_be_seen():
    x = np.array([[[0.0, 0, 0], [np.cos(np.radians(-60)), np.sin(np.radians(-60)), np.tan(np.radians(22))]]])
    camera = choose_camera(x, ((0, 1),), (0, 1), ())
    d = x[0, 1] / np.linalg.norm(x[0, 1])
    assert abs(d @ camera.axes[2]) < 0.7  # not end on, as the first choice would see it


def front(order: np.ndarray) -> Painter:
    """Two discs, one behind the other along y."""
    one, two = (Ball("dot", k, 1.0, body=k) for k in (0, 1))
    return Painter(SpaceScene((two, one), (), (0, 1), np.zeros((0, 3)), (0, 1), (), ()))


@pytest.mark.parametrize("swapped", [False, True])
def test_what_is_near_is_painted_over_what_is_far(swapped):
    pose = np.array([[0.0, 0, 0], [0.3, 5.0, 0.2]])
    painter = front(pose)
    axes = Camera(0.0, 90.0 if swapped else -90.0).axes
    corners, *_ = painter.paint(
        painter.vertices(pose, np.zeros(0), 1.0), pose, lambda x: (x @ axes[:2].T, x @ axes[2], axes, 1.0), 1.0
    )
    middle = corners.mean(axis=1)
    assert len(middle) == 4  # each ball and its light
    last = middle[2] - middle[0]
    expected = (pose[1] - pose[0]) @ axes[:2].T * (1 if swapped else -1)
    np.testing.assert_allclose(last, expected, atol=1e-9)


def test_only_faces_that_are_seen_are_painted():
    scene = SpaceScene(
        (Solid("block", SpaceFrame(0, Way(fixed=(1.0, 0, 0))), mesh.drum(-1.0, 1.0, 1.0, 4, prism=True)),),
        (),
        (0,),
        np.zeros((0, 3)),
        (0,),
        (),
        (),
    )
    painter = Painter(scene)
    pose = np.zeros((1, 3))
    for view, faces, edges in (((0.0, 0.0), 1, 4), ((30.0, 40.0), 3, 9)):
        axes = Camera(*view).axes
        _, areas, *_ = painter.paint(
            painter.vertices(pose, np.zeros(0), 1.0), pose, lambda x, a=axes: (x @ a[:2].T, x @ a[2], a, 1.0), 1.0
        )
        filled = areas[:, 3] > 0
        assert (filled.sum(), (~filled).sum()) == (faces, edges)


# ---------------------------------------------------------------------------------------------------------------
# figures


def test_a_figure_has_the_pose_the_names_and_the_axes(turning):
    figure = viz.draw(turning, pose=4, trace=["P3", "G"])
    solids = only(artists(figure, "mechanism"))
    assert isinstance(solids, Solids)
    np.testing.assert_allclose(solids.pose[: len(poses(turning).names)], poses(turning).places[4], atol=DRAWN)
    ax = figure.axes[0]
    assert (ax.get_xlabel(), ax.get_zlabel()) == ("x [mm]", "z [mm]")
    assert sorted(t.get_text() for t in artists(figure, "label")) == sorted(names(drawn(turning)))
    assert [t.get_text() for t in artists(figure, "input")] == ["φ"]
    assert only([t.get_text() for t in figure.texts]) == "RSCR"
    path = only([x for x, body, *_ in solids.painter.traces if body == poses(turning).names.index("P3") - 2])
    at = poses(turning).path(poses(turning).names.index("P3"))[1]
    np.testing.assert_allclose(path[at], places(turning, "P3"), atol=DRAWN)
    assert not artists(viz.draw(turning, labels=False), "label")
    assert len(artists(viz.draw(turning, ghosts=[2, 6]), "ghost")) == 2


def test_everything_is_on_the_paper(turning):
    for frame in (True, False):
        figure = viz.draw(turning, trace="P3", frame=frame)
        figure.canvas.draw()
        image = np.asarray(figure.canvas.buffer_rgba())[..., :3]
        inked = np.argwhere((image < 235).any(axis=-1))
        assert inked.min() > 0 and (inked.max(axis=0) < np.array(image.shape[:2]) - 1).all()
        if not frame:  # and fills it
            assert (np.ptp(inked, axis=0) > 0.75 * np.array(image.shape[:2])).any()
    texts = artists(figure, "label")
    spots = np.array([middle(t) for t in texts])
    between = np.linalg.norm(spots[:, None] - spots[None], axis=-1)[np.triu_indices(len(texts), 1)]
    assert between.min() > texts[0].get_fontsize() * figure.dpi / 72  # names do not lie on each other


def test_names_and_numbers_of_the_axes_have_room():
    m = mechanism("long names")
    m.ground("a_point_far_left", (-0.5, -0.5, 1.0))
    m.ground("a_point_far_right", (4.0, 2.5, 1.0))
    for figure in (viz.draw(still(m, ("phi",))), viz.draw(still(m), view=(20, 20), size=(4, 3))):
        figure.canvas.draw()
        ax, paper = figure.axes[0], figure.bbox
        axes = (ax.xaxis, ax.yaxis, ax.zaxis)
        ends = np.array(list(itertools.product(*(axis.get_view_interval() for axis in axes))))
        box = ConvexHull(ax.transData.transform(Projection(ax)(ends)[0]))
        names_ = np.concatenate([t.get_window_extent().corners() for t in artists(figure, "label")])
        outside = names_ @ box.equations[:, :2].T + box.equations[:, 2]
        assert outside.max() < 3.0  # pixels: numbers stand around the box
        for axis in axes:
            drawn_ = axis.get_tightbbox(figure.canvas.get_renderer())
            assert paper.x0 <= drawn_.x0 and drawn_.x1 <= paper.x1
            assert paper.y0 <= drawn_.y0 and drawn_.y1 <= paper.y1
        assert (figure.get_size_inches() <= (6.4, 5.0)).all()


@pytest.mark.parametrize("name", ["bennett", "four-bar-in-space", "wobble-plate", "double-wishbone"])
def test_the_floor_is_whole_axes_have_a_scale_and_the_heading_is_not_cut(name):
    figure = viz.draw(CATALOGUE[name]())
    figure.canvas.draw()
    ax, paper = figure.axes[0], figure.bbox
    floor = only(artists(figure, "floor"))
    assert not floor.get_clip_on()  # by the axes, which are smaller than the paper
    (x0, x1), (y0, y1), (z0, _) = (axis.get_view_interval() for axis in (ax.xaxis, ax.yaxis, ax.zaxis))
    rim = ax.transData.transform(Projection(ax)(np.array([(x, y, z0) for x in (x0, x1) for y in (y0, y1)]))[0])
    assert (rim >= paper.p0).all() and (rim <= paper.p1).all()
    for axis in (ax.xaxis, ax.yaxis):
        assert len(axis.get_majorticklocs()) >= 2
    texts = [t.label1.get_window_extent() for t in ax.zaxis.get_major_ticks() if t.label1.get_text()]
    line = ax.transData.transform(Projection(ax)(np.array([(x1, y1, z0)]))[0])[0, 0]
    right = np.mean([box.x0 + box.width / 2 for box in texts]) > line  # numbers stand beside the axis, not on it
    assert not right or min(box.x0 for box in texts) > line
    heading = only(list(figure.texts)).get_window_extent()
    assert heading.x0 >= 0 and heading.x1 <= paper.x1


def test_the_name_of_an_angle_is_clear_of_bars(turning):
    for k in (1, 4, 8):
        figure = viz.draw(turning, pose=k)
        figure.canvas.draw()
        box = only(artists(figure, "input")).get_window_extent()
        solids = only(artists(figure, "mechanism"))
        arcs = ("arc", "reference")
        painter = Painter(
            SpaceScene(
                tuple(i for i in drawn(turning).items if i.role not in arcs and not isinstance(i, Turn)),
                (), (), np.zeros((0, 3)), tuple(range(len(solids.painter.solids))), (), (),
            )
        )  # fmt: skip
        x = painter.vertices(solids.pose, np.zeros(1), solids.unit)[painter.columns :]
        flat, *_ = Projection(figure.axes[0])(x)
        spots = figure.axes[0].transData.transform(flat)
        assert not ((spots > box.p0) & (spots < box.p1)).all(axis=1).any()


def test_names_stay_by_their_points_while_the_view_turns(turning):
    figure = viz.draw(turning)
    ax = figure.axes[0]
    label = next(t for t in artists(figure, "label") if t.get_text() == "P3")
    gaps = []
    for azimuth in (-60, 30):
        ax.view_init(20, azimuth)
        flat, *_ = Projection(ax)(places(turning, "P3")[:1])
        gaps.append(np.linalg.norm(middle(label) - ax.transData.transform(flat[0])))
    np.testing.assert_allclose(gaps[0], gaps[1], rtol=1e-6)


def test_a_failed_pose_is_a_ghost_that_says_why(failing):
    figure = viz.draw(failing, pose=4, trace="P3")
    banner = only(artists(figure, "failure"))
    assert banner.get_visible() and "Pose 4 failed" in banner.get_text()
    solids = only(artists(figure, "mechanism"))
    figure.canvas.draw()
    path, at = solids.painter.traces[0][0], poses(failing).path(poses(failing).names.index("P3"))[1]
    assert np.isnan(path[at[4:6]]).all() and np.isfinite(np.delete(path, at[4:6], axis=0)).all()
    faint = np.asarray(solids.get_facecolor())[:, 3]
    right = viz.draw(failing, pose=3)
    right.canvas.draw()
    assert not only(artists(right, "failure")).get_visible()
    full = np.asarray(only(artists(right, "mechanism")).get_facecolor())[:, 3]
    assert np.median(faint[faint > 0]) < 0.2 < np.median(full[full > 0])


def test_velocities_are_arrows(turning):
    figure = viz.draw(turning, pose=5, velocities=["P2", "P3"])
    solids = only(artists(figure, "mechanism"))
    arrows = [item for item in solids.painter.solids if item.role == "velocity"]
    d = np.stack([item.frame.along.vector(solids.pose) for item in arrows])
    v = np.stack([np.asarray(turning.velocity(n))[5] for n in ("P2", "P3")])
    np.testing.assert_allclose(d * (v[0, 0] / d[0, 0]), v, rtol=1e-6, atol=1e-9)
    longest = np.linalg.norm(v, axis=1).max()
    assert only(artists(figure, "velocity key")).get_text() == f"longest velocity {longest:.3g} mm/s"


def test_axes_and_views_of_the_user(turning):
    figure = Figure(figsize=(6, 3))
    right = figure.add_subplot(1, 2, 2, projection="3d")
    assert viz.draw(turning, ax=right, title="here") is figure
    assert right.get_title(loc="left") == "here"
    with pytest.raises(InputError, match=r"'RSCR' is spatial.*projection='3d'"):
        viz.draw(turning, ax=figure.add_subplot(1, 2, 1))
    for view in (3, (100, 0), ("a", 0), (1, 2, 3)):
        with pytest.raises(InputError, match=r"view=.*elevation.*\(25, -60\)"):
            viz.draw(turning, view=view)
    m = nc.Mechanism("flat")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    m.body("bar", ["A", "B"])
    with pytest.raises(InputError, match=r"'flat' is planar.*leave view out"):
        viz.draw(still_planar(m), view=(20, 30))


def still_planar(m: nc.Mechanism) -> nc.Motion:
    system = assemble(m)
    q = system.parameters.points.reshape(-1)
    zero = np.zeros(())
    return nc.Motion(system, (), (), q, (), np.zeros(0), np.zeros((), int), zero, zero)


def test_files_are_the_same_bytes_each_time(turning, tmp_path):
    for name in ("a.svg", "a.pdf"):
        first, second = tmp_path / name, tmp_path / f"b{name}"
        viz.draw(turning, path=first)
        viz.draw(turning, path=second)
        assert first.read_bytes() == second.read_bytes()


def test_a_gif_moves(turning, failing, tmp_path):
    path = viz.animate(turning, tmp_path / "a.gif", frames=5, trace="P3", size=(3, 2.5), dpi=60)
    with Image.open(path) as image:
        frames = [np.asarray(f.convert("RGB")) for f in ImageSequence.Iterator(image)]
    assert len(frames) == 5 and (frames[0][0, 0] == 255).all()
    for before, after in itertools.pairwise(frames):
        assert 0.002 < np.mean(np.any(before != after, axis=-1)) < 0.5
    viz.animate(failing, path, frames=[3, 4], size=(4, 3), dpi=80, view=(20, -70))
    with Image.open(path) as image:
        frames = [np.asarray(f.convert("RGB")).astype(int) for f in ImageSequence.Iterator(image)]
    below = [f[len(f) // 3 :] for f in frames]  # the message
    orange = [int(np.sum(f[..., 0] - f[..., 2] > 90)) for f in below]  # the coupler, unless it is a ghost
    assert orange[1] < 0.1 * orange[0] and orange[0] > 50


def test_frames_drawn_over_the_axes_equal_frames_drawn_whole(turning):
    from jaxnc.viz.animation import Film

    film = Film(poses(turning), ("P3",), ("P3",), (), True, None, True, (3.0, 2.5), 60)
    quick = film.frame(7).copy()
    for artist in film.moving:
        artist.set_animated(False)
    film.canvas.draw()
    whole = np.asarray(film.canvas.buffer_rgba())
    assert np.mean(np.any(np.abs(quick.astype(int) - whole) > 16, axis=-1)) < 2e-3


# ---------------------------------------------------------------------------------------------------------------
# plots and pages


def test_curves_have_three_components(turning):
    figure = viz.plot(turning, "P3", "v1", "velocity P3", "angular velocity rocker", "P3.z")
    drawn_lines = {a.get_gid(): np.asarray(a.get_xydata()) for ax in figure.axes for a in ax.lines if a.get_gid()}
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(drawn_lines[f"P3.{axis}"][:, 1], places(turning, "P3")[:, k], atol=DRAWN)
        np.testing.assert_allclose(drawn_lines[f"v1.{axis}"][:, 1], places(turning, "v1")[:, k], atol=DRAWN)
        spin = np.degrees(np.asarray(turning.angular_velocity("rocker")))[:, k]
        np.testing.assert_allclose(drawn_lines[f"angular velocity rocker.{axis}"][:, 1], spin, atol=1e-9)
    speed = np.linalg.norm(np.asarray(turning.velocity("P3")), axis=1)
    np.testing.assert_allclose(drawn_lines["|velocity P3|"][:, 1], speed, rtol=1e-9)
    labels = [ax.get_ylabel() for ax in figure.axes]
    expected = ["length [mm]", "direction", "velocity [mm/s]", "angular velocity [°/s]", "P3.z [mm]"]
    assert labels == expected  # the height has a scale of its own: it changes little
    with pytest.raises(InputError, match=r"'rocker'.*matrix.*angular velocity"):
        viz.plot(turning, "orientation rocker")
    with pytest.raises(InputError, match=r"one number.*'P3.x'.*'P3.z'"):
        viz.plot(turning, "P2", against="P3")
    with pytest.raises(InputError, match=r"no quantity 'P3\.w'"):
        viz.plot(turning, "P3.w")


def read(path) -> dict:
    text = path.read_text(encoding="utf-8")
    return json.loads(text.split('id="data">')[1].split("</script>")[0])


def test_a_page_holds_every_pose_and_needs_nothing_else(turning, tmp_path):
    path = viz.to_html(turning, tmp_path / "a.html", trace="P3", velocities="P3", view=(30, -45))
    data = read(path)
    assert (data["dim"], data["poses"], data["closed"], data["view"]) == (3, 13, True, [30, -45])
    for point in (*data["points"], *data["directions"]):
        x = np.stack([unpacked(point[axis], 13) for axis in "xyz"], axis=1)
        np.testing.assert_allclose(x, places(turning, point["name"]), rtol=0, atol=QUANTUM)
    assert [p["name"] for p in data["points"]] == ["A", "B", "P1", "P2", "P3", "G"]
    assert [v["name"] for v in data["directions"]] == ["vA", "vB", "v1"]
    assert data["traces"] == [4] and len(data["tips"]) == 1
    assert {item["role"] for item in data["items"]} <= set(data["styles"])
    assert max(item["mesh"] for item in data["items"] if item["shape"] == "solid") == len(data["meshes"]) - 1
    text = path.read_text(encoding="utf-8")
    assert (
        "http://" not in text.replace("http://www.w3.org/2000/svg", "")
        and "https://" not in text
        and " src=" not in text
        and "{{" not in text
    )
    assert "default-src 'none'" in text and text.count("</script>") == 2


def test_the_page_of_a_suspension_plots_what_its_report_tells(tmp_path):
    m = nc.library.double_wishbone()
    height = {"wheel_centre.z": np.linspace(230.0, 390.0, 13)}
    motion = nc.sweep(m.compile(), height, hold=["tie_inner.y", "rim.x"])
    data, report = read(motion.to_html(tmp_path / "a.html")), suspension_report(motion)
    assert (data["first"], data["over"]) == (len(data["scalars"]), "wheel_centre.z")
    shown = {row["symbol"]: row for row in data["series"]}
    for name in ("camber", "toe", "caster", "kingpin_inclination", "scrub_radius", "track", "roll_centre_height"):
        row = report[name]
        assert shown[row.label]["unit"] == {"deg": "°", "mm": "mm"}[row.unit]
        x = report.curves[name]
        np.testing.assert_allclose(unpacked(shown[row.label]["values"], 13), x, rtol=0, atol=1e-6 * np.abs(x).max())
    ax, *_ = motion.plot("camber").axes
    assert ax.get_ylabel() == "camber [°]"
    np.testing.assert_allclose(ax.lines[0].get_ydata(), report.curves["camber"], rtol=1e-12)
    five = nc.sweep(nc.library.five_link().compile(), height, hold=["tie_inner.y", "rim.x"])
    ax, *_ = five.plot("caster").axes
    want = np.degrees(nc.suspension(five, steer="tie_inner.y", carrier="knuckle").caster)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), want, rtol=1e-12)


def test_a_page_knows_failed_poses(failing, tmp_path):
    data = read(viz.to_html(failing, tmp_path / "a.html"))
    assert data["status"] == np.asarray(failing.status).tolist()
    q = failing.q.at[1].set(jnp.nan)
    data = read(viz.to_html(dataclasses.replace(failing, poses=q), tmp_path / "b.html"))
    assert data["status"][1] != 0 and np.isnan(unpacked(data["points"][2]["z"], data["poses"])[1])
    viz.draw(dataclasses.replace(failing, poses=q), pose=1).canvas.draw()


def test_names_cannot_break_out(tmp_path):
    nasty = 'a</script><script>alert("x")</script> & \u2028 $x_1$ {{DATA}}'
    motion = still(mechanism(nasty))
    text = viz.to_html(motion, tmp_path / "a.html").read_text(encoding="utf-8")
    assert text.count("</script>") == 2
    assert read(tmp_path / "a.html")["title"] == nasty
    viz.draw(motion, path=tmp_path / "a.svg")  # nor into mathematics


def test_plates_without_area_and_single_points_are_drawn(tmp_path):
    m = nc.Mechanism("few", dim=3)
    m.point("P", (0, 0, 0))
    motion = still(m)
    viz.draw(motion, path=tmp_path / "a.png", dpi=40)
    viz.to_html(motion, tmp_path / "a.html")
    assert not [item for item in drawn(motion).items if isinstance(item, Plate)]
