"""Statistics of rows by groups, with checks and printed tables."""

from collections.abc import Mapping
from math import inf, nan, sqrt
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest, chi2

from argument_checks.ties import greatest
from experiments.recover.predictions import ISOLABLE
from fjh.rig.rig import Rig
from fjh.study.result import Check, TableView, check
from ftc.fdi import LEARNING_S

WORST = 1.1
"""Required limit of every run's RMS error, relative to that of a controller without diagnosis."""
NOT_ISOLATED, OVER_INFORMED, ALARMS_PER_HOUR, IDENTIFIED_S = 0.01, 1.10, 0.1, 0.3
"""Goals with all mismatches: fraction of isolable failures that are not identified, RMS error
relative to an informed controller's, false alarms per hour, median time to identification [s]."""
ENOUGH_H = 30.0
"""Least healthy time [h] that can demonstrate the rate of false alarms. With less time, the check
is that the lower bound of the rate is below the goal."""
LARGE_ERROR = 10.0
"""Error, in sizes of the path, above which a larger closure residual is accepted: MuJoCo's soft
constraints open in proportion to the motion."""
COUNTED = ("since", "after")
"""Spans in which an increase of the error by the diagnosis is examined."""

CLOSED = "closure residual [m]"

Tables = Mapping[str, pd.DataFrame]


def noise_of(rig: Rig) -> float:
    """Return the RMS sensor noise of all major rows together, in sizes of the path."""
    return sqrt(len(rig.major)) * rig.noise / rig.size


def grouped(rows: pd.DataFrame, noise: float) -> dict[str, pd.DataFrame]:
    """Return tables of statistics: by mismatch and size, kind of failure, event, and other sorts.

    `noise` is the result of :func:`noise_of`.
    """
    has_fault = rows.sort.isin(["failure", "size", "event"])
    groups = {
        "by_mismatch": (rows[has_fault], "mismatch factor"),
        "by_kind": (rows[(rows.sort == "failure") & (rows.mismatch == "all")], "sense kind"),
        "by_event": (rows[rows.sort == "event"], "event"),
        "pairs": (rows[rows.sort == "pair"], "mismatch"),
        "healthy": (rows[rows.sort == "healthy"], "sense mismatch"),
    }
    return {
        name: pd.DataFrame(
            dict(zip(keys.split(), key, strict=True))
            | (hourly(group) if name == "healthy" else {})
            | statistics(group, noise)
            for key, group in frame.groupby(keys.split(), sort=False)
        )
        for name, (frame, keys) in groups.items()
        if len(frame)
    }


def statistics(rows: pd.DataFrame, noise: float) -> dict[str, Any]:
    """Return the statistics of a group of rows; NaN for missing controllers or spans.

    Runs that ended early are counted, but excluded from all other statistics. Errors are RMS values
    over the runs, and the largest peaks.
    """
    simulated = rows[rows.status == "flown"]
    right, isolable = (simulated[simulated[name].eq(True)] for name in ("right", "isolable"))
    kinds_too = isolable[~(isolable.separation_from_kinds < ISOLABLE)]
    lost_tasks, given_up = simulated.lost_rightly.eq(True), simulated.task_lost.eq(True)
    harm = harm_ratio(simulated, noise)
    rms, peak = (simulated.filter(regex=f"^{what}_").astype(float) for what in ("rms", "peak"))
    return {
        "runs": len(rows),
        "ended": int((rows.status == "ended").sum()),
        "unaware_ended": int(rows.unaware_ended.notna().sum()),
        **share("alarm_before", simulated.alarm_before),
        **share("detected", simulated.alarm_s.notna()),
        **share("named", simulated.named_s.notna()),
        **share("right", simulated.right),
        **share("kind_right", right.kind_right),
        **share("all_right", simulated.all_right),
        **share("handled", simulated.all_right.eq(True) | given_up),
        **share("healthy_named", simulated.healthy_named),
        **share("isolable_right", isolable.right),
        **share("isolable_all_right", kinds_too.all_right),
        "smallest_separation_from_others": simulated.separation_from_others.min(),
        "smallest_separation_from_kinds": simulated.separation_from_kinds.min(),
        "kinds_alike": int(simulated.last_kinds.astype(str).str.contains(" ").sum()),
        "withdrawn": int((simulated.withdrawn > 0).sum()),
        "unexplained": int(simulated.unexplained.sum()),
        "task_lost": int(given_up.sum()),
        "lost": int(lost_tasks.sum()),
        "lost_and_given_up": int((lost_tasks & given_up).sum()),
        **delays("alarm", right.alarm_s),
        **delays("named", right.named_s),
        **np.sqrt((rms**2).mean()),
        **peak.max(),
        **over(simulated, "informed"),
        **over(simulated, "unaware"),
        "counted_worst": float(harm.max()) if len(harm) else 0.0,
        "harmed": int((harm > WORST).sum()),
    }


