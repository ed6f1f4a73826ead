"""Unannounced actuator failures: detection, isolation and recovery."""

from experiments.output.controllers import CONTROLLER
from experiments.output.study import Study

STUDY = Study(
    name="recover",
    help="""Simulate unannounced actuator failures; measure detection, isolation and recovery.

    Struts lock, or lose their coil force or a part of it, at random times and in random postures.
    The diagnosis uses the commands, the measured angles and an exact model of the plant. Each run
    is compared with a controller that is informed of the failure at once, and with one that
    continues without noticing it. 20 to 40 minutes on two cores, 2 with --quick.

    Writes recover.json, the tables as recover.md, a figure, and for some runs their data (.npz)
    and their recordings (.rrd). With --controller that controller runs in the same scenarios; it is
    told of no failure.

    Example: fjh recover --quick --seed 3
    """,
    runs="experiments.recover.runs:run_recover",
    results="experiments.recover.results:results",
    quick="Four failures instead of several hundred.",
    seed="the random failures and the detector noise",
    options=(CONTROLLER,),
)
