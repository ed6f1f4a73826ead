"""Table I in print, from `table1.json`."""

from typing import Any

from experiments.findings import Findings, Picture, Table
from experiments.soundness import complaint

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
    title = "Table I: RMS of desired minus true angle"
    if summary["duration_s"] < summary["bench"]["duration_s"]:
        title += f", first {summary['duration_s']:g} s only (the paper's: 16 s)"
    headings = [column["name"].replace("_uncorrected", "\nuncorr.") for column in columns]
    return Table(
        title,
        ("", *headings),
        _rows(columns),
        "Strut 1 is locked in the last three columns. Peaks are of the secondary motion; closure "
        "is the largest opening of a loop of the mechanism.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """The loops, and what the Jacobian changes."""
    loops = [f"Loop {name}: {loop['sentence']}." for name, loop in summary["loops"].items()]
    return [*loops, summary["jacobian_comparison"]["sentence"]]


def _rows(columns: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    def numbers(key: str, digits: str) -> list[str]:
        return [format(column[key], digits) for column in columns]

    rows = []
    for angle in ("alpha", "beta"):
        rows += [
            (f"{angle}, urad", *numbers(f"{angle}_rms_urad", ".4f")),
            ("  linear model", *numbers(f"predicted_{angle}_rms_urad", ".4f")),
            ("  paper", *numbers(f"paper_{angle}_rms_urad", ".4f")),
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
