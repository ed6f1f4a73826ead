"""Everything that `fjh release` leaves in its folder."""

from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from experiments.files import published, write_arrays, write_json
from experiments.palette import DESIRED, MEASURED, START
from experiments.provenance import recording_properties
from experiments.recording import write_recording
from experiments.release.study import Release
from experiments.release.summary import twist
from prioritized import Classes
from sim import Array


def write(folder: Path, release: Release, summary: dict[str, Any]) -> None:
    """Write data, recordings and figures; all of them or none.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    properties = recording_properties(summary)
    with published(folder, index="release.json") as staging:
        for spiral in summary["spirals"]:
            name = spiral["name"]
            run = release.trajectories[name]
            predicted = {"linear": release.linear[name], "quasi_static": release.quasi_static[name]}
            write_arrays(staging / spiral["data"], asdict(run) | predicted)
            write_recording(
                staging / spiral["recording"],
                f"release-{name}-seed{summary['seed']}",
                name,
                run,
                _notes(spiral, summary),
                properties | spiral["plant"],
            )
        write_arrays(staging / "atlas.npz", _atlas_arrays(release))
        figure_release(release, summary).savefig(staging / "release.png", dpi=150)
        write_json(staging / "release.json", summary)


HEADINGS = ("", "alpha", "model", "beta", "model", "peak", "Ms")
"""RMS of alpha and beta here and in the linear model, peak of alpha, peak sensitivity."""


def table_rows(summary: dict[str, Any]) -> list[tuple[str, ...]]:
    """Each spiral as (name, alpha, the model's, beta, the model's, peak alpha, sensitivity)."""

    def number(value: float | None, digits: int) -> str:
        return "" if value is None else f"{value:.{digits}f}"

    return [
        (
            spiral["name"].replace("_", " "),
            number(spiral["alpha_rms_urad"], 3),
            number(spiral["predicted_alpha_rms_urad"], 3),
            number(spiral["beta_rms_urad"], 3),
            number(spiral["predicted_beta_rms_urad"], 3),
            number(spiral["alpha_peak_urad"], 1),
            number(spiral["sensitivity_peak"], 2),
        )
        for spiral in summary["spirals"]
    ]


def figure_release(release: Release, summary: dict[str, Any]) -> Figure:
    """The sweep over stiffness, and strut 1 losing coil and spring in flight."""
    figure = Figure(figsize=(11, 7.5), layout="constrained")
    figure.suptitle("Strut 1 without its coil: the springs decide where the payload goes")
    grid = figure.add_gridspec(2, 2)
    sweep = summary["sweep"]
    ratio = [point["suspension_over_swing"] for point in sweep]

    axes = figure.add_subplot(grid[0, 0], title="100 µrad asked for, at rest", xscale="log")
    curves: tuple[tuple[str, str, dict[str, Any]], ...] = (
        ("alpha_as_if_locked_urad", "as if locked at its centre", {"color": START, "ls": ":"}),
        ("alpha_elastic_urad", "elastic mapping", {"color": DESIRED}),
        ("alpha_simulated_urad", "simulated", {"color": MEASURED, "marker": "o", "ls": ""}),
        ("alpha_corrected_urad", "simulated, corrected", {"color": START, "marker": "s", "ls": ""}),
    )
    for key, label, style in curves:
        axes.plot(ratio, [point[key] for point in sweep], label=label, **style)
    axes.set(xlabel="suspension / own swing stiffness", ylabel="$\\alpha$, µrad", ylim=(0, 110))
    axes.legend(fontsize="small")

    axes = figure.add_subplot(grid[0, 1], title="distance from the simulation", xscale="log")
    for key, label, color in (
        ("mismatch_as_if_locked_percent", "as if locked", START),
        ("mismatch_elastic_percent", "elastic mapping", DESIRED),
        ("mismatch_linear_model_percent", "linear model, coils as forces", MEASURED),
    ):
        axes.loglog(ratio, [point[key] for point in sweep], "o-", color=color, ms=4, label=label)
    axes.set(xlabel="suspension / own swing stiffness", ylabel="payload motion, %")
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(0, 0.6))

    for column, name in enumerate(("free_in_flight_corrected", "loose_in_flight_corrected")):
        run = release.trajectories[name]
        axes = figure.add_subplot(grid[1, column], title=name.replace("_", " "))
        lines: tuple[tuple[Array, str, dict[str, Any]], ...] = (
            (twist(run), "simulated", {"color": MEASURED, "lw": 2.5, "alpha": 0.5}),
            (release.linear[name], "linear model", {"color": DESIRED, "lw": 0.8}),
            (release.quasi_static[name], "quasi-static", {"color": START, "lw": 0.8, "ls": "--"}),
        )
        for motion, label, style in lines:
            axes.plot(run.time_s, 1e6 * motion[:, 3], label=label, **style)
        axes.set(xlabel="time, s", ylabel="$t_x$, µm")
        axes.legend(fontsize="small", loc="upper left")
    for axes in figure.axes:
        axes.grid(alpha=0.3)
    return figure


def _atlas_arrays(release: Release) -> dict[str, Array]:
    """Rigid and elastic verdicts side by side; rows are conditions."""
    atlas = release.atlas
    assert atlas.elastic is not None  # the hexapod has springs
    names = [field.name for field in fields(Classes)]
    rigid = {f"rigid_{name}": getattr(atlas, name) for name in names}
    elastic = {f"elastic_{name}": getattr(atlas.elastic, name) for name in names}
    return {"codes": atlas.codes} | rigid | elastic


def _notes(spiral: dict[str, Any], summary: dict[str, Any]) -> str:
    """The run in words, shown beside its plots."""
    if spiral["kind"] is None:
        what = "All struts sound."
    else:
        lost = "coil" if spiral["kind"] == "free" else "coil and suspension spring, in orbit,"
        told = {
            "uncorrected": "is not told",
            "corrected": "is told, and reckons with the springs",
            "as_locked": "is told that it is locked",
        }
        when = f"at {spiral['failure_time_s']:g} s"
        what = f"Strut 1 loses its {lost} {when}; the mapping {told[spiral['told']]}."
    return "\n".join(
        [
            f"# {spiral['name'].replace('_', ' ')}",
            "",
            what,
            "",
            f"Seed {summary['seed']}, {summary['duration_s']:g} s, constant Jacobian.",
            "",
            f"RMS: alpha {spiral['alpha_rms_urad']:.4f} urad, "
            f"beta {spiral['beta_rms_urad']:.4f} urad.",
            "",
            f"Largest closure residual {spiral['closure_residual_max_m']:.1e} m.",
        ]
    )
