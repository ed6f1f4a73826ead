"""The other mechanisms of the paper: an arm, a hand, two arms and a platform."""

from experiments.study.study import Study

STUDY = Study(
    name="systems",
    help="""Compare the classification of four other mechanisms with their simulation.

    An arm, a hand, two cooperating arms and a platform are simulated without and with failures:
    every actuator makes a step, the payload is pushed, the payload follows an octagon in its
    major task, and a force is exerted. 12 s on two cores, 8 s with --quick.

    Writes systems.json, the table as systems.md, a figure, and for each mechanism its data (.npz)
    and its recording (.rrd).

    Example: fjh systems --seed 1 --out /tmp/mechanisms
    """,
    runs="experiments.systems.runs:run_systems",
    results="experiments.systems.results:results",
    quick="Only the first three conditions of each mechanism.",
    seed="the random directions",
)
