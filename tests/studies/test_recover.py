"""`fjh paper recover`: actuator failures that nothing announces, and whatever else happens."""

import json
import math
from dataclasses import replace
from math import inf, nan, sqrt
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from scipy.stats import poisson

from experiments.app.cli import main
from experiments.recover import figure, plan
from experiments.recover.plan import exact_rig
from experiments.recover.predictions import SETTINGS, beliefs, lookalikes
from experiments.recover.row import COLUMNS, INFORMED_LATE, informed_late
from experiments.recover.tables import checks, delays, grouped, noise_of, per_hour, share
from fjh.rig.hexapod.mismatch import ALONE
from fjh.study.result import Check
from tests.conftest import fjh


@pytest.fixture
def frames(recover, recover_folder):
    """The dataset and all tables of the study's JSON."""
    return read(recover, recover_folder)


def read(summary: dict[str, Any], folder) -> tuple[pd.DataFrame, dict[str, pd.DataFrame]]:
    tables = {
        name: pd.DataFrame(entries).replace({None: nan})
        for name, entries in summary.items()
        if isinstance(entries, list) and isinstance(entries[0], dict) and name != "checks"
    }
    return pd.read_parquet(folder / summary["dataset"]), tables


def failed(summary, frames) -> list[Check]:
    return [each for each in checks(summary, *frames) if not each.passed]


def test_the_failures_are_found_named_and_gone_around(recover, frames):
    """With an exact plant and with all mismatches alike; the tables count what the rows say."""
    flown, tables = frames
    assert list(flown) == COLUMNS and list(flown.case) == list(range(recover["runs"]))
    failures = tables["by_mismatch"].query("factor == 1.0").set_index("mismatch")
    assert {*failures.index} == {"exact", "all"}
    assert (failures[["right_rate", "detected_rate"]] == 1.0).all(axis=None)
    assert not failures[["alarm_before_count", "healthy_named_count"]].any(axis=None)
    assert (failures.named_median_s < 0.3).all()
    assert failures.over_informed_after_pooled.between(0.9, 1.1).all()
    assert (tables["pairs"].handled_rate == 1.0).all()
    mixed = flown.query("sort == 'failure' and mismatch == 'all'")
    assert failures.right_count["all"] == mixed.right.sum()
    assert (mixed.rms_supervised_after < 0.95 * mixed.rms_unaware_after).all()
    assert (mixed.alarm_s.gt(0) & mixed.alarm_s.le(mixed.named_s)).all()
    assert mixed.kind_confidence.ge(0.5).all()
    [healthy], quiet = tables["healthy"].itertuples(), flown[flown.sort == "healthy"]
    assert healthy.alarms == healthy.commands_changed == healthy.healthy_named_count == 0
    assert healthy.hours == pytest.approx(quiet.duration_s.sum() / 3600)
    cost = tables["dither_cost"]
    assert cost.change.abs().max() < 0.5 * cost.reseeded.abs().max()  # less than another seed


def test_no_belief_about_one_strut_destabilizes_the_loop_and_a_bad_one_would_show(frames):
    found = frames[1]["beliefs"]
    assert found.largest_pole.max() < 1 and found.sensitivity_peak.max() < 3
    rig = exact_rig()
    louder = tuple(replace(each, C=6 * each.C, D=6 * each.D) for each in rig.control.loops)
    testbed = replace(rig.control.testbed, loops=louder)
    found = beliefs([], replace(rig, control=replace(rig.control, testbed=testbed)))
    assert max(row["largest_pole"] for row in found) > 1


@pytest.mark.long
def test_told_late_or_wrongly_the_pointing_stays_bounded():
    """At worst the kick of a healthy strut that is let go, and then the errors of a failed one."""
    told = pd.DataFrame(informed_late(INFORMED_LATE[0]))
    assert told.peak_told_during.max() < 0.8 and told.peak_told_after.max() < 0.15
    late = told[told.late_s > 0]
    assert len(late) == 4
    soon = late[late.late_s < 0.5]
    assert (soon.rms_told_after < 0.95 * soon.rms_told_nothing_after).all()


