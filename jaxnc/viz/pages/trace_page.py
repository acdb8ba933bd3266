"""A page on which a curve is drawn and machines appear: of an embedded atlas, and with Python those of a search."""

import json
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, JaxncError, OutputError
from jaxnc.synthesis.tracing.atlas import Atlas, atlas
from jaxnc.synthesis.tracing.chains import KINDS, Chain
from jaxnc.synthesis.tracing.trace import TracedDesign, TraceResult, trace
from jaxnc.viz.pages.packing import embed_json, fill_template, page_part
from jaxnc.viz.pages.page import page_colours
from jaxnc.viz.repr_html import save_page

_EMBEDDED = {4: 1200, 6: 1800}  # machines in a page, by their number of bars
_LIVE = (3, 20)  # seconds of the searches that follow each other


@public
def trace_page(path: str | Path, source: Atlas | None = None) -> Path:
    """Write a page on which a curve is drawn and machines for it appear: no Python, no network, one file.

    It holds 1,200 four-bars and 1,800 six-bars of an atlas, some 300 kB, looks up by Fourier coefficients those whose
    curves are like the drawn one, and lays them on it. Their joints are dragged.

    Args:
        path: file ending in ``.html``.
        source: an atlas; the first part of `jaxnc.synthesis.atlas` if not given.

    Raises:
        OutputError: a file that cannot be written.
    """
    return save_page(path, _page(source, ()))


def _page(source: Atlas | None, live: tuple[float, ...]) -> str:
    known = atlas(25_000) if source is None else source
    chains: dict[Chain, int] = {}
    rows = []
    for bars, count in _EMBEDDED.items():
        shelf = known.shelves[bars].at(slice(count))
        for k, index in enumerate(shelf.chain):
            chain = chains.setdefault(shelf.chains[index], len(chains))
            numbers = [float(f"{x:.5g}") for x in (*shelf.window[k].tolist(), *shelf.design[k].tolist())]
            rows.append([chain, *numbers[:2], *shelf.sign[k].tolist(), *numbers[2:]])
    data = {"chains": [_chain(chain) for chain in chains], "rows": rows, "live": live}
    hint = page_part("trace_online.html" if live else "trace_offline.html").strip()
    hint = hint.format(" and ".join(f"{s:g}" for s in live) if live else f"{len(rows):,}")
    colours = page_colours("@media (prefers-color-scheme:dark){:root{#}}")
    parts = {"COLOURS": colours, "HINT": hint, "DATA": embed_json(data), "PROGRAM": page_part("trace.js")}
    return fill_template(page_part("trace.html"), parts)


def _chain(chain: Chain) -> list[Any]:
    return [chain.name, chain.tracer, [[KINDS.index(dyad.kind), dyad.first, dyad.second] for dyad in chain.dyads]]


def _machine(design: TracedDesign, links: list[list[str]]) -> dict[str, object]:
    """Write a design as the page has them."""
    drawn = design.numbers
    name, tracer, dyads = _chain(design.chain)
    return {
        "name": name, "tracer": tracer, "dyads": dyads, "sign": np.asarray(drawn.sign, float).tolist(),
        "design": np.asarray(drawn.design, float).tolist(), "begin": drawn.begin, "span": drawn.span,
        "place": [drawn.place.real, drawn.place.imag], "factor": [drawn.factor.real, drawn.factor.imag],
        "closed": design.closed, "distance": design.distance, "links": links,
    }  # fmt: skip


class TraceServer(ThreadingHTTPServer):
    """Serves the page, and what searches find, to this machine alone."""

    daemon_threads = True

    def __init__(self, port: int = 0, source: Atlas | None = None, live: tuple[float, ...] = _LIVE):
        self.text, self.source = _page(source, live).encode(), source
        self.results: list[TraceResult] = []
        self.busy = threading.Lock()
        try:
            super().__init__(("127.0.0.1", port), _Handler)
        except OSError as error:
            raise OutputError(f"port {port} cannot be listened to: {error.strerror or error}; give another") from None

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.server_port}/"

    def search(self, asked: dict[str, object]) -> dict[str, object]:
        """Search for machines for a curve that was drawn."""
        points, closed, seconds = (asked.get(name) for name in ("points", "closed", "seconds"))
        with self.busy:  # one after the other: each takes all processors
            result = trace(points, closed, seconds=seconds, source=self.source, progress=False)  # pyright: ignore[reportArgumentType]
            self.results.append(result)
            number = len(self.results) - 1
        links = [[["open", f"{number}/{k}.html"], ["model", f"{number}/{k}.toml"]] for k in range(len(result.designs))]
        designs = [_machine(design, own) for design, own in zip(result.designs, links, strict=True)]
        return {"designs": designs, "said": f"{result.refined:,} machines refined in {result.seconds:.2g} s"}

    def file(self, path: str) -> tuple[bytes, str] | None:
        """The page or the model file of a machine that was found, by its address; None if there is none."""
        number, _, name = path.strip("/").partition("/")
        which, _, kind = name.partition(".")
        if not (number.isdigit() and which.isdigit() and int(number) < len(self.results)):
            return None
        designs = self.results[int(number)].designs
        if int(which) >= len(designs) or kind not in ("html", "toml"):
            return None
        design = designs[int(which)]
        with tempfile.TemporaryDirectory() as folder:
            to = Path(folder) / f"linkage.{kind}"
            if kind == "html":
                design.move().to_html(to, trace="P", title=design.name, model=design.mechanism)
            else:
                design.save(to)
            return to.read_bytes(), "text/html; charset=utf-8" if kind == "html" else "application/toml"


class _Handler(BaseHTTPRequestHandler):
    server: TraceServer  # pyright: ignore[reportIncompatibleVariableOverride]

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the page tells what happens."""

    def do_GET(self) -> None:
        """Answer with the page, or with a machine's."""
        if not self._is_local():
            return
        found = (self.server.text, "text/html; charset=utf-8") if self.path == "/" else self.server.file(self.path)
        if found is None:
            self._answer(404, b"there is no such page", "text/plain")
        else:
            self._answer(200, *found)

    def do_POST(self) -> None:
        """Search for what was drawn."""
        if not self._is_local():
            return
        size = int(self.headers.get("Content-Length") or 0)
        most = 1_000_000  # bytes of a question
        if self.path != "/trace" or not 0 < size <= most or self.headers.get("Content-Type") != "application/json":
            self._answer(400, b'{"error": "a curve is sent as JSON, at most 1 MB"}', "application/json")
            return
        try:
            asked = json.loads(self.rfile.read(size))
            if not isinstance(asked, dict):
                raise InputError("a curve is sent as points, closed and seconds")
            answer, code = self.server.search(asked), 200
        except (JaxncError, ValueError) as error:
            answer, code = {"error": str(error)}, 400
        self._answer(code, json.dumps(answer).encode(), "application/json")

    def _is_local(self) -> bool:
        """Refuse pages from elsewhere that have led their own name to this address."""
        host = (self.headers.get("Host") or "").rpartition(":")[0]
        if host in ("127.0.0.1", "localhost"):
            return True
        self._answer(403, b"for this machine only", "text/plain")
        return False

    def _answer(self, code: int, content: bytes, kind: str) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)
