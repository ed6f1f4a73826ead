"""The atlas in print, from `atlas.json`."""

from typing import Any

from experiments.atlas.summary import complaint
from experiments.output.findings import Findings, Picture, Table

PICTURES = [
    Picture(
        "atlas_flown.png",
        "Every failure condition flown: simulated against predicted error, and the error over the "
        "number of failed struts.",
        "On the left points on the diagonal, some yellow crosses far above it; on the right "
        "blue points on one level whatever the number of failures, yellow and black ones above.",
    )
]


def findings(summary: dict[str, Any]) -> Findings:
    """One row for each verdict and Jacobian, and where theory and simulation part."""
    return Findings(summary, [table(summary)], notes(summary), PICTURES, complaint(summary))


def table(summary: dict[str, Any]) -> Table:
    """Predicted and simulated errors."""
    rows = [
        (
            each["verdict"].replace("_", " "),
            each["jacobian"],
            str(each["runs"]),
            *(
                _number(each[f"{source}_{angle}_median_urad"])
                for angle in ("alpha", "beta")
                for source in ("predicted", "simulated")
            ),
            _number(each["largest_off_percent"]),
        )
        for each in summary["verdicts"]
    ]
    meaning = "; ".join(
        f"{each['verdict'].replace('_', ' ')}: {each['label']}"
        for each in summary["verdicts"]
        if each["jacobian"] == "constant"
    )
    return Table(
        f"{summary['conditions']} failure conditions with {', '.join(summary['weights'])}, "
        f"{summary['duration_s']:g} s: RMS error, urad",
        ("", "Jacobian", "runs", "alpha:\nmodel", "flown", "beta:\nmodel", "flown", "off, %"),
        rows,
        f"{meaning}. Medians; model: the linear model; off: largest distance of a run from it "
        "whose amplifiers do not saturate, a step of the converters included.",
    )


def notes(summary: dict[str, Any]) -> list[str]:
    """What disagrees, and how fast it went."""
    off, took = summary["explained"], summary["took"]
    said = []
    if off:
        conditions = sorted({each["struts"] for each in off})
        named = ", ".join(conditions[:6]) + (", ..." if len(conditions) > 6 else "")
        said.append(
            f"{len(off)} runs in {len(conditions)} conditions without pointing leave the linear "
            f"model, with the analytic Jacobian only ({named}): beside the nominal pose, where "
            "they are singular, the mapping reaches the lost direction with a gain of 1e5."
        )
    if took["runs_per_s"] is not None:
        said.append(f"{took['runs']} runs in this session, {took['runs_per_s']:.2f} a second.")
    return said


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
