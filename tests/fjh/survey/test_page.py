"""Page of a survey: well-formed, with escaped names, and reproducible."""

import json
import re
from html.parser import HTMLParser

import pytest
from markdown_it import MarkdownIt

from experiments.app.cli import main

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
    """Text and tags of a page; fails on tags that are not closed in order."""

    def __init__(self, html: str):
        super().__init__()
        self.open, self.text, self.tags = list[str](), "", set[str]()
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len({*names}) == len(names) and not any(name.startswith("on") for name in names)
        self.tags.add(tag)
        self.open += [] if tag in VOID else [tag]

    def handle_endtag(self, tag: str) -> None:
        assert tag in VOID or self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.long
def test_page_of_a_matrix_is_valid_and_its_names_are_escaped(tmp_path, capfd):
    file = tmp_path / "rotors.csv"
    quoted = [f'"{name.replace(chr(34), 2 * chr(34))}"' for name in HOSTILE]
    file.write_text(f"{','.join(quoted)}\n1,1,1,1,1,1,1\n0,1,2,3,4,5,6\n")
    out = tmp_path / "out"
    assert main(["survey", "--matrix", str(file), "--out", str(out)]) == 0
    printed, html = capfd.readouterr(), (out / "survey.html").read_text()
    page, summary = Page(html), json.loads((out / "survey.json").read_text())
    assert not page.tags & {"script", "link", "iframe", "object", "base"}
    assert not re.search(r"url\(|@import|https?:", html)
    assert [entry["actuator"] for entry in summary["actuators"]] == list(
        HOSTILE
    ) and not printed.err
    rendered = MarkdownIt("commonmark").enable("table").render((out / "survey.md").read_text())
    markdown = Page(rendered)
    assert not markdown.tags & {"script", "em", "strong", "code", "a"}
    for name in HOSTILE:
        assert name in printed.out
        for text in (page.text, markdown.text):
            assert f"{name} locked" in text, name
    again = tmp_path / "again"
    assert main([*summary["command"].split()[1:], "--quiet", "--out", str(again)]) == 0
    assert (again / "survey.html").read_text() == html