def share(name: str, values: pd.Series) -> dict[str, Any]:
    """Return number and fraction of true values, with the 95 % interval of Clopper and Pearson."""
    valid = values.dropna().astype(bool)
    count, cases = int(valid.sum()), len(valid)
    low, high = binomtest(count, cases).proportion_ci(0.95) if cases else (nan, nan)
    counts = {f"{name}_cases": cases, f"{name}_count": count}
    rate = count / cases if cases else nan
    return counts | {f"{name}_rate": rate, f"{name}_low": float(low), f"{name}_high": float(high)}


def delays(name: str, times_s: pd.Series) -> dict[str, float]:
    """Return median, 95th percentile and maximum of times."""
    levels = {"median": 0.5, "percentile_95": 0.95, "largest": 1.0}
    valid = times_s.dropna().astype(float)
    return {f"{name}_{key}_s": valid.quantile(level) for key, level in levels.items()}


def over(rows: pd.DataFrame, controller: str) -> dict[str, Any]:
    """Return ratios of the supervised controller's RMS errors to another's in the same runs.

    The ratios are those of all runs together, their median, and their maximum.
    """
    result: dict[str, Any] = {}
    for span in COUNTED:
        both = rows[[f"rms_supervised_{span}", f"rms_{controller}_{span}"]].astype(float).dropna()
        supervised, reference = (both[name] for name in both)
        ratio, key = supervised / reference, f"over_{controller}_{span}"
        result |= {f"{key}_runs": len(both), f"{key}_median": ratio.median()}
        result[f"{key}_pooled"] = np.sqrt((supervised**2).mean() / (reference**2).mean())
        result[f"{key}_worst"] = ratio.max()
    return result


def harm_ratio(rows: pd.DataFrame, noise: float) -> pd.Series:
    """Return the ratio of each run's RMS error to that of a controller without diagnosis.

    The ratio is the larger of those since the event and after recovery, and at most 1 if the errors
    differ by less than the sensors' noise. It is NaN if one of the runs is missing.
    """
    ratios = {}
    for span in COUNTED:
        supervised, reference = rows[f"rms_supervised_{span}"], rows[f"rms_unaware_{span}"]
        ratio = supervised / reference
        ratios[span] = ratio.where(supervised - reference > noise, ratio.clip(upper=1.0))
    return pd.DataFrame(ratios).max(axis=1).dropna()


def hourly(rows: pd.DataFrame) -> dict[str, Any]:
    """Return the hourly rates of alarms and of identified actuators in healthy runs.

    Only the time after the learning phase counts, in which alarms are possible.
    """
    hours = float(rows.duration_s.sum()) / 3600
    monitored_hours = hours - float(rows.duration_s.clip(upper=LEARNING_S).sum() / 3600)
    alarms, identified = (int(rows[name].sum()) for name in ("alarms", "healthy_named"))
    return {
        "hours": hours,
        "watched_hours": monitored_hours,
        "alarms": alarms,
        **per_hour("alarms", alarms, monitored_hours),
        **per_hour("named", identified, monitored_hours),
        "commands_changed": int(rows.commands_changed.sum()),
    }


def per_hour(name: str, count: int, hours: float) -> dict[str, float]:
    """Return the rate of a Poisson process with one-sided 95 % bounds (Garwood), or NaN."""
    rate = low = high = nan
    if hours:
        rate, high = count / hours, float(chi2.ppf(0.95, 2 * (count + 1))) / 2 / hours
        low = float(chi2.ppf(0.05, 2 * count)) / 2 / hours if count else 0.0
    key = f"{name}_per_hour"
    return {f"{key}_rate": rate, f"{key}_low_95": low, f"{key}_high_95": high}


def checks(settings: Mapping[str, Any], rows: pd.DataFrame, tables: Tables) -> list[Check]:
    """Return checks of closure, completed runs, errors increased by diagnosis, and the goals."""
    limit_m, is_large = settings["closure_limit_m"], rows.peak_supervised_since > LARGE_ERROR
    gap_m = rows.closure_residual_max_m.fillna(0.0)
    # Runs with the largest sizes of a mismatch have unstable loops.
    near_m = gap_m.where(~is_large & (rows.sort != "size"), 0.0)
    large_m = gap_m.where(is_large, 0.0)
    if "shown" in tables:
        near_m = pd.concat([near_m, tables["shown"].closure_residual_max_m])
    other_ended = rows[["informed_ended", "unaware_ended"]].notna().any(axis=1)
    ended = (rows.status.eq("ended") | other_ended) & (rows.sort != "event")
    result = [
        *check(CLOSED, near_m.max(), limit_m, "runs near the path, at the usual sizes"),
        *check(CLOSED, large_m.max(), 10 * limit_m, "runs with a large error by an event"),
        *check("number of runs that ended early", ended.sum(), 1, settings["robot"]),
    ]
    if "by_event" in tables:
        events = tables["by_event"].set_index("event")
        worst = events.counted_worst.where(events.ended == 0, inf)
        what = "largest RMS error over that of a controller without diagnosis"
        result += check(what, worst, WORST)
    if "healthy" in tables and ("by_event" in tables or "beliefs" in tables):
        healthy, where = tables["healthy"].set_index("mismatch"), "runs without failures or events"
        what = "number of runs in which an actuator was identified as failed"
        result += check(what, healthy.healthy_named_count, 1, where)
        what = "number of runs whose commands an alarm changed"
        result += check(what, healthy.commands_changed, 1, where)
    return result + (goals(tables) if "beliefs" in tables else [])


