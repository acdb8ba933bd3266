"""Pages that stand elsewhere in the repository, and links from page to page as they are written for a code host."""

import os
import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

ROOT = Path(__file__).parent.parent.parent
DOCS = ROOT / "docs"
LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)\s#]+)(#[^)\s]*)?(?=\))")
LOG = logging.getLogger(__name__)


def shown() -> dict[str, str]:
    """The pages of the site that stand elsewhere: the file in the repository, and its page in the site's sources."""
    pages = {
        "CHANGELOG.md": "project/changelog.md",
        "CONTRIBUTING.md": "project/contributing.md",
        "benchmarks/README.md": "project/benchmarks.md",
        "benchmarks/card.md": "project/benchmarks_card.md",
        "benchmarks/dynamics.md": "project/benchmarks_dynamics.md",
        "benchmarks/trace.md": "project/benchmarks_trace.md",
        "notebooks/README.md": "notebooks/index.md",
    }
    return pages | {f"notebooks/{p.name}": f"notebooks/{p.name}" for p in sorted((ROOT / "notebooks").glob("*.ipynb"))}


def led(text: str, origin: str, page: str) -> str:
    """A page with its links changed from where it stands in the repository to where it stands in the site.

    Args:
        text: Markdown, or a notebook.
        origin: its path in the repository, such as ``docs/pages.md``.
        page: its path in the site's sources, such as ``pages.md``.

    Returns:
        The text. A link to what is no page of the site leads to the file, which is then copied beside the site.
    """
    pages = shown() | {"README.md": "index.md", "examples": "tables/examples.md"}
    here = os.path.dirname(page) or "."

    def link(found: re.Match) -> str:
        target = os.path.normpath(os.path.join(os.path.dirname(origin), found[1]))
        anchor = found[2] or ""
        if target.startswith("docs/"):
            to = target.removeprefix("docs/")
        elif target in pages:
            to = pages[target]
        else:
            to = os.path.relpath(ROOT / target, DOCS)
        if not (ROOT / target).exists() and not (DOCS / to).exists():
            LOG.warning("%s: a link leads to %s, which is not there", origin, target)
        return os.path.relpath(to, here) + anchor

    return LINK.sub(link, text)


def write(path: Path, text: str) -> None:
    """Write a file, unless it says so already: what is not changed is not read again."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def bring(app: Sphinx) -> None:
    """Copy the pages that stand elsewhere, and the pictures that they show."""
    kept = set()
    for origin, page in shown().items():
        write(DOCS / page, led((ROOT / origin).read_text(encoding="utf-8"), origin, page))
        kept.add(DOCS / page)
    for folder in {(DOCS / page).parent for page in shown().values()}:
        for path in folder.iterdir():
            if path.suffix in {".md", ".ipynb"} and path not in kept:
                path.unlink()  # its origin is gone


def unlisted(index: str) -> list[str]:
    """Guides that the first page does not name: they come last."""
    trees = " ".join(re.findall(r"^```\{toctree\}(.*?)^```", index, re.S | re.M)).split()
    later = [re.compile(tree.replace("*", ".*")) for tree in trees]
    pages = sorted(path.stem for path in DOCS.glob("*.md"))
    return [
        page for page in pages if page not in ("index", "paper") and not any(tree.fullmatch(page) for tree in later)
    ]


def read(app: Sphinx, page: str, source: list[str]) -> None:
    """Lead the links of the site's own pages."""
    path = f"{page}.md"
    if page == "index":
        text = source[0].replace("and what else there is", "\n".join(unlisted(source[0])))
        some = (line for line in text.splitlines() if not line.endswith("*") or any(DOCS.glob(line + ".*")))
        source[0] = "\n".join(some)  # the gallery and the table of equations are made by commands of their own
    if (DOCS / path).exists() and path not in shown().values():
        source[0] = led(source[0], f"docs/{path}", path)


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", bring)
    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
