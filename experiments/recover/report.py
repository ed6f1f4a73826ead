"""Everything that `fjh recover` leaves in its folder."""

from pathlib import Path
from typing import Any

from experiments.hexapod.provenance import recording_properties
from experiments.hexapod.recording.keep import keep_run
from experiments.hexapod.recording.notes import run_notes
from experiments.hexapod.recording.shown import Shown
from experiments.hexapod.simulation import Trajectory
from experiments.output.files import published, write_index
from experiments.output.plotting import save_figure
from experiments.output.recording.file import About
from experiments.recover.figures import figure_recover
from experiments.recover.marks import marks
from experiments.recover.study import Recover
from experiments.recover.text import findings
from sim import load_model


def write(folder: Path, result: Recover, summary: dict[str, Any]) -> dict[str, Any]:
    """Write data, recordings and the figure; all of them or none.

    Returns:
        The contents of `recover.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="recover.json") as staging:
        for name, (run, flight) in result.shown.items():
            notes = _notes(name, run, summary)
            properties = recording_properties(summary)
            about = About(f"recover-{name}-seed{summary['seed']}", name, notes, properties)
            keep_run(staging, name, about, load_model(), Shown(run, marks(run, flight)))
        save_figure(figure_recover(result, summary), staging, "recover")
        (staging / "recover.md").write_text(findings(summary).markdown(), encoding="utf-8")
        return write_index(staging / "recover.json", summary)


def _notes(name: str, run: Trajectory, summary: dict[str, Any]) -> str:
    """The run in words, shown beside its plots."""
    flight = summary["shown"][name]
    happened = [
        f"- strut {each['strut']} {each['kind']} at {each['time_s']:g} s"
        for each in flight["happened"]
    ]
    found = [f"- strut {each['strut']} {each['kind']}" for each in flight["found"]]
    ends = f"In the last second the pointing error is {flight['rms_in_the_end_urad']:.2f} urad RMS."
    if flight["task_lost"]:
        ends = (
            "The struts that are left cannot point any more: the task is declared lost, and the "
            "commands stand still."
        )
    said = [
        f"Seed {summary['seed']}, constant Jacobian, W_a; the controller is not told.",
        "",
        "What happens:",
        *happened,
        "",
        "What is found, from the pointing angles, the commands and a dither:",
        *found,
        "",
        ends,
        "",
    ]
    return run_notes(name, said, run, {}, recording_properties(summary))
