"""What every study leaves: files that its JSON lists, figures that can be printed and read."""

import json
import re

import pytest

from experiments.studies import LINES
from tests.printed import assert_printable

NOT_JUDGED = {"bode", "atlas", "figure4", "figure5", "figure6", "track"}
"""Figures whose own tests read them: maps, the paper's, and that of any robot."""


@pytest.mark.long
@pytest.mark.parametrize("study", LINES)
def test_a_study_leaves_what_its_json_lists_and_figures_without_faults(
    request, faults_of_figures, study
):
    folder = request.getfixturevalue(f"{study}_folder")
    text = (folder / f"{study}.json").read_text()
    summary, named = json.loads(text), set(re.findall(r'"([\w.-]+\.(?:rrd|npz|parquet))"', text))
    assert summary["experiment"] == study
    assert {"seed", "versions", "model_sha256", "files"} <= set(summary)
    files = {path.name for path in folder.iterdir()}
    assert set(summary["files"]) == files
    assert {f"{study}.json", f"{study}.md", *named} <= files
    assert_printable(folder)
    assert max(path.stat().st_size for path in folder.glob("*.pdf")) < 1e6
    figures = {path.stem for path in folder.glob("*.pdf")} - NOT_JUDGED
    assert {name: faults_of_figures(name) for name in figures} == {name: [] for name in figures}
