"""The short paper: its numbers are those of the benchmarks, and it has the parts that its journal asks for."""

import re

from places import DOCS

from benchmarks import paper


def test_the_page_is_current():
    assert paper.PAGE.read_text(encoding="utf-8") == paper.text(), "python -m benchmarks.paper"


def test_every_number_is_written_by_the_benchmarks():
    plain = re.sub(r"@[\w;@ -]+|`[^`]*`|\\?\]\([^)]*\)", "", paper.TEXT)  # marks and citations, code, links
    assert not re.findall(r"\d", plain)


def test_it_has_the_form_of_the_journal():
    text = paper.PAGE.read_text(encoding="utf-8")
    heads = re.findall(r"^# (.*)$", text, re.M)
    assert heads[:3] == ["Summary", "Statement of need", "State of the field"] and heads[-1] == "References"
    words = len(re.sub(r"^---.*?^---", "", text, flags=re.S | re.M).split())
    assert 250 <= words <= 1200
    for figure in re.findall(r"!\[.*?\]\(([^)]+)\)", text):
        assert (DOCS / figure).exists(), figure
    cited = set(re.findall(r"@([A-Za-z]+\w*)", re.sub(r"^---.*?^---", "", text, flags=re.S | re.M)))
    assert cited == set(re.findall(r"^@\w+\{(\w+),", (DOCS / "paper.bib").read_text(encoding="utf-8"), re.M))
