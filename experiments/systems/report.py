"""Everything that `fjh systems` leaves in its folder."""

from pathlib import Path
from typing import Any

from experiments.hexapod.recording.notes import constants
from experiments.output.files import published, write_arrays, write_index
from experiments.output.plotting import save_figure
from experiments.output.provenance import version_properties
from experiments.output.recording.file import About
from experiments.output.recording.mechanism import Driven, Task, write_mechanism
from experiments.output.recording.series import Plot
from experiments.systems.figure import figure_systems
from experiments.systems.mechanisms import MECHANISMS, Mechanism
from experiments.systems.probe import PERIOD_S
from experiments.systems.study import Examination
from experiments.systems.text import findings
from sim import load_model


def write(folder: Path, examinations: list[Examination], summary: dict[str, Any]) -> dict[str, Any]:
    """Write data, recordings, figure and table; all of them or none.

    Returns:
        The contents of `systems.json`: the summary and the names of all files.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="systems.json") as staging:
        for mechanism in MECHANISMS:
            ours = [one for one in examinations if one.mechanism == mechanism]
            _write_mechanism(staging, mechanism, ours, summary)
        save_figure(figure_systems(examinations), staging, "systems")
        (staging / "systems.md").write_text(findings(summary).markdown(), encoding="utf-8")
        return write_index(staging / "systems.json", summary)


def _write_mechanism(
    staging: Path, mechanism: Mechanism, ours: list[Examination], summary: dict[str, Any]
) -> None:
    unit = mechanism.major_unit
    arrays = {}
    for k, one in enumerate(ours):
        arrays |= {
            f"time_s_{k}": one.time_s,
            f"desired_{unit}_{k}": one.polygon.desired,
            f"reached_{unit}_{k}": one.polygon.reached,
            f"qpos_{k}": one.polygon.qpos,
        }
    write_arrays(staging / f"{mechanism.name}.npz", arrays)
    properties = {
        "seed": summary["seed"],
        "model_sha256": summary["model_sha256"][mechanism.name],
        "step_m_or_rad": summary["step_m_or_rad"],
        "period_s": PERIOD_S,
    } | version_properties(summary)
    notes = _notes(mechanism, ours, properties)
    about = About(
        f"systems-{mechanism.name}-seed{summary['seed']}", mechanism.title, notes, properties
    )
    driven = {str(one.condition): _driven(mechanism, one) for one in ours}
    write_mechanism(staging / f"{mechanism.name}.rrd", about, load_model(mechanism.path), driven)


def _driven(mechanism: Mechanism, one: Examination) -> Driven:
    desired, reached = 1e6 * one.polygon.desired, 1e6 * one.polygon.reached
    unit = f"u{mechanism.major_unit}"
    names = [f"{name} off [{unit}]" for name in mechanism.major_names]
    first, second = mechanism.major_names[:2]
    return Driven(
        one.time_s,
        one.polygon.qpos,
        [Plot("off", f"desired - reached [{unit}]", names, one.time_s, desired - reached)],
        Task((first, second), unit, desired[:, :2], reached[:, :2]),
    )


def _notes(mechanism: Mechanism, ours: list[Examination], properties: dict[str, Any]) -> str:
    """What the classification says of each condition, shown beside the views."""
    lines = [f"# {mechanism.title}", "", "Major task around an octagon, sound and failed.", ""]
    for one in ours:
        said = [f"- {sentence}" for sentence in str(one.report).splitlines()]
        lines += [f"## {one.condition}", "", *said, ""]
    return "\n".join([*lines, *constants(properties)])
