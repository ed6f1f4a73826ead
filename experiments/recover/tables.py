"""All rows by groups, checks of these, and what of them is printed."""

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
"""Design requirement, in every run: RMS error over that of a controller that does nothing."""
NOT_ISOLATED, OVER_INFORMED, ALARMS_PER_HOUR, NAMED_S = 0.01, 1.10, 0.1, 0.3
"""Goals with all mismatches: share of isolable failures that are not identified, RMS error over an
informed controller's, rate of false alarms, and median time until the failed actuator is named."""
ENOUGH_H = 30.0
"""Fewer hours could not show the rate of false alarms even without any alarm; of the usual two the
check asks only that the alarms do not disprove it, by their lower bound."""
THROWN = 10.0
"""Error, in path sizes, of a run that an event throws far: loops that MuJoCo holds by soft
constraints open by a part of what the machine moves."""
COUNTED = ("since", "after")
"""Spans in which the diagnosis may do harm: the start of recovery can hide what follows."""

CLOSED = "closure residual [m]"

Tables = Mapping[str, pd.DataFrame]


def noise_of(rig: Rig) -> float:
    """RMS of the sensors' noise, all major rows: smaller differences of RMS errors do not count."""
    return sqrt(len(rig.major)) * rig.noise / rig.size


def grouped(rows: pd.DataFrame, noise: float) -> dict[str, pd.DataFrame]:
    """Statistics by mismatch and size, kind of failure, event; and of other sorts, if any.

    Args:
        rows: Of the dataset, with another controller's columns where it ran.
        noise: Of :func:`noise_of`.
    """
    struck = rows.sort.isin(["failure", "size", "event"])
    groups = {
        "by_mismatch": (rows[struck], "mismatch factor"),
        "by_kind": (rows[(rows.sort == "failure") & (rows.mismatch == "all")], "sense kind"),
        "by_event": (rows[rows.sort == "event"], "event"),
        "pairs": (rows[rows.sort == "pair"], "mismatch"),
        "healthy": (rows[rows.sort == "healthy"], "sense"),
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
    """All statistics of a group; those of a controller or span that it does not have are NaN.

    Of all its rows their number, and how many ended early; everything else of the others. Errors
    are roots of the mean square over the runs, and the largest peaks.
    """
    flown = rows[rows.status == "flown"]
    right, isolable = (flown[flown[name].eq(True)] for name in ("right", "isolable"))
    kinds_too = isolable[~(isolable.separation_from_kinds < ISOLABLE)]
    lost, given_up = flown.lost_rightly.eq(True), flown.task_lost.eq(True)
    harm = over_unaware(flown, noise)
    rms, peak = (flown.filter(regex=f"^{what}_").astype(float) for what in ("rms", "peak"))
    return {
        "runs": len(rows),
        "ended": int((rows.status == "ended").sum()),
        "unaware_ended": int(rows.unaware_ended.notna().sum()),
        **share("alarm_before", flown.alarm_before),
        **share("detected", flown.alarm_s.notna()),
        **share("named", flown.named_s.notna()),
        **share("right", flown.right),
        **share("kind_right", right.kind_right),
        **share("all_right", flown.all_right),
        **share("handled", flown.all_right.eq(True) | given_up),
        **share("healthy_named", flown.healthy_named),
        **share("isolable_right", isolable.right),
        **share("isolable_all_right", kinds_too.all_right),
        "smallest_separation_from_others": flown.separation_from_others.min(),
        "smallest_separation_from_kinds": flown.separation_from_kinds.min(),
        "kinds_alike": int(flown.last_kinds.astype(str).str.contains(" ").sum()),
        "withdrawn": int((flown.withdrawn > 0).sum()),
        "unexplained": int(flown.unexplained.sum()),
        "task_lost": int(given_up.sum()),
        "lost": int(lost.sum()),
        "lost_and_given_up": int((lost & given_up).sum()),
        **delays("alarm", right.alarm_s),
        **delays("named", right.named_s),
        **np.sqrt((rms**2).mean()),
        **peak.max(),
        **over(flown, "informed"),
        **over(flown, "unaware"),
        "counted_worst": float(harm.max()) if len(harm) else 0.0,
        "harmed": int((harm > WORST).sum()),
    }


def share(name: str, values: pd.Series) -> dict[str, Any]:
    """Count and share of true values, with its exact (Clopper and Pearson) 95 % interval."""
    known = values.dropna().astype(bool)
    count, cases = int(known.sum()), len(known)
    low, high = binomtest(count, cases).proportion_ci(0.95) if cases else (nan, nan)
    counts = {f"{name}_cases": cases, f"{name}_count": count}
    rate = count / cases if cases else nan
    return counts | {f"{name}_rate": rate, f"{name}_low": float(low), f"{name}_high": float(high)}


def delays(name: str, times_s: pd.Series) -> dict[str, float]:
    """Median, 95th percentile and largest of times."""
    levels = {"median": 0.5, "percentile_95": 0.95, "largest": 1.0}
    known = times_s.dropna().astype(float)
    return {f"{name}_{key}_s": known.quantile(level) for key, level in levels.items()}


def over(rows: pd.DataFrame, controller: str) -> dict[str, Any]:
    """RMS errors of the supervised controller over those of another one, in the same runs.

    All runs together, the median and the worst.
    """
    found: dict[str, Any] = {}
    for span in COUNTED:
        both = rows[[f"rms_supervised_{span}", f"rms_{controller}_{span}"]].astype(float).dropna()
        ours, theirs = (both[name] for name in both)
        ratio, key = ours / theirs, f"over_{controller}_{span}"
        found |= {f"{key}_runs": len(both), f"{key}_median": ratio.median()}
        found[f"{key}_pooled"] = np.sqrt((ours**2).mean() / (theirs**2).mean())
        found[f"{key}_worst"] = ratio.max()
    return found


def over_unaware(rows: pd.DataFrame, noise: float) -> pd.Series:
    """RMS error of each run over that of a controller that does nothing, where both have some.

    The greater of those since the event and from recovery on; at most 1 where errors differ by less
    than the sensors' noise.
    """
    ratios = {}
    for span in COUNTED:
        ours, theirs = rows[f"rms_supervised_{span}"], rows[f"rms_unaware_{span}"]
        ratio = ours / theirs
        ratios[span] = ratio.where(ours - theirs > noise, ratio.clip(upper=1.0))
    return pd.DataFrame(ratios).max(axis=1).dropna()


def hourly(rows: pd.DataFrame) -> dict[str, Any]:
    """Rates of alarms, and of runs with a name, in runs without failures.

    Of the time after the diagnosis has learned, in which an alarm is possible.
    """
    hours = float(rows.duration_s.sum()) / 3600
    watched = hours - float(rows.duration_s.clip(upper=LEARNING_S).sum() / 3600)
    alarms, named = (int(rows[name].sum()) for name in ("alarms", "healthy_named"))
    return {
        "hours": hours,
        "watched_hours": watched,
        "alarms": alarms,
        **per_hour("alarms", alarms, watched),
        **per_hour("named", named, watched),
        "commands_changed": int(rows.commands_changed.sum()),
    }


def per_hour(name: str, count: int, hours: float) -> dict[str, float]:
    """Rate of a Poisson process with its two one-sided 95 % bounds (Garwood); of no time, NaN."""
    rate = low = high = nan
    if hours:
        rate, high = count / hours, float(chi2.ppf(0.95, 2 * (count + 1))) / 2 / hours
        low = float(chi2.ppf(0.05, 2 * count)) / 2 / hours if count else 0.0
    key = f"{name}_per_hour"
    return {f"{key}_rate": rate, f"{key}_low_95": low, f"{key}_high_95": high}


# Checks.


def checks(settings: Mapping[str, Any], rows: pd.DataFrame, tables: Tables) -> list[Check]:
    """Closed loops, runs to their end, no event in which the diagnosis does harm; and the goals."""
    limit_m, thrown = settings["closure_limit_m"], rows.peak_supervised_since > THROWN
    gap_m = rows.closure_residual_max_m.fillna(0.0)
    # Against the size of a mismatch runs go on to where the loops themselves are unstable.
    near_m, thrown_m = gap_m.where(~thrown & (rows.sort != "size"), 0.0), gap_m.where(thrown, 0.0)
    if "shown" in tables:
        near_m = pd.concat([near_m, tables["shown"].closure_residual_max_m])
    other_ended = rows[["informed_ended", "unaware_ended"]].notna().any(axis=1)
    ended = (rows.status.eq("ended") | other_ended) & (rows.sort != "event")
    found = [
        *check(CLOSED, near_m.max(), limit_m, "runs near the path, at the usual sizes"),
        *check(CLOSED, thrown_m.max(), 10 * limit_m, "runs that an event throws far"),
        *check("number of runs that ended early", ended.sum(), 1, settings["robot"]),
    ]
    if "by_event" in tables:
        events = tables["by_event"].set_index("event")
        worst = events.counted_worst.where(events.ended == 0, inf)
        what = "largest RMS error over that of a controller that does nothing"
        found += check(what, worst, WORST)
    if "healthy" in tables and ("by_event" in tables or "beliefs" in tables):
        healthy, where = tables["healthy"].iloc[0], "runs without failures or events"
        named = healthy.healthy_named_count
        found += check("number of runs in which an actuator was named", named, 1, where)
        what = "number of runs whose commands an alarm changed"
        found += check(what, healthy.commands_changed, 1, where)
    return found + (goals(tables) if "beliefs" in tables else [])


def goals(tables: Tables) -> list[Check]:
    """Checks of the hexapod's failures, its shown runs, and somebody else's controller."""
    beliefs, [healthy], [pairs] = (
        tables["beliefs"],
        *(tables[name].itertuples() for name in ("healthy", "pairs")),
    )
    worst = beliefs.iloc[greatest(beliefs.sensitivity_peak)]
    failures = tables["by_mismatch"].query("factor == 1.0").set_index("mismatch")
    isolated = "share of the isolable failures that is not identified"
    over = "RMS after recovery divided by that of a controller informed at once"
    what = "number of unstable pairs of true and diagnosed fault"
    unstable = (beliefs.largest_pole >= 1).sum()
    found = check(what, unstable, 1, f"{worst.truth}, {worst.belief} diagnosed")
    for name, plant in {"exact": "exact plant", "all": "all mismatches"}.items():
        own = failures.loc[name]
        for key, which in {"right": "as first named", "all_right": "and kind in the end"}.items():
            missed = 1 - own[f"isolable_{key}_rate"]
            found += check(isolated, missed, NOT_ISOLATED, f"{plant}, actuator {which}")
        found += check(over, own.over_informed_after_pooled, OVER_INFORMED, plant)
    found += check(isolated, 1 - pairs.handled_rate, NOT_ISOLATED, "two failures in a run")
    what = "median time until the failed actuator is named [s]"
    found += check(what, failures.named_median_s["all"], NAMED_S, "all mismatches")
    what = "number of runs in which a healthy actuator was named"
    found += check(what, failures.healthy_named_count.sum(), 1, "runs with a failure")
    low, high = healthy.alarms_per_hour_low_95, healthy.alarms_per_hour_high_95
    side, rate = ("upper", high) if healthy.hours >= ENOUGH_H else ("lower", low)
    what = f"{side} 95 % bound of the false alarms per hour"
    found += check(what, rate, ALARMS_PER_HOUR, "runs without failures")
    wrong = tables["shown"].set_index("name").all_right.eq(False).astype(float)
    what = "wrong diagnosis of the failures or of the task (0 no, 1 yes),"
    found += check(what, wrong.rename("run {}".format), 0.5)
    for other in tables["controller"].itertuples() if "controller" in tables else ():
        what = f"number of runs in which it failed ({other.failure or 'none'})"
        found += check(what, other.failed, 0.5, f"controller {other.name}")
    return found


# What is printed.


def printed(tables: Tables) -> list[TableView]:
    """The rows by event; or those by kind, and of the hexapod by mismatch at its usual size."""
    if "by_event" in tables:
        columns = "event runs over_unaware_since_median:.2f counted_worst:.2f right_count"
        legend = (
            "RMS error over that of a controller that does nothing; counted: where both differ by "
            "more than the sensors' noise. right: the actuator or the cause was named."
        )
        return [TableView("By event", tables["by_event"], columns, legend)]
    legend = (
        "right: the first actuator that was named had failed. over_informed: RMS error after "
        "recovery over that of a controller informed at once."
    )
    columns = "runs right_count named_median_s:.3f over_informed_after_worst:.3f"
    title = "By kind of failure, all mismatches"
    kinds = TableView(title, tables["by_kind"], f"sense kind {columns}", legend)
    if "beliefs" not in tables:
        return [kinds]
    failures = tables["by_mismatch"].query("factor == 1.0 and over_informed_after_runs > 0")
    return [TableView("By mismatch of plant and model", failures, f"mismatch {columns}"), kinds]


def notes(rows: pd.DataFrame, tables: Tables) -> list[str]:
    """Alarms without failures, what was not simulated, somebody else's controller."""
    lines = []
    for each in tables["healthy"].itertuples() if "healthy" in tables else ():
        most = f"below {each.alarms_per_hour_high_95:.2g} per hour at 95 %"
        lines.append(f"{each.alarms} alarms in {each.watched_hours:.2g} healthy hours: {most}.")
    refused = rows.message[rows.status == "refused"].unique()
    lines += [f"Not simulated: {each}." for each in sorted(refused)]
    for other in tables["controller"].itertuples() if "controller" in tables else ():
        over = f"{other.after_over_informed:.4g} times that of the controller informed at once"
        lines.append(f"RMS error of {other.name} after recovery: {over}.")
    return lines
