"""Pages in a real browser: they load without a word on the console, and what one does to them changes the picture.

Chromium is driven over a pipe with its own protocol (DevTools), so that nothing needs to be installed beside it and no
port is opened. Without Chromium these tests are skipped.
"""

import base64
import io
import json
import os
import select
import shutil
import subprocess
import sys
import time

import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

import jaxnc as nc
from jaxnc import viz
from jaxnc.system.assemble import assemble

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
CHROMIUM = os.environ.get("CHROMIUM") or next((path for name in NAMES if (path := shutil.which(name))), None)
PATIENCE = 60.0  # seconds for one answer; a busy machine starts a browser slowly
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--hide-scrollbars",
    "--proxy-server=127.0.0.1:9",  # nothing listens there: a page that wants the network would fail
    "--remote-debugging-pipe",
)
# Chromium reads commands from file 3 and answers on file 4.
LAUNCH = (
    "import os, sys; r, w = map(int, sys.argv[1:3]); os.dup2(r, 3); os.dup2(w, 4); os.execv(sys.argv[3], sys.argv[3:])"
)

pytestmark = pytest.mark.skipif(
    CHROMIUM is None,
    reason="no Chromium, so pages are not tried in a browser: apt-get install chromium (Debian), or set CHROMIUM",
)


class Browser:
    """A headless Chromium with one page."""

    def __init__(self, folder):
        assert CHROMIUM is not None
        commands, self.commands = self._pipe()
        self.answers, answers = self._pipe()
        command = [sys.executable, "-c", LAUNCH, str(commands), str(answers), CHROMIUM, *FLAGS]
        self.process = subprocess.Popen(
            [*command, f"--user-data-dir={folder}", "about:blank"],
            pass_fds=(commands, answers),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(commands)
        os.close(answers)
        self.rest, self.count, self.session, self.said = b"", 0, "", []
        try:
            target = self.ask("Target.createTarget", url="about:blank")["targetId"]
            self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            for domain in ("Page", "Runtime", "Log", "Network"):
                self.ask(f"{domain}.enable")
            self.ask("Emulation.setDeviceMetricsOverride", width=1000, height=760, deviceScaleFactor=1, mobile=False)
        except BaseException:
            self.close()
            raise

    @staticmethod
    def _pipe() -> tuple[int, int]:
        """A pipe whose ends are not 3 or 4, which they are about to be copied to."""
        low = [os.dup(0) for _ in range(2)]
        ends = os.pipe()
        for end in low:
            os.close(end)
        return ends

    def ask(self, method: str, **parameters):
        """Send a command and wait for its answer; what the page says meanwhile is kept."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.commands, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self.count:
                assert "error" not in answer, answer
                return answer["result"]
            self._note(answer)

    def _next(self) -> dict:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.answers], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"Chromium did not answer within {PATIENCE:g} s"
            more = os.read(self.answers, 1 << 16)
            assert more, "Chromium went away"
            self.rest += more
        line, self.rest = self.rest.split(b"\0", 1)
        return json.loads(line)

    def _note(self, event: dict) -> None:
        name, what = event.get("method"), event.get("params", {})
        if name in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded"):
            self.said.append(what)
        if name == "Network.requestWillBeSent" and not what["request"]["url"].startswith(("file:", "data:")):
            self.said.append(what["request"]["url"])

    def open(self, path, fragment: str = "") -> None:
        """Load a page and wait until it is there."""
        self.said = []
        self.ask("Page.navigate", url="about:blank")
        self.ask("Page.navigate", url=path.resolve().as_uri() + fragment)
        end = time.monotonic() + PATIENCE
        while self.run("document.readyState") != "complete" or not self.run("location.href").startswith("file:"):
            assert time.monotonic() < end, "the page did not load"
        self.frame()

    def run(self, expression: str):
        """The value of an expression in the page."""
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def frame(self) -> None:
        """Wait until the page has painted."""
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def key(self, name: str, text: str = "") -> None:
        """Press a key."""
        for kind in ("keyDown", "keyUp"):
            extra = {"text": text} if text and kind == "keyDown" else {}
            self.ask("Input.dispatchKeyEvent", type=kind, key=name, **extra)
        self.frame()

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag with the left button."""
        steps = [("mousePressed", start), ("mouseMoved", end), ("mouseReleased", end)]
        for kind, (x, y) in steps:
            self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
        self.frame()

    def touch(self, steps: list[list[tuple[float, float]]]) -> None:
        """Put fingers down, move them and lift them: where they are, step by step."""
        for k, fingers in enumerate(steps):
            kind = "touchStart" if k == 0 else "touchMove" if fingers else "touchEnd"
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(fingers)]
            self.ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        self.frame()

    def picture(self) -> np.ndarray:
        """The drawing as it is on the screen, ``(height, width, 3)``."""
        box = json.loads(self.run("JSON.stringify(document.getElementById('drawing').getBoundingClientRect())"))
        clip = {"x": box["x"], "y": box["y"], "width": box["width"], "height": box["height"], "scale": 1}
        data = self.ask("Page.captureScreenshot", clip=clip)["data"]
        with Image.open(io.BytesIO(base64.b64decode(data))) as image:
            return np.asarray(image.convert("RGB")).astype(int)

    def close(self) -> None:
        """End it, and wait for it."""
        try:
            self.session = ""
            self.ask("Browser.close")
        except (AssertionError, OSError):
            self.process.kill()
        self.process.wait(timeout=PATIENCE)
        os.close(self.commands)
        os.close(self.answers)


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


@pytest.mark.parametrize("page", ["spatial"], indirect=True)
def test_two_fingers_zoom_and_one_turns(browser, page):
    _, path = page
    browser.open(path)
    first = browser.picture()
    browser.touch([[(300, 300)], [(380, 320)], []])
    assert changed(first, browser.picture()) > 0.005
    browser.run("document.getElementById('reset').click()")
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
    browser.run("document.getElementById('reset').click()")
    browser.frame()
    assert changed(first, browser.picture()) == 0.0
    x, y = 300, 300
    browser.ask("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-300)
    browser.frame()
    assert changed(first, browser.picture()) > 0.005
    browser.run("document.getElementById('reset').click(); document.getElementById('names').click()")
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
