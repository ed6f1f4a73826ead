"""`fjh compare`: what changed by more than noise between two results of one study."""

import copy
import json
import random
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.app.cli import main
from experiments.app.compare import compared_checks
from experiments.studies import STUDIES
from experiments.study.differences import ABSENT, Pair, labelled, pairs
from experiments.study.noise import LEVEL, difference, shifts
from experiments.study.results import Check
from experiments.table1.results import checks

DATA = Path(__file__).parents[2] / "docs" / "data"
TABLE1 = json.loads((DATA / "table1.json").read_text())
CHECKED = len(checks(TABLE1))


def said(capsys, *contents: Any, code: int = 0) -> str:
    """What is printed of two results."""
    for name, content in zip("ab", contents, strict=True):
        Path(f"{name}.json").write_text(json.dumps(content))
    assert main(["compare", "a.json", "b.json"]) == code
    return capsys.readouterr().out


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)


def column(content: dict[str, Any], name: str) -> dict[str, Any]:
    return next(each for each in content["columns"] if each["name"] == name)


def shuffled(value: Any, rng: random.Random) -> Any:
    """The same with the entries of every list, and the keys of every object, in another order."""
    if isinstance(value, dict):
        return {key: shuffled(value[key], rng) for key in rng.sample([*value], len(value))}
    if isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
        return [shuffled(each, rng) for each in rng.sample(value, len(value))]
    return value


def test_a_result_beside_itself_says_that_nothing_changed(capsys):
    told = said(capsys, TABLE1, TABLE1)
    assert "\n0 of " in told and f"{CHECKED} of {CHECKED} pass" in told
    assert "differ in" not in told and "->" not in told.replace("a.json -> b.json", "")


def test_entries_in_another_order_are_no_change(capsys):
    other = dict(TABLE1)
    other["columns"] = random.Random(0).sample(TABLE1["columns"], 6)
    assert "\n0 of " in said(capsys, TABLE1, other)


def test_a_number_that_changed_is_named_with_its_entry(capsys):
    other = copy.deepcopy(TABLE1)
    old = column(TABLE1, "W_b")["alpha_measured_rms_urad"]
    column(other, "W_b")["alpha_measured_rms_urad"] = 1.066 * old
    column(other, "W_c")["alpha_measured_rms_urad"] *= 1.01
    told = said(capsys, TABLE1, other)
    change = f"{old:.5g} -> {1.066 * old:.5g} (+6.6 %), and 1 more of the same name"
    assert f"- alpha_measured_rms_urad of W_b: {change}" in told and "\n2 of " in told


@pytest.mark.parametrize(("factor", "changed"), [(1 + 1e-8, 0), (1 + 1e-5, 1)])
def test_what_another_processor_rounds_is_noise(factor, changed):
    other = copy.deepcopy(TABLE1)
    column(other, "W_a")["beta_rms_urad"] *= factor
    assert len(difference(TABLE1, other, times=False).changed) == changed


def test_another_seed_is_said_first_and_its_noise_is_none(capsys):
    other = copy.deepcopy(TABLE1) | {"seed": 1}
    column(other, "W_a")["beta_measured_rms_urad"] *= 1.03
    told = said(capsys, TABLE1, other)
    assert told.index("- seed: 0 -> 1") < told.index("0 of ")
    column(other, "W_a")["beta_measured_rms_urad"] *= 1.03
    assert "\n1 of " in said(capsys, TABLE1, other)
    column(other, "W_b")["secondary_peak"]["gamma_urad"] *= 2  # 0.04 where others have 17
    assert "\n1 of " in said(capsys, TABLE1, other)


def test_a_word_that_changed_is_no_noise_of_a_seed_and_a_new_constant_is_no_other_draw():
    one = {"seed": 0, "status": "exact", "x": None, "y": 1.0, "rules": {"gain": 1.0}}
    other = one | {"seed": 1, "status": "lost", "x": 2.0, "y": 1.01}
    assert {pair.key for pair in difference(one, other, times=False).changed} == {"status", "x"}
    newer = one | {"rules": {"gain": 1.0, "friction": 0.5}, "y": 1.01}
    found = difference(one, newer, times=False)
    assert [pair.key for pair in found.changed] == ["y"] and len(found.settings) == 1


def test_versions_are_said_first_and_change_no_bound(capsys):
    other = copy.deepcopy(TABLE1)
    other["versions"]["mujoco"] = "4.1.0"
    column(other, "W_a")["beta_measured_rms_urad"] *= 1.03
    told = said(capsys, TABLE1, other)
    assert "- versions.mujoco: 4.0.0 -> 4.1.0" in told and "\n1 of " in told


