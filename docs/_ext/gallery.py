"""The gallery: a page for each file of examples/gallery, with its picture, the page that is alive, and its code."""

import sys

from from_repository import ROOT, write
from sphinx.application import Sphinx
from sphinx.util.display import status_iterator

sys.path.insert(0, str(ROOT / "examples"))

from make_gallery import HERE, Entry, entries, make_all

DOCS = ROOT / "docs"
PAGES = DOCS / "gallery"
SEEN = DOCS / "_static" / "gallery"


def stale(entry: Entry) -> bool:
    """Whether a picture or page is missing, or older than the file that makes it."""
    made = [SEEN / (entry.name + ending) for ending in (".png", ".html")]
    return any(not m.exists() or m.stat().st_mtime < (HERE / f"{entry.name}.py").stat().st_mtime for m in made)


def page(entry: Entry) -> str:
    """The page of one mechanism."""
    return f"""\
# {entry.title}

{entry.seen[0].upper()}{entry.seen[1:]}

**Try:** {entry.tried}

```{{raw}} html
<iframe src="../_static/gallery/{entry.name}.html" title="{entry.title}" loading="lazy"
 style="width:100%;height:46rem;border:1px solid #8884;border-radius:6px"></iframe>
<p><a href="../_static/gallery/{entry.name}.html">The page by itself</a>: joints are dragged, lengths changed.</p>
```

`examples/gallery/{entry.name}.py`:

```python
{entry.code}```
"""


def overview(found: list[Entry]) -> str:
    """All of them at a glance."""
    cards = "\n".join(
        f":::{{grid-item-card}} {e.title}\n:link: {e.name}\n:link-type: doc\n"
        f":img-top: ../_static/gallery/{e.name}.png\n:class-img-top: gallery-picture\n{e.seen}\n:::\n"
        for e in found
    )
    hidden = "\n".join(e.name for e in found)
    return f"""\
# Gallery

{len(found)} mechanisms, each a short script in `examples/gallery`. `python examples/make_gallery.py` makes them all on
one's own machine, with films; `python examples/make_gallery.py jansen` one of them.

::::{{grid}} 1 2 3 3
:gutter: 2

{cards}::::

```{{toctree}}
:hidden:

{hidden}
```
"""


def bring(app: Sphinx) -> None:
    """Make what is not there or out of date, and write the pages."""
    found = entries()
    wanted = [e.name for e in found if stale(e)]
    if wanted:
        done = make_all(wanted, SEEN, film=False)
        for _ in status_iterator(done, "making the gallery... ", length=len(wanted), stringify_func=str):
            pass
    write(PAGES / "index.md", overview(found))
    for entry in found:
        write(PAGES / f"{entry.name}.md", page(entry))
    for path in PAGES.glob("*.md"):
        if path.stem not in {"index", *(e.name for e in found)}:
            path.unlink()


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", bring)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
