"""Widgets in front of a browser: a bare page that hands over what a notebook would, and JupyterLab itself."""

import contextlib
import json
import os
import secrets
import socket
import subprocess
import sys
import time
import urllib.request

from pages import PATIENCE, Browser

# A page with two places for widgets, a style that would spoil them, and what a notebook hands to a widget. Nothing may
# be loaded, no style may stand in the text; a widget's module comes as a blob, as anywidget has it.
PAGE = """<!DOCTYPE html><html><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline' blob:">
</head><body><div id="first"></div><div id="second"></div><script>
const spoiled = new CSSStyleSheet();
spoiled.replaceSync("button { width: 400px !important } svg { display: none !important } #stage { display: none }");
document.adoptedStyleSheets = [spoiled];
class Model {
  data = {}; heard = {}; sent = []; changed = {};
  get(name) { return this.data[name]; }
  set(name, value) { this.changed[name] = value; this.receive(name, value); }
  save_changes() { this.sent.push(this.changed); this.changed = {}; }
  on(name, f) { (this.heard[name] ??= []).push(f); }
  off(name, f) { this.heard[name] = this.heard[name].filter(g => g !== f); }
  receive(name, value) { this.data[name] = value; for (const f of this.heard["change:" + name] ?? []) f(); }
  take() { const sent = this.sent; this.sent = []; return sent; }
}
window.models = {}; window.ends = {};
window.show = async (text, data, place) => {
  const module = await import(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
  const model = models[place] = new Model();
  model.data = data;
  ends[place] = module.default.render({ model, el: document.getElementById(place) });
};
</script></body></html>"""
TOLD = ("_now", "_target")


class Cell:
    """A widget in the page; it and the one in Python tell each other what a notebook's server would."""

    def __init__(self, browser: Browser, widget, place: str = "first"):
        self.browser, self.widget, self.place = browser, widget, place
        self.root = f"document.querySelector('#{place} .jaxnc').shadowRoot"
        data = {name: getattr(widget, name) for name in TOLD}
        browser.run(f"show({json.dumps(widget._esm)}, {json.dumps(data)}, {place!r})")
        browser.frame()
        self.known = dict(data)

    def run(self, expression: str):
        """The value of an expression of `$`, which finds what has an id, and `root`."""
        return self.browser.run(f"((root, $) => {expression})({self.root}, id => {self.root}.getElementById(id))")

    def exchange(self) -> int:
        """Hand over what has been said, until nothing is; how many times the page spoke."""
        count = 0
        while True:
            self.browser.frame()
            sent = self.browser.run(f"models.{self.place}.take()")
            for changes in sent:
                for name, value in changes.items():
                    self.known[name] = value
                    setattr(self.widget, name, value)
            count += len(sent)
            news = [name for name in TOLD if getattr(self.widget, name) != self.known[name]]
            for name in news:
                self.known[name] = getattr(self.widget, name)
                self.browser.run(f"models.{self.place}.receive({name!r}, {json.dumps(self.known[name])})")
            if not sent and not news and self.run("root.host.dataset.busy") != "1":
                return count

    def grip(self, name: str) -> list[float]:
        found = f"[...root.querySelectorAll('.grip')].find(x => x.getAttribute('aria-label').startsWith('{name}:'))"
        return self.run(f"(b => [b.x + 15, b.y + 15])({found}.getBoundingClientRect())")

    def drag(self, ways: list[tuple[float, float]]) -> None:
        kinds = ["mousePressed", *["mouseMoved"] * (len(ways) - 1), "mouseReleased"]
        for kind, (x, y) in zip(kinds, [*ways, ways[-1]], strict=True):
            self.browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
            self.exchange()

    def pull(self, name: str, by: tuple[float, float]) -> None:
        x, y = self.grip(name)
        self.drag([(x + by[0] * k / 4, y + by[1] * k / 4) for k in range(5)])

    def curve(self, share: float) -> tuple[list[float], list[float]]:
        """A place on the traced curve, on the screen."""
        part = "[...$('drawing').querySelectorAll('path')].find(x => x.classList.contains('trail'))"
        spot = f"(p, r, q = p.getPointAtLength({share} * p.getTotalLength())) => [q.x + r.x, q.y + r.y]"
        return self.run(f"({spot})({part}, $('drawing').getBoundingClientRect())")


@contextlib.contextmanager
def jupyterlab(folder, *sources: str):
    """A server on this machine alone, with settings of its own and a notebook of cells; its address."""
    kind = {"cell_type": "code", "metadata": {}, "outputs": [], "execution_count": None}
    cells = [{**kind, "id": f"cell{k}", "source": source} for k, source in enumerate(sources)]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    book = {"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}
    (folder / "a.ipynb").write_text(json.dumps(book))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    own = ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR")
    paths = [os.getcwd(), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {name: str(folder / f".{name}") for name in own} | {"PYTHONPATH": os.pathsep.join(paths)}
    token = secrets.token_hex(16)
    options = (
        f"--ServerApp.port={port}",
        "--ServerApp.ip=127.0.0.1",
        f"--ServerApp.root_dir={folder}",
        f"--IdentityProvider.token={token}",
        "--LabApp.expose_app_in_browser=True",
        "--LabApp.news_url=None",
        "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
        "--allow-root",
        "--no-browser",
    )
    log = folder / "lab.log"
    with log.open("w") as out:
        command = [sys.executable, "-m", "jupyterlab", *options]
        lab = subprocess.Popen(command, env={**os.environ, **environment}, stdout=out, stderr=subprocess.STDOUT)
    try:
        address, end = f"http://127.0.0.1:{port}", time.monotonic() + PATIENCE
        while True:
            try:
                urllib.request.urlopen(f"{address}/api").close()
                break
            except OSError:
                assert time.monotonic() < end and lab.poll() is None, log.read_text()
                time.sleep(0.1)
        yield f"{address}/lab/tree/a.ipynb?token={token}"
    finally:
        lab.terminate()
        lab.wait(timeout=PATIENCE)
