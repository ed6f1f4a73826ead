"""Tests of the study `recover`: unannounced failures and events."""

import math
from dataclasses import replace
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import poisson

from experiments.again import repeat_run
from experiments.app.cli import main
from experiments.recover import plan
from experiments.recover.plan import exact_rig
from experiments.recover.predictions import SETTINGS, ambiguity_rows, stability_rows
from experiments.recover.row import COLUMNS, LATE_FAILURES, informed_late
from experiments.recover.tables import checks, delays, grouped, noise_of, per_hour, share
from fjh.study.errors import WrongInput
from tests.experiments.results import Results


def test_failures_are_detected_isolated_and_compensated(study):
    """Plants are exact or with all mismatches; the tables are those of the rows."""
    dataset, tables = study.rows, study.tables
    assert list(dataset) == COLUMNS and list(dataset.case) == list(range(study.summary["runs"]))
    failures = tables["by_mismatch"].query("factor == 1.0").set_index("mismatch")
    assert {*failures.index} == {"exact", "all"}
    assert (failures[["right_rate", "detected_rate"]] == 1.0).all(axis=None)
    assert not failures[["alarm_before_count", "healthy_named_count"]].any(axis=None)
    assert (failures.named_median_s < 0.3).all()
    assert not tables["healthy"].alarms.any() and tables["beliefs"].sensitivity_peak.max() < 3
    assert failures.over_informed_after_pooled.between(0.9, 1.1).all()
    assert (tables["pairs"].handled_rate == 1.0).all()
    mixed = dataset.query("sort == 'failure' and mismatch == 'all'")
    assert failures.right_count["all"] == mixed.right.sum()
    assert (mixed.rms_supervised_after < 0.95 * mixed.rms_unaware_after).all()
    assert (mixed.alarm_s.gt(0) & mixed.alarm_s.le(mixed.named_s)).all()
    cost = tables["dither_cost"]
    assert cost.change.abs().max() < 0.5 * cost.reseeded.abs().max()  # less than by another seed


def test_a_loop_with_six_times_the_gain_is_unstable_with_a_diagnosis():
    rig = exact_rig()
    louder = tuple(replace(loop, C=6 * loop.C, D=6 * loop.D) for loop in rig.control.loops)
    testbed = replace(rig.control.testbed, loops=louder)
    result = stability_rows([], replace(rig, control=replace(rig.control, testbed=testbed)))
    assert max(row["largest_pole"] for row in result) > 1


@pytest.mark.long
@pytest.mark.night
def test_pointing_stays_bounded_if_informed_late_or_wrongly():
    """The worst error is the transient of a released healthy strut."""
    informed = pd.DataFrame(informed_late(LATE_FAILURES[0]))
    assert informed.peak_told_during.max() < 0.8 and informed.peak_told_after.max() < 0.15
    late = informed[informed.late_s > 0]
    assert len(late) == 4
    soon = late[late.late_s < 0.5]
    assert (soon.rms_told_after < 0.95 * soon.rms_told_nothing_after).all()


@pytest.mark.long
@pytest.mark.parametrize("setting", SETTINGS)
def test_only_antipodal_struts_are_ambiguous_and_not_with_dither(setting):
    ambiguity = pd.DataFrame(ambiguity_rows(setting, [0]))
    if setting == "angles":
        locked = ambiguity[ambiguity.kind == "locked"]
        assert (locked.nearest_other_actuator == "strut4").all() and (locked.alike > 0).all()
    else:
        assert not ambiguity.alike.any()


@pytest.mark.long
def test_a_published_run_can_be_repeated():
    published = Path(__file__).parents[2] / "docs" / "data"
    run, comparison = repeat_run(published, 0)
    assert len(run.time_s) and {"stored", "flown", "same"} == set(comparison)
    with pytest.raises(WrongInput, match="no dataset with case 99999"):
        repeat_run(published, 99999)


def frame(**columns: list[Any]) -> pd.DataFrame:
    """Return a frame of runs that differ in these columns."""
    same = {"sort": "failure", "mismatch": "all", "factor": 1.0, "kind": "free", "status": "flown"}
    result = pd.DataFrame(columns)
    usual = {key: value for key, value in same.items() if key not in result}
    result = result.assign(**usual, sense="task", case=range(len(result)))
    return result.reindex(columns=COLUMNS)


