"""Links of the pages lead somewhere, equations survive GitHub, and the reference is complete."""

import re
from pathlib import Path

import pytest

import fjh
from tests.project.test_rooms import PUBLIC, public_names

ROOT = Path(__file__).parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted(ROOT.glob("docs/**/*.md")),
]
REFERENCE = "".join(page.read_text() for page in ROOT.glob("docs/api/*.md"))


def without_code(text: str) -> str:
    """A page without its fenced blocks and code in backticks."""
    return re.sub(r"`[^`]*`", "", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE))


def anchors(text: str) -> set[str]:
    """Of the headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in headings}


def broken(text: str, folder: Path) -> list[str]:
    """Links of a page in a folder that lead to no file, or to no heading of it."""
    wrong = []
    for link in re.findall(r"\]\(([^)\s]+)\)", without_code(text)):
        if link.startswith(("http://", "https://")):
            continue
        name, _, anchor = link.partition("#")
        target = folder / name
        exists = target.is_file() if name else True
        there = target.read_text() if name and anchor and exists else text
        if not exists or (anchor and anchor not in anchors(there)):
            wrong.append(link)
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_and_picture_of_a_page_is_there(page):
    assert broken(page.read_text(), page.parent) == []


def test_a_broken_link_is_seen(tmp_path):
    (tmp_path / "other.md").write_text("## With `code`, and more\n")
    good = "# Top\n[a](other.md#with-code-and-more) [b](#top) `[c](no.md)` [d](https://e.f)\n"
    assert broken(good, tmp_path) == []
    wrong = ["other.md#with-code", "other.png", "#bottom"]
    assert broken(good + "".join(f"![x]({link})\n" for link in wrong), tmp_path) == wrong


def test_every_picture_is_on_a_page():
    """What `make pictures` writes is looked at; nothing lies about."""
    pages = "".join(page.read_text() for page in PAGES)
    pictures = {picture.name for picture in (ROOT / "docs" / "pictures").iterdir()}
    assert {name for name in pictures if f"pictures/{name}" not in pages} == set()


def eaten(text: str) -> list[str]:
    r"""Inline equations with a backslash before a sign, as \{, which GitHub drops."""
    equations = re.findall(r"\$([^$]+)\$", without_code(text))
    return [equation for equation in equations if re.search(r"\\[^A-Za-z]", equation)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_github_leaves_the_equations_of_a_page_alone(page):
    assert eaten(page.read_text()) == []
    assert eaten(page.read_text() + r"$\lbrace$ and $\{$") == [r"\{"]


@pytest.mark.parametrize("module", PUBLIC)
def test_the_reference_has_every_public_name(module):
    names = public_names(module)
    missing = {name for name in names if not re.search(rf":: {name}$", REFERENCE, re.MULTILINE)}
    assert missing == {"Array"} & names  # the type of all arrays, explained in words


def test_the_reference_names_what_the_one_package_gives():
    named = set(re.findall(r"`fjh\.(\w+)`", (ROOT / "docs" / "api" / "fjh.md").read_text()))
    assert named == set(fjh.__all__)
