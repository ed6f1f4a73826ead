"""`fjh paper report`: one page that needs nothing else, made of chapters that are run once."""

import base64
import io
import json
import re
import subprocess
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote_to_bytes

import matplotlib.image
import pandas as pd
import pytest

from experiments.app import report as report_module
from experiments.app.cli import main
from experiments.studies import study
from fjh.study import provenance
from fjh.study.errors import Interrupted, Unsound
from fjh.study.plotting import new_figure
from fjh.study.result import Check, Picture, Result, Shown
from tests.made import made_study

VOID = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """What a browser would find; fails on tags that are not closed in order."""

    def __init__(self, html: str):
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.images: list[dict[str, str]] = []
        self.tables: list[list[list[str]]] = []
        self.text = ""
        self.tags: set[str] = set()
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Called by the parser."""
        given = {name: value or "" for name, value in attrs}
        assert len(given) == len(attrs)
        self.tags.add(tag)
        if tag not in VOID:
            self.open.append(tag)
        self.ids += [given["id"]] if "id" in given else []
        self.links += [given[key] for key in ("href", "src", "srcset", "data") if key in given]
        if tag == "img":
            self.images.append(given)
        elif tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        """Called by the parser."""
        assert tag in VOID or self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Called by the parser."""
        self.text += data
        if self.open and {"td", "th"} & set(self.open):
            self.tables[-1][-1][-1] += data


HEIGHTS = Shown("Of <it>", pd.DataFrame({"x": ["a < b"], "y_um": [7.25]}), "x y_um:.2f", "& why.")


def record(folder: Path) -> None:
    (folder / "run.rrd").write_text("a recording")


def stub(ran: list[str], failed: float = 0.0, raised=None) -> Callable[..., Result]:
    """What a study does that is sound unless a number of its is 1 or more."""

    def make(*, seed: int, quick: bool, times: int, on_progress) -> Result:
        ran.append(f"{seed}{'q' * quick}")
        on_progress(1, 1)
        if raised:
            raise raised
        return Result(
            {"seed": seed},
            checks=[Check("error & <more>", "at 3 s", failed, 1.0)],
            shown=[HEIGHTS],
            notes=["5 < 6 & so on"],
            pictures=[Picture("figure", "A <pixel>.", 'One "pixel".', lambda: new_figure(1, 1))],
            records=[record],
        )

    return make


@pytest.fixture
def report(tmp_path, monkeypatch, capsys):
    """Run `fjh paper report` on studies of a test's choice: exit code, index, standard error."""
    out = tmp_path / "out"

    def run(*options: str, **made: Callable[..., Result]) -> tuple[int, dict, str]:
        monkeypatch.setattr(report_module, "CHAPTERS", {name: {} for name in made})
        monkeypatch.setattr(report_module, "LINES", {name: f"About {name}." for name in made})
        monkeypatch.setattr(report_module, "study", lambda name: made_study(name, made[name]))
        code = main(["paper", "report", "--out", str(out), *options])
        index = out / "report.json"
        told = json.loads(index.read_text()) if index.exists() else {}
        if told:
            check((out / "report.html").read_text(), told)
        return code, told, capsys.readouterr().err

    return run


def check(html: str, told: dict) -> Page:
    """The laws of every page: it is whole, leads nowhere else, and shows what was found."""
    page = Page(html)
    assert html.startswith("<!DOCTYPE html>\n<html lang=")
    assert len(set(page.ids)) == len(page.ids)
    for link in page.links:
        assert link.startswith("data:image/") or link.removeprefix("#") in page.ids, link
    assert not page.tags & {"script", "link", "iframe", "object", "base"}
    assert not re.search(r"url\(|@import|https?:", html)
    for image in page.images:
        head, _, data = image["src"].partition(",")
        assert head == "data:image/png;base64"
        pixels = matplotlib.image.imread(io.BytesIO(base64.b64decode(unquote_to_bytes(data))))
        assert pixels.size > 0
    for chapter in told["chapters"]:
        assert chapter["command"] in page.text
        assert (chapter["complaint"] or "checks passed") in page.text
    for fact in (told["command"], told["commit"], told["code_sha256"]):
        assert fact in page.text
    for name, version in told["versions"].items():
        assert f"{name} {version}" in page.text
    return page


def test_the_page_has_tables_notes_and_figures_of_each_study(report, tmp_path):
    ran: list[str] = []
    code, told, _ = report(one=stub(ran), two=stub(ran))
    assert code == 0 and told["missing"] == []
    assert told["chapters"][1]["command"] == f"fjh paper two --out {tmp_path / 'out' / 'two'}"
    page = Page((tmp_path / "out" / "report.html").read_text())
    assert page.tables[1:-1] == [[["x", "y_um"], ["a < b", "7.25"]]] * 2
    assert [image["alt"] for image in page.images] == ['One "pixel".'] * 2
    for words in ("Of <it>", "& why.", "5 < 6 & so on", "A <pixel>.", "About two.", "By nothing."):
        assert page.text.count(words) >= 2 or words == "About two."


