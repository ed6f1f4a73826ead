"""A run of `fjh bench` beside one that was saved."""

import json
from pathlib import Path
from typing import Any

from experiments.output.study import WrongInput

_FORMERLY = {"tick_over_mink": "hexapod_tick_over_mink", "tick": "hexapod_tick"}
"""Before the general path was timed, these names stood for the closed form."""


def saved(path: Path) -> dict[str, Any]:
    """The `bench.json` of an earlier run, every number under the name that it has now.

    Raises:
        WrongInput: There is no such file, or something else is in it.
    """
    try:
        summary = json.loads(path.read_bytes())
        if summary["experiment"] == "bench":
            compare(summary, summary)  # it has all that a comparison reads
            return _renamed(summary)
    except OSError as error:
        raise WrongInput(f"--compare {path} cannot be read: {error.strerror}") from None
    except (ValueError, LookupError, TypeError):
        pass
    raise WrongInput(f"--compare {path} was not written by this fjh bench")


def compare(now: dict[str, Any], before: dict[str, Any]) -> dict[str, Any]:
    """What both runs have timed: now over before, and whether that is more than noise.

    It is when the ranges from the 5th to the 95th percentile have nothing in common. `renamed`:
    names whose meaning has changed since, each with the name under which its numbers are compared.
    """
    return {
        "saved_simulated_s": before["simulated_s"],
        "renamed": before.get("renamed", {}),
        "ratios": _changes(now["ratios"], before["ratios"], "ratio", ""),
        "timings": _changes(now["timings"], before["timings"], "median_us", "_us"),
    }


def _renamed(summary: dict[str, Any]) -> dict[str, Any]:
    if "hexapod_tick" in summary["timings"]:
        return summary
    named = {
        kind: {_FORMERLY.get(name, name): one for name, one in summary[kind].items()}
        for kind in ("ratios", "timings")
    }
    return summary | named | {"renamed": _FORMERLY}


def _changes(
    now: dict[str, Any], before: dict[str, Any], key: str, unit: str
) -> dict[str, dict[str, Any]]:
    low, high = f"p5{unit}", f"p95{unit}"
    return {
        name: {
            "saved": before[name][key],
            "now": one[key],
            "now_over_saved": one[key] / before[name][key],
            "changed": one[low] > before[name][high] or one[high] < before[name][low],
        }
        for name, one in now.items()
        if name in before
    }
