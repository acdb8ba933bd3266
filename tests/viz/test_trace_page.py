"""A page to draw curves on: its machines move as the library's, curves are drawn by mouse and finger, machines dragged.

Without Chromium these tests are skipped.
"""

import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from pages import CHROMIUM, PATIENCE, Browser
from tracing import shorten, small_atlas

import jaxnc as nc
from jaxnc.cli.main import main
from jaxnc.synthesis.tracing.atlas import ChainDesign
from jaxnc.synthesis.tracing.chains import KINDS, Chain, Hung
from jaxnc.synthesis.tracing.trace import curve_distance
from jaxnc.viz.pages.page import TraceServer

driven = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium, so pages are not tried in a browser")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """An atlas of a few thousand linkages."""
    with pytest.MonkeyPatch.context() as patch:
        yield small_atlas(patch, tmp_path_factory.mktemp("atlas"))


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    started = Browser(tmp_path_factory.mktemp("chromium"))
    yield started
    started.close()


@pytest.fixture(scope="module")
def page(small, tmp_path_factory):
    return nc.viz.trace_page(tmp_path_factory.mktemp("page") / "draw.html", small)


def read(machine):
    """A machine of the page, as the library has it."""
    chain = Chain(tuple(Hung(KINDS[kind], a, b) for kind, a, b in machine["dyads"]), machine["tracer"])
    numbers = (np.array(machine["sign"]), np.array(machine["design"]))
    return ChainDesign(
        chain, *numbers, complex(*machine["place"]), complex(*machine["factor"]), machine["begin"], machine["span"]
    )


def middle(browser, name):
    return browser.run(
        f"(() => {{ const b = document.getElementById('{name}').getBoundingClientRect(); "
        f"return [b.x + b.width / 2, b.y + b.height / 2]; }})()"
    )


def egg(browser, count=40, size=90.0, share=1.0):
    x, y = middle(browser, "pad")
    t = np.linspace(0.0, 2 * np.pi * share, count)
    return [(x + size * np.cos(a), y + 0.6 * size * np.sin(a) + 0.1 * size * np.sin(2 * a)) for a in t]


def draw(browser, way):
    kinds = ["mousePressed", *["mouseMoved"] * (len(way) - 2), "mouseReleased"]
    for kind, (x, y) in zip(kinds, way, strict=True):
        browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
    browser.frame()


def wait(browser, condition):
    end = time.monotonic() + PATIENCE
    while not browser.run(condition):
        assert time.monotonic() < end, condition
        browser.frame()


@driven
def test_machines_appear_for_what_the_mouse_draws(browser, page):
    browser.open(page)
    assert page.stat().st_size < 350_000
    draw(browser, egg(browser))
    wait(browser, "document.querySelectorAll('#machines button').length === 8")
    machines = browser.run("jaxnc.machines().map(({card, nodes, joints, ...rest}) => rest)")
    target = np.array(browser.run("target")) * 1.0
    assert browser.run("closed") and browser.run("document.getElementById('closed').checked")
    line = np.vstack([target, target[:1]])
    size = np.sqrt(np.mean(np.sum((line - line.mean(axis=0)) ** 2, axis=1)))
    for k, machine in enumerate(machines[:3]):  # they are what the library says of them
        z = read(machine).trace(machine["begin"] + machine["span"] * np.linspace(0.0, 1.0, 65))
        np.testing.assert_allclose(
            np.array(browser.run(f"jaxnc.curveOf(jaxnc.machines()[{k}])")) @ [1, 1j], z, atol=1e-9
        )
        found = curve_distance(np.stack([z.real, z.imag], axis=1), line, 400) / size
        assert found == pytest.approx(machine["distance"], rel=0.1)
    assert machines[0]["distance"] < 0.25 and sorted(m["distance"] for m in machines) == [
        m["distance"] for m in machines
    ]
    assert not browser.said


@driven
def test_a_machine_is_dragged_and_another_chosen(browser, page):
    browser.open(page)
    draw(browser, egg(browser))
    wait(browser, "document.querySelectorAll('#machines button').length === 8")
    browser.run("document.querySelectorAll('#machines button')[1].click()")
    assert browser.run("jaxnc.chosen() === jaxnc.machines()[1]")
    spot = (
        "(b => [b.x + b.width / 2, b.y + b.height / 2])"
        "([...document.querySelectorAll('.grip')].filter(g => g.dataset.body === '1').at(-1).getBoundingClientRect())"
    )
    pivot = spot.replace(".at(-1)", "[0]")
    before, (x, y), (a, b) = browser.run("theta"), browser.run(spot), browser.run(pivot)
    arm = complex(x - a, y - b) * np.exp(0.4j)  # a part of a turn about the crank's pivot
    browser.drag((x, y), (a + arm.real, b + arm.imag))
    wait(browser, f"abs(theta - {before}) > 0.1")
    x, y = browser.run(spot)
    assert abs(complex(x - a, y - b) - arm) < 4.0  # pixels: the joint is where the pointer is
    assert not browser.said


@driven
def test_a_finger_draws_an_open_curve(browser, page):
    browser.open(page)
    way = egg(browser, share=0.5)
    browser.touch([*([at] for at in way), []])
    wait(browser, "document.querySelectorAll('#machines button').length === 8")
    assert not browser.run("closed") and browser.run("Math.abs(jaxnc.chosen().span)") < 6.2
    assert browser.run("jaxnc.machines()[0].distance") < 0.25
    x, y = middle(browser, "pad")
    browser.touch([[(x, y)], [(x + 2, y)], []])
    assert "no curve yet" in browser.run("document.getElementById('said').textContent")
    assert browser.run("document.querySelectorAll('#machines button').length") == 0  # those of the curve before
    draw(browser, way)
    wait(browser, "document.querySelectorAll('#machines button').length === 8")
    draw(browser, [(x, y), (x + 2, y), (x + 2, y)])
    assert browser.run("jaxnc.machines().length + document.querySelectorAll('#machines button').length") == 0
    assert not browser.said


@driven
def test_with_python_searches_follow(browser, small, monkeypatch):
    shorten(monkeypatch, steps=(8, 28, 60))
    with TraceServer(source=small, live=(1, 5)) as server:  # the first may be over with one round, which compiles
        server.source = nc.synthesis.Atlas({4: small.shelves[4]})  # searches by one program instead of three
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser.ask("Page.navigate", url=server.url)
        wait(browser, "document.readyState === 'complete' && 'jaxnc' in window")
        known = "jaxnc.machines()[0]?.distance"
        draw(browser, egg(browser))
        first = browser.run(known)
        wait(browser, "document.getElementById('said').textContent.includes('refined')")
        assert browser.run(known) < first and browser.run("jaxnc.machines()[0].links.length") == 2
        wait(browser, f"{known} < {0.5 * first}")
        model = urllib.request.urlopen(f"{server.url}0/0.toml").read().decode()
        assert "phi" in model and "[run" in model
        assert b"<svg" in urllib.request.urlopen(f"{server.url}0/0.html").read()
        for request in (
            urllib.request.Request(f"{server.url}0/99.toml"),
            urllib.request.Request(server.url, headers={"Host": "elsewhere.example:80"}),
            urllib.request.Request(f"{server.url}trace", b"[]", {"Content-Type": "application/json"}),
            urllib.request.Request(f"{server.url}trace", b"x=1"),
        ):
            with pytest.raises(urllib.error.HTTPError):
                urllib.request.urlopen(request)
        server.shutdown()


def test_the_command_writes_a_page(small, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("jaxnc.viz.pages.page.atlas", lambda count: small)
    assert main(["trace", "--page", str(tmp_path / "draw.html"), "--no-cache"]) == 0
    assert "needs no Python" in capsys.readouterr().out and (tmp_path / "draw.html").stat().st_size > 50_000
    assert main(["trace", "--no-cache"]) == 2 and "--page" in capsys.readouterr().err
