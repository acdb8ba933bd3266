"""How pictures look, measured in them: nothing lies on anything else, is cut off, or stands in an empty sheet."""

import dataclasses
import itertools

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from PIL import Image
from scipy.interpolate import PchipInterpolator

import jaxnc as nc
from jaxnc import viz
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.annotations import LONGEST, Arrows, arrows, crowding
from jaxnc.viz.poses import _ease_inputs, _interpolate, poses
from jaxnc.viz.sketch import sketch_plane
from jaxnc.viz.spatial.drawing import Projection, SpaceView
from jaxnc.viz.spatial.scene import SOLIDS, Solid
from jaxnc.viz.spatial.sketch import sketch_space
from jaxnc.viz.synthesis import abreast

NARROW, USUAL = 3.3, 6.4  # inches: a column, a page


@pytest.fixture(scope="module")
def turning() -> Motion:
    system = nc.library.four_bar(coupler_point=(0.07, 0.05)).compile()
    return nc.sweep(system, {"phi": np.linspace(0.0, 2 * np.pi, 61)}, rates={"phi": 1.0})


@pytest.fixture(scope="module")
def delta() -> Motion:
    system = nc.library.delta_robot().compile()
    return nc.sweep(system, {f"phi{k}": np.linspace(0.0, 0.4, 5) for k in (1, 2, 3)})


def boxes(figure: Figure, artists: list) -> list:
    figure.canvas.draw()
    return [artist.get_window_extent() for artist in artists]


def overlaps(found: list) -> list[tuple[int, int]]:
    """Pairs that lie on each other by more than a pixel."""
    return [
        (i, j)
        for (i, a), (j, b) in itertools.combinations(enumerate(found), 2)
        if min(a.x1, b.x1) - max(a.x0, b.x0) > 1.0 and min(a.y1, b.y1) - max(a.y0, b.y0) > 1.0
    ]


def numbers(ax) -> list:
    """Those at the axes that are shown."""
    ax.figure.canvas.draw()
    out = []
    for axis in (ax.xaxis, ax.yaxis):
        low, high = sorted(axis.get_view_interval())
        ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high and tick.label1.get_visible()]
        out += [tick.label1 for tick in ticks if tick.label1.get_text()]
    return out


def inside(figure: Figure, found: list) -> bool:
    paper = figure.bbox
    return all(b.x0 >= 0 and b.y0 >= 0 and b.x1 <= paper.x1 and b.y1 <= paper.y1 for b in found)


@pytest.mark.parametrize("width", [NARROW, USUAL])
def test_headings_legends_and_names_of_axes_keep_apart(turning, width):
    what = ("P", "C", "orientation coupler", "velocity P", "velocity C", "P.x", "P.y")
    figure = viz.plot(turning, *what, title="a heading of some length above curves", size=width)
    parts = [ax.get_legend() for ax in figure.axes if ax.get_legend()]
    parts += [ax.title for ax in figure.axes] + [figure.axes[0]._left_title]
    parts += [axis.label for ax in figure.axes for axis in (ax.xaxis, ax.yaxis) if axis.label.get_text()]
    found = boxes(figure, [part for part in parts if not hasattr(part, "get_text") or part.get_text()])
    assert len(found) > 9 and not overlaps(found) and inside(figure, found)
    for ax in figure.axes:  # numbers that touch are no numbers
        assert not overlaps(boxes(figure, numbers(ax)))


def test_curves_of_designs_are_drawn_with_more_poses_where_they_bend():
    """A four-bar that all but reaches its change point: what is drawn lies on the rocker's circle in short chords."""
    design = nc.library.four_bar().compile().replace({"coupler.B-C": 0.06001})
    turn = nc.sweep(design, {"phi": np.linspace(0.0, 2 * np.pi, 31)})
    before = np.asarray(turn["C"])
    after, kept = poses(turn).path(turn.system.topology.points.index("C"))
    np.testing.assert_allclose(after[kept], before, rtol=0, atol=1e-9)
    radius = np.hypot(*(after - np.asarray(design["D"])).T)
    np.testing.assert_allclose(radius, 0.08, rtol=0, atol=1e-12)
    sag = [np.hypot(*np.diff(x, axis=0).T).max() ** 2 / (8 * 0.08) for x in (before, after)]
    assert sag[1] < 0.3 * sag[0]


