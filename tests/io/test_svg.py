"""Paths of drawings against closed forms: circles, a parabola, transformations; and what is wrong with a file."""

import numpy as np
import pytest

import jaxnc as nc

EXACT = 1e-12  # Gauss's rule over 64 parts of a segment, halved down to the last digit


@pytest.fixture
def drawn(tmp_path):
    def write(data, before="", after="", more=""):
        path = tmp_path / "a.svg"
        path.write_text(
            f'<svg xmlns="http://www.w3.org/2000/svg"><defs><path d="M0 0L9 9"/></defs>'
            f'{before}<path id="p" d="{data}" {more}/>{after}<path id="q" d="M0 0h5"/></svg>'
        )
        return path

    return write


@pytest.mark.parametrize(
    "data",
    [
        "M 2 0 A 2 2 0 0 1 -2 0 A 2 2 0 0 1 2 0 Z",
        "M2,0a2 2 0 01-4 0 2,2,0,0,1,4,0z",
        "M2 0A1 1 9 1 1-2 0A.1.1 0 0 1 2 0",
        "m2 0a2 2 0 01-.8 1.6 2 2 0 01-2.8-2.8 2 2 0 013.6 1.2",  # these steps add up to 2e-16
    ],
)
def test_circles(drawn, data):
    found = nc.io.outline(drawn(data), 12)
    angle = 2 * np.pi * np.arange(12) / 12
    np.testing.assert_allclose(found.points, 2 * np.stack([np.cos(angle), -np.sin(angle)], axis=1), atol=EXACT)
    assert found.closed
    assert found.length == pytest.approx(4 * np.pi, rel=EXACT)


@pytest.mark.parametrize(("flags", "part", "middle"), [
    ("0 0", 0.25, (1 - 0.5**0.5, 1 - 0.5**0.5)), ("0 1", 0.25, (0.5**0.5, 0.5**0.5)),
    ("1 0", 0.75, (-(0.5**0.5), -(0.5**0.5))), ("1 1", 0.75, (1 + 0.5**0.5, 1 + 0.5**0.5)),
])  # fmt: skip
def test_the_four_arcs_between_two_points(drawn, flags, part, middle):
    found = nc.io.outline(drawn(f"M 1 0 A 1 1 0 {flags} 0 1"), 3, up=False)
    assert found.length == pytest.approx(part * 2 * np.pi, rel=EXACT)
    np.testing.assert_allclose(found.points[1], middle, atol=EXACT)
    assert not found.closed


def test_curves_by_their_lengths_and_by_each_other(drawn):
    parabola = nc.io.outline(drawn("M0 0 Q .5 0 1 1"), 5, up=False)
    assert parabola.length == pytest.approx(np.sqrt(5) / 2 + np.arcsinh(2) / 4, rel=EXACT)
    np.testing.assert_allclose(parabola.points[:, 1], parabola.points[:, 0] ** 2, atol=EXACT)

    def along(x):
        return x * np.sqrt(1 + 4 * x * x) / 2 + np.arcsinh(2 * x) / 4

    np.testing.assert_allclose(along(parabola.points[:, 0]), parabola.length * np.arange(5) / 4, atol=EXACT)
    for short, long in (
        ("M0 0c1 2 2 2 3 0s2-2 3 0", "M0 0C1 2 2 2 3 0C4-2 5-2 6 0"),
        ("M0 0q1 2 2 0t2 0T6 0", "M0 0Q1 2 2 0Q3-2 4 0Q5 2 6 0"),
        ("m1e0,1 1 0v2h1V0H1", "M1 1L2 1L2 3L3 3L3 0L1 0"),
        ("M0 0S1 1 2 0", "M0 0C0 0 1 1 2 0"),
    ):
        np.testing.assert_allclose(
            nc.io.outline(drawn(short), 7).points, nc.io.outline(drawn(long), 7).points, atol=EXACT
        )


