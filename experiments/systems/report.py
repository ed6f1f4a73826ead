"""Everything that `fjh systems` leaves in its folder."""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from experiments.files import published, write_arrays, write_json
from experiments.provenance import version_properties
from experiments.rerun_file import COLORS, write_series
from experiments.systems.mechanisms import MECHANISMS, Mechanism
from experiments.systems.study import Examination
from experiments.systems.summary import markdown


def write(folder: Path, examinations: list[Examination], summary: dict[str, Any]) -> None:
    """Write data, recordings, figure and table; all of them or none.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="systems.json") as staging:
        for mechanism in MECHANISMS:
            ours = [one for one in examinations if one.mechanism == mechanism]
            _write_mechanism(staging, mechanism, ours, summary)
        figure_systems(examinations).savefig(staging / "systems.png", dpi=150)
        (staging / "systems.md").write_text(markdown(summary), encoding="utf-8")
        write_json(staging / "systems.json", summary)


def figure_systems(examinations: list[Examination]) -> Figure:
    """Each mechanism's major task around a polygon, in every condition."""
    figure = Figure(figsize=(12.5, 9.5), layout="constrained")
    figure.suptitle("Major task around an octagon, sound and failed, simulated")
    for panel, mechanism in enumerate(MECHANISMS, 1):
        axes = figure.add_subplot(2, 2, panel, title=mechanism.title, aspect="equal")
        ours = [one for one in examinations if one.mechanism == mechanism]
        for one, color in zip(ours, COLORS, strict=False):
            ls = "--" if one.report.unstable_major or one.report.unmanipulable else "-"
            axes.plot(
                1e6 * one.reached[:, 0],
                1e6 * one.reached[:, 1],
                ls,
                color=[value / 255 for value in color],
                label=str(one.condition),
                lw=1,
            )
        desired = 1e6 * ours[0].desired[:, :2]
        axes.plot(desired[:, 0], desired[:, 1], "ko", ms=4, label="asked for")
        first, second = mechanism.major_names[:2]
        unit = f"µ{mechanism.major_unit}"
        axes.set(xlabel=f"{first}, {unit}", ylabel=f"{second}, {unit}")
        axes.grid(alpha=0.3)
        axes.legend(
            fontsize="x-small",
            title="broken; dashed: task lost",
            title_fontsize="x-small",
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
        )
    return figure


def _write_mechanism(
    staging: Path, mechanism: Mechanism, ours: list[Examination], summary: dict[str, Any]
) -> None:
    arrays, plots = {}, {}
    for k, one in enumerate(ours):
        arrays |= {
            f"time_s_{k}": one.time_s,
            f"desired_{mechanism.major_unit}_{k}": one.desired,
            f"reached_{mechanism.major_unit}_{k}": one.reached,
        }
        unit = f"u{mechanism.major_unit}"
        names = [f"{name} off [{unit}]" for name in mechanism.major_names]
        plots[str(one.condition)] = (one.time_s, names, 1e6 * (one.desired - one.reached))
    write_arrays(staging / f"{mechanism.name}.npz", arrays)
    model = {"seed": summary["seed"], "model_sha256": summary["model_sha256"][mechanism.name]}
    properties = model | version_properties(summary)
    notes = [f"# {mechanism.title}", "", "Major task around an octagon: desired less reached.", ""]
    for one in ours:
        said = [f"- {sentence}" for sentence in str(one.report).splitlines()]
        notes += [f"## {one.condition}", "", *said, ""]
    write_series(
        staging / f"{mechanism.name}.rrd",
        f"systems-{mechanism.name}",
        mechanism.title,
        plots,
        "\n".join(notes),
        properties,
    )
