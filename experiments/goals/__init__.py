"""Secondary goals with desired rates: cool coils, free strokes, an obstacle, a singularity."""

from experiments.output.study import Study

STUDY = Study(
    name="goals",
    help="""Pursue four secondary goals, and measure whether pointing changes.

    Cool coils, free strokes, an obstacle and a singularity: each goal is pursued through the
    mapping, not at all, and through a weighted pseudo-inverse. Through the mapping the pointing
    must change less than with another noise seed. 75 s on two cores, 30 s with --quick.

    Writes goals.json, the table as goals.md, a figure, and for each goal its data (.npz) and its
    recording (.rrd).

    Example: fjh goals --seed 2 --out /tmp/goals
    """,
    runs="experiments.goals.runs:run_goals",
    results="experiments.goals.results:results",
    quick="Shorter runs, one weight.",
)
