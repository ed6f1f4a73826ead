"""The study of the last column in print, from `uncorrected.json`."""

from typing import Any

from experiments.output.findings import Findings, Picture, Table, is_cut
from experiments.uncorrected.soundness import complaint

PICTURES = [
    Picture(
        "uncorrected.png",
        "Candidate explanations of Table I's last column, beside the paper's ratios.",
        "Maps of both ratios over damping and crossover, hatched where a loop is unstable; ratios "
        "over the place at which strut 1 is locked; candidates beside bands of the paper's ratios; "
        "two uncorrected spirals.",
    ),
    Picture(
        "demand_limit.png",
        "A limit on the pointing that the compensators demand explains the last column.",
        "Ratio of alpha and of beta over the limit, a line for each spiral, beside a band of the "
        "paper's. Two uncorrected spirals: the limited one is cut off along alpha in its outer "
        "turns, the one locked off centre begins with a tail.",
    ),
]


def findings(summary: dict[str, Any]) -> Findings:
    """One row for each candidate, and the answer in a paragraph."""
    notes = [summary["paragraph"]]
    return Findings(summary, [table(summary)], notes, PICTURES, complaint(summary))


def table(summary: dict[str, Any]) -> Table:
    """One row for each candidate."""
    rows = [
        (
            candidate["name"].replace("_", " "),
            _pair(candidate["ratio"], ".2f"),
            *(
                _rms(column)
                for column in candidate["columns"]
                if column["name"] != "W_a_uncorrected"
            ),
        )
        for candidate in summary["candidates"]
    ]
    paper = [] if is_cut(summary) else [_paper(summary["paper"])]
    return Table(
        "Strut 1 locked, uncorrected: RMS of alpha, beta over those of W_a",
        ("", "ratios", "W_a", "W_d", "W_e"),
        [*rows, *paper],
        "W_a, W_d, W_e: RMS of alpha, beta, urad; *: by the linear model, not simulated.",
    )


def _paper(paper: dict[str, Any]) -> tuple[str, ...]:
    columns = [_pair(paper["columns_urad"][name], ".1f") for name in ("W_a", "W_d", "W_e")]
    ratios = _pair([paper["alpha_ratio"], paper["beta_ratio"]], ".2f")
    return ("the paper", ratios, *columns)


def _rms(column: dict[str, Any]) -> str:
    """A star: by the linear model, not simulated."""
    if column["rms_urad"] is None:
        return "unstable"
    return _pair(column["rms_urad"], ".1f") + ("" if column["simulated_urad"] else " *")


def _pair(values: list[float] | None, digits: str) -> str:
    return "-" if values is None else ", ".join(format(value, digits) for value in values)
