"""Section 2.3.1 where springs decide: a strut without its coil, and without coil and spring."""

from experiments.output.study import Study

STUDY = Study(
    name="release",
    help="""Simulate a strut without coil force, then without coil force and spring.

    Strut 1 fails from the start or during the spiral; the mapping knows of it or not. Every spiral
    is compared with the linear model, and the payload at rest over six decades of suspension
    stiffness with the elastic mapping. 35 s on two cores, 15 s with --quick.

    Writes release.json, the tables as release.md, a figure, all 3^6 conditions (atlas.npz), and for
    each spiral its data (.npz) and its recording (.rrd).

    Example: fjh release --quick
    """,
    runs="experiments.release.runs:run_release",
    results="experiments.release.results:results",
    quick="Spirals of 4 s, and three points of the sweep.",
)
