"""Table I in print, from `table1.json`."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.hexapod.legacy_checks import complaint
from experiments.output.findings import Findings, Picture, Table, is_cut
from sim import Array

ANGLES = ("alpha", "beta")
ANGLE_ROWS = (
    ("{}, urad", "{}_rms_urad"),
    ("  linear model", "predicted_{}_rms_urad"),
    ("  detector", "{}_measured_rms_urad"),
    ("  paper", "paper_{}_rms_urad"),
)
"""Label and key of what is printed of each angle; the last one of whole spirals only."""

PICTURES = [
    Picture(
        "figure4.png",
        "The paper's Fig. 4: spirals and strut inputs with weighted strut displacements minimized.",
        "Three rows, W_a, W_b and W_c: on the left the same spiral each time, on the right six "
        "strut inputs; under W_b those of struts 1, 3 and 5 are small, under W_c those of 2, 4, 6.",
    ),
    Picture(
        "figure5.png",
        "The paper's Fig. 5: strut 1 locked, and nothing done about it.",
        "A spiral of the detector reading beside the desired one, distorted by the locked strut.",
    ),
    Picture(
        "figure6.png",
        "The paper's Fig. 6: strut 1 locked, mapping reconfigured, secondary motion minimized.",
        "Two spirals as good as sound ones; under W_e the translations t_x and t_y almost vanish, "
        "under W_d they swing by about ten micrometres.",
    ),
]


def findings(summary: dict[str, Any]) -> Findings:
    """The table beside the paper's, and what its reader should know."""
    return Findings(summary, [table(summary)], notes(summary), PICTURES, complaint(summary))


def table(summary: dict[str, Any]) -> Table:
    """One column for each of the paper's."""
    columns = summary["columns"]
    title = f"Table I, bench {summary['configuration']}: RMS of desired minus true angle"
    if is_cut(summary):
        title += f", first {summary['duration_s']:g} s of the spiral only"
    headings = [column["name"].replace("_uncorrected", "\nuncorr.") for column in columns]
    return Table(
        title,
        ("", *headings),
        _rows(columns, ANGLE_ROWS[:-1] if is_cut(summary) else ANGLE_ROWS),
        "Strut 1 is locked in the last three columns. Origin: constants of the bench were fitted "
        "to the column; its errors are those of W_a by construction, since J_m M = I; or they are "
        "predicted. Detector: of its reading, as in the paper. Peaks are of the secondary motion; "
        "closure is the largest opening of a loop of the mechanism.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """What was fitted, the loops, and what the Jacobian changes."""
    loops = [f"Loop {name}: {loop['sentence']}." for name, loop in summary["loops"].items()]
    fit = [] if is_cut(summary) else [summary["fit"], _distance_sentence(summary["columns"])]
    return [*fit, *loops, summary["jacobian_comparison"]["sentence"]]


def _distance_sentence(columns: list[dict[str, Any]]) -> str:
    """How far the table is from the paper's, beside what a constant would be."""

    def entries(key: str) -> Array:
        return np.array([[column[key.format(angle)] for angle in ANGLES] for column in columns])

    printed = entries("paper_{}_rms_urad")
    off = 100 * np.abs(entries("{}_measured_rms_urad") / printed - 1)
    constant = 100 * np.abs(printed[:-1].mean(axis=0) / printed[:-1] - 1)
    return (
        f"Detector errors are within {off[:-1].max():.1f} % of the paper's in W_a to W_e, where a "
        f"constant at the paper's mean is within {constant.max():.1f} %, and within "
        f"{off[-1].max():.1f} % in the last column."
    )


def _rows(
    columns: list[dict[str, Any]], angle_rows: Sequence[tuple[str, str]]
) -> list[tuple[str, ...]]:
    def numbers(key: str, digits: str) -> list[str]:
        return [format(column[key], digits) for column in columns]

    rows = [("origin", *(column["origin"] for column in columns))]
    for angle in ANGLES:
        rows += [
            (label.format(angle), *numbers(key.format(angle), ".4f")) for label, key in angle_rows
        ]
    peaks = [column["secondary_peak"] for column in columns]
    rows += [
        (f"peak {label}", *(format(peak[key], ".3f") for peak in peaks))
        for label, key in (
            ("t_x, um", "t_x_um"),
            ("t_y, um", "t_y_um"),
            ("t_z, um", "t_z_um"),
            ("gamma, urad", "gamma_urad"),
        )
    ]
    return [*rows, ("closure, m", *numbers("closure_residual_max_m", ".1e"))]