def test_nothing_is_drawn_across_poses_that_were_not_found():
    """Two runs of poses, each on the rocker's circle, with one between them that failed."""
    motion = nc.sweep(nc.library.four_bar().compile(), {"phi": np.linspace(0.0, 2 * np.pi, 25)})
    data = dataclasses.replace(poses(motion), status=np.where(np.arange(25) == 12, 7, 0))
    x, at = data.path(data.names.index("C"))
    assert len(x) > 50 and np.flatnonzero(np.isnan(x).any(axis=1)).tolist() == [at[12]]
    np.testing.assert_allclose(np.delete(x[at], 12, 0), np.delete(np.asarray(motion["C"]), 12, 0), rtol=0, atol=1e-9)
    radius = np.hypot(*(np.delete(x, at[12], 0) - data.places[0, data.names.index("D")]).T)
    np.testing.assert_allclose(radius, 0.08, rtol=0, atol=1e-12)


def test_paths_of_several_inputs_are_drawn_as_they_go_from_pose_to_pose():
    """Twelve steps of a five-bar: its cranks' joints lie on circles, all else where a sweep in small steps leads."""
    system = nc.library.five_bar().compile()
    t = np.linspace(0.0, 2 * np.pi, 13)
    asked = {"phi": 2.1 + 0.5 * np.sin(t), "psi": 1.0 + 0.5 * np.cos(2 * t)}
    motion, top = nc.sweep(system, asked), system.topology
    assert np.asarray(motion.converged).all()
    data = poses(motion)
    every = {name: PchipInterpolator(np.arange(13), x)(np.linspace(0, 12, 12 * 64 + 1)) for name, x in asked.items()}
    dense = nc.sweep(system, every)
    for name, column in ((p, top.points.index(p)) for p in "BCD"):
        x, at = data.path(column)
        np.testing.assert_allclose(x[at], data.places[:, column], rtol=0, atol=1e-12)
        assert len(x) > 60 and np.all(np.diff(at) > 0)
        gaps = np.linalg.norm(x[:, None] - np.asarray(dense[name]), axis=-1).min(axis=1)[at[1] : at[-2]]
        assert gaps.max() < 1e-12  # 8 and 64 places a step are among those


def test_inputs_that_move_one_after_the_other_do_so_between_poses():
    x = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [2.0, 3.0], [1.0, 3.0]])
    found = _ease_inputs(np.linspace(0.0, 5.0, 81), x)
    np.testing.assert_allclose(found[::16], x, rtol=0, atol=1e-14)
    assert np.all(np.min([np.abs(found[:, 1]), np.abs(found[:, 0] - 2), np.abs(found[:, 1] - 3)], axis=0) < 1e-14)
    assert found.min() >= -1e-14 and found.max() <= 3 + 1e-14


