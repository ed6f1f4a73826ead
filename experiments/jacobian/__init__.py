"""Variation of the Jacobian over the stroke: eq. (40) with a proven bound, and its effects."""

from experiments.study.study import Option, Study

STUDY = Study(
    name="jacobian",
    help="""Compute how much the Jacobian varies over the stroke, eq. (40), with a proof.

    Finds the largest change of the Jacobian over the stroke and proves an upper bound, tries
    readings of eq. (40) that could give the paper's smaller numbers, and with --loop simulates the
    error that a constant Jacobian causes for larger spirals and strokes. 20 s on two cores,
    5 minutes with --loop.

    Writes jacobian.json, the tables as jacobian.md and a figure; with --loop a second figure, and
    for some runs their data (.npz) and their recordings (.rrd).

    Example: fjh jacobian --loop --quick
    """,
    runs="experiments.jacobian.runs:run_jacobian",
    results="experiments.jacobian.results:results",
    quick="Fewer local searches; with --loop three sizes of the spiral, 4 s each.",
    seed="the searches and the detector noise",
    options=(Option("loop", bool, False, "Also simulate spirals of increasing size: 5 minutes."),),
    in_report={"loop": True},
)
