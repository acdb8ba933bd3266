"""Make the gallery: a picture, a film and a page that is alive of every mechanism in examples/gallery.

    python examples/make_gallery.py                   all of them, into the folder gallery
    python examples/make_gallery.py jansen hart       two of them
    python examples/make_gallery.py --no-film         without films, which take longest

A file of the gallery is a short script of its own: its docstring says what is seen and what to try, ``m`` is the
mechanism, ``motion`` what it does, ``trace`` the points whose paths are drawn.
"""

import argparse
import html
import os
import runpy
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

HERE = Path(__file__).parent / "gallery"


@dataclass(frozen=True)
class Entry:
    """One file of the gallery.

    Attributes:
        name: its name, without ending.
        title: the mechanism.
        seen: what is seen.
        tried: what to try.
        code: the script without its docstring.
    """

    name: str
    title: str
    seen: str
    tried: str
    code: str


def read(path: Path) -> Entry:
    """What a file says of itself."""
    text = path.read_text(encoding="utf-8")
    _, said, code = text.split('"""', 2)
    first, _, last = said.partition("Try:")
    title, _, seen = " ".join(first.split()).partition(":")
    if not (title and seen and last.strip()):
        raise SystemExit(f'{path}: its docstring is to read "Title: what is seen. Try: what to try."')
    return Entry(path.stem, title, seen.strip(), " ".join(last.split()), code.strip() + "\n")


def entries(names: Iterable[str] = ()) -> list[Entry]:
    """The gallery, or some of it, by title."""
    known = {path.stem: path for path in HERE.glob("*.py")}
    names = list(names) or list(known)
    if unknown := [name for name in names if name not in known]:
        raise SystemExit(f"no {', '.join(unknown)} in {HERE}; there are {', '.join(sorted(known))}")
    return sorted((read(known[name]) for name in names), key=lambda entry: entry.title.lower())


def make(name: str, out: str, film: bool = True, page: bool = True) -> str:
    """Run one file and write what there is to see of it.

    Args:
        name: the file, without ending.
        out: a folder that is there.
        film: whether to write a GIF.
        page: whether to write a page.

    Returns:
        The name.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    found = runpy.run_path(str(HERE / f"{name}.py"))
    motion, trace = found["motion"], found["trace"]
    motion.check()
    at = Path(out) / name
    # Not the first pose: many mechanisms start where their bars lie in line.
    motion.draw(at.with_suffix(".png"), pose=len(motion.q) // 8, trace=trace)
    if page:
        motion.to_html(at.with_suffix(".html"), trace=trace, model=found["m"])
    if film:
        motion.animate(at.with_suffix(".gif"), trace=trace)
    return name


def make_all(names: Iterable[str], out: Path, film: bool = True) -> Iterator[str]:
    """Make several side by side, in as many processes as there are processors; names as they are done."""
    out.mkdir(parents=True, exist_ok=True)
    names = list(names)
    with ProcessPoolExecutor(min(os.cpu_count() or 1, len(names)), get_context("spawn")) as pool:
        for done in as_completed([pool.submit(make, name, str(out), film) for name in names]):
            yield done.result()


def overview(found: list[Entry], film: bool) -> str:
    """A page with all of them."""
    cards = (
        f'<a href="{e.name}.html"><img src="{e.name}.{"gif" if film else "png"}" alt="" loading="lazy">'
        f"<b>{html.escape(e.title)}</b><br>{html.escape(e.seen)}</a>"
        for e in found
    )
    style = (
        "body{font:15px/1.4 system-ui,sans-serif;margin:2rem auto;max-width:76rem;padding:0 1rem}"
        ":root{color-scheme:light dark}"
        "main{display:grid;grid-template-columns:repeat(auto-fill,minmax(16rem,1fr));gap:1.5rem}"
        "a{color:inherit;text-decoration:none}"
        "img{width:100%;aspect-ratio:1;object-fit:contain;background:#fff;border-radius:6px}"
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>Gallery</title><style>{style}</style><h1>Gallery</h1><main>{''.join(cards)}</main></html>\n"
    )


def main(arguments: list[str]) -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Make the gallery of mechanisms.")
    parser.add_argument("names", nargs="*", help="files of examples/gallery, without ending; all if not given")
    parser.add_argument("--out", type=Path, default=Path("gallery"), help="folder (default: gallery)")
    parser.add_argument("--no-film", action="store_true", help="no films: pictures and pages only")
    asked = parser.parse_args(arguments)
    from tqdm import tqdm

    found = entries(asked.names)
    film = not asked.no_film
    for _ in tqdm(make_all((e.name for e in found), asked.out, film), total=len(found), disable=None):
        pass
    (asked.out / "index.html").write_text(overview(found, film), encoding="utf-8")
    print(f"{asked.out / 'index.html'}: {len(found)} mechanisms")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
