"""Pictures: the right things at the right places, failures never drawn as if right, files that say what is in them."""

import dataclasses
import html.parser
import itertools
import json
import shutil
import subprocess
import sys

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from pages import unpacked
from PIL import Image, ImageSequence

import jaxnc as nc
from jaxnc import viz
from jaxnc.errors import InputError, OutputError
from jaxnc.system.assemble import assemble
from jaxnc.viz.annotations import TEXT, nice
from jaxnc.viz.poses import poses
from jaxnc.viz.quantities import abscissa, quantity
from jaxnc.viz.scene import Casing

NASTY = 'a</script><script>alert("x")</script> & \u2028 $x_1$ {{DATA}}'
DRAWN = 1e-12  # of the size: artists take their coordinates from the motion unchanged
QUANTUM = 1e-6  # of what pages are drawn from: a ten millionth of ten times the size, or less


def mechanism(name: str = "four-bar") -> nc.Mechanism:
    m = nc.Mechanism(name, length_unit="mm", angle_unit="deg")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0, 1))
    m.point("C", (3.3, 2.9))
    m.point("P", (1.8, 3.6))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C", "P"])
    m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="D", to="C")
    m.marker("E", on="coupler", at=(2.0, 2.2))
    return m


@pytest.fixture(scope="module")
def system():
    return mechanism().compile()


@pytest.fixture(scope="module")
def turning(system):
    """One turn of the crank, with rates."""
    return nc.sweep(system, {"phi": np.linspace(0.5 * np.pi, 2.5 * np.pi, 25)}, rates={"phi": 3.0})


@pytest.fixture(scope="module")
def stopped(system):
    """The same mechanism, not Grashof: the crank does not get all the way round."""
    short = system.replace(C=(1.0, 1.3), D=(2.5, 0.0))
    found = nc.sweep(short, {"phi": np.linspace(0.5 * np.pi, -1.5 * np.pi, 25)}, rates={"phi": -3.0})
    assert 5 < int(found.failures) < 20
    return found


def one(motion: nc.Motion, k: int) -> nc.Motion:
    """A single pose of a sequence."""
    parts = {n: getattr(motion, n)[k] for n in ("poses", "status", "residual", "conditioning")}
    return dataclasses.replace(motion, rates=tuple(r[k] for r in motion.rates), **parts)


def still(m: nc.Mechanism) -> nc.Motion:
    """A mechanism as drawn, as one pose; nothing is solved."""
    system = assemble(m)
    q = jnp.concatenate([system.parameters.points.reshape(-1), jnp.zeros(len(system.topology.scalars))])
    zero = jnp.zeros(())
    return nc.Motion(system, (), (), q, (), jnp.zeros(0), jnp.zeros((), int), zero, zero)


def artists(figure: Figure, role: str) -> list:
    return [a for ax in figure.axes for a in ax.get_children() if a.get_gid() == role]


def places(motion: nc.Motion, name: str) -> np.ndarray:
    return np.asarray(motion[name])


def marker(b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Where the marker E is, from its coupler's joints, in complex numbers."""
    share = (2.0 + 2.2j - 1j) / (3.3 + 2.9j - 1j)
    z = complex(*b) + share * (complex(*c) - complex(*b))
    return np.array([z.real, z.imag])


def only(items: list):
    assert len(items) == 1, items
    return items[0]


# ---------------------------------------------------------------------------------------------------------------
# drawings


def test_bars_plates_and_pins_are_where_the_points_are(turning):
    k = 7
    figure = viz.draw(turning, pose=k)
    at = {name: places(turning, name)[k] for name in "ABCDP"}
    ends = [np.asarray(line.get_xydata()) for line in artists(figure, "bar")]
    np.testing.assert_allclose(ends[0], [at["C"], at["D"]], atol=DRAWN)  # the longer one lies under the shorter one
    np.testing.assert_allclose(ends[1], [at["A"], at["B"]], atol=DRAWN)
    plate = only(artists(figure, "plate")).get_xy()
    assert {tuple(np.round(v, 9)) for v in plate} == {tuple(np.round(at[n], 9)) for n in "BCP"}
    pins = sorted(tuple(p.get_center()) for p in artists(figure, "pin"))
    np.testing.assert_allclose(pins, sorted(map(tuple, (at["B"], at["C"]))), atol=DRAWN)
    grounded = sorted(tuple(p.get_center()) for p in artists(figure, "ground pin"))
    np.testing.assert_allclose(grounded, [at["A"], at["D"]], atol=DRAWN)
    assert len(artists(figure, "support")) == 2
    np.testing.assert_allclose(only(artists(figure, "dot")).get_center(), at["P"], atol=DRAWN)
    cross = np.mean([line.get_xydata() for line in artists(figure, "marker")], axis=(0, 1))
    np.testing.assert_allclose(cross, marker(at["B"], at["C"]), atol=1e-9)
    assert [t.get_text() for t in artists(figure, "input")] == ["φ"]


def test_bodies_have_colours_of_their_own(turning):
    figure = viz.draw(turning)
    colours = {line.get_color() for line in artists(figure, "bar")}
    assert len(colours) == 2
    assert matplotlib.colors.to_hex(only(artists(figure, "plate")).get_edgecolor()) not in colours


def test_axes_are_equal_carry_the_unit_and_hold_the_trace(turning):
    figure = viz.draw(turning, trace="P")
    ax = only(figure.axes)
    assert ax.get_aspect() == 1.0
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_title(loc="left")) == ("x [mm]", "y [mm]", "four-bar")
    path = np.asarray(only(artists(figure, "trace P")).get_xydata())
    at = poses(turning).path(poses(turning).names.index("P"))[1]
    np.testing.assert_allclose(path[at], places(turning, "P"), atol=DRAWN)
    for low, high, x in zip(*np.transpose([ax.get_xlim(), ax.get_ylim()]), path.T, strict=True):
        assert low < x.min() and x.max() < high


