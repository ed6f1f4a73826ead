"""Every command ends with what was checked, where its files are, and what to type next."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from experiments.app.cli import main
from experiments.studies import studies
from experiments.study.results import Check, Results
from experiments.study.study import Study
from experiments.study.tables import Table
from tests.made import keep_made

HEIGHTS = Table("Heights", ("", "m"), [("hill", "7.25")])


@contextmanager
def performed(_: Study, **_options: Any) -> Iterator[Results]:
    """Instead of the runs."""
    yield Results({"seed": 0}, [HEIGHTS], checks=[Check("height [m]", "hill", 7.25, 8.0)])


def ended(out: str) -> tuple[str, list[Path], list[str]]:
    """What was checked, folder and first file, and the words of the next command."""
    checked, written, following = out.splitlines()[-3:]
    folder, file = written.removeprefix("Files are in ").removesuffix(" first.").split("; open ")
    assert following.startswith("Next: ")
    return checked, [Path(folder), Path(file)], shlex.split(following.removeprefix("Next: "))


@pytest.mark.parametrize("name", [*(study.name for study in studies()), "report"])
def test_a_quick_run_ends_with_checks_files_and_the_next_command(
    name, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Study, "perform", performed)
    assert main([name, "--quick"]) == 0
    checked, (folder, file), following = ended(capsys.readouterr().out)
    assert checked.startswith("All checks passed")
    assert folder == Path("results", name)
    assert file.parent == folder and file.is_file()
    assert following == ["fjh", name]


def test_a_review_ends_so_too(capsys, tmp_path):
    keep_made(tmp_path)
    out = tmp_path / "review.rrd"
    assert main(["review", str(tmp_path / "made.npz"), "--out", str(out)]) == 0
    checked, written, following = ended(capsys.readouterr().out)
    assert "agree" in checked
    assert written == [tmp_path, out] and out.is_file()
    assert following == ["rerun", str(out)]
