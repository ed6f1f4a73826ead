"""Tests of the length of the documentation and of its navigation."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
OUTSIDE = {"index", "changelog", "contributing"}
"""Pages that the navigation does not list."""
SECTIONS = {
    "Start": 3,
    "Your robot": 7,
    "The paper, reproduced": 6,
    "Theory and diagnosis": 4,
    "Reference": 8,
}


def word_count(*pages: Path) -> int:
    return sum(len(page.read_text().split()) for page in pages)


@pytest.mark.parametrize(
    ("pages", "most"),
    [
        ([ROOT / "README.md"], 500),
        ([DOCS / "glossary.md"], 450),
        ([ROOT / "README.md", *PAGES], 23_000),
    ],
    ids=["README", "glossary", "all"],
)
def test_the_documentation_stays_short(pages, most):
    assert word_count(*pages) <= most


def test_the_navigation_has_every_page_once():
    trees = re.findall(r":caption: ([^\n]+)\n+(.*?)```", (DOCS / "index.md").read_text(), re.DOTALL)
    listed = {
        name: re.findall(r"^(?:.*<)?([\w/-]+)>?$", tree, re.MULTILINE) for name, tree in trees
    }
    assert {name: len(pages) for name, pages in listed.items()} == SECTIONS
    pages = {str(page.relative_to(DOCS).with_suffix("")) for page in PAGES} - OUTSIDE
    names = [page for pages in listed.values() for page in pages]
    assert sorted(names) == sorted(pages | {"gallery/index"})


def test_pages_use_every_number_and_table_and_no_other(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS / "_extensions"))
    tables = importlib.import_module("tables")
    text = "".join(page.read_text() for page in (ROOT / "README.md", *PAGES))
    numbers = {*re.findall(r"<!--([\w.]+)-->", text)}
    assert numbers - {*tables.VALUES} == set()
    assert {name for name in tables.VALUES if not name.startswith("time.")} <= numbers
    assert {*re.findall(r"<!-- table (\w+)", text)} == {*tables.TABLES}
    with pytest.raises(ValueError, match="a line begins with a number"):
        tables.written("In\n<!--recover.all-->306<!--/--> runs")
