"""`fjh report`: one page that needs nothing else, made of chapters that are run once."""

import base64
import io
import json
import re
import subprocess
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote_to_bytes

import matplotlib.image
import pytest

from experiments.app import report as report_module
from experiments.app.chapter import Chapter, Edition
from experiments.app.cli import main
from experiments.studies import studies
from experiments.study import provenance
from experiments.study.plotting import new_figure
from experiments.study.results import Check, Picture, Results
from experiments.study.study import Interrupted, NotInstalled, OnProgress, Option, Unsound
from experiments.study.tables import Table
from tests.made import MadeStudy, made_study

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
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Called by the parser."""
        self.text += data
        if self.open and {"td", "th"} & set(self.open):
            self.tables[-1][-1][-1] += data


def record(folder: Path) -> None:
    (folder / "run.rrd").write_text("a recording")


def stub(name: str, ran: list[str], failed: float = 0.0, raised=None) -> Chapter:
    """A chapter that is sound unless a number of its is 1 or more."""

    def make(*, seed: int, quick: bool, on_progress: OnProgress) -> Results:
        ran.append(name)
        on_progress(1, 1)
        if raised:
            raise raised
        return Results(
            {"seed": seed, "quick": quick},
            [Table("Of <it>", ("", "x\ny, um"), [(f"a < {name}", "7.25")], "What & why.")],
            ["5 < 6 & so on"],
            [Check("error & <more>", "at 3 s", failed, 1.0)],
            [Picture("figure", "A <pixel>.", 'One "pixel".', lambda: new_figure(0.1, 0.1))],
            records=[record],
        )

    return Chapter(made_study(name, make))


@dataclass(frozen=True)
class Reporter:
    """Runs `fjh report` on chapters of a test's choice."""

    out: Path
    monkeypatch: pytest.MonkeyPatch
    capsys: pytest.CaptureFixture[str]

    def __call__(self, *some: Chapter, options: tuple[str, ...] = ()) -> tuple[int, dict, str]:
        """Exit code, contents of the index, standard error."""
        self.monkeypatch.setattr(report_module, "chapters", lambda: some)
        code = main(["report", "--out", str(self.out), *options])
        index = self.out / "report.json"
        told = json.loads(index.read_text()) if index.exists() else {}
        if told:
            check(self.html(), told)
        return code, told, self.capsys.readouterr().err

    def html(self) -> str:
        """The page."""
        return (self.out / "report.html").read_text()


@pytest.fixture
def report(tmp_path, monkeypatch, capsys):
    return Reporter(tmp_path / "out", monkeypatch, capsys)


def check(html: str, told: dict) -> Page:
    """The laws of every page."""
    page = Page(html)
    assert html.startswith("<!DOCTYPE html>\n<html lang=")
    assert len(set(page.ids)) == len(page.ids)
    for link in page.links:
        assert link.startswith("data:image/") or link.removeprefix("#") in page.ids, link
    assert not page.tags & {"script", "link", "iframe", "object", "base"}
    assert not re.search(r"url\(|@import|https?:", html)
    expected = [
        [table["headings"], *table["rows"]]
        for chapter in told["chapters"]
        for table in chapter["tables"]
    ]
    shown = page.tables[1:-1]  # between the contents and the origin
    assert shown == [
        [[cell.replace("\n", " ") for cell in row] for row in table] for table in expected
    ]
    pictures = [picture for chapter in told["chapters"] for picture in chapter["pictures"]]
    assert [image["alt"] for image in page.images] == [picture["alt"] for picture in pictures]
    for image in page.images:
        head, _, data = image["src"].partition(",")
        assert head == "data:image/png;base64"
        pixels = matplotlib.image.imread(io.BytesIO(base64.b64decode(unquote_to_bytes(data))))
        assert pixels.size > 0
    for chapter in told["chapters"]:
        for words in (chapter["command"], *chapter["question"], *chapter["notes"]):
            assert words in page.text
        assert (chapter["complaint"] or "checks passed") in page.text
    for fact in (told["command"], told["commit"], told["code_sha256"], told["model_sha256"]):
        assert fact in page.text
    for name, version in told["versions"].items():
        assert f"{name} {version}" in page.text
    assert told["machine"]["processor"] in page.text
    return page


def test_the_check_sees_a_page_that_leads_elsewhere_or_shows_other_numbers(report):
    _, told, _ = report(stub("one", []))
    html = report.html()
    for old, new in (
        ("</figure>", ""),
        ('href="#one"', 'href="#two"'),
        ("</h1>", "</h1><a href='elsewhere.html'></a>"),
        ("color-scheme", "background: url(x.png); color-scheme"),
        ("7.25", "7.26"),
        ("data:image/png;base64,iVBOR", "data:image/png;base64,jVBOR"),
    ):
        assert old in html
        with pytest.raises((AssertionError, OSError, ValueError, SyntaxError)):
            check(html.replace(old, new), told)


