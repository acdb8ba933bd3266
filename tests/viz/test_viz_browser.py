"""Pages in a real browser: they load without a word on the console, and what one does to them changes the picture.

Without Chromium these tests are skipped.
"""

import time

import jax.numpy as jnp
import numpy as np
import pytest
from pages import CHROMIUM, PATIENCE, Browser

import jaxnc as nc
from jaxnc import viz
from jaxnc.system.assemble import assemble

pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="no Chromium, so pages are not tried in a browser: apt-get install chromium (Debian), or set CHROMIUM",
)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    started = Browser(tmp_path_factory.mktemp("chromium"))
    yield started
    started.close()


NASTY = 'A</script><script>document.title="broken"</script> & $x_1$ {{DATA}} <b>'
POINT = "</td></script><b>&{{DATA}}"  # names of points have no spaces


def turned(m: nc.Mechanism, angles: np.ndarray, places) -> nc.Motion:
    """A motion whose points are put where a function of the angle says; nothing is solved."""
    system = assemble(m)
    top = system.topology
    points = np.tile(np.asarray(system.parameters.points), (len(angles), 1, 1))
    for name, x in places(angles).items():
        points[:, top.points.index(name)] = x
    rest = len(top.coordinates) - points[0].size - len(top.scalars)
    q = [points.reshape(len(angles), -1), np.zeros((len(angles), rest)), angles[:, None]]
    if rest:
        q[1] = np.tile(np.asarray(system.parameters.vectors).reshape(-1), (len(angles), 1))
    zero = jnp.zeros(len(angles))
    status = jnp.zeros(len(angles), int)
    return nc.Motion(
        system,
        ("phi",),
        (),
        jnp.asarray(np.concatenate(q, axis=1)),
        (),
        jnp.asarray(angles)[:, None],
        status,
        zero,
        zero,
    )


@pytest.fixture(scope="module", params=["planar", "spatial"])
def page(request, tmp_path_factory):
    angles = np.linspace(0.0, 2 * np.pi, 13)
    if request.param == "planar":
        m = nc.Mechanism(NASTY)
        m.ground("O", (0, 0))
        m.point(POINT, (1, 0))
        m.body("crank", ["O", POINT])
        m.angle("phi", at="O", to=POINT)
    else:
        m = nc.Mechanism(NASTY, dim=3)
        m.ground("O", (0, 0, 0))
        m.ground_vector("v", (0, 0, 1))
        m.point(POINT, (1, 0, 0.5))
        m.body("crank", ["O", POINT], vectors=["v"])
        m.angle("phi", at="O", to=POINT, about="v")
    z = [0.5 + 0 * angles] if request.param == "spatial" else []
    motion = turned(m, angles, lambda a: {POINT: np.stack([np.cos(a), np.sin(a), *z], axis=1)})
    path = tmp_path_factory.mktemp("pages") / f"{request.param}.html"
    return request.param, viz.to_html(motion, path, trace=[POINT])


