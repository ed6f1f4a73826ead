"""Everything that `fjh goals` leaves in its folder."""

from pathlib import Path
from typing import Any

from experiments.goals.demonstration import REFERENCE, Outcome
from experiments.goals.figure import figure_goals
from experiments.goals.recording import write_goal
from experiments.goals.study import Outcomes
from experiments.goals.text import findings
from experiments.output.files import published, write_arrays, write_index
from experiments.output.plotting import save_figure
from sim import Array


def write(folder: Path, outcomes: Outcomes, summary: dict[str, Any]) -> dict[str, Any]:
    """Write data, recordings, figure and table; all of them or none.

    Returns:
        The contents of `goals.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="goals.json") as staging:
        for goal in summary["goals"]:
            ours = outcomes[goal["name"]]
            write_arrays(staging / goal["data"], _arrays(goal, ours))
            write_goal(staging / goal["recording"], goal, ours, summary)
        save_figure(figure_goals(outcomes, summary), staging, "goals")
        (staging / "goals.md").write_text(findings(summary).markdown(), encoding="utf-8")
        return write_index(staging / "goals.json", summary)


def _arrays(goal: dict[str, Any], ours: dict[str, Outcome]) -> dict[str, Array]:
    """Arrays of all ways, their names in front; of the other seeds the errors alone."""
    arrays = {"time_s": ours[REFERENCE].time_s}
    for name, outcome in ours.items():
        kept = {"error_rad": outcome.error_rad}
        if not name.startswith(f"{REFERENCE}_seed"):
            kept |= {goal["measure"]: outcome.measure} | outcome.arrays
        arrays |= {f"{name}_{key}": value for key, value in kept.items()}
    return arrays
