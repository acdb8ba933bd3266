"""The notebook widget: what is dragged comes back, what Python assigns is shown; in a bare page and in JupyterLab.

Without Chromium or anywidget what needs them is skipped.
"""

import base64
import contextlib
import dataclasses
import importlib.util
import io
import json
import sys
import time

import numpy as np
import pytest
from pages import CHROMIUM, PATIENCE, Browser
from PIL import Image
from widget_cells import PAGE, Cell, jupyterlab

import jaxnc as nc
from jaxnc.viz.pages import widget as widget_module
from jaxnc.viz.pages.widget import edit_curve
from jaxnc.viz.poses import default_motion

THERE = importlib.util.find_spec("anywidget") is not None
needed = pytest.mark.skipif(not THERE, reason='no anywidget, so there are no widgets: pip install "jaxnc[widget]"')
driven = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium, so widgets are not tried in a browser")


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    started = Browser(tmp_path_factory.mktemp("chromium"))
    yield started
    started.close()


@pytest.fixture
def page(browser, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(PAGE)
    browser.open(path)
    browser.ask("Emulation.setDeviceMetricsOverride", width=1000, height=2200, deviceScaleFactor=1, mobile=False)
    return browser


@pytest.fixture(scope="module")
def four_bar():
    return nc.library.four_bar()


@pytest.fixture
def widget(four_bar):
    return nc.widget(four_bar, {"phi": np.linspace(0.0, 2 * np.pi, 73)}, trace="C")


def test_without_the_extra_it_says_what_to_install(four_bar, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    widget_module._class.cache_clear()
    with pytest.raises(nc.JaxncError, match=r'pip install "jaxnc\[widget\]"'):
        nc.widget(four_bar)


def test_what_is_not_driven_is_shown_as_far_as_it_goes(four_bar):
    system = four_bar.compile()
    whole = default_motion(system, None, {})
    assert whole.driven == ("phi",) and np.ptp(whole.asked) == pytest.approx(2 * np.pi) and int(whole.failures) == 0
    other = nc.library.four_bar(crank=0.08, rocker=0.04).compile()  # the input's link is the rocker now
    some = default_motion(other, None, {})
    limits = nc.travel(other, "phi")
    assert limits.lower < np.min(some.asked) and np.max(some.asked) < limits.upper and int(some.failures) == 0
    assert np.ptp(some.asked) == pytest.approx(0.998 * (limits.upper - limits.lower))
    assert default_motion(nc.library.five_bar().compile(), None, {}).asked.shape == (1, 2)
    with pytest.raises(nc.InputError, match="has its inputs already"):
        default_motion(whole, {"phi": [0.0, 1.0]}, {})


@pytest.mark.parametrize(("name", "freedoms"), [("double_wishbone", 3), ("pantograph", 2), ("rscr", 1)])
def test_what_is_driven_then_determines_the_motion(name, freedoms):
    motion = default_motion(
        getattr(nc.library, name)().compile(), None, {}
    )  # some of its first coordinates follow from others
    assert len(motion.driven) == freedoms and int(motion.failures) == 0


@needed
def test_what_python_assigns_is_checked(widget, four_bar):
    first = widget.system
    widget.inputs = {"phi": 2.0}
    np.testing.assert_allclose(widget.values["C"], nc.solve_position(first, {"phi": 2.0})["C"], rtol=0, atol=1e-14)
    assert list(widget.values) == ["phi", "C"]
    for wrong in ({"psi": 1.0}, {"phi": np.nan}, 3.0, None):
        with pytest.raises(nc.InputError, match="input"):
            widget.inputs = wrong
    for other in (nc.library.jansen_leg(), None):
        with pytest.raises(nc.InputError, match="needs a widget of its own"):
            widget.system = other
    stuck = first.replace({"rocker.C-D": 0.02})  # no crank any more: B and D are 0.1 m apart at least
    widget.system = stuck
    with pytest.raises(nc.AssemblyError):
        widget.inputs = {"phi": 0.0}
    assert widget.inputs == {"phi": 2.0} and widget.system is stuck
    widget.system, widget.inputs = first, {"phi": 0.0}
    widget.system = stuck  # not at this angle: where it is nearest to what is drawn
    b, d = (np.asarray(widget.pose[name]) for name in "BD")
    assert widget.inputs["phi"] != 0.0 and 0.1 - 1e-9 < np.hypot(*(b - d)) < 0.14
    widget.inputs = {"phi": 2.0}
    shorter = first.replace({"coupler.B-C": 0.11})
    heard = []
    widget.observe(lambda change: heard.append((change["name"], widget.values["C"])), names=["system", "inputs"])
    widget.system = shorter
    assert [name for name, _ in heard] == ["system"]
    np.testing.assert_allclose(heard[0][1], nc.solve_position(shorter, {"phi": 2.0})["C"], rtol=0, atol=1e-14)
    h = 1e-6
    ahead, behind = (
        nc.solve_position(shorter.replace({"rocker.C-D": 0.08 + s * h}), {"phi": 2.0})["C"] for s in (1, -1)
    )
    slope = widget.gradient("C")["C", "rocker.C-D"]
    np.testing.assert_allclose(slope, (np.asarray(ahead) - np.asarray(behind)) / (2 * h), rtol=1e-7)


@needed
def test_a_curve_is_pulled_by_the_least_change(four_bar):
    inputs = {"phi": np.linspace(0.0, 2 * np.pi, 73)}
    both = [nc.widget(four_bar, inputs, trace="C", free=free) for free in (None, ["D", "rocker.C-D", "coupler.B-C"])]
    for w in both:
        place = np.asarray(nc.solve_position(w.system, {"phi": 1.0})["C"]) + np.array([0.002, 0.004])
        found = w.pull("C", place, {"phi": 1.0})
        assert found is w.system and w.inputs == {"phi": 1.0}
        np.testing.assert_allclose(w.values["C"], place, rtol=0, atol=1e-9)
        assert int(nc.sweep(found, inputs).failures) == 0
    free, held = (w.system for w in both)
    assert [name for name in held.design_variables if not np.array_equal(held[name], w._first[name])] == [
        "D",
        "coupler.B-C",
        "rocker.C-D",
    ]
    # The more may change, the less each has to.
    change = [[np.linalg.norm(np.ravel(s[name] - w._first[name])) for name in s.design_variables] for s in (free, held)]
    assert 0.0 < np.linalg.norm(change[0]) < np.linalg.norm(change[1])
    before = free
    w = both[0]
    w.pull("C", (1.0, 1.0))  # beyond all reach: as far as all poses are kept
    assert int(nc.sweep(w.system, inputs).failures) == 0
    for wrong in ((1.0,), (np.nan, 0.0)):
        with pytest.raises(nc.InputError, match="a place of 'C' is 2 finite numbers"):
            w.pull("C", wrong)
    with pytest.raises(nc.InputError, match="no design variable 'Q'"):
        nc.widget(nc.library.four_bar(), inputs, trace="C", free=["Q"])
    bennett = nc.sweep(nc.library.bennett().compile(), {"phi": np.array([1.0, 1.1])})
    rigid = nc.widget(nc.library.parallelogram(), trace="E")  # a third crank
    with pytest.raises(nc.InputError, match="none of its dimensions can change alone"):
        rigid.pull("E", rigid.values["E"] + 0.01)
    with pytest.raises(nc.InputError, match=r"22 of 24.*cannot change alone"):
        edit_curve(bennett, bennett.system, "C", np.asarray(bennett["C"])[0] + 0.001, {"phi": 1.0})
    assert before is not w.system


def test_a_pull_follows_the_whole_curve_before_and_after_and_no_more(four_bar, monkeypatch):
    motion, asked = default_motion(four_bar.compile(), None, {}), []

    def solved(design, inputs, **options):
        asked.append(np.size(inputs["phi"]))
        return nc.solve_position(design, inputs, **options)

    monkeypatch.setattr("jaxnc.viz.pages.widget.solve_position", solved)
    goal = np.asarray(nc.solve_position(motion.system, {"phi": 1.0})["C"]) + np.array([0.002, 0.004])
    found = edit_curve(motion, motion.system, "C", goal, {"phi": 1.0})
    np.testing.assert_allclose(nc.solve_position(found, {"phi": 1.0})["C"], goal, rtol=0, atol=1e-9)
    assert [count for count in asked if count > 1] == [9, 9]


@needed
def test_a_target_becomes_a_search(widget):
    with pytest.raises(nc.InputError, match="there is no target"):
        widget.problem()
    angle = np.linspace(0.0, 2 * np.pi, 200)
    loop = np.stack([0.1 + 0.02 * np.cos(angle), 0.07 + 0.01 * np.sin(angle)], axis=1)
    widget._target = {"by": "page", "points": loop[:-3].tolist()}
    assert widget.target.shape == (24, 2) and widget._target["closed"]
    problem = widget.problem()
    assert problem.point == "C" and problem.closed and problem.target.shape == (24, 2)
    steps = np.hypot(*np.diff(np.vstack([widget.target, widget.target[:1]]), axis=0).T)
    np.testing.assert_allclose(steps, steps.mean(), rtol=2e-2)
    assert np.abs(np.hypot((widget.target[:, 0] - 0.1) / 0.02, (widget.target[:, 1] - 0.07) / 0.01) - 1.0).max() < 2e-3
    widget.target = loop[:40]
    assert not widget._target["closed"] and not widget.problem("B", closed=False).closed
    np.testing.assert_array_equal(widget.target, loop[:40])
    with pytest.raises(nc.InputError, match=r"array \(n, 2\)"):
        widget.target = np.zeros((3, 3))


def png(bundle) -> np.ndarray:
    """The picture beside a widget, ``(height, width, 3)``, and that the widget itself is there too."""
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    assert "application/vnd.jupyter.widget-view+json" in data and data["text/plain"].startswith("<Widget of")
    with Image.open(io.BytesIO(base64.b64decode(data["image/png"]))) as image:
        return np.asarray(image.convert("RGB")).astype(int)


@needed
def test_a_picture_is_stored_beside_a_widget(widget):
    """For readers of a notebook without a kernel: as it stands, in the plane and in space."""
    first = png(widget._repr_mimebundle_())
    assert 0.01 < np.mean(np.any(first < 200, axis=-1)) < 0.5  # something is on the paper
    np.testing.assert_array_equal(first, png(widget._repr_mimebundle_()))
    widget.inputs = {"phi": 2.0}
    moved = png(widget._repr_mimebundle_())
    assert not np.array_equal(moved, first)
    widget.system = widget.system.replace({"coupler.B-C": 0.13})
    assert not np.array_equal(png(widget._repr_mimebundle_()), moved)
    space = nc.widget(nc.library.rssr(), {"phi": np.linspace(0.0, 1.0, 5)})
    assert np.mean(np.any(png(space._repr_mimebundle_()) < 200, axis=-1)) > 0.01


KERNEL = all(importlib.util.find_spec(name) is not None for name in ("nbclient", "nbconvert", "ipykernel"))


@needed
@pytest.mark.slow
@pytest.mark.skipif(not KERNEL, reason="no nbclient, so notebooks are not stored: pip install jupyterlab ipykernel")
def test_a_stored_notebook_shows_the_picture_where_no_kernel_runs(tmp_path, monkeypatch):
    import nbclient
    import nbconvert
    import nbformat

    for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(tmp_path / name))
    code = "import jax\njax.config.update('jax_enable_x64', True)\nimport jaxnc as nc\nnc.widget(nc.library.four_bar())"
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code)])
    nbclient.NotebookClient(book, timeout=PATIENCE, kernel_name="python3", store_widget_state=False).execute()
    (output,) = book.cells[0].outputs
    picture = output["data"]["image/png"]
    png(output["data"])
    nbformat.validate(book)
    page, _ = nbconvert.HTMLExporter().from_notebook_node(book)
    assert f'src="data:image/png;base64,{picture.strip()}"' in page.replace("\n", "")


