"""Secondary goals: coil temperature, stroke limits, an obstacle, a singularity."""

from experiments.study.study import Study

STUDY = Study(
    name="goals",
    help="""Pursue four secondary goals, and measure whether pointing changes.

    The goals are to keep coils cool, struts off their stops, the payload away from an obstacle,
    and an arm away from a singularity. Each is simulated with the mapping, without the goal, and
    with a weighted pseudo-inverse. With the mapping the pointing must change less than with another
    noise seed. 75 s on two cores, 30 s with --quick.

    Writes goals.json, the table as goals.md, a figure, and for each goal its data (.npz) and its
    recording (.rrd).

    Example: fjh goals --seed 2 --out /tmp/goals
    """,
    runs="experiments.goals.runs:run_goals",
    results="experiments.goals.results:results",
    quick="Shorter runs, one weight of the pseudo-inverse.",
)
