"""A sweep in print, from `sweep.json`."""

from typing import Any

from experiments.output.findings import Findings, Picture, Table
from experiments.sweep.summary import complaint

PICTURES = [
    Picture(
        "sweep.png",
        "Simulated over predicted RMS error of the runs that the linear model covers, and what the "
        "error depends on.",
        "On the left a cloud of points on the diagonal; on the right bars, one pair for each "
        "quantity varied, the strongest on top.",
    )
]


def findings(summary: dict[str, Any]) -> Findings:
    """How the runs ended, in groups; and how the linear model fared."""
    return Findings(
        summary, [groups(summary), influence(summary)], notes(summary), PICTURES, complaint(summary)
    )


def groups(summary: dict[str, Any]) -> Table:
    """One row for so many failing struts, told and not told to the mapping."""
    rows = [
        (
            _failures(group),
            str(group["runs"]),
            *(
                "" if group[key] is None else f"{group[key]:.3f}"
                for angle in ("alpha", "beta")
                for key in (f"{angle}_median_urad", f"{angle}_percentile_95_urad")
            ),
        )
        for group in summary["groups"]
    ]
    return Table(
        "RMS of desired minus true angle, urad",
        ("struts that fail", "runs", "alpha", "95 %", "beta", "95 %"),
        rows,
        "Median, and what 95 % of the runs stay below.",
    )


def influence(summary: dict[str, Any]) -> Table:
    """One row for each range."""
    rows = [
        (name, f"{found['alpha']:+.2f}", f"{found['beta']:+.2f}")
        for name, found in summary["influence"].items()
    ]
    return Table(
        "What the errors depend on",
        ("", "alpha", "beta"),
        rows,
        "Spearman's rank correlation with the RMS error over all runs that came to their end.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """How runs ended, the linear model, and how fast it went."""
    ended = ", ".join(f"{count} {status}" for status, count in summary["status"].items())
    found, took = summary["prediction"], summary["took"]
    said = [f"{summary['runs']} runs of {summary['duration_s']:g} s: {ended}."]
    if found["compared"]:
        said.append(
            f"In {found['compared']} runs the linear model can be asked: it is off by "
            f"{found['median_percent']:.2g} % (median); the worst run is off by "
            f"{found['largest_over_allowed']:.2g} of what is allowed, 5 % and one step of the "
            "converters, which the model leaves out."
        )
    if took["runs_per_s"] is not None:
        said.append(f"{took['runs']} runs in this session, {took['runs_per_s']:.2f} a second.")
    return said


def _failures(group: dict[str, Any]) -> str:
    if not group["failures"]:
        return "none"
    return f"{group['failures']}, {'told' if group['told'] else 'not told'}"