def test_paths_in_time_are_drawn_as_rates_lead_them():
    """Two inputs with laws of their own, and a double pendulum: few times show what many do."""
    system = nc.library.five_bar().compile()
    laws = {"phi": lambda t: 2.1 + 0.5 * jnp.sin(t), "psi": lambda t: 1.0 + 0.5 * jnp.cos(2 * t)}
    m = nc.Mechanism("double pendulum")
    m.ground("O", (0, 0))
    m.point("P", (1, 0))
    m.point("Q", (1.6, 0.4))
    m.body("upper", ["O", "P"], mass=1.0)
    m.body("lower", ["P", "Q"], mass=0.7)
    m.gravity = (0, -9.81)
    swinging = m.compile()
    few, many = np.linspace(0.0, 2.4, 25), np.linspace(0.0, 2.4, 24 * 64 + 1)
    for run, name, close in (
        (lambda t: nc.motion(system, laws, t), "C", 1e-5),
        (lambda t: nc.simulate(swinging, t), "Q", 0.02),
    ):
        data, true = poses(run(few)), np.asarray(run(many)[name])
        column = data.names.index(name)
        x, at = data.path(column)
        np.testing.assert_allclose(x[at], data.places[:, column], rtol=0, atol=1e-6)
        gaps = np.linalg.norm(x[:, None] - true, axis=-1).min(axis=1)  # places are those of a 64th of a step
        assert len(x) > 100 and gaps.max() < close
        chords = (data.places[:-1, column] + data.places[1:, column]) / 2
        assert np.linalg.norm(chords[:, None] - true, axis=-1).min(axis=1).max() > 2 * close


def test_a_step_with_an_impact_is_straight():
    """A ball that falls and comes up again between two times; the steps before and after it are parabolas."""
    t = np.array([0.0, 0.1, 0.2, 0.3])
    v, a = np.array([-1.0, -2.0, 2.0, 1.0]), np.array([-10.0, -10.0, -10.0, -10.0])
    x = np.array([1.0, 0.85, 0.85, 1.0])
    found = _interpolate(np.linspace(0.0, 3.0, 13), *(y[:, None] if y is not t else y for y in (x, t, v, a)))[:, 0]
    np.testing.assert_allclose(found[4:9], 0.85, rtol=0, atol=1e-14)
    s = np.linspace(0.0, 0.1, 5)
    np.testing.assert_allclose(found[:5], 1.0 - s - 5.0 * s**2, rtol=0, atol=1e-14)


@pytest.mark.parametrize("pose", [0, 4])
def test_a_driven_distance_has_its_name_beside_its_cylinder(pose):
    m = nc.Mechanism("boom")
    m.ground("A", (0, 0))
    m.ground("D", (0.6, -0.3))
    m.point("B", (0.9, 0.7))
    m.point("C", (1.8, 0.9))
    m.body("boom", ["A", "B", "C"])
    m.distance("stroke", start="D", to="B")
    motion = nc.sweep(m.compile(), {"stroke": np.linspace(0.9, 1.3, 5)})
    figure = viz.draw(motion, pose=pose)
    texts = {text.get_text(): text for text in figure.axes[0].texts if text.get_gid() == "label"}
    assert set(texts) == {*"ABCD", "stroke"}
    place, ends = np.array(texts["stroke"].get_position()), np.array([motion[p][pose] for p in "DB"])
    along, length = ends[1] - ends[0], float(motion["stroke"][pose])
    assert abs((place - ends[0]) @ along / length**2 - 0.5) < 0.3  # beside it, and clear of what is drawn
    assert 0.02 < abs(along[0] * (place - ends[0])[1] - along[1] * (place - ends[0])[0]) / length < 0.3
    assert not overlaps(boxes(figure, list(texts.values())))


@pytest.mark.parametrize("dpi", [0, -1, True, 1.5, float("nan"), 1e9, 1e308, "x", None])
def test_dots_per_inch_are_refused_outside_their_range(turning, dpi, tmp_path):
    for call in (turning.draw, lambda path, dpi: turning.plot("P", path=path, dpi=dpi), turning.animate):
        with pytest.raises(nc.InputError, match=r"dpi=.*from 20 to 2400"):
            call(tmp_path / "a.gif" if call == turning.animate else tmp_path / "a.png", dpi=dpi)
    assert not list(tmp_path.iterdir())


def test_the_smallest_figure_has_the_fewest_dots(turning, tmp_path):
    turning.draw(tmp_path / "a.png", size=1, dpi=np.float32(20))
    with Image.open(tmp_path / "a.png") as image:
        assert image.width == pytest.approx(20, abs=1)


