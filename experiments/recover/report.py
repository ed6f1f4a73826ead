"""Everything that `fjh recover` leaves in its folder."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments.files import published, write_arrays, write_json
from experiments.provenance import recording_properties
from experiments.recording import write_recording
from experiments.recover.figures import figure_recover
from experiments.recover.marks import marks
from experiments.recover.study import Recover
from experiments.recover.text import markdown


def write(folder: Path, result: Recover, summary: dict[str, Any]) -> None:
    """Write data, recordings and the figure; all of them or none.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="recover.json") as staging:
        for name, (run, flight) in result.shown.items():
            write_arrays(staging / f"{name}.npz", asdict(run))
            write_recording(
                staging / f"{name}.rrd",
                f"recover-{name}-seed{summary['seed']}",
                name,
                run,
                _notes(name, summary["shown"][name], summary),
                recording_properties(summary),
                marks(run, flight),
            )
        figure_recover(result, summary).savefig(staging / "recover.png", dpi=150)
        (staging / "recover.md").write_text(markdown(summary), encoding="utf-8")
        write_json(staging / "recover.json", summary)


def _notes(name: str, flight: dict[str, Any], summary: dict[str, Any]) -> str:
    """The run in words, shown beside its plots."""
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
    return "\n".join(
        [
            f"# {name}",
            "",
            f"Seed {summary['seed']}, constant Jacobian, W_a; nobody tells the controller.",
            "",
            "What happens:",
            *happened,
            "",
            "What is found, from the pointing angles, the commands and a dither:",
            *found,
            "",
            ends,
        ]
    )