def test_a_chapter_is_run_once_and_again_when_a_file_of_it_is_gone(report, tmp_path):
    first, second = list[str](), list[str]()
    both = {"one": stub(first), "two": stub(second)}
    _, told, _ = report(**both)
    assert report(**both)[1]["chapters"] == told["chapters"]
    assert (len(first), len(second)) == (1, 1)
    (tmp_path / "out" / "two" / "figure.png").unlink()
    report(**both)
    assert (len(first), len(second)) == (1, 2)
    for text in ("", "[]", "{}", '{"versions": 7}'):
        (tmp_path / "out" / "report.json").write_text(text)
        assert report(**both)[0] == 0
    assert (len(first), len(second)) == (5, 6)


def test_other_options_code_or_versions_run_every_chapter_again(report, monkeypatch):
    ran: list[str] = []
    for options in ([], ["--quick"], ["--quick", "--seed", "3"], ["--quick", "--seed", "3"]):
        report(*options, one=stub(ran))
    assert ran == ["0", "0q", "3q"]
    for what, value in (
        ("code_sha256", lambda: "0" * 64),
        ("versions", lambda: {"numpy": "0.1"}),
        ("machine", lambda: {"processor": "abacus", "cores": 1, "memory_gib": 1, "system": "x"}),
    ):
        monkeypatch.setattr(provenance, what, value)
        before = len(ran)
        for _ in range(2):
            report("--quick", one=stub(ran))
        assert len(ran) == before + 1, what


@pytest.mark.parametrize("raised", [KeyboardInterrupt(), Interrupted("--resume goes on")])
def test_ctrl_c_keeps_finished_chapters_and_says_how_to_go_on(report, tmp_path, raised):
    ran: list[str] = []
    last = {"three": stub(ran)}
    code, told, error = report(one=stub(ran), two=stub(ran, raised=raised), **last)
    assert code == 130
    assert error.startswith("fjh: interrupted: no file was left half-written; ")
    assert error.endswith("the same command continues with two, chapter 2 of 3\n")
    assert told["missing"] == ["two", "three"]
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"one", "report.json", "report.html"}
    code, told, _ = report(one=stub(ran), two=stub(ran), **last)
    assert (code, len(ran), told["missing"]) == (0, 4, [])


def test_ctrl_c_in_the_first_chapter_leaves_no_folder(report, tmp_path):
    assert report(one=stub([], raised=KeyboardInterrupt()))[0] == 130
    assert not (tmp_path / "out").exists()


def test_an_unsound_chapter_is_told_and_the_others_still_run(report, tmp_path):
    diverged = Unsound("it diverged at 4 s")
    code, told, error = report(
        one=stub([], failed=2.0), two=stub([], raised=diverged), three=stub([])
    )
    assert code == 1
    assert error == (
        "fjh: a study failed: one: at 3 s: error & <more> is 2, expected below 1; "
        "two: it diverged at 4 s\n"
    )
    assert [bool(chapter["complaint"]) for chapter in told["chapters"]] == [True, True, False]
    html = (tmp_path / "out" / "report.html").read_text()
    assert html.count("&#x2717; a check failed") == 4  # in the contents and in the chapter
    assert html.count("&#x2713; checks passed") == 2
    ran: list[str] = []
    assert report(one=stub(ran), two=stub(ran), three=stub(ran))[0] == 1
    assert ran == ["0"]  # what diverged left no files, and is tried again


def test_wrong_input_is_refused_before_any_work(report, tmp_path):
    (tmp_path / "out").write_text("taken")
    ran: list[str] = []
    code, _, error = report(one=stub(ran))
    assert code == 2 and ran == []
    assert "cannot be a folder" in error


@pytest.mark.long
def test_a_real_study_is_on_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr(report_module, "CHAPTERS", {"release": {}})
    assert main(["paper", "report", "--quick", "--quiet", "--out", str(tmp_path)]) == 0
    told = json.loads((tmp_path / "report.json").read_text())
    page = check((tmp_path / "report.html").read_text(), told)
    printed = (tmp_path / "release" / "release.md").read_text()
    for row in (row for table in page.tables[1:-1] for row in table):
        assert f"| {' | '.join(row)} |" in printed
    assert len(page.images) == 1


@pytest.mark.parametrize("name", report_module.CHAPTERS)
def test_a_chapters_help_has_what_the_page_shows(name):
    assert len((study(name).__doc__ or "").split("\n\n")) > 1


def test_the_code_hash_changes_with_a_source_and_not_with_the_report(tmp_path, monkeypatch):
    here = tmp_path / "experiments" / "app"
    here.mkdir(parents=True)
    monkeypatch.setattr(provenance, "ROOT", tmp_path)
    seen = {provenance.code_sha256()}
    rooms = ("argument_checks/a.py", "prioritized/a.py", "experiments/a.py")
    for name in ("sim/a.py", "sim/b/a.py", "models/a.xml", *rooms):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
        seen.add(provenance.code_sha256())
    (tmp_path / "sim" / "a.py").write_text("2")
    seen.add(provenance.code_sha256())
    assert len(seen) == 8
    (here / "page.py").write_text("1")
    assert provenance.code_sha256() in seen


def test_a_commit_is_named_only_in_the_projects_own_checkout(tmp_path, monkeypatch):
    assert re.match(r"[0-9a-f]{40}(, with uncommitted changes)?$|not a git", provenance.commit())
    monkeypatch.setattr(provenance, "HERE", tmp_path)
    assert provenance.commit() == "not a git checkout"
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    assert provenance.commit() == "not a git checkout"