def test_transformations_and_sizes(drawn):
    before = '<g transform="translate(10,5) scale(2)"><g transform="rotate(90)">'
    path = drawn("M0 0h1v1h-1z", before, "</g></g>", 'transform="matrix(1 0 0 1 4 0)"')
    found = nc.io.outline(path, 4, up=False)
    np.testing.assert_allclose(found.points, [(10, 13), (10, 15), (8, 15), (8, 13)], atol=EXACT)
    np.testing.assert_allclose(nc.io.outline(path, 4).points, found.points * [1, -1], atol=EXACT)
    small = nc.io.outline(path, 4, size=0.5, centre=(1.0, 2.0))
    np.testing.assert_allclose(np.sort(small.points[:, 0]), [0.75, 0.75, 1.25, 1.25], atol=EXACT)
    assert small.length == pytest.approx(2.0, rel=EXACT)
    assert nc.io.outline(path, 3, id="q").length == pytest.approx(5.0)
    turned = nc.io.outline(drawn("M1 0h1", more='transform="rotate(90 1 0) scale(3)"'), 3, up=False)
    np.testing.assert_allclose(turned.points[[0, -1]], [(1, 2), (1, 5)], atol=EXACT)
    two = drawn("M0 0h1M0 2h3")
    assert nc.io.outline(two, 3, piece=1).length == pytest.approx(3.0)
    assert nc.io.outline(drawn("M0 0h1v1L0 0M5 5h1"), 3, piece=0).closed


@pytest.mark.parametrize("hidden", ['display="none"', 'style="fill: red; display: none"'])
def test_what_is_not_shown_is_no_curve(drawn, hidden):
    path = drawn("M0 0h1", f'<g {hidden}><path d="M0 0h7"/></g><path id="h" {hidden} d="M0 0h8"/>')
    assert nc.io.outline(path, 3).length == pytest.approx(1.0)
    assert nc.io.outline(path, 3, id="h").length == pytest.approx(8.0)
    path.write_text(f'<svg><g {hidden}><path d="M0 0h7"/></g></svg>')
    with pytest.raises(nc.ModelFileError, match="none of its paths is shown"):
        nc.io.outline(path, 3)


def test_a_style_decides_before_an_attribute(drawn):
    seen = 'style="-inkscape-display:none; display:inline" display="none"'
    assert nc.io.outline(drawn("M0 0h1", f'<path {seen} d="M0 0h7"/>'), 3).length == pytest.approx(7.0)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("", "draws nothing"),
        ("L1 1", "begins with L; it must begin with M"),
        ("M0 0 L1", "L takes 2 numbers each time, got 1"),
        ("M0 0 X 3", "has 'X'; commands are M L"),
        ("M0 0 A1 1 0 2 0 1 1", "is not a flag"),
        ("M0 0h1M2 2h1", r"2 pieces, a curve is one; .*piece=0"),
        ("M0 0L0 0", "has no length"),
    ],
)
def test_bad_paths(drawn, data, words):
    with pytest.raises(nc.ModelFileError, match=words) as error:
        nc.io.outline(drawn(data), 5)
    assert "a.svg, path 'p'" in str(error.value)


def test_bad_files(drawn, tmp_path):
    good = drawn("M0 0h1")
    for options, words in (({"id": "r"}, "no path with id 'r'"), ({"piece": 3}, "no piece 3; it has 1")):
        with pytest.raises(nc.ModelFileError, match=words):
            nc.io.outline(good, 5, **options)
    for options, words in (
        ({"count": 2}, "at least 3"),
        ({"size": 0}, "must be positive"),
        ({"centre": 1}, "two finite"),
    ):
        with pytest.raises(nc.InputError, match=words):
            nc.io.outline(good, **{"count": 5, **options})
    for text, words in (
        ("<svg", "is not a drawing in SVG"),
        ("<html/>", "first element is <html>"),
        ("<svg><circle/></svg>", "no <path>; turn <circle> into paths"),
        ('<svg><path transform="foo(3)" d="M0 0h1"/></svg>', r"foo\(3\) is not understood"),
    ):
        (tmp_path / "b.svg").write_text(text)
        with pytest.raises(nc.ModelFileError, match=words):
            nc.io.outline(tmp_path / "b.svg", 5)
    with pytest.raises(nc.ModelFileError, match="cannot be read"):
        nc.io.outline(tmp_path / "none.svg", 5)
