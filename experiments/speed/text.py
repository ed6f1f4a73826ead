"""Speed in print, from `bench.json`."""

from typing import Any

from experiments.findings import Findings, Table


def findings(summary: dict[str, Any]) -> Findings:
    """One row for each Jacobian; a time is never unsound."""
    rows = [
        (name, f"{ratio:.2f}", f"{summary['real_time_factor'][f'closed_loop_{name}']:.1f}")
        for name, ratio in summary["closed_loop_over_mj_step"].items()
    ]
    table = Table(
        "Time of the closed loop",
        ("Jacobian", "x mj_step", "x real time"),
        rows,
        "Over the time of MuJoCo's steps alone; simulated time over it.",
    )
    return Findings(summary, [table], [], [], None)