def test_figures_have_one_word_for_their_size(turning, caplog):
    assert viz.plot(turning, "P", size=3.0).get_size_inches()[0] == 3.0
    assert viz.plot(turning, "P.x", size=(3.0, 4.0)).get_size_inches().tolist() == [3.0, 4.0]
    assert viz.draw(turning, size=3.0).get_size_inches()[0] == pytest.approx(3.0, abs=0.02)
    with pytest.raises(nc.CallError, match=r"plot.*width=.*known names.*size"):
        turning.plot("P", width=3)
    with pytest.raises(nc.InputError, match=r"size=\(1, 2, 3\).*inches"):
        turning.plot("P", size=(1, 2, 3))
    figure = Figure(layout="constrained")
    turning.draw(ax=figure.subplots(1, 2)[0])
    FigureCanvasAgg(figure).draw()
    assert not caplog.records


def test_curves_are_told_apart_in_grey(turning):
    lines = viz.plot(turning, "P", "B", "C").axes[0].lines
    looks = [line.get_linestyle() + str(line._unscaled_dash_pattern) for line in lines if len(line.get_xdata()) > 1]
    assert len(set(looks)) == 3


@pytest.mark.parametrize("width", [NARROW, USUAL])
def test_the_keys_of_arrows_are_on_the_paper_and_clear_of_the_title(turning, width):
    figure = viz.draw(
        turning, 9, velocities=["B", "C", "P"], accelerations=["B", "P"], size=(width, 4.0), title="two sorts of arrows"
    )
    ax = figure.axes[0]
    keys = [a for a in ax.get_children() if type(a).__name__ == "QuiverKey"]
    found = boxes(figure, [ax._left_title, *(key.text for key in keys)])
    found += boxes(figure, numbers(ax))
    assert len(found) > 6 and not overlaps(found) and inside(figure, found)
    assert figure.get_figwidth() <= width + 1e-9
    for noun in ("velocity", "acceleration"):  # arrows end inside the axes, not on their numbers
        (quiver,) = (a for a in ax.get_children() if a.get_gid() == noun)
        tips = ax.transData.transform(quiver.get_offsets() + np.stack([quiver.U, quiver.V], axis=1))
        assert all(ax.bbox.contains(*tip) for tip in tips)


def test_one_peak_leaves_no_dots_of_the_other_arrows(turning):
    data = poses(turning)
    plain = np.linalg.norm(arrows(data, "P", (), 1.0)[0].vectors, axis=-1)
    speeds = np.array(turning.rates[0])
    speeds[20] *= 500.0
    (found,) = arrows(poses(dataclasses.replace(turning, rates=(speeds, *turning.rates[1:]))), "P", (), 1.0)
    drawn = np.linalg.norm(found.vectors, axis=-1)
    others = np.arange(61) != 20
    assert drawn.max() == pytest.approx(LONGEST) == drawn[20, 0]
    assert (drawn[others] > 0.6 * plain[others]).all()
    np.testing.assert_allclose(drawn[others], plain[others] * drawn[0] / plain[0], rtol=1e-9)  # and are to scale
    assert "cut at" in found.text and " of " in found.longest and "cut" not in arrows(data, "P", (), 1.0)[0].text


@pytest.mark.parametrize("size", [(NARROW, 2.8), (USUAL, 4.8)])
def test_a_drawing_fills_its_sheet(turning, delta, size):
    for motion in (turning, delta):
        figure = viz.draw(motion, 0, trace="P" if motion is turning else "T", size=size)
        figure.canvas.draw()
        ink = np.argwhere((np.asarray(figure.canvas.buffer_rgba())[..., :3] < 235).any(axis=-1))
        assert ink.min() > 0 and (np.array(figure.bbox.size)[::-1] - ink.max(axis=0) > 0).all()  # nothing is cut
        below = ink[ink[:, 0] > 0.1 * figure.bbox.height]  # of the title
        assert below[:, 0].min() < 0.22 * figure.bbox.height
        assert np.ptp(ink[:, 1]) > 0.85 * figure.bbox.width
        sizes = [text.get_fontsize() for ax in figure.axes for text in ax.get_xticklabels()]
        assert min(sizes) >= 7.0


