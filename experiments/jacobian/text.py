"""The study of the Jacobian in print, from `jacobian.json`."""

from typing import Any

from experiments.jacobian.loop import VARIANTS
from experiments.jacobian.loop_summary import loop_complaint
from experiments.jacobian.norms import NORMS
from experiments.jacobian.summary import complaint
from experiments.output.findings import Findings, Picture, Table

VARIATION_PICTURE = Picture(
    "jacobian.png",
    "How far the Jacobian departs from its nominal value over the stroke.",
    "Left: the change in both norms at the 64 corners of the box of strut lengths, sorted, below "
    "the certified bounds and mostly above the paper's values. Right: 2-norm against Frobenius "
    "norm for every reading of eq. (40) that was tried, and the paper's pair.",
)
LOOP_PICTURE = Picture(
    "jacobian_loop.png",
    "What a constant Jacobian costs as spiral and stroke grow.",
    "Distance from the optimum of the secondary goal in percent over eq. (40) of the lengths "
    "visited, and of the box: by geometry a straight line for the constant Jacobian; four forms of "
    "the mapping as run, of which only the Gauss-Newton step stays at the floor; the loop gain.",
)


def findings(summary: dict[str, Any]) -> Findings:
    """The values of eq. (40); with the loop also what a constant Jacobian costs there."""
    tables, notes, pictures = [variation(summary)], [summary["paragraph"]], [VARIATION_PICTURE]
    wrong = complaint(summary)
    if loop := summary.get("loop"):
        tables.append(in_the_loop(loop))
        notes.append(loop["paragraph"])
        pictures.append(LOOP_PICTURE)
        wrong = wrong or loop_complaint(loop)
    return Findings(summary, tables, notes, pictures, wrong)


def variation(summary: dict[str, Any]) -> Table:
    """The certified values, the paper's, and everything that was tried."""
    variation = summary["variation"]

    def row(label: str, e: dict[str, float], note: str = "", digits: int = 5) -> tuple[str, ...]:
        return (label, *(f"{e[norm]:.{digits}f}" for norm in NORMS), note)

    rows = [
        row("certified to be at most", {n: variation[n]["certified_upper_bound"] for n in NORMS}),
        row("paper", {n: variation[n]["paper"] for n in NORMS}, digits=4),
    ]
    rows += [row(one["reading"], one, _part(one)) for one in summary["tried"]]
    return Table(
        "Eq. (40): largest relative change of J over the stroke",
        ("how eq. (40) is read", "Frobenius", "2-norm", "paper's at"),
        rows,
        "paper's at: the part of the stroke that would give both printed numbers.",
    )


def in_the_loop(loop: dict[str, Any]) -> Table:
    """One row for each size of the spiral."""
    rows = [
        (
            f"x{one['spiral_factor']:g}",
            f"{one['e_visited']['frobenius']:.1e}",
            f"{one['static_extra_percent']:.2f}",
            *(f"{one['variants'][variant]['extra_percent']:.2f}" for variant in VARIANTS),
            f"{one['loop_gain_error_percent']:.2f}",
        )
        for one in loop["growth"]
    ]
    return Table(
        "In the loop, strut 1 locked: secondary goal off its optimum, loop gain off, %",
        ("", "e", "geometry", "const.", "analyt.", "increm.", "relin.", "loop gain"),
        rows,
        "Spiral over the paper's; eq. (40) over the lengths visited; expected by geometry for a "
        "constant Jacobian, and run with each form of the mapping.",
    )


def _part(trial: dict[str, Any]) -> str:
    if trial["is_the_papers"]:
        return "all of it"
    if trial["stroke_fraction"] is None:
        return "-"
    low, high = trial["stroke_fraction"]
    return f"{100 * low:.0f}-{100 * high:.0f} %"
