"""The statistics of all rows, ready for JSON: one entry for each group, with the same keys."""

from collections.abc import Sequence
from math import sqrt
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest, chi2

from experiments.recover.plan import MISMATCHES
from experiments.recover.predictions import ISOLABLE
from experiments.recover.row import CONTROLLERS, SCHEMA
from experiments.recover.simulate import SPANS
from experiments.rig.rig import Rig
from experiments.study.campaign import Row, table_of
from ftc.fdi.diagnosis import DEFAULT_CONFIG

WORST = 1.1
"""Design requirement, in every run: RMS error over that of a controller that does nothing."""
COUNTED = ("since", "after")
"""Spans in which the diagnosis may do harm: the start of recovery can hide what follows."""


def frame_of(rows: Sequence[Row], others: Sequence[Row] = ()) -> pd.DataFrame:
    """All rows, numbers that are missing as NaN, with another controller's columns where it ran."""
    frame = table_of(rows, SCHEMA).to_pandas()
    return frame.merge(pd.DataFrame(others), how="left", on="case") if others else frame


def noise_of(rig: Rig) -> float:
    """RMS of the sensors' noise, all major rows: smaller differences of RMS errors do not count."""
    return sqrt(len(rig.major)) * rig.noise / rig.size


def statistics(frame: pd.DataFrame, noise: float) -> dict[str, list[dict[str, Any]]]:
    """Entries of the whole study by mismatch and size, kind of failure, event; and of other sorts.

    Args:
        frame: Of :func:`frame_of`.
        noise: Of :func:`noise_of`.
    """
    struck = frame[frame["sort"].isin(["failure", "size", "event"])]
    order = struck["mismatch"].map(MISMATCHES.index)
    struck = struck.assign(order=order).sort_values(["order", "factor"], kind="stable")
    mixed = frame[(frame["sort"] == "failure") & (frame["mismatch"] == "all")]
    healthy = frame[frame["sort"] == "healthy"]
    return {
        "by_mismatch": _table(struck, ["mismatch", "factor"], noise),
        "by_kind": _table(mixed, ["sense", "kind"], noise),
        "by_event": _table(frame[frame["sort"] == "event"], ["event"], noise),
        "pairs": _table(frame[frame["sort"] == "pair"], ["mismatch"], noise),
        "healthy": [
            {"sense": sense} | _per_hour(rows) | summarized(rows, noise)
            for sense, rows in healthy.groupby("sense", sort=False)
        ],
    }


def _table(frame: pd.DataFrame, keys: list[str], noise: float) -> list[dict[str, Any]]:
    groups = frame.groupby(keys, sort=False)
    return [dict(zip(keys, key, strict=True)) | summarized(rows, noise) for key, rows in groups]


def summarized(rows: pd.DataFrame, noise: float) -> dict[str, Any]:
    """All statistics of some rows; of a controller or span that they do not have there are none."""
    count, ended = len(rows), int((rows["status"] == "ended").sum())
    unaware_ended = int(rows["unaware_ended"].notna().sum())
    rows = rows[rows["status"] == "flown"]
    right, isolable = (rows[rows[name].eq(True)] for name in ("right", "isolable"))
    kinds_too = isolable[~(isolable["separation_from_kinds"] < ISOLABLE)]
    lost, given_up = (rows[name].eq(True) for name in ("lost_rightly", "task_lost"))
    harm = counted(rows, noise)
    return {
        "runs": count,
        "ended": ended,
        "unaware_ended": unaware_ended,
        "alarm_before": rate(rows["alarm_before"]),
        "detected": rate(rows["alarm_s"].notna()),
        "named": rate(rows["named_s"].notna()),
        "right": rate(rows["right"]),
        "kind_right": rate(right["kind_right"]),
        "all_right": rate(rows["all_right"]),
        "handled": rate(rows["all_right"].eq(True) | given_up),
        "healthy_named": rate(rows["healthy_named"]),
        "isolable_right": rate(isolable["right"]),
        "isolable_all_right": rate(kinds_too["all_right"]),
        "smallest_separation": {
            others: _number(rows[f"separation_from_{others}"].min())
            for others in ("others", "kinds")
        },
        "kinds_alike": int(rows["last_kinds"].str.contains(" ", na=False).sum()),
        "withdrawn": int((rows["withdrawn"] > 0).sum()),
        "unexplained": int(rows["unexplained"].sum()),
        "task_lost": int(given_up.sum()),
        "lost": int(lost.sum()),
        "lost_and_given_up": int((lost & given_up).sum()),
        "alarm_s": quantiles(right["alarm_s"]),
        "named_s": quantiles(right["named_s"]),
        "errors": _errors(rows),
        "over_informed": over(rows, "informed"),
        "over_unaware": over(rows, "unaware"),
        "counted_worst": float(harm.max()) if len(harm) else 0.0,
        "harmed": int((harm > WORST).sum()),
    }


