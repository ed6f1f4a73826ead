"""The campaign of a sweep: its runs as rows."""

from experiments.study.basis import sources_of
from experiments.study.campaign import Campaign
from experiments.sweep.design import SweepRuns
from experiments.sweep.row import SCHEMA, row_of

SOURCES = sources_of(
    "sweep",
    without=("__init__", "again", "atlas", "campaign", "figure", "results", "runs", "words"),
)


def sweep_of(runs: SweepRuns) -> Campaign[SweepRuns]:
    """The runs of a design with this seed."""
    drawn_from = {"design": runs.design.as_json(), "seed": runs.seed}
    return Campaign(runs, row_of, SCHEMA, SOURCES, drawn_from)