def test_rates_have_the_textbook_bounds():
    """The rule of three bounds no alarm in T hours by 3 / T at 95 %; 306 of 306 imply 98.8 %."""
    assert list(per_hour("x", 0, 10.0).values()) == pytest.approx([0.0, 0.0, -math.log(0.05) / 10])
    result = per_hour("x", 3, 10.0)
    assert poisson.sf(2, 10 * result["x_per_hour_low_95"]) == pytest.approx(0.05)
    assert poisson.cdf(3, 10 * result["x_per_hour_high_95"]) == pytest.approx(0.05)
    assert np.isnan(list(per_hour("x", 0, 0.0).values())).all()
    assert share("x", pd.Series([True] * 306))["x_low"] == pytest.approx(0.025 ** (1 / 306))
    assert share("x", pd.Series([None, True, False], dtype=object))["x_rate"] == 0.5
    nothing = share("x", pd.Series([], dtype=object))
    assert nothing["x_cases"] == 0 and math.isnan(nothing["x_rate"])
    assert list(delays("x", pd.Series([1.0, 2.0, 9.0])).values()) == pytest.approx([2.0, 8.3, 9.0])


def test_the_groups_count_the_rows():
    """Runs are a correct one, a wrong one, and one that ended early, in two groups of kinds."""
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
    result = grouped(made, 0.0)
    assert {*result} == {"by_mismatch", "by_kind"}
    [mixed], [free, locked] = (table.to_dict("records") for table in result.values())
    assert [mixed["runs"], mixed["ended"], locked["ended"]] == [3, 1, 1]
    assert [free["right_count"], free["right_cases"], locked["right_cases"]] == [1, 2, 0]
    assert free["isolable_right_count"] == free["kinds_alike"] == free["kind_right_cases"] == 1
    assert free["named_median_s"] == 0.1  # of the correct diagnosis
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
        ((0.6, 0.5), 0, 1.0),  # 1.2 times, within the noise
        ((100.0, 100.0, 7.0), 1, 7.0),
        ((2.5, 5.0), 0, 1.0),
    ],
)
def test_harm_is_above_a_tenth_and_above_the_noise_in_either_span(errors, harmed, worst):
    """Errors are in microradians; the path has a hundred."""
    noise = noise_of(exact_rig())
    assert 100 * noise == pytest.approx(0.3 * sqrt(2))
    supervised, undiagnosed, after, *_ = *errors, 1.0
    made = frame(
        sort=["event"],
        event=["sag"],
        rms_supervised_since=[supervised / 100],
        rms_unaware_since=[undiagnosed / 100],
        rms_supervised_after=[after / 100],
        rms_unaware_after=[0.01],
    )
    [entry] = grouped(made, noise)["by_event"].itertuples()
    assert entry.harmed == harmed and entry.counted_worst == pytest.approx(worst)


@pytest.mark.long
@pytest.mark.night
def test_events_have_rows_a_table_and_checks(tmp_path):
    """Checks detect harm in rows made by the command."""
    assert main(["recover", "--events", "--quick", "--quiet", "--out", str(tmp_path)]) in (0, 1)
    study = Results(tmp_path, "recover")
    simulated, events = study.rows, study.tables["by_event"]
    assert tuple(events.event) == plan.QUICK_EVENTS
    lock = simulated[simulated.event == "locked"].iloc[0]
    assert lock.right and lock.kind_right and not lock.healthy_named
    # The informed controller is best, the supervised one between it and that without diagnosis.
    errors = [lock[f"rms_{who}_since"] for who in ("informed", "supervised", "unaware")]
    assert errors == sorted(errors) and simulated.alarms[0] == 0
    good = events.assign(counted_worst=1.0, ended=0)
    large_errors = simulated.assign(peak_supervised_since=99.0, closure_residual_max_m=2e-7)
    for rows, by_event, expected in (
        (simulated, good, []),
        (simulated, good.assign(counted_worst=[1.2, *good.counted_worst[1:]]), ["is 1.2"]),
        (simulated, good.assign(ended=[1, *good.ended[1:]]), ["is inf"]),
        (large_errors, good, ["with a large error"]),
    ):
        evaluated = checks(study.summary, rows, study.tables | {"by_event": by_event})
        result = [str(entry) for entry in evaluated if not entry.passed]
        assert len(result) == len(expected) and all(part in result[0] for part in expected)