@pytest.mark.long
@pytest.mark.parametrize("setting", SETTINGS)
def test_the_ambiguity_is_that_of_antipodal_struts_and_the_dither_lifts_it(setting):
    seen = pd.DataFrame(lookalikes(setting, [0]))
    if setting == "angles":
        locked = seen[seen.kind == "locked"]
        assert (locked.nearest_other_actuator == "strut4").all() and (locked.alike > 0).all()
    else:
        assert not seen.alike.any()


SPOILS = [
    ("rows", "closure_residual_max_m", 2e-8, "near the path"),
    ("rows", "status", "ended", "ended early"),
    ("beliefs", "largest_pole", 1.0, "unstable"),
    ("by_mismatch", "isolable_right_rate", 0.98, "first named"),
    ("by_mismatch", "isolable_all_right_rate", nan, "kind in the end"),
    ("by_mismatch", "over_informed_after_pooled", 1.2, "RMS after"),
    ("by_mismatch", "named_median_s", 0.301, "until the failed actuator"),
    ("by_mismatch", "named_median_s", nan, "until the failed actuator"),
    ("by_mismatch", "healthy_named_count", 1, "a healthy actuator was named"),
    ("healthy", "healthy_named_count", 1, "in which an actuator was named"),
    ("healthy", "commands_changed", 1, "whose commands an alarm changed"),
    ("healthy", "alarms_per_hour_low_95", 0.2, "lower 95 % bound"),
    ("healthy", "hours", 99.0, "upper 95 % bound"),
    ("pairs", "handled_rate", 0.9, "two failures"),
    ("shown", "all_right", False, "run locked: wrong diagnosis"),
    ("shown", "closure_residual_max_m", 2e-8, "near the path"),
]


@pytest.mark.parametrize(("table", "column", "value", "words"), SPOILS)
def test_whatever_is_not_as_it_should_be_fails_its_check(
    recover, frames, table, column, value, words
):
    assert failed(recover, frames) == []
    flown, tables = frames
    spoilt = (flown if table == "rows" else tables[table]).assign(**{column: value})
    frames = (spoilt, tables) if table == "rows" else (flown, tables | {table: spoilt})
    found = failed(recover, frames)
    assert found and all(words in str(each) for each in found)


# Statistics.


def frame(**columns: list[Any]) -> pd.DataFrame:
    """A frame of runs that differ in these columns."""
    same = {"sort": "failure", "mismatch": "all", "factor": 1.0, "kind": "free", "status": "flown"}
    made = pd.DataFrame(columns)
    usual = {key: value for key, value in same.items() if key not in made}
    made = made.assign(**usual, sense="task", case=range(len(made)))
    return made.reindex(columns=COLUMNS)


def test_rates_have_the_bounds_of_the_textbooks():
    """No alarm in T hours: below 3 / T at 95 %, the rule of three; 306 of 306: from 98.8 % on."""
    assert list(per_hour("x", 0, 10.0).values()) == pytest.approx([0.0, 0.0, -math.log(0.05) / 10])
    found = per_hour("x", 3, 10.0)
    assert poisson.sf(2, 10 * found["x_per_hour_low_95"]) == pytest.approx(0.05)
    assert poisson.cdf(3, 10 * found["x_per_hour_high_95"]) == pytest.approx(0.05)
    assert np.isnan(list(per_hour("x", 0, 0.0).values())).all()
    assert share("x", pd.Series([True] * 306))["x_low"] == pytest.approx(0.025 ** (1 / 306))
    assert share("x", pd.Series([None, True, False], dtype=object))["x_rate"] == 0.5
    nothing = share("x", pd.Series([], dtype=object))
    assert nothing["x_cases"] == 0 and math.isnan(nothing["x_rate"])
    assert list(delays("x", pd.Series([1.0, 2.0, 9.0])).values()) == pytest.approx([2.0, 8.3, 9.0])


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
    found = grouped(made, 0.0)
    assert {*found} == {"by_mismatch", "by_kind"}
    [mixed], [free, locked] = (each.to_dict("records") for each in found.values())
    assert [mixed["runs"], mixed["ended"], locked["ended"], free["ended"]] == [3, 1, 1, 0]
    assert [free["right_count"], free["right_cases"], locked["right_cases"]] == [1, 2, 0]
    assert free["isolable_right_count"] == free["kinds_alike"] == free["kind_right_cases"] == 1
    assert free["named_median_s"] == 0.1  # of the right one
    assert free["rms_supervised_after"] == pytest.approx(sqrt(12.5))
    assert free["peak_supervised_after"] == 7.0 and math.isnan(free["rms_unaware_after"])
    over = [free[f"over_informed_after_{key}"] for key in ("runs", "pooled", "median", "worst")]
    assert over == pytest.approx([2, sqrt(25 / 13), 1.5, 2.0])
    assert free["over_informed_since_runs"] == 0


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
        sort=["event"],
        event=["sag"],
        rms_supervised_since=[supervised / 100],
        rms_unaware_since=[unaware / 100],
        rms_supervised_after=[after / 100],
        rms_unaware_after=[0.01],
    )
    [entry] = grouped(made, noise)["by_event"].itertuples()
    assert entry.harmed == harmed and entry.counted_worst == pytest.approx(worst)