def rate(values: pd.Series) -> dict[str, Any]:
    """Share of true values with its exact (Clopper and Pearson) 95 % interval; of none, None."""
    known = values.dropna().astype(bool)
    count, cases = int(known.sum()), len(known)
    if not cases:
        return {"cases": 0, "count": 0, "rate": None, "low": None, "high": None}
    low, high = map(float, binomtest(count, cases).proportion_ci(0.95))
    return {"cases": cases, "count": count, "rate": count / cases, "low": low, "high": high}


def quantiles(values: pd.Series) -> dict[str, float] | None:
    """Median, 95th percentile and largest; None of nothing."""
    if not len(known := values.dropna()):
        return None
    median, high, largest = known.quantile([0.5, 0.95, 1.0]).tolist()
    return {"median": median, "percentile_95": high, "largest": largest}


def _errors(rows: pd.DataFrame) -> dict[str, Any]:
    """Root of the mean square over the runs, and the largest peak, by controller and span."""
    found = dict[str, Any]()
    for controller in (*CONTROLLERS, "other"):
        for span in SPANS:
            if f"rms_{controller}_{span}" in rows:
                rms, peak = (rows[f"{what}_{controller}_{span}"] for what in ("rms", "peak"))
                if rms.notna().any():
                    pooled = {"rms": float(np.sqrt((rms**2).mean())), "peak": float(peak.max())}
                    found.setdefault(controller, {})[span] = pooled
    return found


def over(rows: pd.DataFrame, controller: str) -> dict[str, Any]:
    """RMS errors of the supervised controller over those of another one, in the same runs.

    All runs together, the median and the worst; None where there are none.
    """
    found = dict[str, Any]()
    for span in COUNTED:
        both = rows[[f"rms_supervised_{span}", f"rms_{controller}_{span}"]].dropna()
        ours, theirs = (both[name] for name in both)
        ratio = ours / theirs
        found[span] = None
        if len(both):
            pooled = float(np.sqrt((ours**2).mean() / (theirs**2).mean()))
            levels = {"median": float(ratio.median()), "worst": float(ratio.max())}
            found[span] = {"runs": len(both), "pooled": pooled, **levels}
    return found


def counted(rows: pd.DataFrame, noise: float) -> pd.Series:
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


def _per_hour(rows: pd.DataFrame) -> dict[str, Any]:
    """Rates of alarms, and of runs with a name, in runs without failures.

    Of the time after the diagnosis has learned, in which an alarm is possible.
    """
    hours = float(rows["duration_s"].sum()) / 3600
    learning_h = rows["duration_s"].clip(upper=DEFAULT_CONFIG.learning_s).sum() / 3600
    watched = hours - float(learning_h)
    alarms, named = (int(rows[name].sum()) for name in ("alarms", "healthy_named"))
    return {
        "hours": hours,
        "watched_hours": watched,
        "alarms": alarms,
        "alarms_per_hour": per_hour(alarms, watched),
        "named_per_hour": per_hour(named, watched),
        "commands_changed": int(rows["commands_changed"].sum()),
    }


def per_hour(count: int, hours: float) -> dict[str, float | None]:
    """Rate of a Poisson process with its two one-sided 95 % bounds (Garwood); of no time, None."""
    if not hours:
        return {"rate": None, "low_95": 0.0, "high_95": None}
    low = float(chi2.ppf(0.05, 2 * count)) / 2 / hours if count else 0.0
    high = float(chi2.ppf(0.95, 2 * (count + 1))) / 2 / hours
    return {"rate": count / hours, "low_95": low, "high_95": high}


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