@needed
@driven
def test_what_is_dragged_comes_back(page, widget):
    cell = Cell(page, widget)
    heard = []
    widget.observe(lambda change: heard.append((change["name"], dict(widget.inputs))), names=["system", "inputs"])
    first = widget.system
    cell.pull("C", (-40.0, -15.0))
    assert {name for name, _ in heard} == {"inputs"} and widget.system is first
    q = cell.widget._now["q"]
    q[-1] += 2 * np.pi  # the page follows the angle; Python has it in the range of the motion
    assert heard[-1][1] == widget.inputs == {"phi": q[-1]} and 5.0 < q[-1] < 2 * np.pi - 0.05
    np.testing.assert_allclose(widget.pose.q, q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(nc.solve_position(first, widget.inputs)["C"], widget.values["C"], rtol=0, atol=1e-12)
    cell.run("$('shape').click()")
    cell.pull("C", (25.0, 20.0))
    assert heard[-2][0] == "system" or heard[-1][0] == "system"
    p = {name: np.asarray(widget.system[name]) for name in "ABCD"}
    for name, (a, b) in {"crank.A-B": "AB", "coupler.B-C": "BC", "rocker.C-D": "CD"}.items():
        assert float(widget.system[name]) == pytest.approx(np.hypot(*(p[b] - p[a])), abs=1e-12)
    assert float(widget.system["crank.A-B"]) == pytest.approx(0.04, abs=1e-12)
    assert abs(float(widget.system["coupler.B-C"]) - 0.12) > 1e-3
    q = np.array(widget._now["q"]) + np.append(np.zeros(8), 2 * np.pi)
    np.testing.assert_allclose(widget.pose.q, q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(nc.solve_position(widget.system, widget.inputs)["C"], q[6:8], rtol=0, atol=1e-12)
    cell.run("$('reset').click()")
    cell.exchange()
    assert widget.system is first


@needed
@driven
@pytest.mark.parametrize("mode", ["move", "shape"])
def test_a_joint_of_a_widget_stays_with_the_pointer_and_the_focus(page, mode):
    """With a guide, that is drawn anew, and Python that hears of every step."""
    cell = Cell(page, nc.widget(nc.library.slider_crank(), {"phi": np.linspace(0.0, 2 * np.pi, 37)}))
    cell.run(f"$('{mode}').click()")
    (x, y), gaps = cell.grip("C"), []
    ways = [(x - 2.0 * k, y) for k in range(13)]
    kinds = ["mousePressed", *["mouseMoved"] * 12, "mouseReleased"]
    for kind, at in zip(kinds, [*ways, ways[-1]], strict=True):
        page.ask("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", buttons=1, clickCount=1)
        cell.exchange()
        gaps.append(np.hypot(*np.subtract(cell.grip("C"), at)))
    assert max(gaps) < 1.5
    for k in range(1, 5):
        page.key("ArrowRight")
        cell.exchange()
        assert cell.run("root.activeElement.getAttribute('aria-label').slice(0, 2)") == "C:"
        np.testing.assert_allclose(cell.grip("C"), [ways[-1][0] + 6.0 * k, y], rtol=0, atol=1.5)
    assert (cell.widget.system is cell.widget._first) == (mode == "move")
    np.testing.assert_allclose(cell.widget.pose["C"], cell.widget._now["q"][8:10], rtol=0, atol=1e-9)


@needed
@driven
def test_what_python_assigns_is_shown(page, widget):
    cell = Cell(page, widget)
    widget.inputs = {"phi": 2.5}
    cell.exchange()
    assert "2.5000 rad" in cell.run("$('scalars').textContent")
    curve = cell.run("$('drawing').innerHTML")
    widget.system = widget.system.replace({"D": [0.11, 0.01], "coupler.B-C": 0.13})
    cell.exchange()
    assert cell.run("$('drawing').innerHTML") != curve
    c = widget.values["C"]
    row = cell.run("[...$('points').rows].find(r => r.textContent.startsWith('C')).textContent")
    assert row == f"C{c[0]:.5f}{c[1]:.5f}".replace("-", "−")
    assert cell.run("[...$('sizes').querySelectorAll('input[type=number]')].map(x => Number(x.value))") == [
        0.04,
        0.13,
        0.08,
    ]
    # Shown again, as in another cell, it begins where it is.
    again = Cell(page, widget, "second")
    assert again.run("[...$('points').rows].find(r => r.textContent.startsWith('C')).textContent") == row
    cell.run("$('undo').click()")
    cell.exchange()
    assert widget.system is widget._first


@needed
@driven
def test_a_curve_and_a_target_are_drawn_by_hand(page, widget):
    cell = Cell(page, widget)
    first, (x, y) = widget.system, cell.curve(0.03)
    cell.drag([(x, y), (x + 2.0, y - 6.0), (x + 4.0, y - 12.0), (x + 4.0, y - 12.0)])
    assert widget.system is not first and widget._now["by"] == "python"
    moved = widget.values["C"] - np.asarray(nc.solve_position(first, widget.inputs)["C"])
    pixels = np.subtract(cell.grip("C"), cell.grip("B"))
    size = np.hypot(*(widget.values["C"] - np.asarray(widget.pose["B"]))) / np.hypot(*pixels)  # of a pixel now
    np.testing.assert_allclose(widget.values["C"], widget._pull["place"], rtol=0, atol=1e-9)
    assert moved[1] > 6.0 * size and not cell.run("$('undo').disabled")
    cell.run("$('pen').click()")
    x, y = 200.0, 300.0
    cell.drag([(x + 60 * np.cos(a), y + 40 * np.sin(a)) for a in np.linspace(0.0, 6.0, 30)])
    assert widget.target.shape == (24, 2) and widget._target["closed"]
    assert cell.run("root.querySelector('.goal').getAttribute('d').endsWith('Z')")
    low, high = widget.target.min(axis=0), widget.target.max(axis=0)
    np.testing.assert_allclose((high - low) / [120.0, 80.0], size, rtol=0.05)
    widget.target = None
    cell.exchange()
    assert cell.run("root.querySelector('.goal').getAttribute('d')") == ""
    assert cell.run("$('pen').getAttribute('aria-pressed')") == "false"


@needed
@driven
def test_two_widgets_and_the_notebook_leave_one_another_alone(page, widget, four_bar):
    cell, other = Cell(page, widget), Cell(page, nc.widget(nc.library.slider_crank()), "second")
    before = other.run("$('drawing').innerHTML")
    assert cell.run("$('play').getBoundingClientRect().width") < 120.0 and cell.run("$('drawing').clientHeight") > 200.0
    cell.pull("C", (-30.0, 0.0))
    page.key("ArrowRight")
    assert other.run("$('drawing').innerHTML") == before and other.exchange() == 0
    assert cell.run("root.host.dataset.look") == "light"
    grey, none = "rgb(204, 204, 204)", "transparent"  # where nothing is painted behind, letters tell
    seen = [(none, grey, "dark"), (none, "black", "light"), ("#111111", "black", "dark")]
    for colour, ink, look in [*seen, ("oklch(0.97 0 0)", grey, "light"), ("rgb(20 20 30)", "", "dark")]:
        page.run(f"Object.assign(document.body.style, {{ backgroundColor: {colour!r}, color: {ink!r} }})")
        end = time.monotonic() + PATIENCE
        while cell.run("root.host.dataset.look") != look:
            assert time.monotonic() < end, f"it is not {look} on {colour}"
            page.frame()
    assert cell.run("getComputedStyle(root.host).backgroundColor") == "rgb(15, 18, 22)"
    # VS Code says what its theme is, and paints white behind widgets whatever it is.
    page.run("document.body.style.backgroundColor = 'white'")
    cell.run("root.host.parentElement.className = 'cell-output-ipywidget-background'")
    for kind, look in (("contrast-light", "light"), ("dark", "dark"), ("light", "light"), ("contrast", "dark")):
        page.run(f"document.body.dataset.vscodeThemeKind = 'vscode-{kind.replace('contrast', 'high-contrast')}'")
        end = time.monotonic() + PATIENCE
        while cell.run("root.host.dataset.look") != look:
            assert time.monotonic() < end, f"it is not {look} where VS Code's theme is {kind}"
            page.frame()
    assert cell.run("root.host.parentElement.style.background") == "none"
    # Keys that a notebook takes for commands stay in the widget, those of the editor round it do not.
    page.run("window.heard = []; document.addEventListener('keydown', event => heard.push(event.key))")
    event = "new KeyboardEvent('keydown', { ...key, bubbles: true, composed: true })"
    pressed = f"key => root.querySelector('svg').dispatchEvent({event})"
    keys = "[{ key: 'd' }, { key: 'ArrowLeft' }, { key: 'F1' }, { key: 'Escape' }, { key: 's', ctrlKey: true }]"
    cell.run(f"{keys}.forEach({pressed})")
    assert page.run("heard") == ["F1", "Escape", "s"]
    # A notebook that asks where to, as VS Code, has to see what is saved.
    seen = "event => { const link = event.composedPath().find(x => x.download); if (link) { event.preventDefault();"
    page.run(f"document.body.addEventListener('click', {seen} window.saved = link.download; }} }})")
    cell.run("$('csv').click()")
    assert page.run("saved") == "four-bar.csv" and cell.run("root.querySelector('a')") is None
    page.ask("Emulation.setDeviceMetricsOverride", width=390, height=900, deviceScaleFactor=1, mobile=False)
    page.frame()
    assert page.run("document.documentElement.scrollWidth") <= 390
    page.run("ends.first()")
    assert page.run("document.querySelectorAll('.jaxnc').length") == 1
    assert page.run("Object.values(models.first.heard).flat().length") == 0  # and nobody listens any more
    assert all(str(said).startswith("blob:") for said in page.said), page.said
    assert str(widget) == f"<Widget of 'four-bar' at phi = {widget.inputs['phi']:.6g}>"


@needed
@driven
def test_a_spatial_mechanism_is_moved_from_both_sides(page):
    m = nc.library.delta_robot()
    w = nc.widget(m, {name: np.linspace(0.0, 0.2, 5) + k / 10 for k, name in enumerate(("phi1", "phi2", "phi3"))})
    cell = Cell(page, w)
    cell.run("(s => { s.value = 3; s.dispatchEvent(new Event('input')); })($('slider'))")
    cell.exchange()
    assert w.inputs == {"phi1": pytest.approx(0.15), "phi2": pytest.approx(0.25), "phi3": pytest.approx(0.35)}
    np.testing.assert_allclose(w.pose.q, w._now["q"], rtol=0, atol=1e-12)
    w.system = w.system.replace({"A1": np.asarray(w.system["A1"]) + 0.01})
    w.inputs = {name: 0.05 for name in w.inputs}
    cell.exchange()
    row = cell.run("[...[...$('points').rows].find(r => r.textContent.startsWith('T')).cells].map(c => c.textContent)")
    shown = [float(x.replace("−", "-")) for x in row[1:]]
    np.testing.assert_allclose(shown, np.asarray(w.pose["T"]), rtol=0, atol=6e-5)
    assert all(str(said).startswith("blob:") for said in page.said), page.said


@needed
@driven
def test_a_length_of_a_spatial_mechanism_comes_back(page):
    w = nc.widget(nc.library.rssr(), {"phi": np.linspace(0.3, 1.3, 5)}, watch=["1", "2"])
    cell, first = Cell(page, w), w.system
    new = 1.02 * float(np.linalg.norm(np.asarray(first["2"]) - np.asarray(first["1"])))
    cell.run(f"(s => {{ s.value = {new!r}; s.dispatchEvent(new Event('change')); }})"
             "($('sizes').querySelectorAll('input[type=number]')[1])")  # fmt: skip
    cell.exchange()
    assert w.system is not first and w.inputs == {"phi": pytest.approx(0.3)}
    assert np.linalg.norm(w.values["2"] - w.values["1"]) == pytest.approx(new, rel=1e-12)
    there = nc.solve_position(w.system, {"phi": 0.3})
    found = np.array(w._now["q"])[:-2]  # but for the angles, of which one is counted from the drawing
    np.testing.assert_allclose(there.q[:-2], found, rtol=0, atol=1e-9)
    w.system = first
    cell.exchange()
    fields = cell.run("[...$('sizes').querySelectorAll('input[type=number]')].map(x => Number(x.value))")
    assert fields[1] == pytest.approx(new / 1.02, rel=1e-5)
    cell.run(f"(s => {{ s.value = {30 * new!r}; s.dispatchEvent(new Event('change')); }})"
             "($('sizes').querySelectorAll('input[type=number]')[1])")  # fmt: skip
    cell.exchange()
    assert "could not be assembled" in cell.run("$('banner').textContent") or w.system is first
    cell.run("$('reset').click()")
    cell.exchange()
    assert w.system is w._first


@needed
@driven
def test_what_cannot_calculate_is_shown_and_says_why(page, four_bar):
    motion = nc.sweep(four_bar.compile(), {"phi": np.linspace(0.0, 1.0, 11)})
    w = nc.widget(dataclasses.replace(motion, conditioning=None), trace="C")
    cell = Cell(page, w)
    assert "no inputs to drive" in cell.run("root.querySelector('.hint').textContent")
    cell.run("(s => { s.value = 7; s.dispatchEvent(new Event('input')); })($('slider'))")
    cell.exchange()
    assert w.inputs == {"phi": pytest.approx(0.7)}
    w.inputs = {"phi": 0.2}
    cell.exchange()
    assert cell.run("root.host.dataset.pose") == "2"
    for refused in (
        lambda: setattr(w, "system", motion.system.replace({"D": [0.11, 0.0]})),
        lambda: w.pull("C", (0, 0)),
    ):
        with pytest.raises(nc.InputError, match="is shown as it is"):
            refused()


LAB = all(importlib.util.find_spec(name) is not None for name in ("jupyterlab", "ipykernel"))
CELL = """import jax
jax.config.update("jax_enable_x64", True)
import numpy as np
import jaxnc as nc
heard = []
w = nc.widget(nc.library.four_bar(), {"phi": np.linspace(0.0, 2 * np.pi, 73)}, trace="C")
w.observe(lambda change: heard.append(change["name"]), names=["system", "inputs"])
w"""
BARS = """from jaxnc.progress import bar
with bar(3, "outer", "design") as outer, bar(2, "inner", leave=False) as inner:
    for k in range(3):
        outer.set_postfix_str(f"best error {3 - k} mm", refresh=False)
        outer.update()
        inner.update(k % 2)"""


@needed
@driven
@pytest.mark.slow
@pytest.mark.skipif(not LAB, reason="no JupyterLab, so widgets are not tried in it: pip install jupyterlab ipykernel")
def test_it_works_in_jupyterlab(tmp_path):
    (tmp_path / "chromium").mkdir()
    with (
        jupyterlab(tmp_path, CELL, "w", BARS) as address,
        contextlib.closing(Browser(tmp_path / "chromium")) as browser,
    ):
        browser.ask("Emulation.setDeviceMetricsOverride", width=1300, height=2200, deviceScaleFactor=1, mobile=False)
        browser.ask("Page.navigate", url=address)
        book = "window.jupyterapp?.shell?.currentWidget"

        def until(expression: str) -> None:
            end = time.monotonic() + PATIENCE
            while not browser.run(expression):
                assert time.monotonic() < end, f"never: {expression}\n{(tmp_path / 'lab.log').read_text()[-2000:]}"
                time.sleep(0.05)

        def execute(code: str) -> str:
            """What the notebook's kernel prints."""
            hear = "f.onIOPub = m => { out += m.content.text ?? m.content.evalue ?? ''; }"
            ask = f"{book}.sessionContext.session.kernel.requestExecute({{ code: {json.dumps(code)} }})"
            return browser.run(f"(async (f, out = '') => {{ {hear}; await f.done; return out; }})({ask})")

        until(f"{book}?.sessionContext?.session?.kernel?.status === 'idle'")
        browser.run("void jupyterapp.commands.execute('notebook:run-all-cells')")
        roots = "[...document.querySelectorAll('.jaxnc')].map(x => x.shadowRoot)"
        until(f"{roots}.filter(root => root.querySelector('.grip')).length === 2")  # two views of it
        results = "[...document.querySelectorAll('.jp-Cell:last-child .jp-OutputArea-output')]"
        until(f"{results}.map(x => x.textContent).join('').includes('100% 3/3')")  # bars have become a quiet line
        kinds, texts = browser.run(f"[{results}.map(x => x.dataset.mimeType), {results}.map(x => x.textContent)]")
        assert kinds == ["text/html"] * 2 and "best error 1 mm" in texts[0] and texts[1] == ""  # and no red stderr
        assert browser.run("document.querySelectorAll('progress').length") == 0
        cell = Cell.__new__(Cell)
        cell.browser, cell.root = browser, f"{roots}[0]"
        cell.exchange = browser.frame
        cell.pull("C", (-40.0, -15.0))
        browser.key("d", "d")  # with the widget in focus the notebook's own keys are not meant: twice deletes a cell
        browser.key("d", "d")
        shown = float(cell.run("$('driving').querySelector('input').value"))
        until(f"Number({roots}[1].querySelector('#driving input').value) === {shown}")  # the other view follows
        ask = "import json; print(json.dumps([w.inputs['phi'], w.values['C'].tolist(), heard]))"
        end, before = time.monotonic() + 9.0, None
        # What is dragged last is told when the kernel has taken what was told before, and may come while it answers:
        # two answers alike are of one moment.
        while (found := json.loads(execute(ask)))[0] != pytest.approx(shown, rel=1e-5) or found != before:
            assert time.monotonic() < end, f"never {shown} twice: {found}"
            before = found
        assert shown != 0.0 and set(found[2]) == {"inputs"}
        there = nc.solve_position(nc.library.four_bar().compile(), {"phi": found[0]})
        np.testing.assert_allclose(found[1], there["C"], rtol=0, atol=1e-12)
        execute("w.system = w.system.replace({'coupler.B-C': 0.13}); w.inputs = {'phi': 1.5}")
        until(f"{roots}.every(root => root.getElementById('scalars').textContent.includes('1.5000'))")
        sizes = cell.run("[...$('sizes').querySelectorAll('input[type=number]')].map(x => Number(x.value))")
        assert sizes == [0.04, 0.13, 0.08]
        cell.drag([cell.curve(0.02), np.add(cell.curve(0.02), [2.0, -10.0]).tolist()])
        until(f"{roots}[0].querySelector('#sizes input').value !== '0.04'")
        crank = json.loads(execute("print(json.dumps(float(w.system['crank.A-B'])))"))
        assert crank != 0.04
        browser.run("void jupyterapp.commands.execute('apputils:change-theme', { theme: 'JupyterLab Dark' })")
        until(f"{roots}.every(root => root.host.dataset.look === 'dark')")
