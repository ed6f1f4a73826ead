"""The figures in words, from `figures.json`."""

from typing import Any

from experiments.output.findings import Findings, Picture, Table

PICTURES = [
    Picture(
        "figure2.png",
        "The paper's Fig. 2, drawn from the machine file: top view and front view.",
        "Six struts, numbered, zigzag between three nodes on the base and three on the payload; "
        "both coordinate frames, laser, telescope and detector.",
    ),
    Picture(
        "figure3.png",
        "The paper's Fig. 3 with the numbers of the loop that runs.",
        "Block diagram: spiral, two compensators with transfer functions and margins, velocity "
        "mapping, drives, hexapod, and back through telescope and detector.",
    ),
    Picture(
        "bode.png",
        "Open pointing loops as they run, with gain and phase margins.",
        "Magnitude and phase of the alpha and beta loops over frequency; the suspension modes "
        "stand out at 39 Hz, below unity gain.",
    ),
    Picture(
        "atlas.png",
        "Every combination of sound, locked and free struts: can the hexapod still point?",
        "A map of 27 by 27 conditions, and the share of each verdict over the number of failures.",
    ),
]


def findings(summary: dict[str, Any]) -> Findings:
    """The failure atlas by number of failures, and the loops; a drawing is never unsound."""
    atlas = summary["atlas"]
    rows = [
        (one["label"], *map(str, one["by_number_of_failures"]), str(one["conditions"]))
        for one in atlas["verdicts"].values()
    ]
    table = Table(
        "Pointing after failures",
        ("struts failed", *map(str, range(len(rows[0]) - 2)), "in all"),
        rows,
        f"Numbers of the {atlas['conditions']} conditions; a failed strut is locked or free.",
    )
    loops = [f"Loop {name}: {loop['sentence']}." for name, loop in summary["loops"].items()]
    return Findings(summary, [table], loops, PICTURES, None)
