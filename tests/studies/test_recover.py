"""`fjh recover`: actuator failures that nothing announces, and whatever else happens."""

import json
import math
import re
from copy import deepcopy
from dataclasses import replace
from math import sqrt
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from matplotlib.figure import Figure

from experiments.app.cli import main
from experiments.recording.properties import properties_of
from experiments.recover import figure, plan
from experiments.recover.figure import headline
from experiments.recover.plan import MISMATCHES, exact_rig
from experiments.recover.predictions import SETTINGS, beliefs, lookalikes
from experiments.recover.results import checks, described
from experiments.recover.row import SCHEMA
from experiments.recover.simulate import INFORMED_LATE, informed_late
from experiments.recover.statistics import (
    WORST,
    frame_of,
    noise_of,
    per_hour,
    quantiles,
    rate,
    statistics,
    summarized,
)
from experiments.study.results import Results
from tests.conftest import fjh
from tests.rrd import rows, scalars


def failures(summary: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Entries of single failures, by the mismatch."""
    return {each["mismatch"]: each for each in summary["by_mismatch"] if each["factor"] == 1.0}


def test_the_failures_are_found_named_and_gone_around(recover):
    """With an exact plant and with all mismatches alike."""
    assert failures(recover).keys() == {"exact", "all"}
    for entry in failures(recover).values():
        assert entry["right"]["rate"] == entry["detected"]["rate"] == 1.0
        assert entry["alarm_before"]["count"] == entry["healthy_named"]["count"] == 0
        assert entry["named_s"]["median"] < 0.3
        assert 0.9 < entry["over_informed"]["after"]["pooled"] < 1.1
    assert recover["pairs"][0]["handled"]["rate"] == 1.0


def test_the_rows_are_those_that_the_summary_counts(recover, recover_folder):
    table = pq.read_table(recover_folder / recover["dataset"])
    assert table.schema.names == SCHEMA.names
    found = table.to_pylist()
    assert [row["case"] for row in found] == list(range(recover["runs"]))
    assert sum(recover["sorts"].values()) == len(found)
    mixed = [row for row in found if (row["sort"], row["mismatch"]) == ("failure", "all")]
    entry = failures(recover)["all"]
    assert entry["right"]["count"] == sum(row["right"] for row in mixed)
    for row in mixed:
        assert row["rms_supervised_after"] < 0.95 * row["rms_unaware_after"]
        assert row["kind_confidence"] >= 0.5 and row["report"].startswith(row["actuator"])
        assert 0 < row["alarm_s"] <= row["named_s"]
    lasting = [row["duration_s"] for row in found if row["sort"] == "healthy"]
    assert recover["healthy"][0]["hours"] == pytest.approx(sum(lasting) / 3600)


def test_the_dither_costs_less_than_another_seed(recover):
    cost = recover["dither_cost"]
    assert np.abs(cost["change"]).max() < 0.5 * np.abs(cost["reseeded"]).max()


def test_without_a_failure_there_is_no_alarm_and_no_command_changes(recover):
    [healthy] = recover["healthy"]
    assert healthy["alarms"] == healthy["commands_changed"] == 0
    assert healthy["healthy_named"]["count"] == 0


def test_no_belief_about_one_strut_destabilizes_the_loop_and_a_bad_one_would_show(recover):
    table = recover["beliefs"]
    assert table["unstable"] == 0 and table["largest_pole"] < 1
    assert table["sensitivity_peak_worst"] < 3
    rig = exact_rig()
    louder = tuple(replace(each, C=6 * each.C, D=6 * each.D) for each in rig.control.loops)
    testbed = replace(rig.control.testbed, loops=louder)
    found = beliefs([], replace(rig, control=replace(rig.control, testbed=testbed)))
    assert found["unstable"] > 0 and found["largest_pole"] > 1


@pytest.mark.long
def test_told_late_or_wrongly_the_pointing_stays_bounded():
    """At worst the kick of a healthy strut that is let go, and then the errors of a failed one."""
    told = informed_late(INFORMED_LATE[0])
    for entry in told:
        assert entry["peak_told_during"] < 0.8
        assert entry["peak_told_after"] < 0.15
    late = [each for each in told if each["late_s"] > 0]
    assert len(late) == 4
    for entry in late[:3]:  # told within half a second
        assert entry["rms_told_after"] < 0.95 * entry["rms_told_nothing_after"]


@pytest.mark.long
@pytest.mark.parametrize("setting", list(SETTINGS)[:2])
def test_the_ambiguity_is_that_of_antipodal_struts_and_the_dither_lifts_it(setting):
    for seen in lookalikes(setting, [0]):
        if setting == "angles" and seen["kind"] == "locked":
            assert {"actuator": "strut4", "kind": "locked"}.items() <= seen["alike"][0].items()
        if setting == "angles, dither":
            assert seen["alike"] == []


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda s: s["closure_m"].update(near=2e-8), "usual sizes: closure residual"),
        (lambda s: s["closure_m"].update(thrown=2e-7), "an event throws far: closure residual"),
        (lambda s: s["beliefs"].update(unstable=1), "unstable"),
        (lambda s: s.update(ended=1), "ended early"),
        (
            lambda s: failures(s)["all"]["isolable_right"].update(rate=0.98),
            "all mismatches, actuator as first named",
        ),
        (
            lambda s: failures(s)["exact"]["isolable_all_right"].update(rate=0.9),
            "exact plant, actuator and kind in the end",
        ),
        (lambda s: failures(s)["all"]["isolable_right"].update(rate=None), "is nan"),
        (
            lambda s: failures(s)["all"]["over_informed"]["after"].update(pooled=1.2),
            "mismatches: RMS after",
        ),
        (lambda s: failures(s)["all"]["named_s"].update(median=0.301), "until the failed actuator"),
        (lambda s: failures(s)["all"].update(named_s=None), "until the failed actuator.* nan"),
        (
            lambda s: failures(s)["exact"]["healthy_named"].update(count=1),
            "a healthy actuator was named",
        ),
        (
            lambda s: s["healthy"][0]["healthy_named"].update(count=1),
            "without failures or events: .* actuator was named",
        ),
        (lambda s: s["healthy"][0].update(commands_changed=1), "whose commands an alarm changed"),
        (lambda s: s["pairs"][0]["handled"].update(rate=0.9), "two failures"),
        (lambda s: s["shown"]["locked"].update(all_right=False), "run locked: wrong diagnosis"),
        (lambda s: s["healthy"][0]["alarms_per_hour"].update(low_95=0.2), "lower 95 % bound"),
        (
            lambda s: s["healthy"][0].update(hours=99, alarms_per_hour={"high_95": 0.11}),
            "without failures: upper 95 % bound of the false alarms",
        ),
    ],
)
def test_whatever_is_not_as_it_should_be_fails_its_check(recover, spoil, words):
    assert Results(recover, checks=checks(recover)).failed_check is None
    spoilt = deepcopy(recover)
    spoil(spoilt)
    assert re.search(words, str(Results(spoilt, checks=checks(spoilt)).failed_check))


def test_tables_and_notes_are_those_of_the_json_file_and_all_files_are_listed(
    recover, recover_folder
):
    told = described(recover)
    assert (recover_folder / "recover.md").read_text() == told.markdown()
    assert set(recover["files"]) == {path.name for path in recover_folder.iterdir()}
    for table in told.tables:
        assert {len(row) for row in table.rows} == {len(table.headings)}
    assert "| locked | centre | angles |" in told.markdown() and "in urad" in told.markdown()


# Statistics.


def frame(**columns: list[Any]) -> pd.DataFrame:
    """A frame of runs that differ in these columns."""
    count = len(next(iter(columns.values())))
    same = {"status": "flown", "sort": "failure", "mismatch": "all", "factor": 1.0}
    given = [
        dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
    ]
    rows = [same | {"case": k, "sense": "task", "kind": "free"} | given[k] for k in range(count)]
    return frame_of(rows)


def test_rates_have_the_bounds_of_the_textbooks():
    """No alarm in T hours: below 3 / T at 95 %, the rule of three; 306 of 306: from 98.8 % on."""
    assert per_hour(0, 10.0) == pytest.approx(
        {"rate": 0.0, "low_95": 0.0, "high_95": -math.log(0.05) / 10}
    )
    low, high = (per_hour(3, 10.0)[f"{bound}_95"] or 0.0 for bound in ("low", "high"))
    assert 0.0 < low < 0.3 < high
    assert per_hour(0, 0.0) == {"rate": None, "low_95": 0.0, "high_95": None}
    assert rate(pd.Series([True] * 306))["low"] == pytest.approx(0.025 ** (1 / 306))
    assert rate(pd.Series([None, True, False], dtype=object))["rate"] == 0.5
    assert rate(pd.Series([], dtype=object))["rate"] is None
    assert quantiles(pd.Series([np.nan])) is None
    assert quantiles(pd.Series([1.0, 2.0, 9.0])) == pytest.approx(
        {"median": 2.0, "percentile_95": 8.3, "largest": 9.0}
    )


def test_the_groups_count_what_the_rows_say():
    """One right, one taken for another, one that ended early, in two groups of kinds."""
    made = frame(
        kind=["free", "free", "locked"],
        right=[True, False, None],
        kind_right=[True, False, None],
        last_kinds=["free weak", "free", None],
        isolable=[True, True, None],
        named_s=[0.1, 0.2, None],
        rms_supervised_after=[3.0, 4.0, None],
        rms_informed_after=[3.0, 2.0, None],
        peak_supervised_after=[7.0, 5.0, None],
        status=["flown", "flown", "ended"],
    )
    found = statistics(made, 0.0)
    assert found["by_event"] == found["pairs"] == found["healthy"] == []
    [mixed], (free, locked) = found["by_mismatch"], found["by_kind"]
    assert (mixed["runs"], mixed["ended"], locked["ended"], free["ended"]) == (3, 1, 1, 0)
    assert (free["right"]["count"], free["right"]["cases"], locked["right"]["cases"]) == (1, 2, 0)
    assert free["isolable_right"]["count"] == free["kinds_alike"] == 1
    assert free["named_s"]["median"] == 0.1  # of the right one
    assert free["kind_right"]["cases"] == 1
    after = {"rms": sqrt(12.5), "peak": 7.0}
    assert free["errors"]["supervised"] == {"after": pytest.approx(after)}
    expected = {"runs": 2, "pooled": sqrt(25 / 13), "median": 1.5, "worst": 2.0}
    assert free["over_informed"] == {"since": None, "after": pytest.approx(expected)}


@pytest.mark.parametrize(
    ("errors", "harmed", "worst"),
    [
        ((5.0, 5.0), 0, 1.0),
        ((6.0, 5.0), 1, 1.2),
        ((0.6, 0.5), 0, 1.0),  # 1.2 times, but within the noise
        ((100.0, 100.0, 7.0), 1, 7.0),  # which a large transient would hide
        ((2.5, 5.0), 0, 1.0),
    ],
)
def test_harm_is_more_than_a_tenth_and_more_than_the_noise_in_either_span(errors, harmed, worst):
    """Errors in microradians, of which the path has a hundred."""
    noise = noise_of(exact_rig())
    assert 100 * noise == pytest.approx(0.3 * sqrt(2))
    supervised, unaware, after, *_ = *errors, 1.0
    made = frame(
        rms_supervised_since=[supervised / 100],
        rms_unaware_since=[unaware / 100],
        rms_supervised_after=[after / 100],
        rms_unaware_after=[0.01],
    )
    entry = summarized(made, noise)
    assert entry["harmed"] == harmed and entry["counted_worst"] == pytest.approx(worst)


# Figures and recordings.


def test_in_the_figure_failures_that_are_not_named_are_missing_from_its_shares():
    """One of four has no diagnosis, one is taken for another strut's: half are named."""
    cases = frame(
        right=[True, True, False, False],
        named_s=[0.003, 0.009, 0.005, None],
        rms_informed_after=[1.0] * 4,
        rms_supervised_after=[1.0] * 4,
        rms_unaware_after=[2.0] * 4,
    )
    delays, after = Figure().subplots(1, 2)
    figure.draw_delays(delays, cases)
    (curve,) = delays.lines
    at, share = curve.get_xydata().T
    assert share[at <= 9].max() == 0.5 and not share[at < 3].any()
    assert curve.get_label() == "free: 2 of 4" and "at most 9 ms" in delays.get_title()
    figure.draw_after(after, cases)
    ends = {line.get_label(): line.get_xydata()[-1].tolist() for line in after.lines}
    assert ends == {"supervised: up to 1.00": [1, 1], "unaware: up to 2.00": [2, 1]}


def test_the_figures_groups_hold_every_mismatch_once_and_count_all_their_runs():
    names = [name for group in figure.GROUPS.values() for name in group]
    assert sorted(names) == sorted(set(MISMATCHES) - {"exact", "other family"})
    flown = frame(
        mismatch=["gain", "hysteresis", "all", "exact"],
        factor=[3.0, 3.0, 1.0, 1.0],
        right=[True, False, True, False],
    )
    axes = Figure().add_subplot()
    figure.draw_sizes(axes, flown)
    assert {text.get_text() for text in axes.texts} == {"1 of 2", "1 of 1"}
    assert "up to 1 times" in axes.get_title()


def test_the_figures_title_says_what_the_summary_does(recover):
    entry = failures(recover)["all"]
    right, cases = entry["right"]["count"], entry["right"]["cases"]
    median_ms = 1e3 * entry["named_s"]["median"]
    assert f"{right} of {cases} failures, {median_ms:.0f} ms" in headline(recover)


def test_the_recording_shows_the_strut_when_it_fails_and_when_it_is_found(recover_folder, recover):
    path = recover_folder / "locked.rrd"
    data = np.load(recover_folder / "locked.npz")
    failed_s = recover["shown"]["locked"]["time_s"]
    times, failed = scalars(path, "/actuators/input/failed_0")
    assert 0 <= times[0] - round(failed_s * 1e9) < 5e6  # shown every 5 ms
    ticks = np.searchsorted(data["time_s"], times / 1e9 - 1e-9)
    np.testing.assert_array_equal(failed[:, 0], data["strut_input_percent"][ticks, 0])
    held = properties_of(path)
    named_s = round((failed_s + held["named_s"]) * 1e9)
    assert 0 < held["named_s"] < 0.3 and held["named_kind"] == "locked"
    for lane, at in (("is", round(failed_s * 1e9)), ("taken_for", named_s)):
        times, states = rows(path, f"/state/strut1_{lane}", "StateChange:state")
        assert states == [["sound"], ["locked"]]
        assert abs(times[-1] - at) < 10
    times, texts = rows(path, "/events", "TextLog:text")
    assert len(texts) == 2 and abs(times - [round(failed_s * 1e9), named_s]).max() < 10


# Events.


@pytest.fixture(scope="module")
def events_folder(made_once):
    """A few events, made by the command; harm is found, not hidden."""

    def command(folder) -> int:
        return fjh("recover", "--events", "--quick")(folder) not in (0, 1)

    return made_once("recover_events", command)


@pytest.mark.long
def test_the_command_leaves_rows_table_figure_and_checks(events_folder, faults_of_figures):
    summary = json.loads((events_folder / "recover.json").read_text())
    table = pq.read_table(events_folder / "recover.parquet")
    assert table.schema.names == SCHEMA.names
    found = table.to_pylist()
    assert [row["case"] for row in found] == list(range(summary["runs"])) == list(range(5))
    assert tuple(entry["event"] for entry in summary["by_event"]) == plan.QUICK_EVENTS
    assert set(summary["files"]) == {path.name for path in events_folder.iterdir()}
    assert (events_folder / "recover.md").read_text() == described(summary).markdown()
    assert faults_of_figures("recover_events") == []
    by_name = {row["event"]: row for row in found}
    lock = by_name["locked"]
    assert lock["right"] and lock["kind_right"] and not lock["healthy_named"]
    # Told at once, a controller is better than one that does nothing; the diagnosis comes near it.
    errors = [lock[f"rms_{who}_since"] for who in ("informed", "supervised", "unaware")]
    assert errors == sorted(errors)
    assert by_name[None]["alarms"] == 0
    spoils = [
        (lambda s: s["by_event"][0].update(counted_worst=1.2), "locked: largest RMS error over"),
        (lambda s: s["by_event"][1].update(ended=1), "hard_over: largest RMS error .* is inf"),
        (lambda s: s["healthy"][0]["healthy_named"].update(count=1), "an actuator was named"),
        (lambda s: s["healthy"][0].update(commands_changed=1), "whose commands an alarm changed"),
        (lambda s: s.update(ended=1), "ended early"),
    ]
    good = deepcopy(summary)
    for entry in good["by_event"]:
        entry.update(counted_worst=1.0, ended=0, harmed=0)
    assert Results(good, checks=checks(good)).failed_check is None
    assert f"At most {WORST:g} times" in headline(good) and "4 of 4" in headline(good)
    for spoil, words in spoils:
        spoilt = deepcopy(good)
        spoil(spoilt)
        assert re.search(words, str(Results(spoilt, checks=checks(spoilt)).failed_check))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--hours", "3"), "--hours does not go with --events"),
        (("--controller", "ftc.oracle:OracleController"), "--controller does not go with --events"),
    ],
)
def test_an_option_of_other_cases_is_refused_in_a_sentence(words, said, tmp_path, capfd):
    assert main(["recover", "--events", "--quick", *words, "--out", str(tmp_path / "out")]) == 2
    assert said in capfd.readouterr().err