def test_labels_keep_clear_of_joints_and_of_each_other(turning):
    figure = viz.draw(turning, pose=3)
    texts = artists(figure, "label")
    assert sorted(t.get_text() for t in texts) == list("ABCDEP")
    unit = artists(figure, "pin")[0].radius
    centres = np.array([t.get_position() for t in texts])
    joints = np.array([places(turning, n)[3] for n in "ABCD"])
    gaps = np.linalg.norm(centres[:, None] - joints[None], axis=-1)
    assert gaps.min() > (1.0 + 0.5 * TEXT) * unit
    between = np.linalg.norm(centres[:, None] - centres[None], axis=-1)[np.triu_indices(len(texts), 1)]
    assert between.min() > TEXT * unit
    assert artists(viz.draw(turning, labels=False), "label") == []


def test_a_slider_rides_on_a_hatched_guide():
    m = nc.Mechanism("slider-crank")
    m.ground("O", (0, 0))
    m.point("A", (0.3, 0.5))
    m.point("S", (1.6, 0.1), fixed="y")
    m.body("crank", ["O", "A"])
    m.body("rod", ["A", "S"])
    figure = viz.draw(still(m))
    block = np.asarray(only(artists(figure, "block")).get_xy())[:-1]
    np.testing.assert_allclose(block.mean(axis=0), (1.6, 0.1), atol=1e-12)
    edge = max((np.asarray(line.get_xydata()) for line in artists(figure, "guide")), key=lambda x: np.ptp(x[:, 0]))
    np.testing.assert_allclose(edge[:, 1], block[:, 1].min(), atol=1e-12)  # the block stands on it
    assert edge[0, 0] < block[:, 0].min() and block[:, 0].max() < edge[1, 0]
    assert (1.6, 0.1) in [pytest.approx(p.get_center()) for p in artists(figure, "pin")]
    assert len(artists(figure, "hatch")) == 2  # of the guide and of the ground pivot


@pytest.mark.parametrize("block", [False, True])
def test_a_pin_in_a_moving_slot(block):
    m = nc.Mechanism("quick return")
    m.ground("O", (0, 0))
    m.ground("Q", (0, -2))
    m.point("A", (0.6, 0.4))
    m.point("C", (0.9, 1.6))
    m.body("crank", ["O", "A"])
    m.body("rocker", ["Q", "C"])
    if block:
        m.body("block", ["A"])
    m.slot("pin", "A", ("Q", "C"))
    figure = viz.draw(still(m))
    if not block:
        channel = np.asarray(only(artists(figure, "channel")).get_xydata())
        across = np.array([1.6 + 2.0, -0.9]) / np.hypot(3.6, 0.9)  # normal of the line Q-C
        np.testing.assert_allclose((channel - (0, -2)) @ across, 0.0, atol=1e-12)
        return
    edges = np.diff(np.asarray(only(artists(figure, "block")).get_xy()), axis=0)
    along = edges[np.argmax(np.linalg.norm(edges, axis=1))]
    np.testing.assert_allclose(np.abs(along[1] / along[0]), 3.6 / 0.9, rtol=1e-9)  # turned along its line


def test_gears_are_pitch_circles_and_discs_touch_their_line():
    m = nc.Mechanism("gears")
    m.ground("A", (0, 0))
    m.ground("B", (3, 0))
    m.point("P", (0.8, 0.6))
    m.point("Q", (1.8, 1.6))
    m.body("pinion", ["A", "P"])
    m.body("wheel", ["B", "Q"])
    m.angle("phi", at="A", to="P")
    m.angle("psi", at="B", to="Q")
    m.gear("mesh", "phi", "psi", radii=(1.0, 2.0))
    wheels = [(*w.center, w.radius) for w in artists(viz.draw(still(m)), "wheel")]
    np.testing.assert_allclose(wheels, [(0, 0, 1), (3, 0, 2)], atol=1e-12)

    m = nc.Mechanism("disc")
    m.ground("A", (0, 0))
    m.ground("B", (6, 0))
    m.point("C", (1, 0.8))
    m.point("K", (1, 0))
    m.point("R", (1.8, 0.8))
    m.body("disc", ["C", "R"])
    m.rolling("roll", centre="C", rim="R", contact="K", line=("A", "B"), angle="phi", distance="s")
    figure = viz.draw(still(m))
    disc = only(artists(figure, "disc"))
    np.testing.assert_allclose((*disc.center, disc.radius), (1, 0.8, 0.8), atol=1e-12)
    strokes = np.concatenate([h.get_segments() for h in artists(figure, "hatch")])
    assert strokes[..., 1].max() <= 1e-12  # below the line: the disc is above


