"""Pages that calculate: their equations, their solver against the library's, and what one does to them.

Without Chromium what needs a browser is skipped.
"""

import dataclasses
import functools
import json
import time
from importlib.resources import files

import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import unreadable
from pages import CHROMIUM, PATIENCE, Browser, unpacked

import jaxnc as nc
from jaxnc import viz
from jaxnc.constraints.coordinates import from_drawing
from jaxnc.io.drives import sweep_arguments
from jaxnc.library.catalogue import CATALOGUE
from jaxnc.reading import Builder, function
from jaxnc.solvers.assembly import derive, to_host
from jaxnc.solvers.branch import page_numbers
from jaxnc.viz.pages import page
from jaxnc.viz.pages.content import pack, write_piece
from jaxnc.viz.pages.solver import FUNCTIONS, Refused, javascript, page_design, page_solver
from jaxnc.viz.poses import poses
from jaxnc.viz.quantities import forces_of, quantity
from jaxnc.viz.spatial.mesh import (
    Coil,
    Mesh,
    Ring,
    Shell,
    dashes,
    drum,
    in_units,
    join,
    reach,
    revolve,
    stand,
    tube,
    two_sided,
)

driven = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium, so pages are not tried in a browser")
TWO = ("add", "sub", "mul", "div", "lt", "le", "gt", "ge", "eq", "ne", "atan2", "pow", "rem", "max", "min")
ONE = (
    *(
        "sqrt",
        "abs",
        "sign",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "exp",
        "log",
        "log1p",
    ),
    *("expm1", "floor", "ceil", "round", "finite", "neg"),
)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    started = Browser(tmp_path_factory.mktemp("chromium"))
    yield started
    started.close()


@functools.cache
def swept(name: str) -> tuple[nc.Mechanism, nc.Motion]:
    """A mechanism of the library and the motion that is shown of it."""
    m = CATALOGUE[name]()
    return m, nc.sweep(m.compile(), **sweep_arguments(m), throw=False)


def text(browser: Browser, name: str) -> str:
    return browser.run(f"document.getElementById('{name}').textContent")


def grip(browser: Browser, name: str) -> list[float]:
    """Where a joint is on the screen."""
    found = f"[...document.querySelectorAll('.grip')].find(x => x.getAttribute('aria-label').startsWith('{name}:'))"
    return browser.run(f"(() => {{ const b = {found}.getBoundingClientRect(); return [b.x + 15, b.y + 15]; }})()")


def drag(browser: Browser, name: str, by: tuple[float, float]) -> None:
    x, y = grip(browser, name)
    ways = [(x + by[0] * k / 8, y + by[1] * k / 8) for k in range(9)]
    for kind, at in [("mousePressed", ways[0]), *(("mouseMoved", w) for w in ways[1:]), ("mouseReleased", ways[-1])]:
        browser.ask("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", buttons=1, clickCount=1)
        browser.frame()
    settled(browser)


def settled(browser: Browser) -> None:
    """Wait until all curves are drawn anew."""
    browser.frame()
    while browser.run("document.documentElement.dataset.busy") == "1":
        browser.frame()
    browser.frame()


def slide(browser: Browser, place: str, value: float) -> None:
    """Move a slider."""
    events = "for (const e of ['input', 'change']) s.dispatchEvent(new Event(e))"
    browser.run(f"{{ const s = document.querySelector('{place} input[type=range]'); s.value = {value}; {events}; }}")
    settled(browser)


def saved(browser: Browser, button: str) -> str:
    """What a button saves."""
    browser.run("URL.createObjectURL = blob => { window.kept = blob; return '#'; }")
    browser.run(f"document.getElementById('{button}').click()")
    return browser.run("window.kept.text()")


@driven
def test_every_operation_of_a_program_is_the_same_in_javascript(browser):
    b, rng = Builder(6), np.random.default_rng(0)
    shares = [b.op("lt", b.first[0], b.first[1]), b.op("ge", b.first[2], b.first[3])]
    outputs = []
    for k in range(6):
        outputs += [b.op(name, b.first[k], b.first[(k + 1) % 6]) for name in TWO]
        outputs += [b.op(name, b.first[k]) for name in ONE]
    for power in (-3, -1, 3, 4):
        outputs.append(b.op("power", b.first[4], value=power))
    for value in (0.5, 1.5, -2.5, 2.49, -0.5):
        outputs.append(b.op("round", b.op("sub", b.op("mul", b.first[0], b.number(0.0)), b.number(value))))
    outputs += [b.op("select", shares[0], b.first[2], b.first[3]), b.op("float", b.op("and", *shares))]
    outputs += [b.op("float", b.op("or", *shares)), b.op("float", b.op("not", shares[1])), b.op("neg", b.first[5])]
    outputs += [b.op("add", b.first[0], b.number(v)) for v in (float("inf"), -0.0, -2.0, 1e-300, 12345678.25)]
    program = b.program(outputs)
    body = javascript(program, lambda k: f"x[{k}]", lambda k: f"o[{k}]")
    for x in (rng.uniform(0.05, 0.95, 6), rng.uniform(-3.0, 3.0, 6)):
        with np.errstate(all="ignore"):
            wanted = np.array([float(v) for v in function(program)(list(x))])
        call = (
            f"(() => {{ {FUNCTIONS} const x = {x.tolist()}, o = []; {body}; return o.map(v => String(Number(v))); }})()"
        )
        found = np.array([float(v.replace("Infinity", "inf")) for v in browser.run(call)])
        np.testing.assert_allclose(found, wanted, rtol=1e-14, atol=0)


@driven
@pytest.mark.parametrize("name", CATALOGUE)
def test_the_solver_of_a_page_finds_the_poses_that_the_library_finds(browser, tmp_path, name):
    m, motion = swept(name)
    browser.open(viz.to_html(motion, tmp_path / "a.html", model=m))
    q, some = np.asarray(motion.q), np.arange(0, len(motion.status), 24)
    good = some[np.asarray(motion.converged)[some]]
    assert len(good) >= 5
    for k in good:
        found = browser.run(f"window.jaxnc.solve({np.asarray(motion.asked)[k].tolist()})")
        np.testing.assert_allclose(found, q[k], rtol=0, atol=1e-9)
    assert browser.said == []


