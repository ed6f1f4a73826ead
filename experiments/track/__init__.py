"""Any robot in the loop: a path, failures in flight, diagnosis, and what the failures cost."""

from pathlib import Path

from experiments.output.controllers import CONTROLLER
from experiments.output.study import Option, Study
from experiments.track.choices import Diagnosing, Limited, Sensing

STUDY = Study(
    name="track",
    help="""Track a path with any robot while its actuators fail.

    The robot is an MJCF file as downloaded; without one it is the hexapod. Its major rows are
    controlled in a closed loop through the mapping, at the joint positions of a keyframe or qpos0.
    An actuator that fails is diagnosed from the measurements, and the mapping is reconfigured. The
    errors are compared with the linear model of the plant. A minute for most robots.

    Writes track.json, track.npz, the figure track.png, and the recording track.rrd with the
    mechanism in 3D, its path, actuators and failures.

    Example: fjh track panda.xml --site hand --major 3,4,5 --fail joint4:locked@4 --out /tmp/panda
    """,
    runs="experiments.track.runs:run_track",
    results="experiments.track.results:results",
    quick="The first half of the run only; failures strike at half of their times.",
    seed="the sensors' noise",
    options=(
        Option(
            "model",
            Path | None,
            None,
            "The robot, MJCF.  [default: the hexapod]",
            "MODEL.xml",
            True,
        ),
        Option("site", str, "payload", "Task frame: a site, or a body.", "NAME"),
        Option("axes", str | None, None, "Site that gives the axes.  [default: world]", "NAME"),
        Option(
            "major",
            str,
            "0,1",
            "Major rows of the twist [turn x, y, z; x, y, z], 0 to 5: controlled exactly.",
            "ROWS",
        ),
        Option(
            "fail",
            list[str],
            (),
            "A failure: actuator or joint, kind (locked, free, weak, loose) and time in seconds. "
            "May be repeated.",
            "NAME:KIND@S",
        ),
        Option(
            "path",
            str,
            "circle",
            "spiral, circle, steps, or FILE.npz with time_s (N,) and desired (N, rows): major "
            "displacements from the start, [rad] or [m]. The hexapod's is its spiral.",
            "PATH",
        ),
        Option(
            "size",
            float | None,
            None,
            "Radius of the path, [rad] or [m].  [default: 1 mrad, or a thousandth of the model's "
            "extent]",
            "R",
        ),
        Option("duration", float, 8.0, "Of the run, in seconds.", "S"),
        Option("turn", float, 4.0, "Time of one turn of a circle or spiral, in seconds.", "S"),
        Option(
            "sense",
            Sensing,
            "task",
            "task: a sensor of the major rows; joints: encoders, and forward kinematics.",
        ),
        Option(
            "noise",
            float | None,
            None,
            "Standard deviation of one sample of each sensor, [rad] or [m].  [default: a hundredth "
            "of the path's size]",
            "SIGMA",
        ),
        Option(
            "crossover",
            float | None,
            None,
            "Gain crossover of the loops.  [default: the highest with a sensitivity peak of 1.7]",
            "HZ",
        ),
        Option("period", float, 1e-3, "Control period, in whole physics steps.", "S"),
        Option(
            "joint_weight",
            str | None,
            None,
            "W1, one number or one an actuator.  [default: 1, unless there is a secondary weight]",
            "W,...",
        ),
        Option("secondary_weight", str | None, None, "W2, one number a secondary row.", "W,..."),
        Option(
            "limits",
            Limited,
            "stated",
            "Displacements of the actuators: within the ranges that the file states, or unlimited.",
        ),
        Option(
            "diagnosis",
            Diagnosing,
            "on",
            "on: failures are diagnosed, and the mapping is reconfigured; off: it goes on.",
        ),
        Option(
            "keyframe",
            str | None,
            None,
            "Where the robot starts: name or number.  [default: the first, or qpos0]",
            "KEY",
        ),
        Option(
            "servo",
            float | None,
            None,
            "Natural frequency of the position servos that torque motors get.",
            "HZ",
        ),
        CONTROLLER,
    ),
)