def test_arrows_are_velocities_to_the_scale_of_their_key(turning):
    k = 4
    figure = viz.draw(turning, pose=k, velocities=["B", "P"], accelerations="P")
    quiver = only(artists(figure, "velocity"))
    drawn = np.stack([quiver.U, quiver.V], axis=1)
    true = np.stack([np.asarray(turning.velocity(n))[k] for n in "BP"])
    factor = drawn[0, 0] / true[0, 0]
    np.testing.assert_allclose(drawn, factor * true, rtol=1e-9)
    np.testing.assert_allclose(quiver.get_offsets(), [places(turning, n)[k] for n in "BP"], atol=DRAWN)
    keys = [a for a in figure.axes[0].get_children() if type(a).__name__ == "QuiverKey"]
    key = next(a for a in keys if a.label.startswith("velocity"))
    value, unit = key.label.split()[1:]
    assert unit == "mm/s"
    np.testing.assert_allclose(key.U, float(value) * factor, rtol=1e-9)
    assert [nice(x) for x in (0.7, 1.0, 4.99, 50.0, 1.3e-5)] == [0.5, 1.0, 2.0, 50.0, 1e-5]


def test_a_failed_pose_is_a_ghost_that_says_why(stopped):
    bad = int(np.flatnonzero(np.asarray(stopped.status))[0])
    figure = viz.draw(stopped, pose=bad, trace="C", velocities="C")
    banner = only(artists(figure, "failure"))
    assert banner.get_visible() and f"Pose {bad} failed" in banner.get_text() and "singular" in banner.get_text()
    assert all(line.get_alpha() < 0.2 for line in artists(figure, "bar"))
    assert not only(artists(figure, "velocity")).get_visible()
    path = np.asarray(only(artists(figure, "trace C")).get_xydata())
    at = poses(stopped).path(poses(stopped).names.index("C"))[1]
    np.testing.assert_array_equal(np.isnan(path).all(axis=1)[at], ~np.asarray(stopped.converged))
    assert np.isnan(path).all(axis=1).sum() == np.sum(~np.asarray(stopped.converged))
    right = viz.draw(stopped, pose=0)
    assert not only(artists(right, "failure")).get_visible()
    assert all(line.get_alpha() is None for line in artists(right, "bar"))


def test_bars_are_kept_apart_where_they_cross_and_nowhere_else():
    crossing, shared = Casing("casing", (0, 1), ((2, 3),)), Casing("casing", (0, 1), ((1, 2),))
    x = np.array([[0.0, 0.0], [10.0, 0.0], [4.0, -5.0], [4.0, 5.0]])
    np.testing.assert_allclose(crossing.strokes(x, 0.5), [[[3.45, 0.0], [4.55, 0.0]]], atol=1e-12)
    x[2:, 0] = [0.0, 8.0]  # aslant: sine of the angle 10 / sqrt(164)
    half = 0.55 * np.sqrt(164.0) / 10.0
    np.testing.assert_allclose(crossing.strokes(x, 0.5), [[[4.0 - half, 0.0], [4.0 + half, 0.0]]], atol=1e-12)
    assert len(shared.strokes(x, 0.5)) == 0  # they meet at a joint
    x[2:] = [[0.5, -5.0], [0.5, 5.0]]
    assert len(crossing.strokes(x, 0.5)) == 0  # too near to a joint of the one
    x[2:] = [[4.0, 1.0], [4.0, 5.0]]
    assert len(crossing.strokes(x, 0.5)) == 0  # they do not reach each other
    x[2:] = [[-1.0, -0.3], [11.0, 0.3]]
    assert len(crossing.strokes(x, 0.5)) == 0  # they lie rather than cross
    leg = nc.library.jansen_leg().compile()
    figure = viz.draw(nc.sweep(leg, {"phi": np.linspace(0.0, 2 * np.pi, 9)}), pose=1)
    lengths = [np.hypot(*np.diff(np.asarray(line.get_xydata()), axis=0).sum(axis=0)) for line in artists(figure, "bar")]
    assert lengths == sorted(lengths, reverse=True)  # the crank on top


