"""The survey as a page and a recording: whole, escaped, and of motions that are really lost."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import mujoco
import numpy as np
import pytest
from markdown_it import MarkdownIt
from scipy.spatial.transform import Rotation

from experiments.app.cli import main
from fjh.recording.properties import properties_of
from fjh.rig.options import RobotOptions, rows_of
from fjh.survey import recording
from fjh.survey.conditions import Survey, surveyed
from fjh.survey.page import headline
from fjh.survey.recording import losses, title, write_losses
from fjh.survey.subject import robot_subject
from sim import MODELS
from tests.rrd import entities, notes, scalars

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
def test_the_page_of_a_matrix_has_every_sentence_and_its_names_are_no_markup(tmp_path, capfd):
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


ROPE = """
<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody><site name="there"/>
  <body><joint name="j1" axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
    <body pos=".3 0 0"><joint name="j2" axis="0 0 1"/><geom size=".02"/>
      <site name="here" pos="0 .1 0"/>
      <body pos=".3 0 0"><joint name="j3" axis="0 0 1"/><geom size=".02"/>
        <site name="payload" pos=".3 0 0"/></body></body></body></worldbody>
  <tendon><fixed name="t1"><joint joint="j1" coef=".02"/><joint joint="j2" coef="-.01"/></fixed>
    <spatial name="t2"><site site="there"/><site site="here"/></spatial></tendon>
  <actuator><motor name="m1" tendon="t1"/><muscle name="m2" tendon="t2" lengthrange=".1 .5"/>
    <motor name="m3" joint="j3"/><motor name="jet" site="payload" gear="0 -1 0 0 0 0"/></actuator>
  <keyframe><key qpos=".3 .6 .5"/></keyframe></mujoco>
"""
"""Drives that are no joints: tendons, a muscle, a thruster; and one that is."""


def survey(file: Path, major: str) -> Survey:
    subject = robot_subject(file, RobotOptions(major=rows_of("major", major)), None, None)
    return surveyed(subject, 0, 0, lambda done, total: None)


def write(found: Survey, folder: Path) -> None:
    verdict = headline(found.subject, found.start)
    write_losses(found.subject, found.start, "fjh survey", verdict, folder)


@pytest.fixture(scope="module")
def surveys(tmp_path_factory) -> dict[str, Survey]:
    """An arm with a free joint each, a platform with a lost turn, and an arm of ropes."""
    rope = tmp_path_factory.mktemp("rope") / "rope.xml"
    rope.write_text(ROPE)
    files = {"arm": MODELS / "arm.xml", "platform": MODELS / "platform.xml", "rope": rope}
    return {name: survey(file, MAJOR[name]) for name, file in files.items()}


MAJOR = {"arm": "0,1", "platform": "3,4", "rope": "3,4"}


def moved(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """How far the payload is from the start along the way, by MuJoCo alone, shape (T, 6)."""
    data, poses = mujoco.MjData(model), []
    site = model.site("payload").id
    for data.qpos[:] in qpos:
        mujoco.mj_kinematics(model, data)
        poses.append((data.site_xmat[site].reshape(3, 3).copy(), data.site_xpos[site].copy()))
    (R, x), *_ = poses
    turns = [Rotation.from_matrix(each @ R.T).as_rotvec() for each, _ in poses]
    return np.hstack([turns, [place - x for _, place in poses]])


@pytest.mark.parametrize("name", MAJOR)
def test_the_motion_is_along_the_direction_that_is_lost(surveys, name, monkeypatch, tmp_path):
    """The pose of the site along the recorded joints; a locked joint moves, a held one rests."""
    found, written = surveys[name], {}
    monkeypatch.setattr(recording, "MOST", 99)
    monkeypatch.setattr(recording, "condition_scene", lambda *driven, **_: driven)
    monkeypatch.setattr(recording, "write_scenes", lambda *of, pages: written.update(of[2]))
    write(found, tmp_path)
    model, lost = found.subject.robot.scene.own, losses(found.subject, found.start)
    assert len(written) == len(lost) > 0
    active = found.subject.system.active
    for loss, (_, _, qpos, (plot,)) in zip(lost, written.values(), strict=True):
        way = moved(model, qpos)
        size = way @ loss.direction
        np.testing.assert_allclose(way, np.outer(size, loss.direction), atol=2e-3 * size.max())
        shown = 1e-6 * plot.values
        np.testing.assert_allclose(shown[:, int(loss.drifts)], size, atol=2e-3 * size.max())
        assert not shown[:, 1 - loss.drifts].any() and size.max() > 1e-4
        rates = loss.velocities[active]
        for codes in found.start.codes[loss.rows]:
            failing = np.flatnonzero(codes)
            assert (codes[failing] == (2 if loss.drifts else 1)).all()
            assert np.abs(rates[failing]).max() > 1e-3 * np.abs(rates).max()
            if loss.drifts:
                assert not np.delete(rates, failing).any()


def test_every_lost_direction_of_the_survey_has_a_cell_with_its_failures(surveys, tmp_path):
    found = surveys["platform"]
    write(found, tmp_path)
    file = tmp_path / "survey.rrd"
    cells = [entity for entity in entities(file) if entity.endswith("/along")]
    assert len(cells) == len(losses(found.subject, found.start)) == 1
    _, values = scalars(file, cells[0])
    assert np.ptp(values, axis=0)[0] > 1 and not np.ptp(values, axis=0)[1]
    lost = {row for loss in losses(found.subject, found.start) for row in loss.rows}
    said = [row for row in found.start.singles.ravel() if found.start.lost(row).size]
    assert lost == set(said)
    assert "motor1 locked, motor2 locked, motor3 locked or motor4 locked: turn z is lost" in notes(
        file
    )
    known = properties_of(file)
    assert (known["study"], known["robot"]) == ("survey", "planar platform on four legs")
    assert known["verdict"] == headline(found.subject, found.start)


def test_more_directions_than_a_screen_holds_are_in_further_recordings(
    surveys, tmp_path, monkeypatch
):
    monkeypatch.setattr(recording, "MOST", 3)
    found = surveys["arm"]
    lost = losses(found.subject, found.start)
    write(found, tmp_path)
    files = sorted(tmp_path.glob("*.rrd"))
    cells = [sum(entity.endswith("/along") for entity in entities(file)) for file in files]
    assert sum(cells) == len(lost) and max(cells) == 3 and len(files) == -(-len(lost) // 3)
    said = "\n".join(notes(file) for file in files)
    assert all(title(found.subject, found.start, loss, most=99) in said for loss in lost)