@pytest.mark.parametrize("name", CATALOGUE)
def test_what_a_changed_drawing_says_is_what_the_library_reads_off_it(name):
    system = CATALOGUE[name]().compile()
    top, rng = system.topology, np.random.default_rng(3)
    found = page_design(top)
    par = system.parameters
    points = np.asarray(par.points) + 0.02 * rng.normal(size=par.points.shape)
    markers = np.asarray(par.markers) + 0.02 * rng.normal(size=par.markers.shape)
    dimensions = np.asarray(par.dimensions) * rng.uniform(0.97, 1.03, par.dimensions.shape)
    changed = {top.points[k]: p for k, p in enumerate(points)}
    vectors = np.asarray(par.vectors) + 0.02 * rng.normal(size=par.vectors.shape)
    changed |= {name: vectors[k] for k, name in enumerate(top.vectors)}
    changed |= {m.name: markers[k] for k, m in enumerate(top.markers)}
    changed |= {top.dimensions[k]: d for k, d in enumerate(dimensions)}
    eq = to_host(derive(system.replace(changed)))
    out = np.array([float(v) for v in function(found.program)([*eq.home, *markers.reshape(-1), *dimensions])])
    constants, scalars, coefficients, read = np.split(out, np.cumsum(found.outputs)[:-1])
    scale = float(eq.length)
    np.testing.assert_allclose(constants, np.array(eq.numbers)[list(found.constants)], rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(scalars, eq.home[len(eq.home) - len(scalars) :], rtol=0, atol=1e-14)
    np.testing.assert_allclose(coefficients, eq.markers.reshape(-1), rtol=0, atol=1e-14)
    for name, value in zip(top.dimensions, read, strict=True):
        body, _, key = name.rpartition(".")
        p, dash, q = key.partition("-")
        if dash:  # a length of a body: as it is drawn
            p, q = (points[top.points.index(x)] for x in (p, q))
            np.testing.assert_allclose(value, np.linalg.norm(q - p), rtol=1e-14)
        else:
            assert value == dimensions[top.dimensions.index(name)], body


@pytest.fixture(scope="module")
def four_bar(tmp_path_factory):
    m = nc.library.four_bar()
    u = np.linspace(0.0, 2 * np.pi, 73)
    motion = nc.sweep(m.compile(), {"phi": u}, rates={"phi": 2.0})
    return motion, viz.to_html(motion, tmp_path_factory.mktemp("live") / "a.html", trace="C", velocities="C", model=m)


def lengths(browser: Browser, system: nc.System) -> list[float]:
    """Of crank, coupler, rocker in the page's pose."""
    q = dict(zip(system.topology.coordinates, browser.run("window.jaxnc.design().q"), strict=True))
    p = {name: np.array([q[f"{name}.x"], q[f"{name}.y"]]) for name in "ABCD"}
    return [float(np.hypot(*(p[b] - p[a]))) for a, b in ("AB", "BC", "CD")]


@driven
def test_a_joint_that_is_dragged_takes_the_mechanism_along(browser, four_bar):
    motion, path = four_bar
    browser.open(path)
    x, y = grip(browser, "C")
    drag(browser, "C", (-60.0, -20.0))
    new = grip(browser, "C")
    assert abs(new[0] - (x - 60.0)) < 8.0 and new[1] < y + 1.0  # along its circle
    assert browser.run("document.documentElement.dataset.pose") == "73"  # between those of the motion
    np.testing.assert_allclose(lengths(browser, motion.system), [0.04, 0.12, 0.08], rtol=1e-12)
    slider = float(browser.run("document.querySelector('#driving input[type=range]').value"))
    phi = browser.run("window.jaxnc.design().q").pop()
    assert 0.0 <= slider <= 2 * np.pi and np.cos(slider - phi) == pytest.approx(1.0, abs=1e-9)
    assert browser.said == []


@driven
def test_links_are_reshaped_and_the_changed_model_is_that_of_the_page(browser, four_bar, tmp_path):
    motion, path = four_bar
    browser.open(path, "#9")
    before = browser.picture()
    browser.run("document.getElementById('shape').click()")
    drag(browser, "C", (30.0, 40.0))
    crank, coupler, rocker = lengths(browser, motion.system)
    assert crank == pytest.approx(0.04, abs=1e-12) and abs(coupler - 0.12) > 1e-3 and abs(rocker - 0.08) > 1e-3
    np.testing.assert_allclose(browser.run("window.jaxnc.design().dimensions"), [crank, coupler, rocker], rtol=1e-12)
    support = "document.querySelectorAll('#drawing > g > g')[1].innerHTML"
    stood = browser.run(support)
    drag(browser, "D", (10.0, 5.0))  # a point of the ground
    assert browser.run(support) != stood  # and what it stands on
    found = browser.run("window.jaxnc.solve([1.0])")
    model = tmp_path / "changed.json"
    model.write_text(saved(browser, "design"))
    again = nc.solve_position(nc.load(model).compile(), {"phi": 1.0})
    np.testing.assert_allclose(found, again.q, rtol=0, atol=1e-12)
    table = [line.split(",") for line in saved(browser, "csv").splitlines()]
    assert table[0][:4] == ["pose", "phi [rad]", "A.x [m]", "A.y [m]"] and len(table) == 74
    whole = nc.sweep(nc.load(model).compile(), {"phi": np.linspace(0.0, 2 * np.pi, 73)}, throw=False)
    at = table[0].index("C.x [m]")
    for row, place, good in zip(table[1:], np.asarray(whole["C"]), np.asarray(whole.converged), strict=True):
        assert not good or np.hypot(float(row[at]) - place[0], float(row[at + 1]) - place[1]) < 1e-9
    browser.run("document.getElementById('undo').click()")
    settled(browser)
    np.testing.assert_allclose(lengths(browser, motion.system), [crank, coupler, rocker], rtol=1e-9)
    browser.run("document.getElementById('reset').click()")
    browser.run("document.getElementById('move').click()")
    browser.run("{ const s = document.getElementById('slider'); s.value = 9; s.dispatchEvent(new Event('input')); }")
    settled(browser)
    assert np.mean(np.any(np.abs(before - browser.picture()) > 24, axis=-1)) < 1e-4
    assert "svg" in saved(browser, "picture")[:5] and browser.said == []


@driven
def test_a_length_is_set_as_far_as_the_mechanism_can_be_assembled(browser, four_bar):
    motion, path = four_bar
    browser.open(path, "#36")  # stretched crank: A-C is 0.08 + ... at most
    slide(browser, "#sizes .control:nth-child(2)", 0.1)
    np.testing.assert_allclose(lengths(browser, motion.system), [0.04, 0.1, 0.08], rtol=1e-9)
    slide(browser, "#sizes .control:nth-child(2)", 0.23)
    assert "could not be assembled" in text(browser, "banner")
    assert not browser.run("document.getElementById('banner').hidden")
    crank, coupler, rocker = lengths(browser, motion.system)
    assert (crank, rocker) == pytest.approx((0.04, 0.08), abs=1e-9)
    assert 0.2 < coupler < 0.22 + 1e-6  # B and D are 0.14 apart, and C is beyond D when all is stretched
    assert float(browser.run("document.querySelectorAll('#sizes input[type=number]')[1].value")) == pytest.approx(
        coupler, rel=1e-5
    )
    assert browser.said == []


@driven
def test_a_motion_of_two_turns_keeps_its_inputs_when_it_is_changed(browser, tmp_path):
    m = nc.library.gear_pair()
    motion = nc.sweep(m.compile(), **sweep_arguments(m))
    assert np.ptp(motion.asked) == pytest.approx(4 * np.pi)
    browser.open(viz.to_html(motion, tmp_path / "a.html", model=m), "#40")
    slide(browser, "#sizes .control:nth-child(1)", 0.15)
    settled(browser)
    assert browser.run("document.documentElement.dataset.pose") == "361"
    assert text(browser, "count") == "≈ 40 / 360"
    assert browser.run("window.jaxnc.askedOf(40)") == pytest.approx(np.asarray(motion.asked)[40], abs=1e-12)
    assert browser.run("document.querySelector('#driving input[type=number]').value") == f"{motion.asked[40, 0]:.6g}"
    there = nc.solve_position(motion.system, {"phi": float(motion.asked[40, 0])})["psi"]
    assert browser.run("window.jaxnc.design().q").pop() == pytest.approx(float(there), abs=1e-9)
    assert browser.said == []


@driven
def test_curves_of_a_changed_mechanism_are_no_chords(browser, tmp_path):
    """Of twelve steps: a crank's joint is drawn on the circle of its new length."""
    m = nc.library.four_bar()
    motion = nc.sweep(m.compile(), {"phi": np.linspace(0.0, 2 * np.pi, 13)})
    browser.open(viz.to_html(motion, tmp_path / "a.html", trace="B", model=m), "#3")
    slide(browser, "#sizes .control:nth-child(1)", 0.048)
    settled(browser)
    path = browser.run("document.querySelector('.trail').getAttribute('d')")
    x = np.array([place.split() for place in path[1:].split("L")], float)
    radius = np.hypot(*(x - (x.min(axis=0) + x.max(axis=0)) / 2).T)
    np.testing.assert_allclose(radius, radius.mean(), rtol=0, atol=0.02)  # pixels, of which hundredths are written
    assert len(x) > 48 and radius.mean() > 100
    steps = np.hypot(*np.diff(x, axis=0).T)
    assert (steps**2).max() < 8 * radius.mean() * 1.0  # no chord lies a pixel off its arc
    assert not browser.run("document.getElementById('banner').textContent")
    browser.run("document.getElementById('reset').click()")
    again = browser.run("document.querySelector('.trail').getAttribute('d')")
    assert again != path and browser.said == []


@driven
def test_a_dead_point_stops_the_input_and_is_said(browser, tmp_path):
    m = nc.library.four_bar()
    system = m.compile()
    start = nc.solve_position(system, {"phi": 1.0})
    c = np.asarray(start["C"])
    motion = nc.sweep(system, {"C.x": c[0] + np.linspace(0.0, -0.005, 5)}, start=start)
    browser.open(viz.to_html(motion, tmp_path / "a.html"))
    slide(browser, "#driving", float(c[0]) - 0.004)
    assert text(browser, "banner") == ""
    assert browser.run("window.jaxnc.solve([-0.2])") is None
    browser.run("{ const f = document.querySelector('#driving input[type=number]'); f.value = -0.2;"
                " f.dispatchEvent(new Event('change')); }")  # fmt: skip
    assert text(browser, "banner").startswith("Dead point: C.x stops at ")
    # The rocker's end is farthest left where crank and coupler lie in line: |AC| = 0.12 - 0.04.
    x = dict(zip(system.topology.coordinates, browser.run("window.jaxnc.design().q"), strict=True))
    assert np.hypot(x["C.x"], x["C.y"]) == pytest.approx(0.08, abs=1e-7)
    assert browser.said == []


@driven
def test_a_mechanism_of_two_inputs_leaves_the_dead_point_of_one(browser, tmp_path):
    """Boom and stick on two cylinders: where the first one's dead point is met, both go on by either hand."""
    m = nc.Mechanism("arm")
    for name, at in {"O": (0, 0), "P": (0.45, -0.35)}.items():
        m.ground(name, at)
    for name, at in {"Q": (1.9, 1.5), "T": (4.2, 1.4), "R": (2.3, 2.1), "U": (4.5, 2.1), "E": (3.6, -1.3)}.items():
        m.point(name, at)
    m.body("boom", ["O", "Q", "T", "R"])
    m.body("stick", ["T", "U", "E"])
    m.distance("c1", "P", "Q")
    m.distance("c2", "R", "U")
    system = m.compile()
    motion = nc.sweep(system, {"c1": np.linspace(2.3, 2.4, 5), "c2": np.linspace(2.6, 2.7, 5)}, start={"Q": (1.9, 1.5)})
    drawn = viz.to_html(motion, tmp_path / "a.html")
    browser.open(drawn)

    def now(name: str) -> float:
        return dict(zip(system.topology.coordinates, browser.run("window.jaxnc.design().q"), strict=True))[name]

    dead = np.hypot(1.9, 1.5) - np.hypot(0.45, 0.35)
    # Along the dead point, within rounding of it, steps stay short: a page answers all the same.
    for c1, c2 in ((2.3, 2.6), (dead + 1e-9, 2.6), (dead, 2.6), (dead - 1e-12, 2.601)):
        browser.run(f"window.jaxnc.solve([{c1}, {c2}]), 0")
    assert now("c1") == pytest.approx(dead, abs=1e-6)
    browser.open(drawn)
    assert browser.run("window.jaxnc.solve([1.5, 2.65])") is None  # beyond |OQ| - |OP|
    assert now("c1") == pytest.approx(dead, abs=1e-6)
    browser.run("window.jaxnc.fit(0)")
    drag(browser, "E", (10, 10))
    before = now("c1"), now("c2")
    drag(browser, "T", (30, -60))
    drag(browser, "T", (0, -60))
    assert now("c1") > before[0] + 1e-3 and text(browser, "banner") == ""
    drag(browser, "E", (40, 0))
    assert abs(now("c2") - before[1]) > 1e-3
    assert browser.run("window.jaxnc.solve([2.0, 2.6])") is not None
    assert browser.said == []


@driven
def test_a_field_that_is_emptied_changes_nothing_and_a_driven_place_is_one_column(browser, tmp_path):
    m = nc.library.slider_crank()
    system = m.compile()
    x = float(system["B"][0])
    motion = nc.sweep(system, {"B.x": np.linspace(x, 0.99 * x, 5)})
    browser.open(viz.to_html(motion, tmp_path / "a.html", model=m), "#2")
    before = browser.run("window.jaxnc.design().q")
    field = "const f = document.querySelector('#driving input[type=number]')"
    browser.run(f"{{ {field}; f.focus(); f.value = ''; f.dispatchEvent(new Event('change')); f.blur(); }}")
    settled(browser)
    assert browser.run("window.jaxnc.design().q") == before
    assert browser.run(f"(() => {{ {field}; return f.value; }})()") == f"{motion.asked[2, 0]:.6g}"
    (tmp_path / "a.csv").write_text(saved(browser, "csv"))
    np.testing.assert_allclose(nc.io.load_csv(tmp_path / "a.csv")["B"], motion["B"], atol=1e-7)
    assert browser.said == []


def enter(browser: Browser, place: str, value: float) -> None:
    """Type into the field of an input or a dimension."""
    field = f"const f = document.querySelector('{place} input[type=number]')"
    browser.run(f"{{ {field}; f.value = {value}; f.dispatchEvent(new Event('change')); }}")
    settled(browser)


@driven
@pytest.mark.parametrize("tie", ["gear", "relation"])
@pytest.mark.parametrize("start", [2.8, np.pi])  # half a turn is an edge: a drawing says one or the other
def test_a_saved_design_counts_turns_as_the_page_does(browser, tmp_path, tie, start):
    m = nc.Mechanism("pair")
    m.ground("A", (0, 0)), m.ground("B", (70, 0))
    m.point("P", (30 * np.cos(0.5), 30 * np.sin(0.5))), m.point("Q", (70 + 40 * np.cos(start), 40 * np.sin(start)))
    m.body("one", ["A", "P"]), m.body("two", ["B", "Q"]), m.angle("a", at="A", to="P"), m.angle("b", at="B", to="Q")
    m.gear("mesh", "a", "b", radii=(30, 40)) if tie == "gear" else m.relation("tie", {"a": 30.0, "b": 40.0})
    motion = nc.sweep(m.compile(), {"a": np.linspace(0.5, 0.5 + 4 * np.pi, 61)})
    path = viz.to_html(motion, tmp_path / "a.html", model=m)
    for a, radius in ((0.5, 40), (2.0, 40), (9.0, 40), (9.0, 42)):
        browser.open(path)
        enter(browser, "#driving", a)
        if radius != 40:  # the second wheel's, or the factor of its angle: the pose that is shown stays
            enter(browser, "#sizes .control:nth-child(2)", radius)
        file = tmp_path / "changed.json"
        file.write_text(saved(browser, "design"))
        there = nc.solve_position(nc.load(file).compile(), {"a": 0.7})
        b = start - 30 / 40 * (a - 0.5) - 30 / radius * (0.7 - a)
        np.testing.assert_allclose(there["Q"], [70 + 40 * np.cos(b), 40 * np.sin(b)], rtol=0, atol=1e-9)
    assert browser.said == []


@driven
@pytest.mark.parametrize("model", [False, True])
@pytest.mark.parametrize("driver", ["a", "b"])
@pytest.mark.parametrize("factors", [{"a0": 0.1, "a1": 0.5, "a2": 0.3, "a3": 0.0, "a4": 0.0}, {"a1": 0.5, "a2": 0.3}])
def test_what_follows_by_a_polynomial_keeps_its_zero(browser, tmp_path, driver, model, factors):
    """Changed, dragged and saved, b is a polynomial from where it was drawn, x being what a is from there."""
    m = nc.Mechanism("arm")
    m.ground("A", (0, 0)), m.point("B", (1, 0.2)), m.point("C", (1.8, 0.9)), m.body("upper", ["A", "B"])
    m.body("lower", ["B", "C"]), m.angle("a", at="A", to="B"), m.angle("b", at="B", to="C")
    kind = nc.constraints.CATALOGUE["joint that follows another"]
    m.constrain("law", kind, scalars=["b", "a"], constants=factors)
    a, b = np.arctan2(0.2, 1.0), np.arctan2(0.7, 0.8)
    motion = nc.sweep(
        m.compile(), {driver: {"a": a, "b": b + factors.get("a0", 0.0)}[driver] + np.linspace(0.0, 0.3, 13)}
    )
    browser.open(motion.to_html(tmp_path / "arm.html", model=m if model else None), "#9")
    enter(browser, "#sizes .control:nth-child(1)", 0.2)
    browser.run("document.getElementById('shape').click()")
    drag(browser, "C", (20, -10))
    file = tmp_path / "changed.json"
    file.write_text(saved(browser, "design"))
    changed = nc.load(file).compile() if model else motion.system.replace(json.loads(file.read_text()))
    at = changed.topology.position
    for x in (0.05, 0.3):
        rise = 0.2 + 0.5 * x if "a0" in factors else 0.2 * x  # the first factor was changed to 0.2
        wanted = {"a": a + x, "b": b + rise + 0.3 * x**2}
        found = nc.solve_position(changed, {driver: wanted[driver]})
        on_page = browser.run(f"window.jaxnc.solve([{wanted[driver]}])")
        for name, value in wanted.items():
            assert (float(found[name]), on_page[at[name]]) == pytest.approx((value, value), abs=1e-9)


@driven
def test_a_table_has_poses_to_the_last_digit(browser, tmp_path):
    m = nc.Mechanism("crank", length_unit="mm")
    m.ground("A", (0, 0)), m.point("B", (300, 400)), m.body("crank", ["A", "B"]), m.angle("phi", at="A", to="B")
    phi = np.linspace(0.0, 2 * np.pi, 41)
    browser.open(viz.to_html(nc.sweep(m.compile(), {"phi": phi}), tmp_path / "a.html", model=m))
    (tmp_path / "a.csv").write_text(saved(browser, "csv"))
    table = nc.io.load_csv(tmp_path / "a.csv")
    np.testing.assert_allclose(table["B"], 500 * np.stack([np.cos(phi), np.sin(phi)], axis=1), rtol=0, atol=1e-9)
    np.testing.assert_allclose(table["phi"], phi, rtol=0, atol=1e-11)  # twelve digits are written


@driven
def test_a_table_keeps_the_assemblies_of_the_motion(browser, tmp_path):
    poses = nc.modes(nc.library.four_bar().compile(), {"phi": 1.0}).poses
    browser.open(viz.to_html(poses, tmp_path / "a.html"))
    (tmp_path / "a.csv").write_text(saved(browser, "csv"))
    assert len(poses.status) == 2
    np.testing.assert_allclose(nc.io.load_csv(tmp_path / "a.csv")["C"], poses["C"], rtol=0, atol=1e-7)


@driven
def test_poses_that_a_changed_design_does_not_reach_show_its_ground(browser, four_bar):
    browser.open(four_bar[1])
    browser.run("document.getElementById('shape').click()")
    drag(browser, "D", (240, 0))
    ground = json.loads(saved(browser, "design"))["ground"]["D"]
    head, *rows = [line.split(",") for line in saved(browser, "csv").splitlines()]
    assert any(not row[head.index("B.x [m]")] for row in rows), "some poses fail"
    np.testing.assert_allclose([float(row[head.index("D.x [m]")]) for row in rows], ground[0], rtol=1e-9)
    assert all(row[head.index("phi [rad]")] for row in rows), "the input that was asked for stands"


@driven
def test_poses_that_only_a_changed_design_reaches_have_the_rates_that_were_asked_for(browser, tmp_path):
    m = nc.Mechanism("bars")
    m.ground("A", (0, 0)), m.ground("D", (4, 0)), m.point("B", (0, 2)), m.point("C", (3.3, 2.0))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"]), m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    phi = np.linspace(1.5, 3.1, 33)
    motion = nc.sweep(m.compile(), {"phi": phi}, rates={"phi": 10.0}, throw=False)
    assert not motion.converged[20]
    browser.open(motion.to_html(tmp_path / "bars.html"), "#3")
    enter(browser, "#sizes .control:nth-child(2)", 5.5)
    index = browser.run("[...document.getElementById('quantity').options].findIndex(o => o.text === 'speed of C')")
    browser.run(
        f"{{ const q = document.getElementById('quantity'); q.value = {index}; q.dispatchEvent(new Event('change')) }}"
    )
    posed(browser, 20)

    def place(angle: float) -> complex:
        """C where the circles about B and D meet."""
        d = 4 - 2 * np.exp(1j * angle)
        along = (5.5**2 - (0.7**2 + 2**2) + abs(d) ** 2) / (2 * abs(d))
        return 4 - d + d / abs(d) * (along + 1j * np.sqrt(5.5**2 - along**2))

    speed = 10 * abs(place(phi[20] + 1e-5) - place(phi[20] - 1e-5)) / 2e-5
    assert float(text(browser, "reading").split()[0]) == pytest.approx(speed, rel=1e-4)


@driven
def test_curves_have_a_cursor_and_are_read_in_degrees(browser, four_bar):
    motion, path = four_bar
    browser.open(path, "#18")
    assert text(browser, "reading") == f"{float(motion['C'][18, 1]):.5g} m"
    numbers = browser.run("[...document.querySelectorAll('#plot text')].map(x => x.textContent)")
    assert {"0.5π", "1.0π", "1.5π", "2.0π"} < set(numbers)  # and some on the other axis too
    assert sum("π" not in number and "[" not in number for number in numbers) >= 4
    index = browser.run("[...document.getElementById('quantity').options].findIndex(o => o.text === 'speed of C')")
    change = f"list.value = {index}; list.dispatchEvent(new Event('change'))"
    browser.run(f"{{ const list = document.getElementById('quantity'); {change}; }}")
    speed = float(np.hypot(*np.asarray(motion.velocity("C"))[18]))
    assert float(text(browser, "reading").split()[0]) == pytest.approx(speed, rel=1e-4)
    browser.run("document.getElementById('degrees').click()")
    assert "90.00°" in text(browser, "scalars") and "φ [°]" in text(browser, "plot")
    box = browser.run("(() => { const b = document.getElementById('plot').getBoundingClientRect();"
                      " return [b.x, b.y, b.width, b.height]; })()")  # fmt: skip
    browser.run("document.getElementById('plot').scrollIntoView()")
    top = browser.run("document.getElementById('plot').getBoundingClientRect().y")
    at = (box[0] + box[2] - 12.0, top + 40.0)
    browser.ask("Input.dispatchMouseEvent", type="mousePressed", x=at[0], y=at[1], button="left", clickCount=1)
    browser.ask("Input.dispatchMouseEvent", type="mouseReleased", x=at[0], y=at[1], button="left", clickCount=1)
    browser.frame()
    assert browser.run("document.documentElement.dataset.pose") == "72"
    assert browser.said == []


@driven
def test_joints_are_moved_by_keys_and_fingers(browser, four_bar):
    motion, path = four_bar
    browser.open(path, "#20")
    browser.run("document.querySelector('.grip[visibility=visible]').focus()")
    browser.key("ArrowLeft")
    assert browser.run("document.documentElement.dataset.pose") == "73"
    x, y = grip(browser, "B")
    browser.touch([[(x, y)], [(x + 12, y + 4)], [(x + 24, y + 10)], []])
    settled(browser)
    assert np.hypot(*np.subtract(grip(browser, "B"), (x, y))) > 8.0
    np.testing.assert_allclose(lengths(browser, motion.system), [0.04, 0.12, 0.08], rtol=1e-12)
    assert browser.said == []


PIXELS = 1.5  # by which a joint may lie beside the pointer that holds it


@pytest.fixture(scope="module")
def sliding(tmp_path_factory):
    """Pages of mechanisms whose guides, slots and plates are drawn anew when they change."""
    folder, out = tmp_path_factory.mktemp("sliding"), {}
    for name in ("slider-crank", "quick-return"):
        m = CATALOGUE[name]()
        given = sweep_arguments(m)
        motion = nc.sweep(m.compile(), **{**given, "inputs": {k: v[::5] for k, v in given["inputs"].items()}})
        out[name] = viz.to_html(motion, folder / f"{name}.html", model=m)
    return out


@pytest.fixture(params=["mouse", "finger"])
def hand(request, browser):
    """What joints are dragged with; a finger does it on a telephone."""
    if request.param == "finger":
        browser.ask("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=2, mobile=True)
        browser.ask("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
    yield request.param
    if request.param == "finger":
        browser.ask("Emulation.setTouchEmulationEnabled", enabled=False)
        browser.ask("Emulation.setDeviceMetricsOverride", width=1000, height=760, deviceScaleFactor=1, mobile=False)


def steps(browser: Browser, hand: str, ways):
    """Drag along places; the pointer is at each of them, and held, when it is given out."""
    kinds = ["Pressed", *["Moved"] * (len(ways) - 1)]
    try:
        for kind, (x, y) in zip(kinds, ways, strict=True):
            if hand == "mouse":
                more = {"type": f"mouse{kind}", "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1}
                browser.ask("Input.dispatchMouseEvent", **more)
            else:
                kind = "touchStart" if kind == "Pressed" else "touchMove"
                browser.ask("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y, "id": 0}])
            browser.frame()
            yield x, y
    finally:
        if hand == "mouse":
            x, y = ways[-1]
            browser.ask("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", clickCount=1)
        else:
            browser.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])


def posed(browser: Browser, pose: int) -> None:
    """Show a pose of the motion."""
    move = f"s.value = {pose}; s.dispatchEvent(new Event('input'))"
    browser.run(f"{{ const s = document.getElementById('slider'); {move}; }}")


@driven
@pytest.mark.parametrize(
    ("name", "joint", "mode"),
    [
        ("slider-crank", "B", "move"),
        ("slider-crank", "C", "move"),
        ("slider-crank", "B", "shape"),
        ("slider-crank", "C", "shape"),
        ("slider-crank", "A", "shape"),
        ("quick-return", "P2", "move"),
        ("quick-return", "P1", "shape"),
    ],
)
def test_a_joint_stays_under_the_pointer_that_drags_it(browser, sliding, hand, name, joint, mode):
    """Ten moves and more, with the mechanism drawn anew at each; the view stays where it is."""
    browser.open(sliding[name], "#12")
    browser.run("addEventListener('pointercancel', () => { window.cancelled = true; }, true)")
    browser.run(f"document.getElementById('{mode}').click()")
    start, along = grip(browser, joint), []
    for pose in range(12, 24):
        posed(browser, pose)
        along.append(grip(browser, joint))
    posed(browser, 12)
    settled(browser)
    aside = {"B": (1.5, 2.0), "A": (-1.0, -1.5), "P1": (-1.0, 1.5)}
    if mode == "move":
        ways = along
    elif joint == "C":  # along its guide, and off it, where it stays on it
        ways = [(start[0] + 1.5 * k, start[1] + 2.5 * k) for k in range(12)]
    else:
        ways = [(start[0] + aside[joint][0] * k, start[1] + aside[joint][1] * k) for k in range(12)]
    grounded = "G" if name == "slider-crank" else "A"
    still = grip(browser, grounded)
    for k, (x, y) in enumerate(steps(browser, hand, ways)):
        at = grip(browser, joint)
        if (joint, mode) == ("C", "shape"):
            y = start[1]
        assert np.hypot(at[0] - x, at[1] - y) < PIXELS, f"after {k} moves"
        assert np.hypot(*np.subtract(grip(browser, grounded), still)) < 0.1, f"the view moved after {k} moves"
    settled(browser)
    assert np.hypot(*np.subtract(grip(browser, grounded), still)) < 0.1
    assert np.hypot(*np.subtract(grip(browser, joint), at)) < 0.1
    assert not browser.run("window.cancelled") and browser.run("scrollY") == 0
    assert browser.said == []


@driven
@pytest.mark.parametrize("hand", ["finger"], indirect=True)
def test_a_finger_beside_the_joints_scrolls_the_page(browser, sliding, hand):
    browser.open(sliding["slider-crank"], "#12")
    box = json.loads(browser.run("JSON.stringify(document.getElementById('drawing').getBoundingClientRect())"))
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.92 * box["height"]
    for _ in steps(browser, hand, [(x, y - 20 * k) for k in range(12)]):
        pass
    end = time.monotonic() + PATIENCE
    while not browser.run("scrollY > 40"):
        assert time.monotonic() < end, "it does not scroll"
    assert browser.run("document.documentElement.dataset.pose") == "12"


@driven
@pytest.mark.parametrize("mode", ["move", "shape"])
def test_a_joint_keeps_the_focus_while_the_arrow_keys_move_it(browser, sliding, mode):
    browser.open(sliding["slider-crank"], "#12")
    browser.run(f"document.getElementById('{mode}').click()")
    browser.run("[...document.querySelectorAll('.grip')].find(x => x.ariaLabel.startsWith('C:')).focus()")
    held = "document.activeElement.ariaLabel.slice(0, 2)"
    before = grip(browser, "C")
    for k in range(1, 7):
        browser.key("ArrowLeft")
        settled(browser)
        assert browser.run(held) == "C:"
        np.testing.assert_allclose(grip(browser, "C"), [before[0] - 6.0 * k, before[1]], rtol=0, atol=PIXELS)
    assert browser.run("document.documentElement.dataset.pose") == "73" and browser.said == []


@driven
def test_the_view_changes_where_a_mechanism_has_left_it_and_the_pointer_has_gone(browser, sliding, hand):
    browser.open(sliding["slider-crank"], "#12")
    browser.run("document.getElementById('shape').click()")
    box = json.loads(browser.run("JSON.stringify(document.getElementById('drawing').getBoundingClientRect())"))
    x, y = grip(browser, "B")
    for k, at in enumerate(steps(browser, hand, [(x + 8.0 * k, y - 6.0 * k) for k in range(14)])):
        assert np.hypot(*np.subtract(grip(browser, "B"), at)) < PIXELS, f"after {k} moves"
    settled(browser)
    if hand == "mouse":  # it may take the joint again
        assert np.hypot(*np.subtract(grip(browser, "B"), at)) < PIXELS
        browser.ask("Input.dispatchMouseEvent", type="mouseMoved", x=at[0], y=box["y"] + box["height"] + 30.0)
        settled(browser)
    assert np.hypot(*np.subtract(grip(browser, "B"), at)) > 3.0  # all that it reaches is in the picture now
    for pose in range(0, 73, 6):
        posed(browser, pose)
        p = grip(browser, "C")
        assert 0 < p[0] - box["x"] < box["width"] and 0 < p[1] - box["y"] < box["height"]
    assert browser.said == []


@driven
def test_a_mechanism_that_is_moved_out_of_the_picture_is_fitted_in_again(browser, tmp_path, hand):
    m = nc.Mechanism("arm")
    m.ground("A", (0, 0)), m.point("B", (1, 0.2)), m.body("arm", ["A", "B"]), m.angle("phi", at="A", to="B")
    path = viz.to_html(nc.sweep(m.compile(), {"phi": np.linspace(0.1, 0.6, 9)}), tmp_path / "a.html")
    browser.open(path)
    box = json.loads(browser.run("JSON.stringify(document.getElementById('drawing').getBoundingClientRect())"))
    left, top, right, bottom = box["left"], box["top"], box["right"], box["bottom"]

    def seen() -> bool:
        x, y = grip(browser, "B")
        return left < x < right and top < y < bottom

    enter(browser, "#driving", -1.5)
    assert seen() and browser.run("window.jaxnc.design().q").pop() == -1.5
    browser.open(path)
    (x, y), (a, b) = grip(browser, "B"), grip(browser, "A")
    for k, _ in enumerate(steps(browser, hand, [(x, y), *((x - 8.0 * k, b + 40.0 * k) for k in range(1, 9))])):
        assert np.hypot(*np.subtract(grip(browser, "A"), (a, b))) < 0.1, f"the view moved after {k} moves"
    settled(browser)
    if hand == "mouse":
        browser.ask("Input.dispatchMouseEvent", type="mouseMoved", x=left + 9.0, y=bottom + 30.0)
        settled(browser)
    assert seen() and np.hypot(*np.subtract(grip(browser, "A"), (a, b))) > 1.0
    assert browser.said == []


@driven
@pytest.mark.parametrize("relative", [False, True])
def test_a_joint_at_full_reach_stays_nearest_to_the_pointer(browser, tmp_path, hand, relative):
    """Out of reach and round the circle: where the line to the pointer meets it."""
    m = nc.Mechanism("arm")
    m.ground("A", (0, 0)), m.point("B", (1.0, 0.6)), m.point("C", (1.7, -0.2))
    m.body("upper", ["A", "B"]), m.body("lower", ["B", "C"]), m.angle("a", at="A", to="B")
    m.angle("b", at="B", to="C", **({"start": "A"} if relative else {}))
    t, b = np.linspace(0.0, 6.0, 21), np.arctan2(-0.8, 0.7) - (np.arctan2(-0.6, -1.0) if relative else 0.0)
    motion = nc.sweep(m.compile(), {"a": np.arctan2(0.6, 1.0) + 0.3 * np.sin(t), "b": b + 0.3 * np.sin(1.5 * t)})
    browser.open(viz.to_html(motion, tmp_path / "a.html"))
    a, b, c = (np.array(grip(browser, name)) for name in "ABC")
    reach = (np.hypot(1.0, 0.6) + np.hypot(0.7, 0.8)) * np.hypot(*(b - a)) / np.hypot(1.0, 0.6)
    angles = np.arctan2(c[1] - a[1], c[0] - a[0]) + np.linspace(0.0, -0.6, 13)
    round_it = [a + 1.1 * reach * np.array([np.cos(x), np.sin(x)]) for x in angles]
    ways = [*(c + (round_it[0] - c) * k / 10 for k in range(10)), *round_it]
    for k, at in enumerate(steps(browser, hand, ways)):
        if k > 10:
            wanted = a + (at - a) * reach / np.hypot(*(at - a))
            assert np.hypot(*(grip(browser, "C") - wanted)) < PIXELS, f"after {k} moves"
    assert browser.said == []


@driven
def test_the_inputs_of_a_spatial_mechanism_are_moved(browser, tmp_path):
    m = nc.library.delta_robot()
    given = sweep_arguments(m)
    motion = nc.sweep(m.compile(), **{**given, "inputs": {k: v[::60] for k, v in given["inputs"].items()}})
    browser.open(viz.to_html(motion, tmp_path / "a.html", velocities=m.model.run.outputs[0], model=m))
    before, asked = browser.picture(), np.array(motion.asked)[0]
    slide(browser, "#driving", float(np.asarray(motion.asked)[3, 0]))
    assert np.mean(np.any(np.abs(before - browser.picture()) > 24, axis=-1)) > 0.002
    asked[0] = np.asarray(motion.asked)[3, 0]
    there = nc.solve_position(motion.system, dict(zip(motion.driven, asked, strict=True)))
    np.testing.assert_allclose(browser.run("window.jaxnc.design().q"), there.q, rtol=0, atol=1e-9)
    assert browser.said == []


@driven
@pytest.mark.parametrize(
    ("name", "ends", "by"),
    [
        ("rssr", ("1", "2"), "slider"),
        ("rssr", ("A", "1"), "field"),  # the crank, whose angle is counted from the drawing
        ("rssp", ("1", "2"), "slider"),
        ("double-wishbone", ("tie_outer", "tie_inner"), "field"),
        ("double-wishbone", ("tie_outer", "tie_inner"), "slider"),
        ("delta-robot", ("P1", "R1"), "field"),
    ],
)
def test_a_length_of_a_spatial_mechanism_is_changed(browser, tmp_path, name, ends, by):
    """One length is another then, all others are what they were, and poses are those of the library."""
    m = CATALOGUE[name]()
    system, given = m.compile(), sweep_arguments(m)
    motion = nc.sweep(system, **{**given, "inputs": {k: v[::12] for k, v in given["inputs"].items()}}, throw=False)
    start = int(np.flatnonzero(np.asarray(motion.converged))[3])
    model = m if by == "field" else None
    browser.open(viz.to_html(motion, tmp_path / "a.html", model=model), f"#{start}")
    top = system.topology
    at = [top.points.index(p) for p in ends]
    names = browser.run("[...document.querySelectorAll('#sizes label')].map(x => x.textContent)")
    (row,) = [k for k, text in enumerate(names) if text.split(" [")[0] == "–".join(ends)]
    was = float(browser.run(f"document.querySelectorAll('#sizes input[type=number]')[{row}].value"))
    drawn = np.asarray(system.parameters.points)
    assert was == pytest.approx(np.linalg.norm(drawn[at[1]] - drawn[at[0]]), rel=1e-5)
    new = 1.015 * was
    if by == "slider":
        slide(browser, f"#sizes .control:nth-child({row + 1})", new)
    else:
        field = f"document.querySelectorAll('#sizes input[type=number]')[{row}]"
        browser.run(f"{{ {field}.value = {new!r}; {field}.dispatchEvent(new Event('change')); }}")
        settled(browser)
    assert text(browser, "banner") == ""
    file = tmp_path / "changed.json"
    file.write_text(saved(browser, "design"))
    changed = nc.load(file).compile() if model else system.replace(json.loads(file.read_text()))
    points = np.asarray(changed.parameters.points)
    assert np.linalg.norm(points[at[1]] - points[at[0]]) == pytest.approx(new, rel=1e-12)
    # What is no input and counted from the drawing has its zero where the changed mechanism is drawn.
    counted = [k for k, (b, _) in enumerate(top.measures) if from_drawing(top.blocks[b].kind)]
    counted = [drawn.size + np.asarray(system.parameters.vectors).size + k for k in counted]
    counted = [k for k in counted if top.coordinates[k] not in motion.driven]
    gaps = []
    for asked in np.asarray(motion.asked)[:: max(1, len(motion.asked) // 6)]:
        found = browser.run(f"window.jaxnc.solve({asked.tolist()})")
        inputs = dict(zip(motion.driven, asked, strict=True))
        there = nc.solve_position(changed, inputs, hold=motion.held, throw=False)
        if found is None or not bool(there.converged):
            continue
        gap = np.array(found) - np.asarray(there.q)
        gaps.append(gap[counted])
        gap[counted] = 0.0
        np.testing.assert_allclose(gap, 0.0, rtol=0, atol=1e-9)
        # What the page says is right by itself: lengths of all rods are those of the first design but for the one.
        where = np.array(found)[: drawn.size].reshape(drawn.shape)
        for body in top.bodies:
            for i, j in zip(body.points[:-1], body.points[1:], strict=True):
                length, before = (float(np.linalg.norm(x[j] - x[i])) for x in (where, drawn))
                assert length == pytest.approx(new if {i, j} == set(at) else before, rel=1e-9)
    assert len(gaps) >= 4
    np.testing.assert_allclose(gaps, np.tile(gaps[0], (len(gaps), 1)), rtol=0, atol=1e-9)
    before = browser.picture()
    browser.run("document.getElementById('undo').click()")
    settled(browser)
    posed(browser, start)
    settled(browser)
    assert np.mean(np.any(np.abs(before - browser.picture()) > 24, axis=-1)) > 1e-4
    assert float(browser.run(f"document.querySelectorAll('#sizes input[type=number]')[{row}].value")) == was
    assert browser.said == []


def test_a_length_between_points_of_the_ground_is_no_link():
    """It would stay what it is, without a word."""
    m = CATALOGUE["double-wishbone"]()
    system, given = m.compile(), sweep_arguments(m)
    top = system.topology
    motion = nc.sweep(system, **{**given, "inputs": {k: v[::40] for k, v in given["inputs"].items()}})
    links = [{top.points[i] for i in link["points"]} for link in page_solver(poses(motion))[1]["links"]]
    assert {"lower_front", "lower_ball"} in links and {"lower_rear", "lower_ball"} in links
    assert {"lower_front", "lower_rear"} not in links and {"upper_front", "upper_rear"} not in links


@driven
def test_a_length_of_an_overconstrained_spatial_mechanism_does_not_change_alone(browser, tmp_path):
    m = nc.library.bennett()
    motion = nc.sweep(m.compile(), {"phi": np.linspace(0.5, 1.5, 6)})
    browser.open(viz.to_html(motion, tmp_path / "a.html"), "#2")
    q = browser.run("window.jaxnc.solve([0.9])")
    was = float(browser.run("document.querySelector('#sizes input').value"))
    slide(browser, "#sizes .control:nth-child(1)", 1.3 * was)
    assert "could not be assembled" in text(browser, "banner")
    np.testing.assert_allclose(browser.run("window.jaxnc.solve([0.9])"), q, rtol=0, atol=1e-6)
    assert "a pointer tells two of three directions" in browser.run("document.querySelector('.hint').textContent")
    assert browser.said == []


@driven
def test_angles_know_the_new_length_of_their_arm(browser, tmp_path):
    """Some equations of an angle hold the length of the link that it turns."""
    m = nc.Mechanism("crank")
    m.ground("A", (0, 0))
    m.ground("D", (0.1, 0))
    for name, place in {"B": (0.03, 0.03), "C": (0.11, 0.08)}.items():
        m.point(name, place)
    for name in ("AB", "BC", "CD"):
        m.body(name, list(name))
    m.angle("phi", at="A", to="B", form="cosine")
    motion = nc.sweep(m.compile(), {"phi": np.linspace(0.6, 1.0, 5)})
    browser.open(viz.to_html(motion, tmp_path / "a.html", model=m), "#2")
    slide(browser, "#sizes .control:nth-child(1)", 0.044)
    x = dict(zip(motion.system.topology.coordinates, browser.run("window.jaxnc.solve([0.7])"), strict=True))
    np.testing.assert_allclose([x["B.x"], x["B.y"]], [0.044 * np.cos(0.7), 0.044 * np.sin(0.7)], rtol=0, atol=1e-12)


@driven
def test_what_is_measured_along_a_link_knows_its_new_length(browser, tmp_path):
    """A distance along an arm whose second point goes away, and gears of which one radius grows, as saved."""
    m = nc.Mechanism("distance along an arm")
    m.ground("Q", (0, 0)), m.point("T", (2, 1)), m.ground("X", (1, 3)), m.body("arm", ["Q", "T"])
    m.angle("phi", at="Q", to="T"), m.distance("u", "Q", "X", along="T")
    gears = nc.library.gear_pair()
    for model, name, near in ((m, "u", 0.7), (gears, "psi", 2.0)):
        system = model.compile()
        motion = nc.sweep(system, {"phi": np.linspace(0.5, 0.9, 9)})
        browser.open(viz.to_html(motion, tmp_path / f"{name}.html", model=model))
        browser.run("""{ const f = document.querySelector('#sizes input[type=number]');
            f.value = 1.5 * f.value; f.dispatchEvent(new Event('change')); }""")
        settled(browser)
        path = tmp_path / f"{name}.json"
        path.write_text(saved(browser, "design"))
        changed, at = nc.load(path).compile(), system.topology.coordinates.index(name)
        for phi in (0.5, near):
            found = browser.run(f"[...window.jaxnc.solve([{phi}])]")[at]
            assert found == pytest.approx(float(nc.solve_position(changed, {"phi": phi})[name]), abs=1e-9)
    assert browser.said == []


@driven
def test_turns_that_gears_count_are_shown_as_they_are(browser, tmp_path):
    """Crank -20 degrees is no 340 degrees where a wheel turns by half of it."""
    m = nc.Mechanism("geared five-bar")
    (
        m.ground("A", (0, 0)),
        m.ground("E", (3, 0)),
        m.point("B", (0.5, 0)),
        m.point("D", (3, 0.5)),
        m.point("C", (1.7, 2.5)),
    )
    for name, ends in (("a", "AB"), ("b", "BC"), ("c", "CD"), ("d", "DE")):
        m.body(name, list(ends))
    m.angle("p1", at="A", to="B"), m.angle("p2", at="E", to="D"), m.gear("mesh", "p1", "p2", radii=(1.0, 2.0))
    system = m.compile()
    motion = nc.sweep(system, {"p1": np.radians(np.linspace(0, 720, 145))})
    browser.open(viz.to_html(motion, tmp_path / "geared.html", model=m))
    for degrees in (-20.0, 340.0):
        browser.run(f"""{{ const f = document.querySelector('#driving input[type=number]');
            f.value = {np.radians(degrees)}; f.dispatchEvent(new Event('change')); }}""")
        settled(browser)
        found = browser.run("window.jaxnc.design().q")
        right = nc.solve_position(system, {"p1": np.radians(degrees)})
        np.testing.assert_allclose(found, right.q, atol=1e-8)
        assert (
            browser.run("document.querySelector('#driving input[type=number]').value") == f"{np.radians(degrees):.6g}"
        )


@driven
def test_a_force_that_depends_on_time_is_found_at_the_time_itself(browser, tmp_path):
    m = nc.Mechanism("arm")
    m.ground("A", (0, 0)), m.point("B", (1, 0)), m.body("arm", ["A", "B"], mass=1.0), m.angle("phi", at="A", to="B")
    m.torque("motor", "phi", lambda t, state, p: 10 * jnp.sin(200 * t))
    time = 1000 + np.linspace(0, 1 / 3, 31)
    motion = nc.motion(m.compile(), {"phi": lambda t: t - 1000}, time)
    browser.open(viz.to_html(motion, tmp_path / "time.html", forces=True), "#7")
    browser.run(f"window.jaxnc.solve([{float(motion['phi'][7])!r}])")
    browser.frame()
    assert browser.run("window.jaxnc.plotted()['load motor']") == pytest.approx(10 * np.sin(200 * time[7]), abs=1e-8)


@driven
def test_a_saved_design_keeps_what_is_fixed_of_its_points(browser, tmp_path):
    m = nc.library.slider_crank(fixed_guide=True)
    motion = nc.sweep(m.compile(), {"phi": np.linspace(0.6, 1.0, 5)})
    browser.open(viz.to_html(motion, tmp_path / "a.html", model=m), "#2")
    slide(browser, "#sizes .control:nth-child(1)", 0.11)
    file = tmp_path / "changed.json"
    file.write_text(saved(browser, "design"))
    again = nc.load(file).compile()
    assert again.topology.fixed == motion.system.topology.fixed
    np.testing.assert_allclose(
        nc.solve_position(again, {"phi": 0.7}).q, browser.run("window.jaxnc.solve([0.7])"), rtol=0, atol=1e-12
    )


def test_what_a_page_cannot_calculate_it_shows_and_says_why(four_bar, tmp_path):
    motion = nc.sweep(unreadable().compile(), {"P.x": np.array([0.3, 0.4, 0.5])})
    with pytest.raises(Refused, match="kind 'loop' branches or loops"):
        page_solver(poses(motion))
    page = viz.to_html(motion, tmp_path / "a.html").read_text()
    assert "a page cannot calculate it" in page and 'id="move"' not in page and "const solver" not in page
    motion, _ = four_bar
    with pytest.raises(Refused, match="no inputs"):  # such as that of a simulation
        page_solver(poses(dataclasses.replace(motion, conditioning=None)))
    with pytest.raises(Refused, match="none to start from"):
        page_solver(poses(dataclasses.replace(motion, status=np.ones(73, int))))
    chain = nc.library.four_bar_chain(loops=60)
    motion = nc.sweep(chain.compile(), {"phi": np.array([1.0, 1.1])}, throw=False)
    with pytest.raises(Refused, match="more than a page solves for"):
        page_solver(poses(motion))


def loaded(dim: int = 2) -> nc.Mechanism:
    """A four-bar with masses of all sorts, springs and a load; or a crank in space."""
    m = nc.Mechanism("loaded", dim=dim)
    if dim == 3:
        m.ground("A", (0, 0, 0))
        m.ground_vector("v", (0, 0.6, 0.8))
        m.point("B", (0.3, 0.4, -0.3))
        m.body("crank", ["A", "B"], vectors=["v"], mass=2.0, com=(0.1, 0.2, 0.1), inertia=(0.1, 0.2, 0.15))
        m.angle("phi", at="A", to="B", about="v")
        m.gravity = (0, 0, -9.81)
        m.ground("S", (0.0, 0.0, 0.5))
        m.spring("coil", "S", "B", stiffness=300.0)
        return m
    m.ground("A", (0, 0))
    m.ground("D", (0.1, 0))
    for name, at in {"B": (0.02, 0.03), "C": (0.11, 0.08), "E": (0.05, 0.1)}.items():
        m.point(name, at)
    m.body("crank", ["A", "B"], mass=2.0, com=(0.012, 0.011), inertia=0.003)
    m.body("coupler", ["B", "C", "E"], mass=0.7, shape="plate")
    m.body("rocker", ["C", "D"], mass=0.5)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -9.81)
    m.spring("coil", "A", "E", stiffness=300.0)
    m.spring("bar", "phi", stiffness=0.02)
    m.force("push", "E", (10.0, 5.0))
    return m


TURNS = np.linspace(0.3, 6.0, 24)  # those of the page; the library is asked beside them


def forces(system: nc.System) -> tuple[np.ndarray, dict[str, float]]:
    """What the library finds in a pose that is none of the page's: the force on A, and all that is plotted."""
    motion = nc.sweep(system, {"phi": TURNS + 0.01}, rates={"phi": 20.0})
    data = poses(motion)
    found = {x.label: x for x in (quantity(data, name) for name in forces_of(data))}
    size = {name: x.values[9] if x.kind == "number" else np.linalg.norm(x.values[9]) for name, x in found.items()}
    return found["support A"].values[9], {name: float(x) for name, x in size.items()}


@driven
@pytest.mark.parametrize("dim", [2, 3])
def test_forces_are_found_between_poses_and_of_changed_dimensions(browser, tmp_path, dim):
    m = loaded(dim)
    system = m.compile()
    motion, between = nc.sweep(system, {"phi": TURNS}, rates={"phi": 20.0}), f"window.jaxnc.solve([{TURNS[9] + 0.01}])"
    browser.open(motion.to_html(tmp_path / "a.html", forces=True, model=m), "#9")
    browser.run(between)
    force, wanted = forces(system)
    found = browser.run("window.jaxnc.plotted()")
    assert "support A" in wanted and {name: found[name] for name in wanted} == pytest.approx(wanted, rel=1e-9)
    assert text(browser, "forces").strip() == "" and "given" not in browser.run("document.body.innerText")
    if dim == 3:  # masses do not go along with a changed length there, and nothing is told of forces
        slide(browser, "#sizes .control:nth-child(1)", 0.7)
        assert set(browser.run("window.jaxnc.plotted()").values()) == {None}
        assert "only with the dimensions as they were given" in text(browser, "controls")
        browser.run("document.getElementById('undo').click()")
        browser.run(between)
        found = browser.run("window.jaxnc.plotted()")
        assert {name: found[name] for name in wanted} == pytest.approx(wanted, rel=1e-9)
        assert browser.said == []
        return
    first = "document.querySelector('#drawing path[style*=\"{}: var(--reaction)\"]').getAttribute('d')".format
    foot, tip = (np.array(browser.run(first(d))[1:].split("L")[0].split(), float) for d in ("stroke", "fill"))
    ahead = (tip - foot) * (1, -1)
    np.testing.assert_allclose(ahead / np.hypot(*ahead), force / np.hypot(*force), atol=0.03)
    slide(browser, "#sizes .control:nth-child(2)", 1.06 * np.hypot(0.09, 0.05))
    browser.run("window.jaxnc.solve([1.0])")
    model = tmp_path / "changed.json"
    model.write_text(saved(browser, "design"))  # drawn in another pose: centres of mass and springs are the same
    browser.run(between)
    found, (_, changed) = browser.run("window.jaxnc.plotted()"), forces(nc.load(model).compile())
    assert {name: found[name] for name in wanted} == pytest.approx(changed, rel=1e-9)
    assert abs(changed["effort phi"] - wanted["effort phi"]) > 1e-3
    assert browser.said == []


def test_a_page_says_why_it_does_not_find_forces_again():
    m = loaded()
    m.friction("rub", coefficient=0.1, bodies=("crank", "coupler"), at="B", radius=0.005)
    motion = nc.sweep(m.compile(), {"phi": TURNS}, rates={"phi": 20.0})
    equations, given = page_solver(poses(motion), m, plotted=["effort phi"])
    assert "as it was given: friction depends on the forces" in given["unforced"] and "pushes(" not in equations


@driven
@pytest.mark.parametrize(
    ("name", "trace", "shown"),
    [
        ("quick-return", (), "P3.x"),
        ("pantograph", ("P", "Q"), "Q.y"),
        ("gear-pair", (), "ψ"),
        ("slider-crank", (), "C.x"),
    ],
)
def test_a_page_plots_first_what_is_looked_at(browser, tmp_path, name, trace, shown):
    """The ram and not the crank that drives it; what is traced, and no input over an input."""
    m = CATALOGUE[name]()
    given = sweep_arguments(m)
    motion = nc.sweep(m.compile(), **{**given, "inputs": {k: v[::24] for k, v in given["inputs"].items()}})
    browser.open(viz.to_html(motion, tmp_path / "a.html", trace=trace))
    assert browser.run("document.getElementById('quantity').selectedOptions[0].textContent") == shown


SMALL = 140_000  # bytes of a page
PROGRAM = {2: 61_500, 3: 65_500}  # bytes of its script as it stands in the page, without data and equations


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_page_is_small_and_its_program_too(tmp_path, name):
    m, motion = swept(name)
    assert len(motion.status) == 361
    text = viz.to_html(motion, tmp_path / "a.html", model=m).read_text()
    assert len(text.encode()) < SMALL
    equations, numbers = page_solver(poses(motion), m)
    assert written(text, equations) < PROGRAM[m.model.dim]
    assert json.loads(json.dumps(numbers, allow_nan=False))["names"] == list(motion.driven)


def written(text: str, equations: str) -> int:
    """Bytes of a page's script without a mechanism's equations."""
    program = text.split("<script>")[1].split("</script>")[0]
    assert equations in program
    return len(program.encode()) - len(equations.encode())


@pytest.mark.parametrize(("dim", "timed"), [(2, True), (3, True), (3, False)])
def test_the_program_of_a_page_with_forces_is_small_too(tmp_path, monkeypatch, dim, timed):
    """With everything that a page may have: forces that it finds, time, arrows, traces, centres of mass, assemblies."""
    m, made = loaded(dim), []
    parts = page.page_parts
    monkeypatch.setattr(page, "page_parts", lambda *args, **more: made.append(parts(*args, **more)) or made[-1])
    if timed:
        motion = nc.motion(m.compile(), {"phi": lambda t: 20.0 * t + 0.3}, np.linspace(0.0, 0.3, 20))
    else:
        motion = nc.sweep(m.compile(), {"phi": TURNS}, rates={"phi": 20.0})
    text = motion.to_html(tmp_path / "a.html", trace="B", velocities="B", forces=True, modes=True, model=m).read_text()
    (found,) = made
    without = {"MORE", *(("CLOCK",) if not timed else ()), ("CENTRES" if dim == 3 else "BACK")}
    assert {name for name, part in found.items() if not part} == without | ({"STILL"} if dim == 3 else set())
    assert written(text, found["EQUATIONS"]) < PROGRAM[dim]


def test_the_program_of_a_simulation_is_small_too(tmp_path):
    m = loaded()
    run = nc.simulate(m.compile(), np.linspace(0.0, 0.1, 6), method="rk4", step=0.005)
    text = run.to_html(tmp_path / "a.html", trace="E", forces=True).read_text()
    assert written(text, "") < PROGRAM[2]


FRAMES = """(async (x, y, count) => {
  const asked = window.requestAnimationFrame, next = () => new Promise(done => asked(done)), spent = [], gaps = [];
  window.requestAnimationFrame = f => asked(t => {
    const start = performance.now(); f(t); spent.push(performance.now() - start);
  });
  const joint = document.elementFromPoint(x, y), begin = joint.getAttribute("cx");
  let before = await next(), way = 0;
  for (let i = 1; i <= count; i++) {
    const clientX = x + 25 * Math.sin(i / 6), clientY = y + 12 * (1 - Math.cos(i / 6)), pointerId = window.held;
    joint.dispatchEvent(new PointerEvent("pointermove", { clientX, clientY, pointerId, buttons: 1, bubbles: true }));
    const t = await next();
    gaps.push(t - before); before = t; way = Math.max(way, Math.abs(joint.getAttribute("cx") - begin));
  }
  window.requestAnimationFrame = asked;
  return [spent, gaps, way];
})"""


@driven
@pytest.mark.parametrize(("make", "joint"), [("jansen_leg", "F"), ("four_bar_chain", "B8")])
def test_a_drag_is_drawn_as_often_as_is_asked(browser, tmp_path, make, joint):
    """While a joint is dragged, solving and drawing and all: of a Jansen leg, of 20 bars."""
    m = nc.library.jansen_leg() if make == "jansen_leg" else nc.library.four_bar_chain(9)
    motion = nc.sweep(m.compile(), **sweep_arguments(m))
    browser.open(
        viz.to_html(motion, tmp_path / "a.html", trace=joint, velocities="F" if make == "jansen_leg" else ()), "#120"
    )
    browser.run("addEventListener('pointerdown', event => { window.held = event.pointerId; }, true)")
    x, y = grip(browser, joint)
    browser.ask("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", buttons=1, clickCount=1)
    spent, gaps, way = browser.run(f"{FRAMES}({x}, {y}, 60)")
    browser.ask("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", buttons=1, clickCount=1)
    assert len(gaps) == 60 and len(spent) >= 30 and way > 5.0  # it was dragged, in pixels
    # The quickest frames, whatever else runs here: a tenth of the 16.7 ms that a screen gives.
    assert np.quantile(spent, 0.25) < 14.0
    assert browser.said == []


def test_a_page_tells_branches_apart_by_the_numbers_of_the_library(four_bar):
    numbers, script = page_numbers(), files("jaxnc.viz.pages").joinpath("solver.js").read_text(encoding="utf-8")
    assert not [name for name in numbers if f"{{{{{name}}}}}" not in script]
    parts = page.page_parts(four_bar[0], [], [], [], None, 30.0, None, None)
    assert {name: float(parts[name]) for name in numbers} == numbers


@driven
def test_a_page_makes_the_solids_that_the_library_makes(browser):
    text = files("jaxnc.viz.pages").joinpath("spatial.js").read_text()
    script = text[text.index("function solid(") : text.index("D.meshes = ")]
    profile = ((-1.0, 0.5), (0.0, 2.0), (1.0, 0.5))
    whole = join(
        tube(0.4, 3),
        stand(3.0, 1.9),
        Mesh((Shell(profile, 5),)),
        Mesh((Coil(2, 1.4, 0.5, 0.7),)),
        reach(0.2, 0.5),
        drum(-1.0, 1.0, 2.0, 4, prism=True),
    )
    flat = in_units(0.0, 1.0, 2.0), in_units(0.0, 2.0, 1.0), in_units(1.0, 0.0, 0.5)
    whole = join(
        whole, dashes(3), two_sided(flat), revolve((Ring(units=-0.5, radius=0.3), Ring(units=0.5, radius=0.3)), 40)
    )
    pieces = json.dumps([write_piece(x) for x in whole.pieces])
    run = f"(() => {{ const {{ max, cos, sin, PI }} = Math, turn = 2 * PI; {script} return solid({pieces}); }})()"
    found, made = browser.run(run), whole.polygons
    np.testing.assert_allclose(found["v"], made.vertices, rtol=0, atol=1e-5)
    assert [tuple(face) for face in found["f"]] == list(made.faces)
    assert [tuple(edge) for edge in found["e"]] == [(*edge[:4], int(edge[4])) for edge in made.edges]
    assert (found["fp"], found["ep"]) == (list(made.face_parts), list(made.edge_parts))
    assert found["parts"] == [int(part not in made.face_parts) for part in range(made.parts)] and found["shares"]


@pytest.mark.parametrize("order", range(4))
def test_values_are_packed_to_the_last_quantum(order):
    t, rng = np.linspace(0.0, 6.0, 200), np.random.default_rng(order)
    x = (t**order, 1e5 * np.sin(3.0 * t), rng.normal(size=200), np.where((t > 1) & (t < 2), np.nan, 40.0 * np.cos(t)))[
        order
    ]
    quantum = (1e-7, 1e-2, 1e-6, 10.0)[order]
    np.testing.assert_allclose(unpacked(pack(x, quantum), 200), x, rtol=0, atol=0.5000001 * quantum)


@driven
def test_without_scripts_the_still_is_there(browser, four_bar):
    _, path = four_bar
    browser.open(path)
    browser.ask("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.ask("Page.reload")
        look = "document.readyState + (document.querySelector('noscript svg path') !== null)"
        end = time.monotonic() + PATIENCE
        while browser.run(look) != "completetrue":
            assert time.monotonic() < end, "no still"
        assert browser.run("getComputedStyle(document.getElementById('controls')).display") == "none"
    finally:
        browser.ask("Emulation.setScriptExecutionDisabled", value=False)


@driven
def test_what_is_typed_far_off_or_is_no_number_says_what_is_so(browser, tmp_path):
    """The crank stops where coupler and rocker are in line, by the law of cosines, however far it was to go."""
    m = nc.library.four_bar(4.0, 3.0, 3.5, 3.0)
    system = m.compile()
    browser.open(nc.sweep(system, {"phi": np.linspace(0.5, 0.9, 9)}).to_html(tmp_path / "a.html", model=m))
    limit = np.arccos((4.0**2 + 3.0**2 - 6.5**2) / (2 * 4.0 * 3.0))
    for value in (1e3, 1e9):
        enter(browser, "#driving", value)
        x = dict(zip(system.topology.coordinates, browser.run("window.jaxnc.design().q"), strict=True))
        assert x["phi"] == pytest.approx(limit, abs=1e-6)
    assert text(browser, "banner").startswith("Dead point")
    browser.run("document.querySelector('#driving input[type=number]').select()")
    for key, typed in (("e", "e"), ("Enter", "\r")):
        browser.key(key, typed)
    left = browser.run("document.querySelector('#driving input[type=number]').value")
    assert float(left) == pytest.approx(limit, rel=1e-5) and text(browser, "banner") == "" and browser.said == []


@driven
def test_a_length_that_vanishes_is_not_taken(browser, tmp_path):
    m = nc.Mechanism("slider-crank", length_unit="mm")
    m.ground("A", (-4e3, 2e3)), m.point("B", (-3950, 2070)), m.point("C", (-3700, 2000), fixed="y")
    m.body("crank", ["A", "B"], lengths={("A", "B"): 86.0}), m.body("rod", ["B", "C"]), m.angle("phi", at="A", to="B")
    browser.open(nc.sweep(m.compile(), {"phi": np.linspace(0.9, 1.5, 9)}).to_html(tmp_path / "a.html", model=m))
    for row in (1, 2):  # a length that the model gives, and one of the drawing
        enter(browser, f"#sizes .control:nth-child({row})", 1e-300)
    file = tmp_path / "changed.json"
    file.write_text(saved(browser, "design"))
    assert nc.load(file).model.bodies["crank"].lengths == {"A-B": 86.0} and browser.said == []
    assert nc.solve_position(nc.load(file).compile(), {"phi": 1.2}).converged


@driven
def test_symbols_of_masses_stay_away_where_a_page_finds_no_forces(browser, tmp_path):
    m = nc.library.slider_crank(fixed_guide=True)
    m.mass("crank", 1.0, com=(0.05, 0.0), inertia=0.01)
    m.friction("rub", coefficient=0.1, joint="C", speed=1.0)
    m.gravity = (0, -9.81)
    motion = nc.sweep(m.compile(), {"phi": np.linspace(0.3, 6.0, 24)}, rates={"phi": 3.0})
    browser.open(motion.to_html(tmp_path / "a.html", forces=True, model=m), "#5")
    drag(browser, "B", (20, -10))
    assert browser.run("document.querySelectorAll('#drawing .mass[visibility=hidden]').length") == 1
    assert browser.said == []