def test_springs_dampers_torques_and_centres_of_mass_are_drawn(tmp_path):
    m = nc.Mechanism("rig")
    a, d, e = m.ground("A", (0, 0)), m.ground("D", (1, 0)), m.ground("E", (1.4, 0.9))
    b, c = m.point("B", (0.2, 0.4)), m.point("C", (0.9, 0.7))
    for name, points in (("crank", [a, b]), ("coupler", [b, c]), ("rocker", [c, d])):
        m.body(name, points)
    m.angle("phi", at=a, to=b)
    m.angle("psi", at=d, to=c)
    m.spring("s", c, e, stiffness=100.0)
    m.damper("t", c, e, damping=3.0)
    m.spring("u", "psi", stiffness=3.0)
    m.torque("effort on phi", "phi", 2.0)
    m.mass("coupler", 3.0)
    m.gravity = (0.0, -9.81)
    motion = nc.sweep(m.compile(), {"phi": np.array([1.0, 1.2])}, rates={"phi": 1.0})
    figure = viz.draw(motion, pose=1, forces="weight")
    at = {name: places(motion, name)[1] for name in "ABCDE"}
    coil, spiral = sorted((np.asarray(x.get_xydata()) for x in artists(figure, "spring")), key=len)
    np.testing.assert_allclose(coil[[-1, 0]], [at["C"], at["E"]], atol=DRAWN)
    assert np.hypot(*(spiral - at["D"]).T).max() < 0.12  # round its joint
    dashpot = np.concatenate([np.asarray(x.get_xydata()) for x in artists(figure, "dashpot")])
    assert {tuple(p) for p in np.round(dashpot, 9)} >= {tuple(np.round(at[n], 9)) for n in "CE"}
    assert len(artists(figure, "torque")) == len(artists(figure, "torque head")) == 1
    disc, full = artists(figure, "centre of mass")
    np.testing.assert_allclose(disc.get_offsets(), [0.5 * (at["B"] + at["C"])], atol=1e-12)
    np.testing.assert_allclose(full.get_offsets(), disc.get_offsets(), atol=DRAWN)
    (weight,) = artists(figure, "weight")
    np.testing.assert_allclose(weight.get_offsets(), disc.get_offsets(), atol=DRAWN)
    assert weight.U[0] == pytest.approx(0.0, abs=1e-12) and weight.V[0] < 0  # straight down
    spans = [x for x in read(viz.to_html(motion, tmp_path / "a.html"))[1]["items"] if "ends" in x]
    assert {"spring", "dashpot"} <= {x["role"] for x in spans} and {x["shape"] for x in spans} == {"stamp"}


def test_a_stop_on_an_angle_is_drawn_about_its_vertex():
    m = nc.Mechanism("flap")
    m.ground("A", (0, 0)), m.point("B", (1, 0.4)), m.body("flap", ["A", "B"]), m.angle("phi", at="A", to="B")
    m.stop("end", "phi", stiffness=5.0, lower=0.0, upper=1.0)
    figure = viz.draw(nc.sweep(m.compile(), {"phi": np.array([0.3, 0.5])}), pose=1)
    x = np.concatenate([np.asarray(line.get_xydata()) for line in artists(figure, "dashpot")])
    assert len(x) > 20 and np.hypot(*x.T).max() < 0.15  # of a bar of length 1.08


def test_a_pin_of_the_ground_in_a_moving_slot_stands_on_the_ground():
    m = nc.Mechanism("oscillating cylinder")
    m.ground("A", (0, 0)), m.ground("D", (3, 0)), m.point("B", (0.6, 0.8)), m.point("P", (4.2, -0.4))
    m.body("crank", ["A", "B"]), m.body("rod", ["B", "P"]), m.angle("phi", at="A", to="B")
    m.slot("cylinder", "D", line=("B", "P"))
    figure = viz.draw(nc.sweep(m.compile(), {"phi": np.linspace(0.93, 1.5, 3)}), pose=1)
    found = sorted(tuple(p.get_center()) for p in artists(figure, "ground pin"))
    np.testing.assert_allclose(found, [(0, 0), (3, 0)], atol=DRAWN)
    assert len(artists(figure, "support")) == 2


def test_one_pose_can_be_drawn_a_batch_cannot(turning, system):
    figure = viz.draw(one(turning, 3))
    np.testing.assert_allclose(artists(figure, "bar")[1].get_xydata()[1], places(turning, "B")[3], atol=DRAWN)
    batch = dataclasses.replace(turning, poses=turning.q[None], status=turning.status[None])
    with pytest.raises(InputError, match=r"'four-bar'.*\(1, 25\).*motion\.pose\(0\)"):
        viz.draw(batch)
    designs = jax.tree.map(lambda x: x[None], turning)
    with pytest.raises(InputError, match=r"designs.*jax\.tree\.map"):
        viz.plot(designs, "P")
    with pytest.raises(InputError, match="poses 0 to 24"):
        viz.draw(turning, pose=25)
    with pytest.raises(InputError, match=r"trace: .*no point or marker 'Q'"):
        viz.draw(turning, trace="Q")
    with pytest.raises(InputError, match=r"rates=\{'phi'"):
        viz.draw(dataclasses.replace(turning, rates=()), velocities="P")
    with pytest.raises(InputError, match="draw it outside"):
        jax.jit(lambda x: len(viz.draw(dataclasses.replace(turning, poses=x)).axes))(turning.q)


def test_drawing_into_axes_of_the_user(turning):
    figure = Figure(figsize=(6, 3))
    left, right = figure.subplots(1, 2)
    assert viz.draw(turning, ax=right, title="here") is figure
    assert left.get_title(loc="left") == "" and right.get_title(loc="left") == "here"


# ---------------------------------------------------------------------------------------------------------------
# plots


def lines(figure: Figure) -> dict[str, np.ndarray]:
    return {a.get_gid(): np.asarray(a.get_xydata()) for ax in figure.axes for a in ax.lines if a.get_gid()}


