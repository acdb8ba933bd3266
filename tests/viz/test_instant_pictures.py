"""What pictures show of an instant: the right places, honest about infinity, and what cannot be shown is said."""

import numpy as np
import pytest

import jaxnc as nc
from jaxnc.kinematics import centrodes, instant_centres, instant_motion


def swept(name, poses, **options):
    m = getattr(nc.library, name)(**options)
    (driven, drive) = next(iter(m.model.run.inputs.items()))
    values = np.linspace(drive.start, drive.end, poses)
    return nc.sweep(m.compile(), {driven: values}, rates={driven: 2.0}, accelerations={driven: 0.5})


@pytest.fixture(scope="module")
def four_bar():
    return swept("four_bar", 25)


@pytest.fixture(scope="module")
def slider_crank():
    return swept("slider_crank", 25)


def words(figure):
    """All texts of a picture, also those packed under it."""
    from matplotlib.text import Text

    return [t.get_text().strip() for t in figure.findobj(Text) if t.get_text().strip()]


def artist(figure, name):
    return next(a for a in figure.axes[0].findobj() if a.get_gid() == name)


def test_centres_stand_where_they_are(four_bar):
    figure = four_bar.draw(pose=10, show="centres")
    dots = np.array([a.get_center() for a in figure.axes[0].patches if a.get_gid() == "pole"])
    said = words(figure)
    assert {"1 ground", "2 crank", "3 coupler", "4 rocker"} <= set(said)
    for pair, x in instant_centres(four_bar.pose(10)).items():
        gaps = np.linalg.norm(dots - np.asarray(x.centre), axis=1)
        names = ("ground", "crank", "coupler", "rocker")
        text = f"P{''.join(sorted('₁₂₃₄'[names.index(n)] for n in pair))}"
        assert gaps.min() < 1e-12 or any(s.startswith(f"{text} at (") for s in said), pair
        assert text in said


def test_marks_of_an_instant_stand_beside_traces_of_few_poses(four_bar):
    """Traces of few poses are drawn with places between them, which know nothing of the marks."""
    figure = four_bar.draw(pose=10, show="centres", trace="C")
    assert len(artist(figure, "trace C").get_xdata()) > 2 * len(four_bar.status)
    assert "3 coupler" in words(figure)


def test_a_centre_at_infinity_is_an_arrow_and_a_sentence(slider_crank):
    figure = slider_crank.draw(pose=3, show=["centres slider"])
    assert "P₁₄ ∞" in words(figure) and "P₁₄ at infinity, 90°" in words(figure)
    arrow = artist(figure, "towards P₁₄ ∞").get_xydata()
    np.testing.assert_allclose(arrow[:, 0], slider_crank["C"][3, 0], rtol=1e-12)


def test_centrodes_and_circles_are_those_of_the_numbers(four_bar):
    figure = four_bar.draw(pose=14, show=["centrodes coupler", "Bresse circles coupler", ("curvature", "B", "rocker")])
    found, x = centrodes(four_bar, "coupler", pose=14), instant_motion(four_bar.pose(14), "coupler")
    for name in ("fixed", "moving"):
        drawn = artist(figure, f"{name} centrode").get_xydata()
        drawn = drawn[np.isfinite(drawn).all(axis=1)]
        np.testing.assert_allclose(drawn, np.asarray(getattr(found, name))[np.asarray(found.finite)])
    circle = artist(figure, "inflection")
    np.testing.assert_allclose(circle.get_center(), x.centre + 0.5 * x.inflection, rtol=1e-9)
    assert circle.get_radius() == pytest.approx(0.5 * float(np.linalg.norm(x.inflection)))
    second = artist(figure, "tangential")
    pole = np.asarray(x.acceleration_pole)
    for ring in (circle, second):  # Bresse's circles meet in the pole of accelerations
        assert np.linalg.norm(pole - ring.get_center()) == pytest.approx(ring.get_radius())
    assert any(s.startswith("radius of curvature at B: ") for s in words(figure))