def test_a_check_that_passed_and_fails_now_is_exit_code_one(capsys):
    other = copy.deepcopy(TABLE1)
    column(other, "W_b")["closure_residual_max_m"] = 1e-6
    told = said(capsys, TABLE1, other, code=1)
    assert "- passed and fails now: W_b: closure residual [m] is 1e-06" in told
    assert f"{CHECKED - 1} of {CHECKED} pass, {CHECKED} of {CHECKED} before" in told
    assert "- failed and fails still: W_b: closure residual" in said(capsys, other, other)
    assert "- failed and passes now: W_b: closure residual" in said(capsys, other, TABLE1)


def test_checks_of_an_earlier_version_are_not_known(capsys):
    earlier = {key: value for key, value in TABLE1.items() if key != "columns"}
    told = said(capsys, earlier, TABLE1)
    assert (
        f"{CHECKED} of {CHECKED} pass, not known of this version" in told
        and "- 1 of columns, in" in told
    )


def check(value: float, what: str = "ratio, {:.3f},", where: str = "run") -> Check:
    return Check(what.format(value), where, value, 1.0)


@given(st.lists(st.floats(0, 2), max_size=4), st.lists(st.floats(0, 2), max_size=4))
def test_only_a_check_that_did_not_fail_before_is_new(before, now):
    """By its words without their numbers."""
    places = ("first", "second", "third", "fourth")

    def made(values: list[float]) -> list[Check]:
        return [check(v, where=place) for v, place in zip(values, places, strict=False)]

    new = compared_checks(made(before), made(now))[1]
    failed = {p for v, p in zip(before, places, strict=False) if v >= 1}
    fails = {p for v, p in zip(now, places, strict=False) if v >= 1}
    assert {line.split(":")[0] for line in new} == fails - failed


