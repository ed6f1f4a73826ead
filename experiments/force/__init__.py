"""Section 3: force mappings of the hexapod and of an over-actuated platform, in simulation."""

from experiments.output.study import Study

STUDY = Study(
    name="force",
    help="""Simulate static forces that the force mapping prescribes.

    Theorems 7, 8 and 9 on the hexapod, sound, with a locked and with a free strut: pressing against
    a fixed environment, and holding a prescribed wrench. A platform on four legs with its internal
    force. 35 s on two cores, 12 s with --quick.

    Writes force.json, the tables as force.md, a figure, all forces that were commanded and measured
    (.npz) and a recording (.rrd).

    Example: fjh force --quick --json --quiet
    """,
    runs="experiments.force.runs:run_force",
    results="experiments.force.results:results",
    quick="Only strut 1 fails.",
    seed="the directions of all forces",
)
