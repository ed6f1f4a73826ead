"""Tests that the code of every page runs and prints the stated output."""

import contextlib
import json
import re
import shlex
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import typer
from rerun.chunk import RrdReader

from experiments.app.cli import app_of
from experiments.app.command import command
from experiments.studies import LINES
from sim import MODELS
from tests.pages import assert_prints, blocks, run
from tests.robots import PANDA

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
DOCS = ROOT / "docs"
PAGES = [README, *sorted(DOCS.rglob("*.md"))]
WITH_CODE = [str(page.relative_to(ROOT)) for page in PAGES if "```python\n" in page.read_text()]


def text(page: str) -> str:
    return (ROOT / page).read_text()


def code(page: str, language: str) -> list[str]:
    return [content for kind, content in blocks(text(page)) if kind == language]


def prepare(page: str, folder: Path, request: pytest.FixtureRequest) -> None:
    """Create the files that a page requires in a folder."""
    if page == "docs/track.md":
        shutil.copy(MODELS / "arm.xml", folder / "arm.xml")
    elif page == "docs/load.md":
        (folder / "panda.xml").write_text(PANDA)
        (folder / "arm.urdf").write_text(code(page, "xml")[0])
    elif page == "docs/recordings.md":
        (folder / "docs").symlink_to(DOCS)
        for file in ("W_e.npz", "W_e.rrd"):
            (folder / file).symlink_to(request.getfixturevalue("table1_folder") / file)


@pytest.fixture(scope="session")
def names_of(tmp_path_factory, request):
    """Return a function from a page to its names and its `folder`; each page runs once."""
    done: dict[str, dict[str, Any]] = {}

    def names(page: str) -> dict[str, Any]:
        if page not in done:
            folder = tmp_path_factory.mktemp("page")
            prepare(page, folder, request)
            with contextlib.chdir(folder):
                done[page] = run(text(page)) | {"folder": folder}
        return done[page]

    return names


pytestmark = pytest.mark.long


@pytest.mark.parametrize("page", WITH_CODE)
def test_the_code_of_a_page_prints_the_stated_output(page, names_of):
    assert names_of(page)


@pytest.mark.parametrize("page", [page for page in PAGES if "```sh\n" in page.read_text()], ids=str)
def test_the_command_line_accepts_every_command_of_a_page(page):
    """Names, options and their values are parsed; no command is run."""
    app = typer.main.get_command(app_of(*LINES))
    for line in "".join(code(str(page), "sh")).splitlines():
        program, *arguments = shlex.split(line, comments=True) or [""]
        if Path(program).name == "fjh":
            parser: Any = app
            context = parser.make_context("fjh", arguments)
            while hasattr(parser, "resolve_command"):
                arguments = [*context._protected_args, *context.args]
                _, parser, arguments = parser.resolve_command(context, arguments)
                context = parser.make_context(parser.name, arguments, parent=context)


@pytest.mark.parametrize("robot", ["unknown_arm", "unnamed_gantry"])
def test_the_code_of_the_readme_works_for_other_robots(robot, tmp_path, monkeypatch, capsys):
    """The lock is identified; with noise that hides all signals, the reason is printed."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(Path(__file__).parents[1] / "models" / f"{robot}.xml", tmp_path / "yours.xml")
    site, joint, rig = {
        "unknown_arm": ('"tool"', "j2", "major=[4, 5]"),
        "unnamed_gantry": ("3", "car", "major=[3, 4], noise=1.0, crossover=0.5"),
    }[robot]
    changed = code("README.md", "python")[0].replace('fjh.MODELS / "arm.xml"', '"yours.xml"')
    changed = changed.replace("motor4", joint).replace('"payload"', site)
    names: dict = {}
    exec(changed.replace('major=["x", "y", "z"]', rig), names)
    printed = capsys.readouterr().out
    if robot == "unknown_arm":
        assert printed.startswith("m2 was identified as locked at 2.")
        assert names["error"] < 0.5 * names["rig"].size
    else:
        assert names["rig"].actuators == ("beam", "car", "fine")
        assert "Nothing was diagnosed; the sensors agree with the prediction of" in printed


def test_the_tick_of_the_page_uses_the_general_solver_if_a_rank_is_uncertain(capsys):
    (script,), (printed,) = (code("docs/performance.md", kind) for kind in ("python", "text"))
    exec(script.replace("if qvel is None", "if True"), {})
    assert_prints(capsys.readouterr().out, printed)


def table(heading: str) -> Iterator[list[str]]:
    """Yield the rows of the table of docs/recordings.md with this first heading."""
    page = text("docs/recordings.md")
    for line in page.split(f"|{heading}|")[1].split("\n\n")[0].splitlines()[2:]:
        yield [cell.strip(" `") for cell in line.strip("|").split("|")]


def test_the_tables_list_all_entities_and_arrays_of_the_files(names_of):
    """Entities match exactly one row, and as many as the row states."""
    folder = names_of("docs/recordings.md")["folder"]
    schema = RrdReader(folder / "W_e.rrd").store().schema()
    patterns = {entity.replace("*", "[^/]+"): int(count) for entity, count, *_ in table("entity")}
    present = schema.entity_paths(include_properties=True)
    rows = [[row for row in patterns if re.fullmatch(row, path)] for path in present]
    assert all(len(row) == 1 for row in rows)
    assert Counter(row[0] for row in rows) == patterns
    with np.load(folder / "W_e.npz") as arrays:
        assert {name for name, *_ in table("array")} == set(arrays)


def test_the_study_of_the_page_writes_its_files_and_its_checks_can_fail(names_of, tmp_path):
    names = names_of("docs/architecture.md")
    app = typer.Typer()
    app.command()(command(names["seeds"]))
    app(["--quick", "--out", str(tmp_path)], standalone_mode=False)
    summary = json.loads((tmp_path / "seeds.json").read_text())
    assert {path.name for path in tmp_path.iterdir()} == set(summary["files"])
    runs = pd.DataFrame(summary["runs"])
    assert 0 < np.ptp(runs.alpha_rms_urad) < 0.05 * runs.alpha_rms_urad[0]
    assert [each.passed for each in names["checks"](runs)] == [True] * 4
    for spoilt, passed in (
        ({"alpha_rms_urad": 1.06 * runs.alpha_rms_urad}, [False, False, True, True]),
        ({"gap_m": 1e-6}, [True, True, False, False]),
    ):
        assert [each.passed for each in names["checks"](runs.assign(**spoilt))] == passed


@pytest.mark.parametrize("name", ["fjh", "arm", "arms", "hand", "platform"])
def test_every_number_of_a_machine_file_has_a_stated_source(name):
    comment = ""
    for token in re.findall(
        r"<!--.*?-->|<[^!?/][^>]*>", (MODELS / f"{name}.xml").read_text(), re.DOTALL
    ):
        comment = token if token.startswith("<!--") else comment
        if re.search(r'\w="[-+.\d]', token) and token != comment:
            assert re.search(r"\[(paper|geometry|chosen|derived)\b", comment), token
