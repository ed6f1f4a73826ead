"""What stands beside the views: parameters, results, the paper's numbers, every constant."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.hexapod.metrics import closure_residual_max_m, pointing_rms_urad
from experiments.hexapod.simulation import Trajectory


def run_notes(
    title: str,
    said: Sequence[str],
    run: Trajectory,
    beside: Mapping[str, tuple[float | None, float | None]],
    properties: Mapping[str, Any],
) -> str:
    """One run in words, as Markdown.

    Args:
        title: Of the run.
        said: What was done, a sentence or a list item each.
        run: The run.
        beside: RMS of (alpha, beta) [urad] that the run is to be compared with, by where they come
            from; None where there is none.
        properties: All parameters.
    """
    rms = {"here": pointing_rms_urad(run), **beside}
    lines = [f"# {title}", "", *said, "", "| RMS, urad | alpha | beta |", "| --- | --- | --- |"]
    lines += [f"| {name} | {_number(pair[0])} | {_number(pair[1])} |" for name, pair in rms.items()]
    lines += ["", "| peak | |", "| --- | --- |"]
    lines += [f"| {name} | {value} |" for name, value in _peaks(run).items()]
    return "\n".join([*lines, "", *constants(properties)])


def constants(properties: Mapping[str, Any]) -> list[str]:
    """All parameters as a table; units are in their names."""
    rows = [f"| {name} | {value} |" for name, value in properties.items()]
    return ["| parameter | value |", "| --- | --- |", *rows]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"


def _peaks(run: Trajectory) -> dict[str, str]:
    gamma, *translation = 1e6 * np.abs(run.secondary).max(axis=0)
    return {
        "strut inputs 1 to 6, %": ", ".join(
            f"{peak:.2f}" for peak in np.abs(run.strut_input_percent).max(axis=0)
        ),
        "gamma, urad": f"{gamma:.3f}",
        "t_x, t_y, t_z, um": ", ".join(f"{peak:.3f}" for peak in translation),
        "closure residual, nm": f"{1e9 * closure_residual_max_m(run):.2f}",
    }