def changed(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the picture that is different."""
    return float(np.mean(np.any(np.abs(before - after) > 24, axis=-1)))


def crank(picture: np.ndarray) -> np.ndarray:
    """Middle of what is blue, the colour of the first body, ``(2,)``."""
    red, _, blue = np.moveaxis(picture, -1, 0)
    return np.argwhere(blue - red > 60).mean(axis=0)


def test_a_page_loads_in_silence_and_is_not_blank(browser, page):
    _, path = page
    browser.open(path)
    assert browser.run("document.title") == NASTY and browser.run("document.querySelector('h1').textContent") == NASTY
    assert POINT in browser.run("document.getElementById('points').textContent")
    picture = browser.picture()
    assert (picture == 255).all(axis=-1).mean() > 0.5  # paper
    assert 0.002 < np.mean(np.any(picture < 200, axis=-1)) < 0.4  # and something on it
    assert browser.said == []


def test_the_slider_moves_the_mechanism(browser, page):
    _, path = page
    browser.open(path, "#3")
    assert browser.run("document.documentElement.dataset.pose") == "3"
    before = browser.picture()
    move = "slider.value = 9; slider.dispatchEvent(new Event('input', { bubbles: true }))"
    browser.run(f"{{ const slider = document.getElementById('slider'); {move}; }}")
    browser.frame()
    after = browser.picture()
    assert browser.run("document.getElementById('count').textContent") == "9 / 12"
    assert changed(before, after) > 0.002
    assert np.linalg.norm(crank(before) - crank(after)) > 20  # the crank is on the other side
    assert "4.7124 rad" in browser.run("document.getElementById('scalars').textContent")
    browser.key("ArrowLeft")
    assert browser.run("document.documentElement.dataset.pose") == "8"
    browser.key("Home")
    assert browser.run("document.documentElement.dataset.pose") == "0"
    assert browser.said == []


def test_it_plays_and_pauses(browser, page):
    _, path = page
    browser.open(path)
    browser.key(" ", " ")
    assert browser.run("document.getElementById('play').textContent") == "Pause"
    end = time.monotonic() + PATIENCE
    while browser.run("document.documentElement.dataset.pose") == "0":
        assert time.monotonic() < end, "it does not play"
        browser.frame()
    browser.key(" ", " ")
    stopped = browser.run("document.documentElement.dataset.pose")
    browser.frame()
    assert browser.run("document.documentElement.dataset.pose") == stopped
    assert browser.run("document.getElementById('play').textContent") == "Play"


def pendulum(length: float = 1.0) -> nc.dynamics.Simulation:
    m = nc.Mechanism("pendulum")
    m.ground("O", (0, 0))
    m.point("P", (length, 0))
    m.ground("Q", (length, 1))
    m.body("bar", ["O", "P"], mass=1.0)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -9.81)
    m.spring("coil", "P", "Q", stiffness=2.0)
    m.torque("brake", "phi", -0.3)
    t = np.concatenate([np.linspace(0.0, 0.5, 5), np.linspace(0.6, 1.2, 13)])  # not evenly
    return nc.simulate(m.compile(), t * length**0.5, method="rk4", step=0.02 * length)


def test_a_simulation_plays_by_the_clock_and_plots_its_energies(browser, tmp_path):
    run = pendulum()
    found = nc.reactions(run)
    plots = ("kinetic energy", "velocity phi", "load coil", "support O")
    path = run.to_html(tmp_path / "run.html", plots=plots, forces=found)
    browser.open(path, "#9")
    text = "document.getElementById('{}').textContent".format
    k, times = 9, np.asarray(run.time)
    assert browser.run(text("count")) == f"{times[k]:.4g} s"
    names = browser.run("[...document.getElementById('quantity').options].map(o => o.textContent)")
    assert names[1:7] == ["kinetic energy", "velocity of φ", "load coil", "support O", "support O, x", "support O, y"]
    pick = "{ const q = document.getElementById('quantity'); q.value = %d; q.dispatchEvent(new Event('change')); }"
    wanted = np.asarray(run.velocity("phi"))[k], np.asarray(found.support("O"))[k, 1]
    for name, value, unit in zip(("velocity of φ", "support O, y"), wanted, ("rad/s", "N"), strict=True):
        browser.run(pick % names.index(name))
        number, _, said = browser.run(text("reading")).replace("−", "-").partition(" ")
        assert said == unit and float(number) == pytest.approx(value, rel=1e-4)
    first = "document.querySelector('path[style*=\"{}: var(--reaction)\"]').getAttribute('d')".format
    foot, tip = (np.array(browser.run(first(part))[1:].split("L")[0].split(), float) for part in ("stroke", "fill"))
    ahead, force = (tip - foot) * (1, -1), np.asarray(found.support("O"))[k]
    np.testing.assert_allclose(ahead / np.hypot(*ahead), force / np.hypot(*force), atol=2e-3)
    browser.run("document.getElementById('forces').click()")
    assert browser.run(first("fill")) == ""
    browser.open(path)
    begin = time.monotonic()
    browser.key(" ", " ")
    while browser.run(text("play")) == "Pause":
        assert time.monotonic() < begin + PATIENCE, "it does not end"
        browser.frame()
    assert time.monotonic() - begin >= 1.1  # 1.2 s, in real time
    assert browser.run("document.documentElement.dataset.pose") == str(len(times) - 1)
    assert browser.said == []


@pytest.mark.parametrize("page", ["spatial"], indirect=True)
def test_two_fingers_zoom_and_one_turns(browser, page):
    _, path = page
    browser.open(path)
    first = browser.picture()
    browser.touch([[(300, 300)], [(380, 320)], []])
    assert changed(first, browser.picture()) > 0.005
    browser.run("document.getElementById('home').click()")
    browser.touch([[(300, 280), (400, 280)], [(280, 280), (400, 280)], [(280, 280), (430, 280)], []])
    larger = browser.picture()
    blue = [int(np.sum(x[..., 2] - x[..., 0] > 60)) for x in (first, larger)]
    assert blue[1] > 1.2 * blue[0]
    assert browser.said == []


@pytest.mark.parametrize("page", ["spatial"], indirect=True)
def test_a_spatial_page_turns_zooms_and_hides_names(browser, page):
    _, path = page
    browser.open(path, "#2")
    first = browser.picture()
    browser.drag((300, 300), (420, 340))
    turned_picture = browser.picture()
    assert changed(first, turned_picture) > 0.005
    browser.run("document.getElementById('home').click()")
    browser.frame()
    assert changed(first, browser.picture()) == 0.0
    x, y = 300, 300
    browser.ask("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-300)
    browser.frame()
    assert changed(first, browser.picture()) > 0.005
    browser.run("document.getElementById('home').click(); document.getElementById('names').click()")
    browser.frame()
    assert 0.0 < changed(first, browser.picture()) < 0.05
    browser.run("document.getElementById('names').click(); document.getElementById('drawing').focus()")
    browser.key("ArrowRight")  # with the drawing in focus the arrows turn it
    assert browser.run("document.documentElement.dataset.pose") == "2"
    assert changed(first, browser.picture()) > 0.005
    browser.key("0", "0")
    assert changed(first, browser.picture()) == 0.0
    for view in ("front", "side", "top"):
        browser.run(f"document.getElementById('{view}').click()")
        browser.frame()
        assert changed(first, browser.picture()) > 0.002
    assert browser.said == []


def test_traces_are_switched_in_the_page(browser, page):
    _, path = page
    browser.open(path)
    before = browser.picture()
    browser.run("document.querySelector('#points input').click()")
    browser.frame()
    assert changed(before, browser.picture()) > 0.0005
