"""Detection, isolation, delay and false alarms, by mismatch and by its size."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.recover.flight import MISMATCHES
from experiments.recover.rates import quantiles, rate
from experiments.study.campaign import Row


def identified(rows: Sequence[Row]) -> dict[str, Any]:
    """What the diagnosis made of flights with one failure each."""
    right = [row for row in rows if row["strut_right"]]
    return {
        "alarm_before": rate([row["alarm_before"] for row in rows]),
        "detected": rate([row["alarm_ms"] is not None for row in rows]),
        "named": rate([row["named_ms"] is not None for row in rows]),
        "strut": rate([row["strut_right"] for row in rows]),
        "sound_named": rate([row["sound_named"] for row in rows]),
        "kind": rate([row["kind_right"] for row in right]),
        "all_right": rate([row["all_right"] for row in rows]),
        "unexplained": sum(row["unexplained"] for row in rows),
        "alarm_ms": quantiles([r["alarm_ms"] for r in right if r["alarm_ms"] is not None]),
        "named_ms": quantiles([row["named_ms"] for row in right]),
    }


def groups(failures: Sequence[Row]) -> list[dict[str, Any]]:
    """One entry for each mismatch, of the flights with a controller that is informed beside."""
    entries = []
    for name in MISMATCHES:
        if rows := [row for row in failures if row["mismatch"] == name]:
            over = {"after_over_oracle": over_oracle(rows)}
            entries.append({"mismatch": name, **identified(rows), **over})
    return entries


def sizes(flown: Sequence[Row]) -> list[dict[str, Any]]:
    """One entry for each mismatch and factor; factor zero, for all, is the exact plant."""
    entries = []
    rows = [row for row in flown if row["sort"] in ("failure", "size")]
    exact = [row for row in rows if row["mismatch"] == "exact"]
    for name in MISMATCHES:
        own = [row for row in rows if row["mismatch"] == name]
        if name == "exact" or not own:
            continue
        by_factor = {0.0: exact}
        for factor in sorted({row["factor"] for row in own}):
            by_factor[factor] = [row for row in own if row["factor"] == factor]
        entries += [
            {"mismatch": name, "factor": factor, **identified(group)}
            for factor, group in by_factor.items()
        ]
    return entries


def over_oracle(rows: Sequence[Row]) -> dict[str, float]:
    """RMS after recovery, over the informed controller's: all flights together, and the worst."""
    ours, theirs = (
        np.array([row[f"rms_{name}_after_urad"] for row in rows])
        for name in ("supervised", "informed")
    )
    pooled = np.sqrt(np.mean(ours**2) / np.mean(theirs**2))
    return {"pooled": float(pooled), "worst_case": float((ours / theirs).max())}
