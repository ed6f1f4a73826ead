"""Table I in print: rows, title and notes of `table1.json`, and its Markdown."""

from typing import Any


def markdown(summary: dict[str, Any]) -> str:
    """The table beside the paper's, as Markdown."""
    columns = summary["columns"]
    head = ["", *(column["name"] for column in columns)]
    lines = [_row(head), _row(["---"] * len(head))]
    lines += [_row([label, *cells]) for label, cells in table_rows(columns)]
    bullets = [f"- {note}" for note in notes(summary)]
    return "\n".join([table_title(summary), "", *lines, "", *bullets, ""])


def table_title(summary: dict[str, Any]) -> str:
    """What the numbers are."""
    title = "Table I: RMS of desired minus true angle"
    if summary["duration_s"] < summary["bench"]["duration_s"]:
        title += f", first {summary['duration_s']:g} s only (the paper's: 16 s)"
    return title


def notes(summary: dict[str, Any]) -> list[str]:
    """What a reader of the table should know: the loops, and what the Jacobian changes."""
    loops = [f"Loop {name}: {loop['sentence']}." for name, loop in summary["loops"].items()]
    return [*loops, summary["jacobian_comparison"]["sentence"]]


def table_rows(columns: list[dict[str, Any]]) -> list[tuple[str, list[str]]]:
    """Label and cells of each row of the printed table."""

    def numbers(key: str, digits: str) -> list[str]:
        return [format(column[key], digits) for column in columns]

    rows = []
    for angle in ("alpha", "beta"):
        rows += [
            (f"{angle}, urad", numbers(f"{angle}_rms_urad", ".4f")),
            ("  linear model", numbers(f"predicted_{angle}_rms_urad", ".4f")),
            ("  paper", numbers(f"paper_{angle}_rms_urad", ".4f")),
        ]
    peaks = [column["secondary_peak"] for column in columns]
    rows += [
        (f"peak {label}", [format(peak[key], ".3f") for peak in peaks])
        for label, key in (
            ("t_x, um", "t_x_um"),
            ("t_y, um", "t_y_um"),
            ("t_z, um", "t_z_um"),
            ("gamma, urad", "gamma_urad"),
        )
    ]
    rows.append(("closure, m", numbers("closure_residual_max_m", ".1e")))
    return rows


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"