def test_curves_have_the_values_and_units_of_the_motion(turning):
    names = ("P", "P.x", "psi", "velocity P", "acceleration psi", "angular velocity coupler")
    figure = viz.plot(turning, *names)
    drawn = lines(figure)
    np.testing.assert_allclose(drawn["path P"], places(turning, "P"), atol=DRAWN)
    degrees = np.degrees(places(turning, "phi"))
    np.testing.assert_allclose(drawn["P.x"], np.stack([degrees, places(turning, "P.x")], axis=1), rtol=1e-12)
    np.testing.assert_allclose(drawn["psi"][:, 1], np.degrees(places(turning, "psi")), rtol=1e-12)
    np.testing.assert_allclose(drawn["velocity P.y"][:, 1], np.asarray(turning.velocity("P"))[:, 1], rtol=1e-12)
    np.testing.assert_allclose(drawn["|velocity P|"][:, 1], np.hypot(*np.asarray(turning.velocity("P")).T))
    spin = np.degrees(np.asarray(turning.angular_velocity("coupler")))
    np.testing.assert_allclose(drawn["angular velocity coupler"][:, 1], spin, rtol=1e-12)
    labels = ["y [mm]", "P.x [mm]", "ψ [°]", "velocity [mm/s]", "acceleration of ψ [°/s²]"]
    assert [ax.get_ylabel() for ax in figure.axes] == [*labels, "angular velocity of coupler [°/s]"]
    assert figure.axes[-1].get_xlabel() == "φ [°]"
    assert figure.axes[0].get_aspect() == 1.0


def on_axes(figure: Figure) -> list[list[str]]:
    """Names of the curves of each axes."""
    return [[line.get_gid() for line in ax.lines if line.get_gid()] for ax in figure.axes]


def test_curves_that_would_look_flat_have_axes_of_their_own():
    system = nc.library.four_bar(coupler_point=(0.07, 0.05)).compile()
    m = nc.sweep(system, {"phi": np.linspace(0.0, 2 * np.pi, 25)}, rates={"phi": 1.0})
    q = np.array(m.q)
    column = system.topology.position["P.y"]
    q[:, column] = 7.0 + 1e-3 * np.sin(q[:, system.topology.position["phi"]])  # far away, and nearly constant
    high = dataclasses.replace(m, poses=jnp.asarray(q))
    assert on_axes(viz.plot(m, "P.x", "P.y")) == [["P.x", "P.y"]]
    figure = viz.plot(high, "P.y", "P.x", "C.x")
    assert on_axes(figure) == [["P.y"], ["P.x", "C.x"]]
    assert [ax.get_ylabel() for ax in figure.axes] == ["P.y [m]", "length [m]"]
    low, high_ = figure.axes[0].get_ylim()
    assert high_ - low < 3e-3
    q[:, column] = 0.05  # a straight line between the others hides nothing
    assert on_axes(viz.plot(dataclasses.replace(m, poses=jnp.asarray(q)), "P.y", "P.x")) == [["P.y", "P.x"]]
    q[:, column] = 7.0
    assert on_axes(viz.plot(dataclasses.replace(m, poses=jnp.asarray(q)), "P.y", "P.x")) == [["P.y"], ["P.x"]]
    q[:] = q[:1]  # where nothing moves nothing is hidden either
    assert on_axes(viz.plot(dataclasses.replace(m, poses=jnp.asarray(q)), "P.y", "P.x", against="pose")) == [
        ["P.y", "P.x"]
    ]


def test_a_list_says_which_curves_share_axes(turning):
    assert on_axes(viz.plot(turning, ["P.x"], ["P.y"], "psi")) == [["P.x"], ["P.y"], ["psi"]]
    assert on_axes(viz.plot(turning, ["P.x", "B.y"], "P.x")) == [["P.x", "B.y"], ["P.x"]]
    mixed = viz.plot(turning, ("psi", "orientation coupler"))
    assert on_axes(mixed) == [["psi", "orientation coupler"]] and mixed.axes[0].get_ylabel() == "angle [°]"
    paths = viz.plot(turning, ["P", "C"], ["B"], "psi")
    assert on_axes(paths)[:2] == [["path P", "start P", "path C", "start C"], ["path B", "start B"]]
    assert [ax.get_aspect() for ax in paths.axes] == [1.0, 1.0, "auto"]
    assert on_axes(viz.plot(turning, "P.x", "P.x")) == [["P.x"]]  # named twice, drawn once
    with pytest.raises(InputError, match=r"'P.x' \(length.*'velocity P' \(velocity"):
        viz.plot(turning, ["P.x", "velocity P"])
    with pytest.raises(InputError, match=r"'P' .*'P.x' .*cannot share axes"):
        viz.plot(turning, ["P", "P.x"])
    with pytest.raises(InputError, match=r"list .* is empty; name one"):
        viz.plot(turning, [])


def test_every_curve_has_a_name_and_a_look_of_its_own(turning):
    figure = viz.plot(turning, ["velocity P", "velocity C", "velocity B"])
    (ax,) = figure.axes
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    ends = ("x", "y", "magnitude")
    assert names == [f"velocity of {point}, {end}" for point in "PCB" for end in ends]
    looks = {(line.get_color(), str(line._unscaled_dash_pattern), line.get_linewidth()) for line in ax.lines}
    assert len(looks) == len(ax.lines) == 9


