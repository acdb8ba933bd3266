"""What was typed is drawn before it is compiled, and things show themselves in notebooks."""

import gc
import html.parser
import os
import subprocess
import sys
from typing import Any

import jax
import numpy as np
import pytest
from matplotlib.text import Text

import jaxnc as nc
from jaxnc import viz
from jaxnc.errors import InputError, MechanismError
from jaxnc.synthesis.design import Design


def four_bar(complete: bool = True) -> nc.Mechanism:
    m = nc.Mechanism("a <four-bar>")
    a, d = m.ground("A", (0, 0)), m.ground("D", (4, 0))
    b, c, p = m.point("B", (0, 1)), m.point("C", (3.3, 2.9)), m.point("P", (1.8, 2.6))
    m.body("crank", [a, b])
    m.body("coupler", [b, c, p])
    m.angle("phi", at=a, to=b)
    if complete:
        m.body("rocker", [c, d])
    return m


def artists(figure, role):
    (axes,) = figure.axes
    return [x for x in axes.get_children() if x.get_gid() == role]


def test_a_mechanism_is_drawn_while_it_is_typed(tmp_path):
    figure = four_bar(complete=False).draw(path=tmp_path / "a.png")
    (crank,) = artists(figure, "bar")
    np.testing.assert_allclose(crank.get_xydata(), [[0, 0], [0, 1]])
    assert len(artists(figure, "plate")) == 1 and (tmp_path / "a.png").stat().st_size > 5000
    (axes,) = figure.axes
    assert axes.get_title("left").startswith("a <four-bar>: 2 degrees of freedom; phi, B.x, … may")
    m = four_bar()
    system = m.compile()
    for thing in (m, system):
        figure = thing.draw()
        assert figure.axes[0].get_title("left").startswith("a <four-bar>: 1 degree of freedom; phi, … may be driven")
        assert len(artists(figure, "bar")) == 2 and len(artists(figure, "arc")) == 2  # its arrow's line and head
    assert viz.draw(system, title="mine").axes[0].get_title("left") == "mine"


def test_a_drawing_needs_no_wide_numbers(monkeypatch):
    """A first line that was forgotten is told by compile(); the drawing is complete all the same."""
    wide = four_bar().draw().axes[0].get_title("left")
    with jax.enable_x64(False):
        with pytest.raises(nc.JaxncError, match="jax_enable_x64"):
            four_bar().compile()
        assert four_bar().draw().axes[0].get_title("left") == wide


def test_a_distance_along_a_guide_begins_somewhere():
    """The guide of a rolling disc is drawn near the disc; where its distance counts from is drawn, too."""
    figure = nc.library.rolling_disc().draw()
    (line,) = (x for x in artists(figure, "reference") if np.ptp(x.get_ydata()) == 0.0)
    np.testing.assert_allclose(line.get_xdata(), [0.0, 0.2], atol=1e-12)
    names = {x.get_text() for x in figure.axes[0].findobj(Text)}
    assert {"A", "s", "P3"} <= names


@pytest.mark.parametrize("on", [True, False])
def test_no_drawing_waits_for_the_collector_of_garbage(on):
    m, seen, was = nc.library.rssr(), [], gc.isenabled()
    gc.callbacks.append(lambda phase, info: seen.append(info["generation"]))
    (gc.enable if on else gc.disable)()
    try:
        picture = m._repr_html_()
        begun = list(seen)
        m.draw()._repr_png_()
        after = gc.isenabled()
    finally:
        gc.callbacks.pop()
        (gc.enable if was else gc.disable)()
    assert "<img" in picture and after is on
    assert len(begun) <= 2 and len(seen) <= 6  # begun and done once, when each is over


def test_what_is_missing_stands_in_the_heading():
    m = four_bar()
    m.point("Q", (1, 1))
    assert "point 'Q' belongs to no body" in m.draw().axes[0].get_title("left").replace("\n", " ")
    with pytest.raises(MechanismError, match="has no points"):
        nc.Mechanism("empty").draw()
    with pytest.raises(InputError, match=r"Mechanism.*System.*Motion.*int"):
        viz.draw(3)


def test_a_spatial_mechanism_is_drawn_as_typed():
    m = nc.library.rscr()
    figure = m.draw()
    assert any(x.get_text().startswith("RSCR: 1 degree of freedom") for x in figure.findobj(Text))


class Words(html.parser.HTMLParser):
    def __init__(self, text: str):
        super().__init__()
        self.tags, self.words = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.words += data


