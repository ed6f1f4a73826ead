"""Numbers in sentences on diagnosis, robots and speed, by name; docs/data has the results."""

from collections.abc import Callable
from typing import Any

from results import row, rows, study


def _isolated(robot: str) -> str:
    """Return how many failures the designed dither isolates with all sensors, as "10 of 12"."""
    cases = sum(kind["runs"] for kind in rows(robot, "by_kind", sense="both"))
    return f"{len(study(robot)['dither']['both']['isolable'])} of {cases}"


def _over_unaware(event: str) -> str:
    return f"{row('events', 'by_event', event=event)['over_unaware_since_median']:.2f}"


def _ik_ratios() -> str:
    """Return the range of the times of inverse kinematics over those of mink."""
    timed: Any = study("bench")
    ratios = [each["ratio"] for each in timed if each["question"].startswith("ik_")]
    return f"{min(ratios):.2f} to {max(ratios):.2f}"


VALUES: dict[str, Callable[[], str]] = {
    "diagnosis.arm": lambda: _isolated("arm"),
    "diagnosis.arms": lambda: _isolated("arms"),
    "diagnosis.hand": lambda: _isolated("hand"),
    "diagnosis.platform": lambda: _isolated("platform"),
    "ik.tick": _ik_ratios,
    "track.locked": lambda: _over_unaware("locked"),
    "track.stuck": lambda: _over_unaware("stuck"),
}