def test_names_in_space_do_not_lie_on_each_other(delta):
    figure = viz.draw(delta, 2)
    names = [a for a in figure.findobj() if a.get_gid() in ("label", "input")]
    assert len(names) > 20
    assert len(overlaps(boxes(figure, names))) == 0


def test_a_picture_without_axes_has_a_scale(turning, delta, tmp_path):
    for motion in (turning, delta):
        figure = viz.draw(motion, 0, frame="scale")
        bar, text = (a for a in figure.findobj() if a.get_gid() == "scale")
        assert inside(figure, boxes(figure, [bar, text]))
        assert text.get_text().endswith(" m") and float(text.get_text().split()[0]) > 0
        assert not [a for a in viz.draw(motion, 0, frame=False).findobj() if a.get_gid() == "scale"]
    figure = viz.draw(turning, 0, frame="scale")
    bar, text = (a for a in figure.findobj() if a.get_gid() == "scale")
    assert np.ptp(bar.get_xdata()) == pytest.approx(float(text.get_text().split()[0]))


def test_sheets_have_few_empty_places():
    assert [abreast(n, int(np.ceil(np.sqrt(n)))) for n in (1, 2, 3, 4, 5, 6, 9, 12)] == [1, 2, 2, 2, 3, 3, 3, 4]
    assert [abreast(n, 3) for n in (1, 2, 3, 4, 5, 6)] == [1, 2, 3, 2, 3, 3]


def texts_of(figure: Figure) -> list:
    """Names of points, angles and distances, headings and the numbers of axes in the plane."""
    names = [a for a in figure.findobj(Text) if a.get_gid() in ("label", "input", "title", "scale")]
    for ax in figure.axes:
        names += [ax._left_title, *(numbers(ax) if ax.name != "3d" and ax.axison else [])]
    return [a for a in names if a.get_text() and a.get_visible()]


@pytest.mark.parametrize("width", [NARROW, USUAL])
def test_names_of_the_whole_library_are_apart_and_on_the_paper(width):
    """Names neither lie on each other nor, side by side, read as one: B beside φ is not Bφ."""
    wrong = {}
    for name, make in nc.library.CATALOGUE.items():
        m = make()
        if m.model.dim == 3 and width == USUAL:
            continue  # there are more names in less room on the narrow paper
        figure = viz.draw(m, size=(width, 0.78 * width), title=name.replace("-", " "))
        texts = texts_of(figure)
        found = boxes(figure, texts)
        if not inside(figure, found):
            wrong[name] = "over the edge"
        gap = 2.0 * figure.dpi / 72.0  # points
        named = [box for box, text in zip(found, texts, strict=True) if text.get_gid() in ("label", "input")]
        wide = [Bbox.from_extents(b.x0 - gap / 2, b.y0 + 0.3 * b.height, b.x1 + gap / 2, b.y1) for b in named]
        for pair in (*overlaps(found), *overlaps(wide)):
            wrong[name] = [texts[k].get_text() for k in pair]
    assert not wrong


def test_names_do_not_lie_on_thin_lines():
    """A line between two places of a name, where its letters are, is seen as well as one through its corners."""
    half, centre = np.array([3.0, 1.0]), np.array([[0.0, 0.0], [0.0, 9.0], [3.4, 0.0]])
    for x in np.linspace(-2.9, 2.9, 30):
        ends = np.array([[x, -5.0], [x, 5.0]])
        through, beside, _ = crowding(centre, half, ends[:1], ends[1:], np.zeros(1))
        assert through > 2.0 and beside == 0.0
    a, b = np.array([[3.5, -5.0]]), np.array([[3.5, 5.0]])
    np.testing.assert_allclose(crowding(centre, half, a, b, np.zeros(1))[0], 4.0 * (0.55 - 0.5) ** 2, rtol=1e-12)


