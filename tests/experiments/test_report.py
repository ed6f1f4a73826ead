"""Tests of `fjh paper report`: a self-contained page of studies that are run once."""

import base64
import html
import io
import json
import re
import shutil
from collections.abc import Callable
from urllib.parse import unquote_to_bytes

import pandas as pd
import pytest
from PIL import Image

from experiments.app import report as report_module
from experiments.app.cli import main
from fjh.study import provenance
from fjh.study.errors import Interrupted, Unsound
from fjh.study.plotting import new_figure
from fjh.study.result import Check, Picture, Result, TableView
from tests.synthetic import synthetic_study

HEIGHTS = TableView(
    "Of <it>", pd.DataFrame({"x": ["a < b"], "y_um": [7.25]}), "x y_um:.2f", "& why."
)


PICTURE = Picture("figure", "A <pixel>.", 'One "pixel".', lambda: new_figure(1, 1))


def stub(ran: list[str], failed=0.0, raised=None, pictures=()) -> Callable[..., Result]:
    """Return a study that passes its check if a number is below 1."""

    def make(*, seed: int, quick: bool, times: int, on_progress) -> Result:
        ran.append(f"{seed}{'q' * quick}")
        on_progress(1, 1)
        if raised:
            raise raised
        return Result(
            {"seed": seed},
            checks=[Check("error & <more>", "at 3 s", failed, 1.0)],
            views=[HEIGHTS],
            notes=["5 < 6 & so on"],
            pictures=list(pictures),
            records=[lambda folder: (folder / "run.rrd").touch()],
        )

    return make


@pytest.fixture
def report(tmp_path, monkeypatch, capsys):
    """Function that runs `fjh paper report`; returns exit code, index and standard error."""
    out = tmp_path / "out"

    def run(*options: str, **made: Callable[..., Result]) -> tuple[int, dict, str]:
        monkeypatch.setattr(report_module, "STUDIES", {name: (name, {}) for name in made})
        monkeypatch.setattr(report_module, "LINES", {name: f"About {name}." for name in made})
        monkeypatch.setattr(report_module, "study", lambda name: synthetic_study(name, made[name]))
        code = main(["paper", "report", "--out", str(out), *options])
        index = out / "report.json"
        summary = json.loads(index.read_text()) if index.exists() else {}
        if summary:
            text_of((out / "report.html").read_text(), summary)
        return code, summary, capsys.readouterr().err

    return run


def text_of(page: str, summary: dict) -> str:
    """Return the text of a page, checked to be complete and self-contained."""
    assert page.startswith("<!DOCTYPE html>\n<html lang=") and page.rstrip().endswith("</html>")
    places = re.findall(r' id="([^"]*)"', page)
    assert len(set(places)) == len(places)
    for link in re.findall(r' (?:href|src|srcset|data)="([^"]*)"', page):
        assert link.startswith("data:image/") or link.removeprefix("#") in places, link
    assert not re.search(r"<(script|link|iframe|object|base)\b|url\(|@import|https?:", page)
    for data in re.findall(r'src="data:image/png;base64,([^"]*)"', page):
        Image.open(io.BytesIO(base64.b64decode(unquote_to_bytes(data)))).verify()
    text = html.unescape(re.sub(r"<[^>]*>", "", page))
    for entry in summary["chapters"]:
        assert entry["command"] in text
        assert (entry["complaint"] or "checks passed") in text
    facts = [summary[key] for key in ("command", "commit", "code_sha256")]
    for fact in (*facts, *summary["versions"].values()):
        assert fact in text
    return text


def test_the_page_has_tables_notes_and_figures_of_each_study(report, tmp_path):
    made = stub([], pictures=[PICTURE])
    code, summary, _ = report(one=made, two=made)
    assert code == 0 and summary["missing"] == []
    assert summary["chapters"][1]["command"] == f"fjh paper two --out {tmp_path / 'out' / 'two'}"
    page = (tmp_path / "out" / "report.html").read_text()
    cells = re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", page)
    assert cells.count("a &lt; b") == cells.count("7.25") == 2
    assert page.count('alt="One &quot;pixel&quot;."') == 2
    for words in ("Of <it>", "& why.", "5 < 6 & so on", "A <pixel>.", "By nothing."):
        assert text_of(page, summary).count(words) >= 2