def test_a_chapter_is_run_once_and_again_when_a_file_of_it_is_gone_or_changed(report):
    ran: list[str] = []
    both = (stub("one", ran), stub("two", ran))
    code, told, _ = report(*both)
    assert code == 0
    assert told["missing"] == []
    assert [chapter["name"] for chapter in told["chapters"]] == ran == ["one", "two"]
    assert told["chapters"][1]["command"] == f"fjh two --seed 0 --out {report.out / 'two'}"
    assert told["chapters"][1]["recordings"] == ["run.rrd"]
    page = report.html()

    again = report(*both)[1]
    assert ran == ["one", "two"]
    assert again["chapters"] == told["chapters"]
    undated = [
        re.sub(r"[Ww]ritten.*", "", text)
        for text in (page, Path(report.out, "report.html").read_text())
    ]
    assert undated[0] == undated[1]  # the same page, but for the time of its writing

    (report.out / "two" / "figure.png").unlink()
    report(*both)
    assert ran == ["one", "two", "two"]
    (report.out / "one" / "one.json").write_text("{}")
    report(*both)
    assert ran == ["one", "two", "two", "one"]
    for text in ("", "[]", "{}", '{"basis": 7}'):
        before = len(ran)
        (report.out / "two" / "chapter.json").write_text(text)
        report(*both)
        assert ran[before:] == ["two"], text


def test_other_options_code_or_versions_run_every_chapter_again(report, monkeypatch):
    ran: list[str] = []
    both = (stub("one", ran), stub("two", ran))
    report(*both)
    _, told, _ = report(*both, options=("--quick",))
    assert "fjh one --quick --seed 0" in told["chapters"][0]["command"]
    report(*both, options=("--quick", "--seed", "3"))
    assert len(ran) == 6
    for what, value in (
        ("code_sha256", lambda: "0" * 64),
        ("versions", lambda: {"numpy": "0.1"}),
        ("processor", lambda: "an abacus"),
    ):
        before = len(ran)
        monkeypatch.setattr(provenance, what, value)
        report(*both, options=("--quick", "--seed", "3"))
        assert len(ran) == before + 2, what
        report(*both, options=("--quick", "--seed", "3"))
        assert len(ran) == before + 2, what


def test_ctrl_c_keeps_finished_chapters_and_says_how_to_go_on(report):
    ran: list[str] = []
    first, last = stub("one", ran), stub("three", ran)
    code, told, error = report(first, stub("two", ran, raised=KeyboardInterrupt()), last)
    assert code == 130
    assert error.startswith("fjh: interrupted: no file was left half-written; ")
    assert error.endswith("the same command continues with two, chapter 2 of 3\n")
    assert error.count("\n") == 1
    assert told["missing"] == ["two", "three"]
    assert "</strong> two, three; the same command" in report.html()
    assert {path.name for path in report.out.iterdir()} == {"one", "report.json", "report.html"}
    code, told, _ = report(first, stub("two", ran), last)
    assert (code, ran, told["missing"]) == (0, ["one", "two", "two", "three"], [])


def test_an_interrupted_report_of_another_kind_costs_only_the_chapters_that_it_replaced(report):
    ran: list[str] = []
    first, last = stub("one", ran), stub("two", ran)
    report(first, last)
    interrupted = stub("two", ran, raised=KeyboardInterrupt())
    assert report(first, interrupted, options=("--quick",))[0] == 130
    assert report(first, last)[0] == 0
    assert ran == ["one", "two", "one", "two", "one"]


def test_a_chapter_whose_packages_are_absent_is_left_out_and_the_page_says_why(report):
    ran: list[str] = []
    absent = NotInstalled("fjh two needs what is not installed, mink: pip install it")
    code, told, error = report(stub("one", ran), stub("two", ran, raised=absent))
    assert (code, error) == (0, "")
    assert told["missing"] == []
    assert told["left_out"] == {"two": str(absent)}
    assert [chapter["name"] for chapter in told["chapters"]] == ["one"]
    assert f"Left out: two, since {absent}." in Page(report.html()).text
    assert not (report.out / "two").exists()
    code, told, _ = report(stub("one", ran), stub("two", ran))  # they have been installed
    assert (code, ran, told["left_out"]) == (0, ["one", "two", "two"], {})


def test_an_interrupted_study_that_keeps_its_runs_goes_on_with_them(report):
    """As a sweep does, which has its own sentence about Ctrl-C."""
    ran: list[str] = []
    code, told, error = report(stub("one", ran, raised=Interrupted("--resume goes on")))
    assert (code, told) == (130, {})
    assert error.endswith("the same command continues with one, chapter 1 of 1\n")
    given: list[dict] = []

    def make(**options: object) -> Results:
        given.append(options)
        return Results({})

    words = ("sweep", "Run many.\n\nAnd compare.", "", "", "Less.", "the noise")
    further = (Option("workers", int, 3, "Processes."), Option("resume", bool, False, "Go on."))
    assert report(Chapter(MadeStudy(*words, further, streams=True, make=make)))[0] == 0
    (options,) = given
    assert options["resume"] is None
    assert options["workers"] == 3
    assert options["folder"] == report.out / "sweep"