def test_failed_poses_are_gaps_and_shaded(stopped):
    wrong = ~np.asarray(stopped.converged)
    figure = viz.plot(stopped, "C", "psi", "velocity C")
    drawn = lines(figure)
    for name in ("psi", "velocity C.x"):
        np.testing.assert_array_equal(np.isnan(drawn[name][:, 1]), wrong)
    np.testing.assert_array_equal(np.isnan(drawn["path C"]).all(axis=1), wrong)
    asked = np.degrees(np.linspace(0.5 * np.pi, -1.5 * np.pi, 25))
    np.testing.assert_allclose(drawn["psi"][:, 0], asked, rtol=1e-9)  # the inputs asked for
    shaded = [p for p in figure.axes[1].patches if p.get_gid() == "failure"]
    for x in asked[wrong]:
        assert any(p.get_x() - 1e-9 < x < p.get_x() + p.get_width() + 1e-9 for p in shaded)
    assert not any(p.get_x() < x < p.get_x() + p.get_width() for p in shaded for x in asked[~wrong])
    assert only(artists(figure, "failure")[:1]).get_text() == f"{wrong.sum()} of 25 poses failed"


def test_what_curves_are_drawn_over(turning):
    data = poses(turning)
    assert abscissa(data, None).name == "phi"
    assert abscissa(data, "pose").values[-1] == 24
    timed = dataclasses.replace(turning, time=jnp.linspace(0.0, 2.0, 25))
    assert abscissa(poses(timed), None).unit == "s"
    assert viz.plot(timed, "psi").axes[0].get_xlabel() == "time [s]"
    np.testing.assert_allclose(quantity(poses(timed), "time").values, np.linspace(0.0, 2.0, 25))
    with pytest.raises(InputError, match=r"give one number, 'P.x' or 'P.y'"):
        viz.plot(turning, "psi", against="P")
    with pytest.raises(InputError, match=r"'velocity Pq'.*did you mean 'P'"):
        viz.plot(turning, "velocity Pq")
    with pytest.raises(InputError, match=r"no jerk; .*jerk=True"):
        viz.plot(turning, "jerk P")
    with pytest.raises(InputError, match=r"use draw\(\)"):
        viz.plot(one(turning, 0), "P")
    assert [ax.get_ylabel() for ax in viz.plot(turning).axes] == ["ψ [°]"]


# ---------------------------------------------------------------------------------------------------------------
# files


def test_pictures_are_the_same_bytes_each_time(turning, tmp_path):
    first, second = tmp_path / "a.svg", tmp_path / "b.svg"
    viz.draw(turning, path=first)
    viz.draw(turning, path=second)
    assert first.read_bytes() == second.read_bytes()
    viz.plot(turning, "P", path=tmp_path / "deep" / "p.png", dpi=40)
    with Image.open(tmp_path / "deep" / "p.png") as image:
        assert image.width == 256


def test_a_gif_has_its_frames_and_they_move(turning, stopped, tmp_path):
    path = viz.animate(turning, tmp_path / "a.gif", frames=6, trace="P", size=(3, 2.5), dpi=60)
    assert path == tmp_path / "a.gif"
    with Image.open(path) as image:
        frames = [np.asarray(f.convert("RGB")) for f in ImageSequence.Iterator(image)]
        assert image.info["duration"] == 40
    assert len(frames) == 6
    for before, after in itertools.pairwise(frames):
        assert 0.002 < np.mean(np.any(before != after, axis=-1)) < 0.5
    assert (frames[0][0, 0] == 255).all()  # white paper
    viz.animate(turning, path, size=(3, 2.5), dpi=40, labels=False)  # all poses; the last is the first again
    with Image.open(path) as image:
        assert image.n_frames == 24
    viz.animate(stopped, path, frames=[0, 24, 3, 24], size=(3, 2.5), dpi=60)
    with Image.open(path) as image:
        frames = [np.asarray(f.convert("RGB")).astype(int) for f in ImageSequence.Iterator(image)]
    assert len(frames) == 4
    blue = [int(np.sum(f[..., 2] - f[..., 0] > 80)) for f in frames]  # the crank, unless it is a ghost
    assert blue[1] < 0.05 * blue[0] and blue[2] > 0.5 * blue[0]


@pytest.mark.parametrize(("lasts", "fps"), [(1.2, 240), (1.01, 60), (12.0, 30), (0.12, 30)])
def test_a_film_of_a_motion_in_time_is_in_real_time(turning, tmp_path, lasts, fps):
    """Or slower by a power of ten: by the pauses that a reader of GIF finds."""
    wanted = lasts * (10.0 if lasts < 1.0 else 1.0)
    for motion, last in ((turning, 0.0), (turning.pose(slice(13)), max(1.0 / min(fps, 50), wanted / 239))):
        times = np.linspace(0.0, lasts, len(motion.status))  # backwards where all poses are there
        timed = dataclasses.replace(motion, time=times if last else times[::-1])
        with Image.open(viz.animate(timed, tmp_path / "a.gif", fps=fps, size=(1, 1), dpi=20, labels=False)) as image:
            pauses = [f.info["duration"] for f in ImageSequence.Iterator(image)]
        assert 1e-3 * sum(pauses) == pytest.approx(wanted + last, abs=0.012) and min(pauses) >= 20