def test_things_show_themselves_in_notebooks(tmp_path):
    m = four_bar()
    system = m.compile()
    motion = nc.sweep(system, {"phi": np.linspace(1.0, 2.0, 5)})
    for thing, said in (
        (m, "1 degree of freedom"),
        (system, "inputs may be    phi"),
        (motion, "5 poses driven by phi"),
    ):
        page = Words(thing._repr_html_())
        assert said in page.words and "a <four-bar>" in page.words
        tags = [tag for tag, _ in page.tags]
        assert "svg" in tags and tags.count("text") == 6 and "script" not in tags  # five points and the angle
    assert "not complete" in Words(nc.Mechanism("empty")._repr_html_()).words
    several = nc.solve_position(system, {"phi": np.array([[1.0, 1.1], [1.2, 1.3]])})  # a batch is said in words
    assert "poses driven by phi" in Words(several._repr_html_()).words and "<svg" not in several._repr_html_()
    assert 'src="data:image/png;base64,' in nc.library.rscr().compile()._repr_html_()
    path = motion.to_html(tmp_path / "a.html")
    frame = dict(Words(path._repr_html_()).tags)["iframe"]
    assert frame["srcdoc"] == path.read_text() and "allow-scripts" in frame["sandbox"]
    film = motion.animate(tmp_path / "a.gif", frames=2)
    assert film.with_suffix(".gif") == tmp_path / "a.gif" and 'src="data:image/gif;base64,' in film._repr_html_()
    film.unlink()
    assert str(tmp_path) in film._repr_html_()


def test_showing_a_planar_mechanism_needs_no_plotting_library():
    code = (
        "import sys, jaxnc as nc\n"
        "m = nc.library.jansen_leg(); assert '<svg' in m._repr_html_() and '<svg' in m.compile()._repr_html_()\n"
        "assert 'matplotlib' not in sys.modules\n"
        "assert '<img' in nc.library.double_wishbone()._repr_html_()\n"  # in space neither what takes long to import
        "assert not {'scipy.spatial', 'jaxnc.dynamics.simulation'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120, env={**os.environ, "JAX_ENABLE_X64": "1"})


def test_reports_and_searches_show_themselves_too():
    m = four_bar()
    system = m.compile()
    path = nc.synthesis.PathGeneration(m, "P", [(1.0, 1.0), (1.2, 1.4), (0.8, 1.6)])
    motion = nc.sweep(system, {"phi": np.linspace(1.0, 2.0, 5)})
    design = Design(
        system, motion, motion, np.zeros(1), 0.25, 0.1, 0.2, np.zeros(3), np.zeros(3), "crank-rocker", 0.5, True,
        (4.0, 3.0), {"A-B": 1.0}, (), (), True, 0.0, 0.0, 3, "", 2,
    )  # fmt: skip
    found = nc.synthesis.Result(path, (design,), (), 3, 40, 0, None)
    front = nc.synthesis.Front(path, ("path", "size"), np.array([[0.25, 3.0]]), (design,), 3, 40, 0, 0)
    for thing, said, drawn in (
        (nc.mobility(system), "degrees of freedom 1", True),
        (nc.travel(system, "phi"), "phi turns fully", True),
        (nc.diagnose(system, {"phi": 1.0}), "a <four-bar> assembles at phi = 1", True),
        (nc.sensitivity(system, ["P"], {"phi": 1.0}), "sensitivity to", False),
        (found, "crank-rocker", True),
        (front, "the front is one point (path 0.25, size 3)", True),
        (nc.synthesis.Result(path, (), (), 3, 40, 0, None), "40 designs screened", True),
    ):
        text = thing._repr_html_()
        page = Words(text)
        tags = [tag for tag, _ in page.tags]
        assert said in page.words and ("svg" in tags) == drawn and len(text) < 30_000
        assert "script" not in tags and text.count("<div") == text.count("</div>")
        assert str(thing)  # plain text elsewhere
    assert Words(found._repr_html_()).words.count("converged") == 1


def test_a_simulation_shows_its_path_and_numbers():
    m = four_bar()
    for body in ("crank", "coupler", "rocker"):
        m.mass(body, 1.0, shape="plate" if body == "coupler" else "rod")
    run = nc.simulate(m.compile(), np.linspace(0, 0.1, 5), rates={"phi": 1.0}, method="rk4")
    page = Words(run._repr_html_())
    assert "constraintsmet to" in page.words and "0 s to 0.1 s" in page.words and "table" in dict(page.tags)
    assert sum(1 for tag, a in page.tags if tag == "path" and a.get("stroke-opacity") == "0.6") == 1  # that of P


def test_what_cannot_be_drawn_is_said_and_never_raised():
    several = nc.solve_position(four_bar().compile(), {"phi": np.array([[1.0, 1.1], [1.2, 1.3]])})
    assert "(not drawn: 'a <four-bar>': a batch of poses" in Words(several._repr_html_()).words

    class Broken(nc.kinematics.Mobility):
        def __str__(self):
            raise ValueError("no <words>")

    nothing: list[Any] = [""] * 14
    broken = Broken(*nothing)
    assert Words(broken._repr_html_()).words == "Broken: no <words>"


def test_drawings_take_their_file_first(tmp_path):
    """As sheets, films and pages do."""
    m = nc.library.four_bar()
    system = m.compile()
    for k, one in enumerate((m, system, nc.sweep(system, {"phi": [0.0, 0.1]}))):
        one.draw(tmp_path / f"{k}.svg")
        assert (tmp_path / f"{k}.svg").read_bytes().startswith(b"<?xml")
