"""The fault-tolerance report of a robot, or of any effectiveness matrix."""

from dataclasses import replace
from pathlib import Path

from experiments.rig.options import ROBOT, SERVO, START, TASK, Switch
from experiments.study.study import Option, Study

_MAJOR = {"kind": str | None, "default": None, "parse": None}
_TASK = tuple(replace(each, **_MAJOR) if each.name == "major" else each for each in TASK)
_SERVO = "For the sensors: natural frequency of the position servos that other actuators get."

STUDY = Study(
    name="survey",
    help="""Say what a robot, or an effectiveness matrix, can still do after each failure.

    The robot is an MJCF file; without one it is the hexapod. A matrix is a text file of numbers
    whose columns are actuators and whose rows are effects, as of rotors or thrusters; rows and
    columns may have names. Each failure of one or two actuators (of one with more than 99; of up to
    nine all combinations are counted), locked or free: whether the major task survives, what speed
    or effect, force and precision is left in the worst direction, and which secondary motion goes;
    for a robot also over its workspace. A failure is survived if at least 1 % of the speed and
    force, or of the effect, without failures is left. Takes 3 s for a matrix, 5 to 20 s for a
    robot; what takes longer says so.

    Writes survey.json, the report on one page as survey.html, the tables as survey.md and all
    conditions as survey.npz; a figure, if the task is possible without failures; and of a robot
    survey.rrd, survey_2.rrd and so on: its motion in each direction that a single failure costs.

    Example: fjh survey --matrix rotors.csv --lower 0 --upper 6 --hold 15,0,0,0 --out rotors
    """,
    runs="experiments.survey.runs:run_survey",
    results="experiments.survey.results:results",
    quick="At most 8 postures.",
    seed="the postures",
    options=(
        ROBOT,
        *_TASK,
        *START,
        Option("matrix", Path | None, None, "Effects per input, instead of a robot.", "FILE"),
        Option(
            "lower",
            str | None,
            None,
            "Lower limit of each input, or rate of a robot's actuators: a number, or a file of "
            "them.  [default: -1; of velocity actuators their range]",
            "L",
        ),
        Option("upper", str | None, None, "Upper limit likewise.  [default: 1]", "U"),
        Option(
            "hold",
            str | None,
            None,
            "What the inputs of a matrix exert at rest, such as a weight: one number a major row.",
            "W,...",
        ),
        Option(
            "postures",
            int,
            32,
            "Of the workspace, by a Sobol sequence over the joint ranges; 0: the start alone.",
            "N",
            bounds=(0, 4096),
        ),
        Option(
            "sensors",
            Switch,
            "on",
            "Whether to say which failures a robot's sensors tell apart: 1 s for the hexapod, 10 s "
            "for 12 actuators, not for more.",
        ),
        replace(SERVO, help=_SERVO),
    ),
)
