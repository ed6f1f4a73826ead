"""The last column of Table I: changes of the testbed that reproduce its errors."""

from experiments.study.study import Study

STUDY = Study(
    name="uncorrected",
    help="""Test explanations for the large error in the last column of Table I.

    Strut 1 is locked and the mapping is not reconfigured. Candidate explanations, one at a time and
    combined, are simulated and compared with the linear model. Maps from the linear model cover
    damping and crossover, and a detector off the focus; one over a limit on the demanded pointing
    is made by fjh sweep --design experiments/sweep/demand_limit.toml. 4 minutes on two cores, 25 s
    with --quick.

    Writes uncorrected.json, the table as uncorrected.md, two figures, the map (map.npz), the data
    of each candidate (.npz) and some recordings (.rrd).

    Example: fjh uncorrected --quick --out /tmp/why
    """,
    runs="experiments.uncorrected.runs:run_uncorrected",
    results="experiments.uncorrected.results:results",
    quick="Spirals of 4 s, three candidates, a coarse map.",
    seed="the detector noise and the floor vibration",
)
