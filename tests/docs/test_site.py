"""The documentation site: tables that the code fills, links that lead somewhere. `.ci/run` builds the site itself."""

import importlib
import re
import sys
from pathlib import Path

import pytest
from places import DOCS, ROOT

WRITTEN = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.md")])
LINK = re.compile(r"\]\((?!\w+:)([^)\s#]*)(?:#([^)\s]+))?\)")


@pytest.fixture(scope="module")
def tables():
    sys.path.insert(0, str(DOCS / "_ext"))
    try:
        yield importlib.import_module("tables")
    finally:
        sys.path.pop(0)


def slugs(text: str) -> set[str]:
    """Anchors of a page's headings, as code hosts and the site make them."""
    plain = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    heads = re.findall(r"^#+ (.*)$", plain, re.M)
    return {re.sub(r"[^\w\- ]", "", re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", h).lower()).replace(" ", "-") for h in heads}


def test_links_of_the_written_pages_lead_somewhere():
    made = {"api", "notebooks", "project", "gallery"}  # by the site
    for page in WRITTEN:
        text = page.read_text()
        for target, anchor in LINK.findall(text):
            at = (page.parent / target).resolve() if target else page
            first = at.relative_to(DOCS).parts[0] if at.is_relative_to(DOCS) else ""
            if first in made:
                continue  # Sphinx looks at these
            assert at.exists(), f"{page.relative_to(ROOT)} links to {target}, which is not there"
            if anchor:
                assert anchor in slugs(at.read_text()), f"{page.relative_to(ROOT)}: {target} has no heading #{anchor}"


NAMES = (
    "bodies joints coordinates constraints forces options statuses errors model_files problem_files commands examples "
    "library plots"
)


@pytest.mark.parametrize("name", NAMES.split())
def test_tables_are_made_from_the_code(tables, name):
    text = tables.PAGES[name]()
    if name != "commands" or sys.version_info[:2] == (3, 11):  # whose argparse words its help otherwise
        assert (DOCS / "tables" / f"{name}.md").read_text() == text, "`python docs/_ext/tables.py` writes them anew"
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert text.startswith("# ") and (len(rows) >= 8 or name == "examples")
    width = 0
    for above, line in zip(["", *text.splitlines()], text.splitlines(), strict=False):
        if line.startswith("|"):
            cells = len(re.findall(r"(?<!\\)\|", line)) - 1
            width = width if above.startswith("|") else cells
            assert cells == width and not re.search(r"\|\s+\|", line.removesuffix("|")[:2]), line


def test_what_the_code_has_and_no_table_says_stops_the_build(tables, monkeypatch):
    said = tables.said
    for what, table, gone in (
        ("STATUSES", "statuses", "TOO_FAR"),
        ("ERRORS", "errors", "AssemblyError"),
        ("FORCES", "forces", "spring"),
        ("JOINTS", "joints", "screw"),
        ("FORMS", "coordinates", "switched"),
        ("TABLES", "model_files", "friction"),
        ("METHODS", "options", "kvaerno5"),
    ):
        texts = dict(getattr(said, what))
        del texts[gone]
        monkeypatch.setattr(said, what, texts)
        with pytest.raises(tables.NothingSaid, match=gone):
            tables.PAGES[table]()
        monkeypatch.undo()
    monkeypatch.setitem(said.STATUSES, "BROKEN", "what the code does not have")
    with pytest.raises(tables.NothingSaid, match=r"speaks of \['BROKEN'\]"):
        tables.statuses()
    monkeypatch.setitem(said.MESSAGES, "nobody ever says this", "")
    with pytest.raises(tables.NothingSaid, match="nobody ever says this"):
        tables.mistakes()


def test_every_package_is_in_the_reference_or_said_to_be_inside(tables):
    found = {p.parent for p in (ROOT / "jaxnc").rglob("__init__.py") if re.search("^ *from", p.read_text(), re.M)}
    names = {".".join(p.relative_to(ROOT).parts) for p in found}
    said = {*tables.said.PACKAGES, *tables.said.INSIDE} - {"jaxnc.library.benchmarks"}  # a module without a list
    inside = {n for n in names if n.startswith(tables.said.INSIDE)}
    assert names - said - inside == set() and said - names <= {"jaxnc.solvers"}


def test_pictures_of_pages_are_made_by_their_code():
    namespace: dict = {"__file__": str(DOCS / "pictures.py"), "__name__": "pictures"}
    exec((DOCS / "pictures.py").read_text(), namespace)
    for page, pictures in namespace["MADE"].items():
        text = (DOCS / f"{page}.md").read_text()
        shown = {Path(name).name for name in re.findall(r"!\[[^]]*\]\(([^)]*)\)", text)}
        assert shown - {"descent.gif"} == set(pictures.values())  # the film takes minutes: examples/descent.py
        for made, shown in pictures.items():
            assert f'"{made}"' in text and (DOCS / shown).exists()


def test_bodies_in_the_table_have_the_counts_of_the_text(tables):
    lines = [[c.strip() for c in line.split("|")] for line in tables.bodies().splitlines()]
    plane, space = [], []
    for cells in lines:
        if len(cells) > 4 and cells[2].isdigit():
            (plane if int(cells[2]) % 2 == 0 and not space and "vector" not in cells[1] else space).append(cells)
    found = {cells[1]: (int(cells[2]), int(cells[3])) for cells in plane + space}
    assert found["4 points"] == (12, 6) and found["2 points, 1 vector"] == (9, 3)  # n - 6 in space
    for cells in plane[:5]:
        assert int(cells[3]) == int(cells[2]) - 3  # §3.1: a body in the plane has three freedoms
    for name in ("2 points, 1 vector along them (bar)", "3 points in line (bar)"):
        assert found[name] == (9, 4)  # erratum 1: five freedoms