def test_a_heading_is_in_one_line_where_the_sheet_has_room():
    for make in (nc.library.hoeken, nc.library.quick_return, nc.library.jansen_leg):
        figure = make().draw()
        (heading,) = (ax._left_title for ax in figure.axes)
        assert heading.get_text().endswith("may be driven") and "\n" not in heading.get_text()
        assert inside(figure, boxes(figure, [heading]))
    narrow = nc.library.hoeken().draw(size=(NARROW, 2.6))
    assert inside(narrow, boxes(narrow, [narrow.axes[0]._left_title]))


@pytest.mark.parametrize("make", [nc.library.rssr, nc.library.bennett, nc.library.wobble_plate])
def test_the_scale_of_a_spatial_drawing_is_as_long_as_it_says(make):
    data = poses(make())
    view = SpaceView(data, [0], (), True, None)
    view.open(None, (USUAL, 5.0), "scale", "a scale")
    bar, text = (a for a in view.figure.findobj() if a.get_gid() == "scale")
    view.figure.canvas.draw()
    drawn = np.ptp(bar.get_transform().transform(np.array(bar.get_data()).T)[:, 0]) * 72.0 / view.figure.dpi
    assert drawn == pytest.approx(float(text.get_text().split()[0]) * view.scale, rel=1e-9)
    flat, *_ = Projection(view.ax)(view.columns[0])
    pixels, x = view.ax.transData.transform(flat), view.columns[0] @ view.camera.axes[:2].T
    far = np.unravel_index(np.argmax(np.linalg.norm(x[:, None] - x, axis=-1)), (len(x), len(x)))
    points = float(np.hypot(*(pixels[far[0]] - pixels[far[1]]))) * 72.0 / view.figure.dpi
    assert points == pytest.approx(float(np.hypot(*(x[far[0]] - x[far[1]]))) * view.scale, rel=1e-6)


@pytest.fixture(scope="module")
def heavy() -> Motion:
    m = nc.library.slider_crank()
    m.gravity = (0.0, -9.81)
    for body in m.model.bodies:
        m.mass(body, 1.0)
    return nc.sweep(m.compile(), {"phi": np.linspace(0.5, 1.5, 3)}, rates={"phi": 12.0})


@pytest.mark.parametrize("width", [NARROW, USUAL])
def test_centres_of_mass_leave_joints_to_be_seen(heavy, width):
    figure = viz.draw(heavy, forces=True, size=(width, 0.78 * width))
    discs = [a for a in figure.axes[0].get_children() if a.get_gid() == "centre of mass"]
    pins = [a for a in figure.axes[0].get_children() if a.get_gid() in ("pin", "ground pin")]
    assert len(discs) == 2 and max(d.get_zorder() for d in discs) < min(p.get_zorder() for p in pins)
    unit = pins[0].radius
    at = heavy.system.topology.points.index("C")  # the slider, a body of one point, which is a joint too
    offsets = np.asarray(discs[0].get_offsets())
    (k,) = np.flatnonzero(np.hypot(*(offsets - poses(heavy).places[0, at]).T) < 1e-9)
    per = figure.axes[0].transData.get_matrix()[0, 0] * 72.0 / figure.dpi
    radii = 0.5 * np.sqrt(discs[0].get_sizes()) / (unit * per)
    assert radii[k] == pytest.approx(1.6, rel=0.05)  # seen around the joint
    np.testing.assert_allclose(np.delete(radii, k), 1.05, rtol=0.05)


@pytest.mark.parametrize("width", [NARROW, USUAL])
def test_the_keys_of_forces_are_arrows_that_can_be_measured_by(heavy, width):
    figure = viz.draw(heavy, forces=True, size=(width, 0.78 * width))
    keys = [a for a in figure.axes[0].get_children() if type(a).__name__ == "QuiverKey"]
    found = boxes(figure, [*(key.text for key in keys), figure.axes[0]._left_title])
    assert len(keys) == 2 and not overlaps(found) and inside(figure, found)
    longest = max(float(np.hypot(a.U, a.V).max()) for a in figure.axes[0].get_children() if a.get_gid() == "reaction")
    assert min(key.U for key in keys) > 0.2 * longest


