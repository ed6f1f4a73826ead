"""Everything that `fjh jacobian` leaves in its folder."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments.bench import Bench
from experiments.files import published, write_arrays, write_json
from experiments.jacobian.figures import figure_loop, figure_variation
from experiments.jacobian.growth import grown_bench, grown_machine
from experiments.jacobian.loop import VARIANTS, Case, Outcome
from experiments.provenance import plant_constants, version_properties
from experiments.recording import write_recording
from sim import hexapod, load_model


def write(folder: Path, summary: dict[str, Any], outcomes: dict[Case, Outcome]) -> None:
    """Write data, recordings and figures; all of them or none.

    Raises:
        OutputError: The disk or the folder refuses.
    """
    with published(folder, index="jacobian.json") as staging:
        figure_variation(hexapod(load_model()), summary).savefig(staging / "jacobian.png", dpi=150)
        if outcomes:
            figure_loop(summary["loop"]).savefig(staging / "jacobian_loop.png", dpi=150)
        for case, outcome in outcomes.items():
            if case.is_recorded:
                _write_run(staging, case, outcome, summary)
        write_json(staging / "jacobian.json", summary)


LOOP_HEADINGS = ("", "e", "geometry", "const.", "analyt.", "increm.", "relin.", "loop gain")
"""Spiral; eq. (40) visited; distance from the optimum, expected and run; loop gain error, %."""


def loop_rows(loop: dict[str, Any]) -> list[tuple[str, ...]]:
    """One row for each size."""
    return [
        (
            f"x{one['spiral_factor']:g}",
            f"{one['e_visited']['frobenius']:.1e}",
            f"{one['static_extra_percent']:.2f}",
            *(f"{one['variants'][variant]['extra_percent']:.2f}" for variant in VARIANTS),
            f"{one['loop_gain_error_percent']:.2f}",
        )
        for one in loop["growth"]
    ]


def _write_run(staging: Path, case: Case, outcome: Outcome, summary: dict[str, Any]) -> None:
    write_arrays(staging / f"{case.name}.npz", asdict(outcome.trajectory))
    machine = plant_constants(grown_machine(load_model(), case.growth))
    around = asdict(grown_bench(Bench(), case.growth))
    plain = {"seed": case.seed, "model_sha256": summary["model_sha256"], "variant": case.variant}
    growth = {"stroke_factor": case.growth.stroke, "spiral_factor": case.growth.spiral}
    write_recording(
        staging / f"{case.name}.rrd",
        f"jacobian-{case.name}",
        case.name,
        outcome.trajectory,
        _notes(case, outcome),
        plain | growth | version_properties(summary) | around | machine,
    )


def _notes(case: Case, outcome: Outcome) -> str:
    """The run in words, shown beside its plots."""
    jacobian, form = VARIANTS[case.variant]
    duration_s = len(outcome.trajectory.time_s) * Bench().control_period_s
    return "\n".join(
        [
            f"# {case.name}",
            "",
            f"{case.column}, strut 1 locked; stroke x{case.growth.stroke:g}, spiral "
            f"x{case.growth.spiral:g}; seed {case.seed}, {duration_s:g} s.",
            "",
            f"{jacobian.capitalize()} Jacobian, {form} displacements.",
            "",
            f"Off the optimum of the secondary goal by {outcome.extra_percent:.2f} %.",
            "",
            f"e visited: {outcome.e_visited['frobenius']:.1e} (Frobenius), "
            f"{outcome.e_visited['two']:.1e} (2-norm).",
        ]
    )
