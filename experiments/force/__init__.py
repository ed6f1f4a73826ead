"""Force mappings of section 3, simulated: the hexapod and an over-actuated platform."""

from experiments.study.study import Study

STUDY = Study(
    name="force",
    help="""Simulate static forces commanded by the force mapping.

    Tests Theorems 7, 8 and 9 on the hexapod without failure, with a locked and with a free strut:
    it presses against a fixed environment, or holds a prescribed wrench. A platform on four legs
    tests the internal force. 35 s on two cores, 12 s with --quick.

    Writes force.json, the tables as force.md, a figure, all commanded and measured forces
    (.npz) and a recording (.rrd).

    Example: fjh force --quick --json --quiet
    """,
    runs="experiments.force.runs:run_force",
    results="experiments.force.results:results",
    quick="Only strut 1 fails.",
    seed="the directions of all forces",
)
