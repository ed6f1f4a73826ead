"""A strut without coil force, and without coil force and spring (section 2.3.1)."""

from experiments.study.study import Study

STUDY = Study(
    name="release",
    help="""Simulate a strut without coil force, then without coil force and spring.

    Strut 1 fails at the start or during the spiral, known or unknown to the mapping. Every spiral
    is compared with the linear model. The payload at rest is compared with the elastic mapping over
    six decades of suspension stiffness. 35 s on two cores, 15 s with --quick.

    Writes release.json, the tables as release.md, a figure, all 3^6 conditions (atlas.npz), and for
    each spiral its data (.npz) and its recording (.rrd).

    Example: fjh release --quick
    """,
    runs="experiments.release.runs:run_release",
    results="experiments.release.results:results",
    quick="Spirals of 4 s, and three values of the stiffness.",
)
