"""Is the Jacobian constant? Eq. (40) with a certificate, and what it means in the loop."""

from experiments.output.study import Option, Study

STUDY = Study(
    name="jacobian",
    help="""Compute how far the Jacobian varies over the stroke, eq. (40), with a certificate.

    Its largest change over the stroke, bounded from above; the readings of eq. (40) that could give
    the paper's smaller numbers; and with --loop the error that a constant Jacobian causes as spiral
    and stroke grow. 20 s on two cores, 5 minutes with --loop.

    Writes jacobian.json, the tables as jacobian.md and a figure; with --loop a second figure, and
    for some runs their data (.npz) and their recordings (.rrd).

    Example: fjh jacobian --loop --quick
    """,
    runs="experiments.jacobian.runs:run_jacobian",
    results="experiments.jacobian.results:results",
    quick="Few local searches; with --loop three sizes, 4 s each.",
    seed="the searches and the detector noise",
    options=(Option("loop", bool, False, "Also track the spiral, at growing sizes: 5 minutes."),),
)