def test_frames_drawn_over_the_ground_equal_frames_drawn_whole(turning):
    from jaxnc.viz.animation import Film

    film = Film(poses(turning), ("P",), ("P",), (), True, None, True, (3.0, 2.5), 60)
    quick = film.frame(9).copy()
    for artist in film.moving:
        artist.set_animated(False)
    film.canvas.draw()
    whole = np.asarray(film.canvas.buffer_rgba())
    assert np.mean(np.any(np.abs(quick.astype(int) - whole) > 16, axis=-1)) < 1e-3


@pytest.mark.parametrize("make", [nc.library.four_bar, nc.library.whitworth])
def test_names_in_films_give_way_to_cranks(make):
    """How often the middle line of a bar runs through letters; and names stay beside their points."""
    from jaxnc.viz.animation import Film

    motion = nc.sweep(make().compile(), {"phi": np.linspace(0.0, 2 * np.pi, 145)})
    view = Film(poses(motion), (), (), (), True, None, True, (5.0, 4.0), 60).view
    half = 0.45 * view.unit * TEXT
    along, over, far = np.linspace(0.0, 1.0, 200)[:, None], np.zeros((2, 9)), []
    still = [(label.dx, label.dy) for label in view.scene.labels]
    for k in range(0, 144, 2):
        view.show(k)
        bars = [np.asarray(bar.get_xydata()) for bar in artists(view.figure, "bar")]
        bars = np.concatenate([a + along * (b - a) for x in bars for a, b in itertools.pairwise(x)])
        for n, (label, text) in enumerate(zip(view.scene.labels, artists(view.figure, "label"), strict=True)):
            point, spot = view.data.places[k, label.at], np.array(text.get_position())
            far.append(np.hypot(*(spot - point)) / view.unit)
            before = point + view.unit * np.array(still[n])  # one place for all poses, as pages have it
            over[:, n] += [np.any(np.abs(bars - x).max(axis=1) < half) for x in (spot, before)]
    moved, stood = over.max(axis=1) / 72
    assert moved < 0.05 and moved < 0.6 * stood and over[0].sum() <= min(5, 0.5 * over[1].sum())
    assert min(far) > 1.5 and max(far) < 8.0


@pytest.mark.parametrize(
    ("write", "name", "kinds"),
    [
        (lambda m, p: viz.draw(m, path=p), "a.bmp", ".png or .svg"),
        (lambda m, p: viz.plot(m, "P", path=p), "a", ".png or .svg"),
        (lambda m, p: viz.animate(m, p), "a.avi", ".gif"),
        (lambda m, p: viz.to_html(m, p), "a.txt", ".html"),
    ],
)
def test_unknown_suffixes_are_named(turning, tmp_path, write, name, kinds):
    with pytest.raises(OutputError) as caught:
        write(turning, tmp_path / name)
    assert str(tmp_path / name) in str(caught.value) and f"end it in {kinds}" in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.png", "a.html", "a.gif"])
def test_files_that_cannot_be_written(turning, tmp_path, name):
    (tmp_path / "taken").write_text("a file, not a folder")
    target = tmp_path / "taken" / name
    write = {"a.png": lambda p: viz.draw(turning, path=p), "a.html": lambda p: viz.to_html(turning, p)}
    with pytest.raises(OutputError) as caught:
        write.get(name, lambda p: viz.animate(turning, p, frames=2))(target)
    assert str(target) in str(caught.value) and "choose another folder" in str(caught.value)
    (tmp_path / "b.html").mkdir()
    with pytest.raises(OutputError, match="there is a folder of that name"):
        viz.to_html(turning, tmp_path / "b.html")


def test_animations_ask_for_frames_that_exist(turning, tmp_path):
    for bad, says in (({"frames": 0}, "frames=0"), ({"frames": [99]}, "0 to 24"), ({"fps": 0}, "fps=0")):
        with pytest.raises(InputError, match=says):
            viz.animate(turning, tmp_path / "a.gif", **bad)
    with pytest.raises(InputError, match="does not move"):
        viz.animate(one(turning, 0), tmp_path / "a.gif")


# ---------------------------------------------------------------------------------------------------------------
# pages


class Page(html.parser.HTMLParser):
    """Tags, the data and the heading of a page."""

    def __init__(self, text: str):
        super().__init__()
        self.tags, self.data, self.heading, self.open, self.scripts = [], "", "", [], 0
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.open.append((tag, dict(attributes)))
        self.scripts += tag == "script"

    def handle_endtag(self, tag):
        while self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, text):
        if self.open and self.open[-1][1].get("id") == "data":
            self.data += text
        if self.open and self.open[-1][0] == "h1":
            self.heading += text


def read(path) -> tuple[Page, dict]:
    page = Page(path.read_text(encoding="utf-8"))
    return page, json.loads(page.data)