# Figures.


def test_in_the_figure_failures_that_are_not_named_are_missing_from_its_shares():
    """One of four has no diagnosis, one is taken for another strut's: half are named."""
    axes = Figure().add_subplot()
    figure.draw_delays(axes, pd.Series(["free"] * 4), pd.Series([3.0, 9.0, inf, inf]))
    [curve] = axes.lines
    at, shares = np.transpose(curve.get_xydata())
    assert shares[at <= 9].max() == 0.5 and not shares[at < 3].any()
    assert curve.get_label() == "free: 2 of 4" and "at most 9 ms" in axes.get_title()


def test_the_figures_groups_hold_every_mismatch_once_and_count_all_their_runs():
    names = [name for group in figure.GROUPS.values() for name in group]
    assert sorted(names) == sorted(["all", *ALONE])
    axes, right = Figure().add_subplot(), [True, False, True, False]
    mismatches, factors = ["gain", "hysteresis", "all", "exact"], [3.0, 3.0, 1.0, 1.0]
    figure.draw_sizes(axes, frame(mismatch=mismatches, factor=factors, right=right))
    assert {text.get_text() for text in axes.texts} == {"1 of 2", "1 of 1"}
    assert "up to 1 times" in axes.get_title()


# Events.


@pytest.mark.long
def test_events_have_rows_a_table_a_figure_and_checks(made_once, faults_of_figures):
    """Made by the command; harm is found, not hidden."""
    words = fjh("recover", "--events", "--quick")
    folder = made_once("recover_events", lambda folder: words(folder) not in (0, 1))
    summary = json.loads((folder / "recover.json").read_text())
    flown, tables = read(summary, folder)
    assert list(flown.case) == list(range(5))
    assert tuple(tables["by_event"].event) == plan.QUICK_EVENTS
    assert set(summary["files"]) == {path.name for path in folder.iterdir()}
    assert faults_of_figures("recover_events") == []
    lock = flown[flown.event == "locked"].iloc[0]
    assert lock.right and lock.kind_right and not lock.healthy_named
    # Told at once, a controller is better than one that does nothing; the diagnosis comes near it.
    errors = [lock[f"rms_{who}_since"] for who in ("informed", "supervised", "unaware")]
    assert errors == sorted(errors) and flown.alarms[0] == 0
    good = tables["by_event"].assign(counted_worst=1.0, ended=0)
    assert failed(summary, (flown, tables | {"by_event": good})) == []
    for column, value, why in (("counted_worst", 1.2, "is 1.2"), ("ended", 1, "is inf")):
        spoilt = good.assign(**{column: [value, *good[column][1:]]})
        [found] = failed(summary, (flown, tables | {"by_event": spoilt}))
        assert "locked: largest RMS error over" in str(found) and why in str(found)
    thrown = flown.assign(peak_supervised_since=99.0, closure_residual_max_m=2e-7)
    [found] = failed(summary, (thrown, tables | {"by_event": good}))
    assert "an event throws far" in str(found)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--events", "--hours", "3"), "--hours does not go with --events"),
        (("--events", "--controller", "ftc.loop:Stage"), "--controller does not go"),
        (("--scheduler", "x", "--controller", "ftc.loop:Stage"), "module is here"),
        (("--hours", "0"), "hours must be a number from 0.001"),
        (("--hours", "nan"), "hours must be a number from 0.001"),
    ],
)
def test_an_option_of_other_cases_is_refused_in_a_sentence(words, said, tmp_path, capfd):
    assert main(["recover", "--quick", *words, "--out", str(tmp_path / "out")]) == 2
    assert said in capfd.readouterr().err