def goals(tables: Tables) -> list[Check]:
    """Return checks of the hexapod's failures and recorded runs, and of another controller."""
    stability = tables["beliefs"]
    [pairs] = tables["pairs"].itertuples()
    worst = stability.iloc[greatest(stability.sensitivity_peak)]
    failures = tables["by_mismatch"].query("factor == 1.0").set_index("mismatch")
    isolated = "share of the isolable failures that is not identified"
    over = "RMS after recovery divided by that of a controller informed at once"
    what = "number of unstable pairs of true and diagnosed fault"
    unstable = (stability.largest_pole >= 1).sum()
    result = check(what, unstable, 1, f"{worst.truth}, {worst.belief} diagnosed")
    for name, plant in {"exact": "exact plant", "all": "all mismatches"}.items():
        row = failures.loc[name]
        for key, which in {"right": "identified first", "all_right": "and kind in the end"}.items():
            missed = 1 - row[f"isolable_{key}_rate"]
            result += check(isolated, missed, NOT_ISOLATED, f"{plant}, actuator {which}")
        result += check(over, row.over_informed_after_pooled, OVER_INFORMED, plant)
    result += check(isolated, 1 - pairs.handled_rate, NOT_ISOLATED, "two failures in a run")
    what = "median time until the failed actuator is identified [s]"
    result += check(what, failures.named_median_s["all"], IDENTIFIED_S, "all mismatches")
    what = "number of runs in which a healthy actuator was identified as failed"
    result += check(what, failures.healthy_named_count.sum(), 1, "runs with a failure")
    for healthy in tables["healthy"].itertuples():
        low, high = healthy.alarms_per_hour_low_95, healthy.alarms_per_hour_high_95
        side, rate = ("upper", high) if healthy.hours >= ENOUGH_H else ("lower", low)
        what = f"{side} 95 % bound of the false alarms per hour"
        result += check(what, rate, ALARMS_PER_HOUR, f"{healthy.mismatch}, no failures")
    is_wrong = tables["shown"].set_index("name").all_right.eq(False).astype(float)
    what = "wrong diagnosis of the failures or of the task (0 no, 1 yes),"
    result += check(what, is_wrong.rename("run {}".format), 0.5)
    for other in tables["controller"].itertuples() if "controller" in tables else ():
        what = f"number of runs in which it failed ({other.failure or 'none'})"
        result += check(what, other.failed, 0.5, f"controller {other.name}")
    return result


def printed_tables(tables: Tables) -> list[TableView]:
    """Return the printed tables: by event; or by kind, and for the hexapod by mismatch."""
    if "by_event" in tables:
        columns = "event runs right_count=identified over_unaware_since_median=median_ratio:.2f "
        columns += "counted_worst=largest_ratio:.2f"
        legend = (
            "Identified: the actuator or the cause. Ratio: RMS error over that of a controller "
            "without diagnosis; the largest of those that differ by more than the sensors' noise."
        )
        return [TableView("By event", tables["by_event"], columns, legend)]
    legend = (
        "Identified: the first identified actuator had failed. Ratio: RMS error after recovery "
        "over that of a controller informed at once."
    )
    columns = "runs right_count=identified named_median_s=median_time_s:.3f "
    columns += "over_informed_after_worst=largest_ratio:.3f"
    title = "By kind of failure, all mismatches"
    kinds = TableView(title, tables["by_kind"], f"sense=sensors kind {columns}", legend)
    if "beliefs" not in tables:
        return [kinds]
    failures = tables["by_mismatch"].query("factor == 1.0 and over_informed_after_runs > 0")
    return [TableView("By mismatch of plant and model", failures, f"mismatch {columns}"), kinds]


def notes(rows: pd.DataFrame, tables: Tables) -> list[str]:
    """Return sentences on alarms in healthy runs, events not simulated, and another controller."""
    lines = []
    for row in tables["healthy"].itertuples() if "healthy" in tables else ():
        most = f"below {row.alarms_per_hour_high_95:.2g} per hour at 95 %"
        where = f"{row.watched_hours:.2g} healthy hours, {row.mismatch}"
        lines.append(f"{row.alarms} alarms in {where}: {most}.")
    reasons = rows.message[rows.status == "refused"].unique()
    lines += [f"Not simulated: {reason}." for reason in sorted(reasons)]
    for other in tables["controller"].itertuples() if "controller" in tables else ():
        over = f"{other.after_over_informed:.4g} times that of the controller informed at once"
        lines.append(f"RMS error of {other.name} after recovery: {over}.")
    return lines