def test_screws_and_axodes_are_drawn():
    found = swept("bevel_gears", 19)
    figure = found.draw(pose=4, show=[("axodes", "wheel1", "wheel2"), "screw axis wheel1 / wheel2", "curvature 2"])
    said = words(figure)
    assert {"── fixed axode, on wheel2", "── moving axode, on wheel1", "ISA", "2₀"} <= set(said)
    assert any(s.startswith("screw axis of wheel1 over wheel2: rate ") and s.endswith("pitch 0 m/rad") for s in said)


@pytest.mark.parametrize(
    "show, said",
    [
        ("centroids", "in the plane is centres, centrodes, "),
        ("screw axis coupler", r"what can be shown in the plane is "),
        ("centrodes", "'centrodes'.*show='centrodes …'"),
        ("curvature Z", r"no point or marker 'Z'; "),
        ("centres conrod", r"no body 'conrod'; "),
        ("inflection circle coupler / rocker / crank", "one name, or one and.*body"),
    ],
)
def test_mistakes_are_named(four_bar, show, said):
    with pytest.raises(nc.InputError, match=said):
        four_bar.draw(show=show)


def vectors(figure, name):
    """Starts and ends of the arrows of one kind, ``(arrows, 2, 2)``."""
    found = [a for a in figure.axes[0].texts if a.get_gid() == name]
    return np.array([(a.xyann, a.xy) for a in found]).reshape(-1, 2, 2)


def test_a_velocity_polygon_has_the_velocities_and_images_like_the_bodies(four_bar):
    figure = four_bar.polygon("velocity", pose=5)
    ends = vectors(figure, "velocity vector")
    assert not ends[:, 0].any() and {"o", "b", "c", "in the pole o: A, D"} <= set(words(figure))
    B, C = (np.asarray(four_bar.velocity(n))[5] for n in "BC")
    np.testing.assert_allclose(ends[:, 1], [B, C], rtol=1e-12)
    side = next(a for a in figure.axes[0].lines if a.get_gid() == "image").get_xydata()
    arm = np.asarray(four_bar["C"] - four_bar["B"])[5]  # turned by a quarter, times the angular velocity
    rate = float(four_bar.angular_velocity("coupler")[5])
    np.testing.assert_allclose(side[1] - side[0], rate * np.array([-arm[1], arm[0]]), rtol=1e-9)
    assert figure.axes[0].get_xlabel() == "velocity x [m/s]"


def test_accelerations_are_put_together_from_their_parts():
    found = swept("shaper", 13)
    figure, k = found.polygon("acceleration", pose=4), 4
    under, coriolis, slide = (vectors(figure, n) for n in ("acceleration vector", "Coriolis", "sliding"))
    A, rate = np.asarray(found["A"] - found["O4"])[k], float(found.angular_velocity("rocker")[k])
    along = A / np.linalg.norm(A)
    sliding = float(np.asarray(found.velocity("A"))[k] @ along)
    np.testing.assert_allclose(coriolis[0, 1] - coriolis[0, 0], 2 * rate * sliding * np.array([-along[1], along[0]]))
    np.testing.assert_allclose(slide[0, 0], coriolis[0, 1])
    np.testing.assert_allclose(slide[0, 1], found.acceleration("A")[k])
    rest = slide[0, 1] - slide[0, 0]  # along the rocker
    assert abs(rest[0] * along[1] - rest[1] * along[0]) < 1e-9 * np.linalg.norm(under)


@pytest.mark.parametrize(
    "ask, said",
    [
        (lambda m: m.polygon("jerk"), "polygon.*'velocity' or 'acceleration'"),
        (lambda m: swept("bennett", 3).polygon(), "spatial.*planar mechanisms"),
    ],
)
def test_mistakes_of_polygons_are_named(four_bar, ask, said):
    with pytest.raises(nc.InputError, match=said):
        ask(four_bar)