@pytest.fixture(scope="module")
def sprung() -> Motion:
    m = nc.library.rssr()
    m.gravity = (0.0, 0.0, -9.81)
    m.mass("bar", 2.0, shape="rod")
    m.ground("S", (0.3, -0.1, 0.0))
    m.spring("s", "2", "S", stiffness=100.0, free=0.2)
    m.damper("d", "1", "S", damping=1.0)
    m.spring("c", "phi", stiffness=1.0, free=0.0)
    m.stop("e", "phi", stiffness=1.0, lower=0.0, upper=2.0)
    m.torque("effort on phi", "phi", 3.0)
    system = m.compile()
    return nc.sweep(system, {"phi": np.linspace(0.8, 1.2, 5)}, rates={"phi": 1.0})


def test_what_acts_in_space_is_seen(sprung):
    data = poses(sprung)
    scene, pose = sketch_space(data), data.every_column[2]
    spring, spiral = (item for item in scene.items if item.role == "spring")
    x = spring.vertices(pose, 1e-3)
    a, b = (pose[data.names.index(name)] for name in "2S")
    along = (x - a) @ (b - a) / ((b - a) @ (b - a))
    assert -0.02 < along.min() < 0.03 and 0.97 < along.max() < 1.02
    assert np.linalg.norm(x - a - along[:, None] * (b - a), axis=1).max() < 2e-3
    (stop,) = (item for item in scene.items if item.role == "dashpot")
    for item in (spiral, stop):
        x = item.vertices(pose, 1e-3) - pose[data.names.index("A")]
        assert np.ptp(x @ pose[len(data.names)]) < 1e-12 and np.linalg.norm(x, axis=1).max() < 4e-3  # about the axis vA
    assert sum(item.role == "torque" for item in scene.items) == 2
    case = next(item for item in scene.items if item.role == "block")
    assert case.frame.along.columns == tuple(data.names.index(name) for name in "1S")
    assert all(SOLIDS[i.role].fill for i in scene.items if isinstance(i, Solid) and i.mesh.polygons.faces)


def test_a_centre_of_mass_is_a_ball_of_light_and_dark_octants(sprung):
    data = poses(sprung)
    middle = 0.5 * (np.asarray(sprung["1"]) + np.asarray(sprung["2"]))
    view = SpaceView(data, [2], (), True, None)
    down = np.broadcast_to([0.0, 0.0, -0.05], (5, 1, 3))
    view.add_arrows([Arrows("weight", (), middle[:, None], down, 0.0, "weight", "weight 19.6 N", 1.0)])
    masses = [item for item in view.scene.items if item.role in ("mass", "dark mass")]
    (arrow,) = (item for item in view.scene.items if item.role == "weight")
    np.testing.assert_allclose(arrow.frame.along.vector(view.columns[2]), down[2, 0], atol=1e-14)
    for item in masses:
        x = item.vertices(view.columns[2], 1e-3)
        np.testing.assert_allclose(x.mean(axis=0), middle[2], atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(x - middle[2], axis=1), 1.15e-3, rtol=1e-9)
    assert len(masses) == 2


def test_markers_are_part_of_the_body_that_carries_them():
    for name, role in (("roberts", "plate"), ("hoeken", "bar")):  # a triangle, and a bar that is longer
        data = poses(nc.library.CATALOGUE[name]())
        coupler = next(item for item in sketch_plane(data).items if item.role == role and len(item.points) > 2)
        assert data.names.index("P") in coupler.points
        if role == "bar":
            assert data.names[coupler.points[-1]] == "P" or data.names[coupler.points[0]] == "P"


