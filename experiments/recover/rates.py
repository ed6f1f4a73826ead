"""Rates with exact bounds, and quantiles; ready for JSON."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest, chi2

LEVELS = {"median": 0.5, "percentile_95": 0.95, "largest": 1.0}


def rate(right: Sequence[bool]) -> dict[str, Any]:
    """With the exact (Clopper and Pearson) 95 % interval; no cases, no rate."""
    counted = {"cases": len(right), "right": sum(right)}
    if not right:
        return counted | {"rate": None, "low": None, "high": None}
    interval = binomtest(sum(right), len(right)).proportion_ci(0.95)
    bounds = {"low": float(interval.low), "high": float(interval.high)}
    return counted | {"rate": sum(right) / len(right)} | bounds


def per_hour(alarms: int, hours: float) -> dict[str, float]:
    """Rate of a Poisson process with its two one-sided 95 % bounds (Garwood)."""
    low = chi2.ppf(0.05, 2 * alarms) / 2 / hours if alarms else 0.0
    high = chi2.ppf(0.95, 2 * (alarms + 1)) / 2 / hours
    return {
        "hours": hours,
        "alarms": alarms,
        "per_hour": alarms / hours,
        "low_per_hour_95": float(low),
        "high_per_hour_95": float(high),
    }


def quantiles(values: Sequence[float]) -> dict[str, float] | None:
    """Median, 95th percentile and largest; None of nothing."""
    if not values:
        return None
    found = np.quantile(values, list(LEVELS.values())).tolist()
    return dict(zip(LEVELS, found, strict=True))
