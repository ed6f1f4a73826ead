"""Results of studies as data frames, and comparison of two results."""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.app.cli import main
from fjh.comparison import LEVEL, Comparison, compare, shifted
from fjh.result_frames import results
from fjh.study.errors import WrongInput
from fjh.study.result import Check, Result
from tests.synthetic import write_synthetic_run

DATA = Path(__file__).parents[2] / "docs" / "data"
TABLE1 = json.loads((DATA / "table1.json").read_text())


@pytest.fixture(autouse=True)
def working_folder(tmp_path_factory, monkeypatch):
    """Change to an empty working directory."""
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))


def compared(a: dict[str, Any], b: dict[str, Any]) -> Comparison:
    for name, content in (("a", a), ("b", b)):
        Path(f"{name}.json").write_text(json.dumps({"experiment": "figures"} | content))
    return compare("a.json", "b.json")


@pytest.mark.parametrize(
    ("seed", "factor", "changed"),
    [(0, 1 + 1e-8, 0), (0, 1 + 1e-5, 1), (0, 1.066, 1), (1, 1.03, 0), (1, 1.07, 1)],
)
def test_more_than_rounding_is_a_change_and_with_another_seed_more_than_noise(
    seed, factor, changed
):
    other = copy.deepcopy(TABLE1) | {"seed": seed}
    column = next(each for each in other["columns"] if each["name"] == "W_b")
    column["alpha_measured_rms_urad"] *= factor
    difference = compared(TABLE1, other)
    assert difference.resampled == bool(seed) and list(difference.settings.place) == ["seed"] * seed
    assert list(difference.changed.place) == ["columns.W_b.alpha_measured_rms_urad"] * changed


def test_changed_text_is_no_noise_and_a_new_constant_no_new_sample():
    one = {"seed": 0, "status": "exact", "x": None, "y": 1.0, "rules": {"gain": 1.0}}
    difference = compared(one, one | {"seed": 1, "status": "lost", "x": 2.0, "y": 1.01})
    assert set(difference.changed.place) == {"status", "x"}
    difference = compared(one, one | {"rules": {"gain": 1.0, "friction": 0.5}, "y": 1.01})
    assert list(difference.changed.place) == ["y"] and len(difference.settings) == 1


def test_bounds_of_confidence_count_if_the_samples_differ():
    one = {"seed": 0, "right_count": 60, "right_rate": 1.0, "right_low": 0.94, "right_high": 1.0}
    other = {"seed": 1, "right_count": 55, "right_rate": 0.92}
    other |= {"right_low": 0.82, "right_high": 0.97}
    assert not len(compared(one, other).changed)
    assert set(compared(one, other | {"seed": 0}).changed.place) == {"right_count", "right_rate"}
    assert len(compared(one, other | {"right_high": 0.9}).changed) == 2


def test_round_off_files_and_sentences_are_not_compared():
    note = "In a run of 16 s the error is {} urad, and more."
    one = {"a": 1e-16, "b": 1e13, "files": ["a"], "note": note.format(3.10)}
    other = {"a": 3e-12, "b": 7e15, "files": [], "note": note.format(3.11)}
    assert not len(compared(one, other).changed)
    difference = compared({"a": 0.0, "b": 2.0}, {"a": 1e-3})
    assert len(difference.changed) == 1 and list(difference.absent.place) == ["b"]


@given(st.dictionaries(st.sampled_from("uvw"), st.floats(-1e3, 1e3)), st.randoms())
def test_a_table_equals_itself_in_any_order(numbers, rng):
    rows = [{"name": name, "at": k, **numbers} for name in "pq" for k in range(3)]
    difference = compared({"rows": rows}, {"rows": rng.sample(rows, len(rows))})
    assert not len(difference.changed) and not len(difference.absent)


