"""Unannounced actuator failures: how fast and surely they are found, and what recovery is worth."""

from experiments.output.study import Study

STUDY = Study(
    name="recover",
    help="""Simulate unannounced actuator failures; measure detection, isolation and recovery.

    Struts lock, lose their coil force or a part of it, at random times and in random postures. The
    diagnosis has the commands, the measured angles and an exact model of the plant. Beside each
    run, one of a controller that is informed at once, and one of a controller that is unaware of
    the failure. 20 minutes on two cores, 45 s with --quick.

    Writes recover.json, the tables as recover.md, a figure, and for some runs their data (.npz)
    and their recordings (.rrd).

    Example: fjh recover --quick --seed 3
    """,
    runs="experiments.recover.runs:run_recover",
    results="experiments.recover.results:results",
    quick="Four failures instead of some hundreds.",
    seed="the failures drawn and the detector noise",
)
