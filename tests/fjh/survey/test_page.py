"""The survey as a page: whole, escaped, and as the documentation prints it."""

import json
import re
import shlex
from html.parser import HTMLParser
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from experiments.app.cli import main
from tests.pages import assert_prints, blocks

VOID = {"meta", "img"}
HOSTILE = (
    "<script>alert(1)</script>",
    'a"onload="x',
    "r&d",
    "c|d _e_",
    "[red]$\\bad{$",
    ":x:",
    "日",
)


class Page(HTMLParser):
    """Text, addresses and tags of a page; fails on tags that are not closed in order."""

    def __init__(self, html: str):
        super().__init__()
        self.open: list[str] = []
        self.text, self.addresses, self.tags, self.ids = "", [], set(), []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Called by the parser."""
        given = dict(attrs)
        assert len(given) == len(attrs) and not any(name.startswith("on") for name in given)
        self.tags.add(tag)
        self.open += [] if tag in VOID else [tag]
        self.ids += [given["id"]] if "id" in given else []
        self.addresses += [given[name] or "" for name in ("href", "src") if name in given]

    def handle_endtag(self, tag: str) -> None:
        """Called by the parser."""
        assert tag in VOID or self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Called by the parser."""
        self.text += data


def page_of(folder: Path) -> tuple[Page, dict]:
    """The page in a folder, and the numbers beside it; the laws of every page hold."""
    html = (folder / "survey.html").read_text()
    page, told = Page(html), json.loads((folder / "survey.json").read_text())
    assert html.startswith("<!DOCTYPE html>\n<html lang=")
    assert not page.tags & {"script", "link", "iframe", "object", "base"}
    assert not re.search(r"url\(|@import|https?:", html)
    for address in page.addresses:
        assert address.startswith("data:image/png;base64,") or address.removeprefix("#") in page.ids
    assert "survey.html" in told["files"]
    for sentence in (told["command"], *sentences(folder)):
        assert page.text.count(sentence) >= 1, sentence
    for name, version in told["versions"].items():
        assert f"{name} {version}" in page.text
    return page, told


def sentences(folder: Path) -> list[str]:
    """Those below the tables, without Markdown's backslashes."""
    lines = (folder / "survey.md").read_text().splitlines()
    return [re.sub(r"\\(?=\W)", "", line[2:]) for line in lines if line.startswith("- ")]


def shown_by_markdown(text: str) -> str:
    """What a reader of rendered Markdown sees; no name is markup."""
    page = Page(MarkdownIt("commonmark").enable("table").render(text))
    plain = {"h2", "img", "p", "table", "thead", "tbody", "tr", "th", "td", "ul", "li"}
    assert page.tags <= plain, page.tags - plain
    return page.text


@pytest.mark.long
def test_the_page_of_a_matrix_is_whole_and_its_names_are_no_markup(tmp_path, capfd):
    file = tmp_path / "rotors.csv"
    quoted = [f'"{name.replace(chr(34), 2 * chr(34))}"' for name in HOSTILE]
    file.write_text(f"{','.join(quoted)}\n1,1,1,1,1,1,1\n0,1,2,3,4,5,6\n")
    out = tmp_path / "out"
    assert main(["survey", "--matrix", str(file), "--out", str(out)]) == 0
    printed, (page, told) = capfd.readouterr(), page_of(out)
    assert [each["actuator"] for each in told["actuators"]] == list(HOSTILE) and not printed.err
    shown = shown_by_markdown((out / "survey.md").read_text())
    for name in HOSTILE:
        assert all(f"{name} locked" in text for text in (page.text, printed.out, shown)), name
    sha = told["matrix_sha256"]
    assert sha in page.text and not list(out.glob("*.rrd"))
    again = tmp_path / "again"
    words = told["command"].split()[1:]
    assert main([*words, "--quiet", "--out", str(again)]) == 0
    files = told["files"]
    assert json.loads((again / "survey.json").read_text())["files"] == files
    assert (again / "survey.html").read_text() == (out / "survey.html").read_text()


@pytest.mark.long
def test_the_page_prints_what_the_command_says(tmp_path, monkeypatch, capfd):
    page = (Path(__file__).parents[3] / "docs" / "survey.md").read_text()
    (matrix,) = (content for language, content in blocks(page) if language == "none")
    (said,) = (content for language, content in blocks(page) if language == "text")
    commands = [content for language, content in blocks(page) if language == "sh"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    (tmp_path / "rotors.csv").write_text(matrix)
    assert main(shlex.split(commands[1])[1:]) == 0
    *_, printed = capfd.readouterr().out.partition("What the failures")
    title, table, *_, sentences, _ = printed.strip().split("\n\n")
    assert_prints(f"What the failures {title}\n{table}\n{sentences}", said)