def test_ctrl_c_in_the_first_chapter_leaves_no_folder(report):
    assert report(stub("one", [], raised=KeyboardInterrupt()))[0] == 130
    assert not report.out.exists()


def test_an_unsound_chapter_is_told_and_the_others_still_run(report):
    ran: list[str] = []
    code, told, error = report(
        stub("one", ran, failed=2.0),
        stub("two", ran, raised=Unsound("it diverged at 4 s")),
        stub("three", ran),
    )
    assert code == 1
    assert error == (
        "fjh: a study failed: one: at 3 s: error & <more> is 2, expected below 1; "
        "two: it diverged at 4 s\n"
    )
    assert ran == ["one", "two", "three"]
    assert [chapter["complaint"] is None for chapter in told["chapters"]] == [False, False, True]
    html = report.html()
    assert html.count("&#x2717; a check failed") == 4  # in the contents and in the chapter
    assert html.count("&#x2713; checks passed") == 2


def test_what_diverged_is_tried_again_and_never_told_with_older_numbers(report):
    ran: list[str] = []
    report(stub("one", ran))
    code, told, _ = report(stub("one", ran, raised=Unsound("it diverged")), options=("--quick",))
    assert code == 1
    assert told["chapters"][0]["tables"] == told["chapters"][0]["pictures"] == []
    code, _, _ = report(stub("one", ran), options=("--quick",))
    assert (code, ran) == (0, ["one"] * 3)


def test_wrong_input_is_refused_before_any_work(report, tmp_path):
    ran: list[str] = []
    report.out.write_text("taken")
    code, _, error = report(stub("one", ran))
    assert code == 2
    assert "cannot be a folder" in error
    assert main(["report", "--seed", "-1"]) == 2
    assert ran == []
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.long
def test_a_real_study_has_captions_for_its_figures_and_its_tables_as_they_are_printed(report):
    """The study of the other tests, run short."""
    study = next(each for each in studies() if each.name == "release")
    code, told, _ = report(Chapter(study), options=("--quick",))
    assert code == 0
    (chapter,) = told["chapters"]
    figures = {file for file in chapter["wrote"] if file.endswith(".png")}
    assert {picture["file"] for picture in chapter["pictures"]} == figures
    assert chapter["recordings"] == [file for file in chapter["wrote"] if file.endswith(".rrd")]
    assert chapter["model_sha256"] == told["model_sha256"]
    page = Page(report.html())
    printed = (report.out / "release" / "release.md").read_text()
    for row in (row for table in page.tables[1:-1] for row in table):
        assert f"| {' | '.join(row)} |" in printed


def tables_in(markdown: str) -> list[Table]:
    """The tables of a study's Markdown file."""
    tables = []
    for title, body in re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", markdown, re.M | re.S):
        lines = [line for line in body.splitlines() if line.startswith("|")]
        heads, _, *rows = [[cell.strip() for cell in line[1:-1].split("|")] for line in lines]
        tables.append(Table(title, tuple(heads), [tuple(row) for row in rows]))
    return tables


def test_table_1_stands_on_the_page_beside_the_papers_numbers(report, table1_folder):
    """Table I is the one of the other tests."""
    tables = tables_in((table1_folder / "table1.md").read_text())

    def make(*, seed: int, quick: bool, on_progress: OnProgress) -> Results:
        return Results({}, tables)

    assert report(Chapter(made_study("table1", make)))[0] == 0
    rows = Page(report.html()).tables[1]
    assert rows[0][1:] == ["W_a", "W_b", "W_c", "W_d", "W_e", "W_a_uncorrected"]
    papers = [row[1:] for row in rows if row[0].strip() == "paper"]
    assert papers == [
        ["2.4476", "2.2444", "2.3115", "2.3634", "2.8324", "9.8167"],
        ["3.0916", "3.2712", "3.2528", "3.5601", "3.2868", "4.7903"],
    ]


@pytest.mark.parametrize("chapter", report_module.chapters(), ids=lambda chapter: chapter.name)
def test_a_chapters_command_is_one_that_fjh_understands(chapter, capsys):
    words = chapter.command(Edition(Path("results"), 0, True, {})).split()[1:]
    assert chapter.name == words[0]
    assert main([*words, "--help"]) == 0
    told = capsys.readouterr().out
    for word in words[1:]:
        assert not word.startswith("--") or f"{word} " in told
    assert all(chapter.question)


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