def test_a_study_is_run_once_and_again_if_a_file_is_missing(report, tmp_path):
    first, second = list[str](), list[str]()
    both = {"one": stub(first), "two": stub(second)}
    _, summary, _ = report(**both)
    assert report(**both)[1]["chapters"] == summary["chapters"]
    assert (len(first), len(second)) == (1, 1)
    (tmp_path / "out" / "two" / "run.rrd").unlink()
    report(**both)
    assert (len(first), len(second)) == (1, 2)
    for text in ("", "[]", '{"versions": 7}'):
        (tmp_path / "out" / "report.json").write_text(text)
        assert report(**both)[0] == 0
    assert (len(first), len(second)) == (4, 5)


def test_other_options_code_or_versions_run_every_study_again(report, monkeypatch):
    ran: list[str] = []
    for options in ([], ["--quick"], ["--quick", "--seed", "3"], ["--quick", "--seed", "3"]):
        report(*options, one=stub(ran))
    assert ran == ["0", "0q", "3q"]
    other = {"processor": "abacus", "cores": 1, "memory_gib": 1, "system": "x"}
    for what, value in (
        ("code_sha256", "0" * 64),
        ("versions", {"numpy": "0.1"}),
        ("machine", other),
    ):
        monkeypatch.setattr(provenance, what, lambda value=value: value)
        before = len(ran)
        for _ in range(2):
            report("--quick", one=stub(ran))
        assert len(ran) == before + 1, what


@pytest.mark.parametrize("raised", [KeyboardInterrupt(), Interrupted("--resume goes on")])
def test_ctrl_c_keeps_finished_studies_and_tells_how_to_continue(report, tmp_path, raised):
    ran: list[str] = []
    last = {"three": stub(ran)}
    code, summary, error = report(one=stub(ran), two=stub(ran, raised=raised), **last)
    assert code == 130
    assert error.startswith("fjh: interrupted: no file was left half-written; ")
    assert "the same command continues with two, study 2 of 3" in error
    assert summary["missing"] == ["two", "three"]
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"one", "report.json", "report.html"}
    code, summary, _ = report(one=stub(ran), two=stub(ran), **last)
    assert (code, len(ran), summary["missing"]) == (0, 4, [])
    shutil.rmtree(tmp_path / "out")
    assert report(one=stub([], raised=raised))[0] == 130
    assert not (tmp_path / "out").exists()


def test_a_failed_study_is_reported_and_the_others_are_run(report, tmp_path):
    diverged = Unsound("it diverged at 4 s")
    code, summary, error = report(
        one=stub([], failed=2.0), two=stub([], raised=diverged), three=stub([])
    )
    assert code == 1
    for complaint in ("one: at 3 s: error & <more> is 2, expected below 1", f"two: {diverged}"):
        assert complaint in error
    assert [bool(entry["complaint"]) for entry in summary["chapters"]] == [True, True, False]
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("a check failed") == 4  # in the contents and in the section
    assert page.count("checks passed") == 2
    ran: list[str] = []
    assert report(one=stub(ran), two=stub(ran), three=stub(ran))[0] == 1
    assert ran == ["0"]  # the diverged study has no files and is repeated


@pytest.mark.long
@pytest.mark.night
def test_a_real_study_is_on_the_page(tmp_path, monkeypatch):
    monkeypatch.setattr(report_module, "STUDIES", {"release": ("release", {})})
    assert main(["paper", "report", "--quick", "--quiet", "--out", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text()
    text = text_of(page, json.loads((tmp_path / "report.json").read_text()))
    for cell in re.findall(r"\| ([\d.]+) ", (tmp_path / "release" / "release.md").read_text()):
        assert cell in text