def test_two_samples_of_one_distribution_seldom_differ_and_a_shift_is_detected():
    """The significance level is that of all columns together."""

    def rows(seed: int, shift: float = 0.0) -> pd.DataFrame:
        rng = np.random.default_rng(seed)
        values = {f"x{k}": rng.normal(size=200) for k in range(20)}
        return pd.DataFrame({"case": range(200), **values, "y": rng.normal(shift, 1, 200)})

    false = sum(len(shifted(rows(2 * k), rows(2 * k + 1))[0]) > 0 for k in range(20))
    assert false <= 20 * LEVEL + 2
    changed, tested = shifted(rows(0), rows(1, shift=0.7))
    assert list(changed.place) == ["median of y"] and tested == 21


def test_a_newly_failed_check_gives_exit_code_one(capsys):
    check = {"what": "gap [m]", "where": "W_b", "value": 1e-9, "limit": 1e-8, "passed": True}
    compared({"checks": [check]}, {"checks": [check | {"value": 1e-6, "passed": False}]})
    assert main(["results", "b.json", "--against", "a.json"]) == 1
    assert "1 checks fail that passed before: gap [m]" in capsys.readouterr().err
    assert main(["results", "b.json", "--against", "b.json"]) == 0


def test_results_of_two_studies_are_not_compared(capsys):
    compared({}, {})
    Path("b.json").write_text('{"experiment": "force"}')
    assert main(["results", "b.json", "--against", "a.json"]) == 2
    assert "of figures and b.json of" in capsys.readouterr().err


def test_printed_text_has_no_control_characters(capsys):
    evil = "\x1b[2J\n"
    compared({evil: 1.0, "word": "a"}, {evil: 2.0, "word": evil})
    assert main(["results", "b.json", "--against", "a.json"]) == 0
    assert all(line.isprintable() for line in capsys.readouterr().out.splitlines())


def test_runs_checks_and_files_of_every_folder_are_frames():
    """Answer the first question of docs/find.md from the published rows."""
    frames = results(DATA)
    late = frames.runs.query("named_s > 0.1 and kind == 'locked' and mismatch == 'all'")
    assert len(late) and set(late.study) == {"recover"}
    assert {"study", "folder"} <= set(frames.files)
    with pytest.raises(WrongInput, match="no results of a study"):
        results("nowhere")


def test_a_folder_of_recordings_alone_is_a_row_for_each(tmp_path):
    for name in ("one", "two"):
        write_synthetic_run(tmp_path, name)
    frames = results(tmp_path)
    assert list(frames.runs.recording) == ["one", "two"] and set(frames.runs.study) == {"made"}
    assert list(frames.runs)[:2] == list(frames.files)[:2] == ["study", "folder"]


def test_a_study_of_tables_gives_its_first_and_its_checks(tmp_path):
    spirals, arm = pd.DataFrame({"name": ["a", "b"]}), pd.DataFrame({"name": ["c"]})
    checks = [Check("gap [m]", "a", 1e-9, 1e-8), Check("gap [m]", "b", 1e-7, 1e-8)]
    Result({"seed": 0}, {"spirals": spirals, "arm": arm}, checks).publish("limits", tmp_path)
    frames = results(tmp_path)
    assert list(frames.runs.name) == ["a", "b"]
    assert frames.checks.passed.tolist() == [True, False]
    assert {".json", ".parquet"} <= set(frames.files.kind)


def test_a_comparison_is_at_most_25_lines_of_80_columns():
    checks = [
        {"what": "gap [m]", "where": "W" * k, "value": None, "limit": 1e-8, "passed": False}
        for k in range(30)
    ]
    one = {"rules": {f"v{k}": "1" for k in range(30)}, "seed": 0}
    other = {"rules": {f"v{k}": "2" * 39 for k in range(30)}, "seed": 1, "checks": checks}
    numbers = ({f"{'x' * k}_a": scale for k in range(90)} for scale in (1 / 3, 1e9 / 3))
    a, b = (entry | values for entry, values in zip((one, other), numbers, strict=True))
    lines = str(compared(a, b | {f"new{k}": 1 for k in range(30)})).splitlines()
    assert len(lines) == 25 and max(map(len, lines)) < 80
    assert lines[2] == "31 settings differ:" and "- 87 more" in lines
    assert lines[-2].endswith("W: gap [m]: None, expected below 1e-08")