def test_a_page_holds_every_pose_and_needs_nothing_else(turning, tmp_path):
    path = viz.to_html(turning, tmp_path / "new" / "a.html", trace="P", velocities="P")
    page, data = read(path)
    assert (data["poses"], data["closed"], data["traces"]) == (25, True, [4])
    for point in data["points"]:
        x = np.stack([unpacked(point[axis], 25) for axis in "xy"], axis=1)
        if point["name"] == "E":
            true = [marker(b, c) for b, c in zip(places(turning, "B"), places(turning, "C"), strict=True)]
        else:
            true = places(turning, point["name"])
        np.testing.assert_allclose(x, true, rtol=0, atol=QUANTUM)
    assert [p["name"] for p in data["points"]] == ["A", "D", "B", "C", "P", "E"]
    phi = next(s for s in data["scalars"] if s["name"] == "phi")
    assert (phi["angle"], phi["driven"], phi["symbol"], data["degrees"]) == (True, True, "φ", True)
    np.testing.assert_allclose(unpacked(phi["values"], 25), places(turning, "phi"), rtol=0, atol=1e-7)
    arrows = only(data["arrows"])
    foot, tip = only(arrows["shafts"])
    assert (arrows["order"], foot, tip) == (0, 4, 6)
    v = np.stack([unpacked(data["tips"][0][axis], 25) - unpacked(data["points"][4][axis], 25) for axis in "xy"], axis=1)
    true = np.asarray(turning.velocity("P"))
    np.testing.assert_allclose(v * (true[0, 0] / v[0, 0]), true, rtol=1e-4, atol=1e-6)
    assert {item["role"] for item in data["items"]} <= set(data["styles"])
    for tag, attributes in page.tags:
        assert tag not in {"link", "img", "iframe", "object"}
        assert not {"src", "href"} & set(attributes)
    text = path.read_text(encoding="utf-8")
    assert "http://" not in text.replace("http://www.w3.org/2000/svg", "") and "https://" not in text
    assert "default-src 'none'" in text and "{{" not in text.replace(page.data, "")


def test_names_cannot_break_out_of_a_page(tmp_path):
    motion = still(mechanism(NASTY))
    path = viz.to_html(motion, tmp_path / "a.html")
    page, data = read(path)
    assert page.scripts == 2  # the data and the program, none from the name
    assert page.heading == NASTY and data["title"] == NASTY
    text = path.read_text(encoding="utf-8")
    assert "alert(" not in text.replace("alert(&quot;x&quot;)", "").replace('alert(\\"x\\")', "")
    assert text.count("</script>") == 2 and "\u2028" not in page.data
    viz.draw(motion, path=tmp_path / "a.svg")  # nor into mathematics


def test_a_page_knows_failed_poses_and_gaps(stopped, tmp_path):
    _, data = read(viz.to_html(stopped, tmp_path / "a.html", trace=["C"], velocities="C"))
    status = np.asarray(stopped.status)
    assert data["status"] == status.tolist() and not data["closed"]
    for s in set(status.tolist()) - {0}:
        assert data["sentences"][str(s)] == nc.Status(s).sentence
    foot = data["points"][data["arrows"][0]["shafts"][0][0]]
    for axis in "xy":  # no arrow where a pose is not right
        at, end = (unpacked(x[axis], data["poses"]) for x in (foot, data["tips"][0]))
        assert np.isfinite(end[status == 0]).all() and not np.any(np.abs(end - at)[status != 0] > 0)
    q = stopped.q.at[1].set(jnp.nan)
    _, data = read(viz.to_html(dataclasses.replace(stopped, poses=q), tmp_path / "b.html"))
    assert data["status"][1] != 0 and np.isnan(unpacked(data["points"][2]["x"], data["poses"])[1])
    figure = viz.draw(dataclasses.replace(stopped, poses=q), pose=1)
    assert only(artists(figure, "failure")).get_visible()


@pytest.mark.skipif(shutil.which("node") is None, reason="no node to check the program of the page")
def test_the_program_of_a_page_parses(turning, tmp_path):
    text = viz.to_html(turning, tmp_path / "a.html").read_text(encoding="utf-8")
    program = tmp_path / "page.js"
    program.write_text(text.rsplit("<script>", 1)[1].split("</script>", 1)[0], encoding="utf-8")
    done = subprocess.run([shutil.which("node"), "--check", str(program)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# ---------------------------------------------------------------------------------------------------------------
# manners


def test_importing_is_cheap_and_leaves_matplotlib_alone(turning, tmp_path):
    code = "import sys, jaxnc.viz; print({'jax', 'matplotlib', 'PIL'} & set(sys.modules), dir(jaxnc.viz))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    names = ["Widget", "animate", "band", "burmester", "draw", "draw_circuits", "draw_dexterity", "draw_modes"]
    names += ["draw_modes_map", "plot", "plot_energy", "plot_families", "polygon", "to_html"]
    names += ["trace_page"]
    assert done.stdout.strip() == f"set() {names}"
    before = dict(matplotlib.rcParams)
    loaded = "matplotlib.pyplot" in sys.modules
    turning.draw(path=tmp_path / "a.pdf")
    turning.plot("psi", path=tmp_path / "b.svg")
    assert dict(matplotlib.rcParams) == before
    assert ("matplotlib.pyplot" in sys.modules) == loaded
    assert turning.draw()._repr_png_().startswith(b"\x89PNG")