def test_every_driven_angle_between_bars_that_meet_is_drawn():
    figure = viz.draw(nc.library.planar_3r())
    assert sorted(t.get_text() for t in figure.axes[0].texts if t.get_gid() == "input") == ["φ1", "φ2", "φ3"]


def test_long_names_are_on_the_paper_and_clear_of_their_arrow():
    m = nc.Mechanism("long names")
    m.ground("A", (0, 0))
    m.ground("leftmost_of_all_points", (-1, 0))
    m.point("rightmost_of_all_points", (1, 0.4))
    m.body("crank", ["A", "rightmost_of_all_points"])
    m.angle("angle_of_the_crank", at="A", to="rightmost_of_all_points")
    figure = viz.draw(m)
    figure.canvas.draw()
    texts = {t.get_text(): t.get_window_extent() for t in figure.axes[0].texts if t.get_gid() in ("label", "input")}
    assert set(texts) == {"A", "leftmost_of_all_points", "rightmost_of_all_points", "angle_of_the_crank"}
    box = figure.axes[0].bbox
    for name, at in texts.items():
        assert box.x0 <= at.x0 and at.x1 <= box.x1 and box.y0 <= at.y0 and at.y1 <= box.y1, name
    arrow = next(p for p in figure.axes[0].get_children() if p.get_gid() == "arc" and hasattr(p, "get_xydata"))
    line = figure.axes[0].transData.transform(arrow.get_xydata())
    assert not texts["angle_of_the_crank"].count_contains(line)


def test_what_is_plotted_unasked_moves_and_is_no_line_in_an_empty_sheet():
    def seen(motion: Motion) -> tuple[list[str], str]:
        axes = viz.plot(motion).axes
        return [ax.get_ylabel() for ax in axes], axes[-1].get_xlabel()

    turn = np.linspace(0.1, 6.0, 9)
    assert seen(nc.sweep(nc.library.slider_crank().compile(), {"phi": turn})) == (["C.x [m]"], "φ [rad]")
    to_and_fro = {"phi": 0.2 * np.sin(turn) + 1.0, "psi": 2.0 + 0.1 * turn}
    five = nc.library.five_bar().compile()
    figure = viz.plot(nc.sweep(five, to_and_fro))
    assert figure.axes[0].get_lines()[0].get_label() == "C"  # not D, which goes round a circle
    assert viz.plot(nc.sweep(five, to_and_fro), "C.x").axes[0].get_xlabel() == "ψ [rad]"  # the one that runs one way
    both = {"phi": to_and_fro["phi"], "psi": 0.1 * np.cos(turn) + 2.0}
    assert viz.plot(nc.sweep(five, both), "C.x").axes[0].get_xlabel() == "pose"
    flat = nc.sweep(nc.library.four_bar_in_space().compile(), {"phi": turn})
    assert {line.get_label() for line in viz.plot(flat).axes[0].get_lines()} == {"C.x", "C.y"}  # z stands still


def test_names_of_angles_at_one_point_do_not_lie_on_each_other():
    m = nc.Mechanism("two angles")
    m.ground("O", (0, 0))
    m.ground("R", (1, 0))
    m.point("C", (0.5, 0.1))
    m.body("arm", ["O", "C"])
    m.angle("arm_angle", at="O", to="C")
    m.angle("ring_angle", at="O", to="R", start="C")
    figure = viz.draw(m)
    texts = [t for t in figure.axes[0].texts if t.get_gid() in ("label", "input")]
    assert len(texts) == 5 and not overlaps(boxes(figure, texts))


def test_unit_vectors_about_one_point_have_an_extent():
    m = nc.Mechanism("pointer", dim=3)
    m.ground("O", (0, 0, 0)), m.ground_vector("a", (1, 0, 0)), m.vector("u", (0, 0.6, 0.8))
    m.body("hand", ["O"], vectors=["a", "u"])
    low, high = m.draw().axes[0].get_xlim()
    assert 0.1 < high - low < 10.0
