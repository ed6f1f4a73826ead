"""Unannounced failures and events: detection, isolation and recovery."""

from dataclasses import replace
from pathlib import Path

from experiments.rig.options import DITHER, LOOPS, PATH, TASK
from experiments.study.controllers import CONTROLLER
from experiments.study.spelling import check_file
from experiments.study.study import Option, Study
from experiments.study.where import SCHEDULER, WHERE

MODEL = Option(
    "model",
    Path | None,
    None,
    "Another robot: an MJCF file whose actuators move single joints; the options of fjh track.",
    "MODEL.xml",
    parse=check_file,
)
HOURS = Option(
    "hours", float, 2.0, "Simulated without failures, in runs of 16 s, unless --quick.", "H"
)
EVENTS = Option(
    "events",
    bool,
    False,
    "Only events: whatever happens to actuators, supply, machine and sensors, against a controller "
    "that does nothing; an estimated 30 minutes on two idle cores.",
)
HEXAPOD_ALONE = (HOURS, CONTROLLER, SCHEDULER)
OTHERS_ALONE = (*TASK, *PATH, *LOOPS, replace(DITHER, default="designed"))

STUDY = Study(
    name="recover",
    help="""Simulate unannounced actuator failures; measure detection, isolation and recovery.

    Struts lock, or lose their coil force or a part of it, at random times and in random postures,
    on plants that differ from the controller's model: gains, stiffness, damping, inertia, delay,
    floor vibration, drift, hysteresis and integrator step, each by itself, all together, and in
    several sizes. Runs are compared with a controller that is informed of the failure at once, and
    with one that continues without noticing it. On two idle cores an estimated 40 minutes, of which
    eight for each of the --hours without failures; half a minute with --quick.

    Rows are written to a Parquet dataset, OUT/unfinished, as runs finish; Ctrl-C keeps them, and
    --resume continues, with more or fewer --hours as well. The rows are identical to the bit for
    any number of workers and interruptions, on processors of one kind.

    Writes recover.json, the rows as recover.parquet, the tables as recover.md, a figure, and for
    some runs their data (.npz) and their recordings (.rrd). With --controller that controller runs
    in the same cases; it is told of no failure.

    With --events, in place of all these, other things happen to actuators, supply, machine and
    sensors at any time in a run, on several paths, and on plants of a family that the diagnosis
    does not assume; beside them a continuous hour without events. A check for each event says
    whether the error stays below 1.1 times that of a controller that does nothing.

    With --model, every actuator of another robot locks, goes limp and weakens on a circle, on
    plants that differ from the model, seen by a sensor of the task, by encoders, and by both: five
    minutes on two cores with four actuators. With --model and --events each of these events
    happens twice to the robot, on its circle.

    Example: fjh recover --quick --seed 3
    """,
    runs="experiments.recover.command:run",
    results="experiments.recover.results:results",
    quick="A few runs of each sort.",
    seed="the random failures and plants, and the detector noise",
    options=(MODEL, HOURS, EVENTS, CONTROLLER, *WHERE, *OTHERS_ALONE),
    streams=True,
    again="experiments.recover.command:again",
)