@pytest.mark.parametrize(
    ("contents", "why"),
    [
        (("{", "{}"), "a.json is not readable JSON"),
        (("[]", "[]"), "a.json is no result of a study"),
        (('{"experiment": "tabel1"}',) * 2, "a.json is no result of a study"),
        (('{"experiment": []}',) * 2, "a.json is no result of a study"),
        (
            ('{"experiment": "table1"}',) * 2,
            "b.json: it is no result of this version of fjh table1",
        ),
        (
            ('{"experiment": "table1"}', '{"experiment": "force"}'),
            "is of fjh table1, b.json of fjh",
        ),
        (('{"experiment": "table1", "columns": 3}',) * 2, "b.json: it is no result"),
        (("[" * 900 + "]" * 900,) * 2, "a.json is no result"),
        (
            ('{"experiment": "figures", "x": ' + '{"x": ' * 960 + "1" + "}" * 961,) * 2,
            "a.json",
        ),
    ],
)
def test_what_is_no_pair_of_results_is_one_sentence(capsys, contents, why):
    for name, content in zip("ab", contents, strict=True):
        Path(f"{name}.json").write_text(content)
    assert main(["compare", "a.json", "b.json"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("fjh: ") and why in error and error.count("\n") == 1


def test_nothing_that_is_printed_commands_a_terminal(capsys):
    evil = "\x1b[2J\n"
    told = said(capsys, TABLE1 | {evil: 1.0, "word": "a"}, TABLE1 | {evil: 2.0, "word": evil})
    assert "\n2 of " in told and all(line.isprintable() for line in told.splitlines())


def test_folders_are_named_by_what_they_hold(capsys):
    Path("empty").mkdir()
    assert main(["compare", str(DATA / "table1.json"), "empty"]) == 2
    assert "empty has no result of a study" in capsys.readouterr().err
    Path("own").mkdir()
    shutil.copy(DATA / "table1.json", "own")
    assert main(["compare", str(DATA / "table1.json"), "own"]) == 0


def test_the_table_of_this_version_passes_beside_that_of_the_last_release(capsys, table1_folder):
    assert main(["compare", str(DATA / "table1.json"), str(table1_folder)]) == 0
    assert "passed and fails now" not in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.night
@pytest.mark.parametrize("name", [study.name for study in STUDIES if study.name != "bench"])
def test_a_result_of_every_study_is_compared_from_its_json(request, capsys, name):
    folder = str(request.getfixturevalue(f"{name}_folder"))
    assert main(["compare", folder, folder]) == 0
    assert "\n0 of " in capsys.readouterr().out


# Pairs of values.

SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(-5, 5), st.floats(-1e3, 1e3), st.sampled_from("abc")
)
ENTRIES = st.lists(
    st.fixed_dictionaries({"name": st.sampled_from("pqrs"), "at": st.integers(0, 9), "x": SCALARS}),
    unique_by=lambda entry: (entry["name"], entry["at"]),
    max_size=5,
)
CONTENTS = st.recursive(
    SCALARS | ENTRIES,
    lambda inner: st.dictionaries(st.sampled_from(["u", "v", "w"]), inner, max_size=3),
    max_leaves=8,
)


@given(CONTENTS, st.randoms(use_true_random=False))
def test_anything_equals_itself_in_any_order(content, rng):
    found = difference({"of": content}, {"of": shuffled(content, rng)}, times=False)
    assert not (found.changed or found.absent or found.settings)


@given(CONTENTS, CONTENTS)
def test_what_changed_one_way_changed_back_the_other(a, b):
    there, back = (difference({"of": x}, {"of": y}, times=False) for x, y in ((a, b), (b, a)))
    assert {(p.place, p.size) for p in there.changed} == {(p.place, p.size) for p in back.changed}
    assert len(there.absent) == len(back.absent) and there.compared == back.compared


@given(ENTRIES, ENTRIES)
def test_labels_tell_entries_apart_by_the_fewest_first_keys(a, b):
    for entries, labels in zip((a, b), labelled(a, b), strict=True):
        assert len(labels) == len(entries) and {*map(id, labels.values())} == {*map(id, entries)}
    a, b = ([{"name": each["name"], **each} for each in one] for one in (a, b))
    if all(len({each["name"] for each in one}) == len(one) for one in (a, b)):
        assert [*labelled(a, b)[0]] == [each["name"] for each in a]


def bounded(low: float, high: float, **entry: float) -> dict[str, Any]:
    return {"seed": 0, "timings": {"daqp": {"p5_us": low, "p95_us": high, **entry}}, "other": 1.0}


@pytest.mark.parametrize(
    ("low", "high", "changed"), [(3.0, 5.0, 0), (4.0, 9.0, 0), (4.2, 5.0, 1), (1.0, 2.9, 1)]
)
def test_timings_changed_where_their_ranges_have_nothing_in_common(low, high, changed):
    before = bounded(3.0, 4.1, median_us=4.0)
    found = difference(before, bounded(low, high, median_us=2.0) | {"other": 9.0}, times=True)
    assert [pair.name for pair in found.changed] == ["timings.daqp.median_us"] * changed


def test_bounds_of_confidence_count_where_the_draws_differ():
    one = {"seed": 0, "rate": {"cases": 60, "right": 60, "rate": 1.0, "low": 0.94, "high": 1.0}}
    other = {"seed": 1, "rate": {"cases": 60, "right": 55, "rate": 0.92, "low": 0.82, "high": 0.97}}
    assert not difference(one, other, times=False).changed
    assert {p.key for p in difference(one, other | {"seed": 0}, times=False).changed} == {
        "rate.right",
        "rate.rate",
    }


def test_round_off_is_not_compared():
    """Nor the reciprocal of what symmetry makes zero."""
    for a, b in ((1e-16, 3e-12), (1e13, 7e15), (0.0, -1e-10)):
        assert Pair(("x",), 0, a, b).size == 0.0
    assert Pair(("x",), 0, 0.0, 1e-3).size == 1.0
    assert Pair(("x",), 0, 1.0, ABSENT).size == float("inf")


def test_files_times_and_sentences_are_no_results():
    one = {
        "files": ["a"],
        "took": {"runs": 3},
        "paragraph": "In a run of 16 s an error of 3.10 urad was found.",
    }
    other = {
        "files": [],
        "took": {"runs": 4},
        "paragraph": "In a run of 16 s an error of 3.11 urad was found.",
    }
    assert not difference(one, other, times=False).changed
    assert len(list(pairs({"status": "exact"}, {"status": "lost"}))) == 1


# Rows.


def rows(seed: int, shift: float = 0.0, count: int = 200) -> pa.Table:
    rng = np.random.default_rng(seed)
    values = {f"x{k}": rng.normal(size=count) for k in range(20)}
    return pa.table({"case": np.arange(count), **values, "y": rng.normal(shift, 1, count)})


def test_two_samples_of_one_distribution_seldom_differ_and_a_shift_is_seen():
    """The level is that of all columns together."""
    false = sum(bool(shifts(rows(2 * k), rows(2 * k + 1))[0]) for k in range(20))
    assert false <= 20 * LEVEL + 2
    changed, tested = shifts(rows(0), rows(1, shift=0.7))
    assert [each.name for each in changed] == ["y"] and tested == 21
    assert changed[0].p < 1e-6 and changed[0].counts == (200, 200)


def test_rows_that_were_drawn_otherwise_are_compared_as_samples(capsys):
    for name, seed, shift in (("a", 0, 0.0), ("b", 1, 0.7)):
        own = Path(name)
        own.mkdir()
        content = json.loads((DATA / "recover.json").read_text()) | {"seed": seed}
        (own / "recover.json").write_text(json.dumps(content))
        pq.write_table(rows(seed, shift), own / "recover.parquet")
    assert main(["compare", "a", "b"]) == 0
    told = capsys.readouterr().out
    assert "1 of 21 columns of the rows differ" in told and "- median y: " in told
    Path("b", "recover.parquet").unlink()
    assert main(["compare", "a", "b"]) == 0
    assert "The rows are not compared: b/recover.parquet is missing." in capsys.readouterr().out
