"""Pages, read and driven: Chromium over a pipe with its own protocol (DevTools), with nothing beside it and no port."""

import base64
import io
import json
import os
import select
import shutil
import subprocess
import sys
import time

import numpy as np
from PIL import Image

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
        """Wait until the page has drawn what it was asked for: what it does before its next frame is done by then."""
        self.run("new Promise(done => requestAnimationFrame(() => done(1)))")

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


def unpacked(values, poses: int) -> np.ndarray:
    """Values over the poses of a page, NaN where there is none."""
    if isinstance(values, (int, float)):
        return np.full(poses, float(values))
    if "steps" not in values:
        return np.linspace(values["from"], values["to"], poses)
    out, ahead, step, place = [], [0] * values["order"], 0, 1
    for character in values["steps"]:
        digit = ord(character) - 63
        if digit < 0:
            out.append(np.nan)
            ahead = [0] * values["order"]
            continue
        step, place = step + digit % 32 * place, place * 32
        if digit < 32:
            whole, step, place = (-(step + 1) // 2 if step % 2 else step // 2), 0, 1
            for j in reversed(range(values["order"])):
                ahead[j] += whole
                whole = ahead[j]
            out.append(whole * values["quantum"])
    return np.array(out)
