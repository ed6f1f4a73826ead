"""What is counted and averaged over the flights."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest, chi2

from experiments.hexapod.testbed import Bench
from experiments.recover.false_alarms import Healthy
from experiments.recover.flights import STRUCK
from experiments.recover.recovery import Recovery


def rate(right: Sequence[bool]) -> dict[str, Any]:
    """With the exact (Clopper and Pearson) 95 % interval; no cases, no rate."""
    if not right:
        return {"cases": 0, "right": 0, "rate": None, "low": None, "high": None}
    interval = binomtest(sum(right), len(right)).proportion_ci(0.95)
    return {
        "cases": len(right),
        "right": sum(right),
        "rate": sum(right) / len(right),
        "low": float(interval.low),
        "high": float(interval.high),
    }


def delays_ms(recoveries: list[Recovery], kind: str) -> dict[str, Any]:
    """From failure to alarm and to the first naming, of cases found, median, 95 %, largest."""
    first = [each.found.first for each in recoveries if each.found.case.kind == kind]
    ticks = {
        "alarm": [each.alarm_tick - STRUCK for each in first if each is not None],
        "named": [each.tick - STRUCK for each in first if each is not None],
    }
    period_ms = 1e3 * Bench().control_period_s
    return {
        name: None
        if not counted
        else dict(
            zip(
                ("median", "percentile_95", "largest"),
                (period_ms * np.quantile(counted, (0.5, 0.95, 1.0))).tolist(),
                strict=True,
            )
        )
        for name, counted in ticks.items()
    }


def errors_urad(recoveries: list[Recovery], kind: str) -> dict[str, Any] | None:
    """Root of the mean square over the cases, and the largest peak: before, during, after."""
    cases = [each for each in recoveries if each.found.case.kind == kind]
    if not cases:
        return None
    pooled = {}
    for flown in ("supervised", "informed", "uncorrected"):
        errors = [getattr(each, flown) for each in cases]
        rms = np.sqrt(np.mean([np.square(each.rms_urad) for each in errors], axis=0))
        peak = np.max([each.peak_urad for each in errors], axis=0)
        pooled[flown] = {
            when: {"rms": float(rms[k]), "peak": float(peak[k])}
            for k, when in enumerate(("before", "during", "after"))
        }
    return pooled


def over_oracle(recoveries: list[Recovery]) -> dict[str, float]:
    """RMS after recovery, over that of the oracle: all cases together, and the worst."""
    flown = [(each.supervised, each.informed) for each in recoveries]
    after = np.array([[errors.rms_urad[2] for errors in both] for both in flown])
    pooled = np.sqrt((after**2).mean(axis=0))
    return {
        "pooled": float(pooled[0] / pooled[1]),
        "worst_case": float((after[:, 0] / after[:, 1]).max()),
    }


def alarm_rate(healthy: Healthy) -> dict[str, float]:
    """False alarms per hour with the two one-sided 95 % bounds of a Poisson process."""
    low = chi2.ppf(0.05, 2 * healthy.alarms) / 2 / healthy.hours if healthy.alarms else 0.0
    return {
        "hours": healthy.hours,
        "alarms": healthy.alarms,
        "per_hour": healthy.alarms / healthy.hours,
        "low_per_hour_95": float(low),
        "high_per_hour_95": healthy.upper_per_hour,
    }
