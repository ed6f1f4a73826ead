"""Any robot in the loop: a path, failures in flight, diagnosis, and what the failures cost."""

from pkgutil import resolve_name

from experiments.rig.options import DITHER, DURATION, LOOPS, PATH, ROBOT, SENSE, TASK, Switch
from experiments.study.controllers import CONTROLLER
from experiments.study.study import Option, Study

STUDY = Study(
    name="track",
    help="""Track a path with any robot while its actuators fail.

    The robot is an MJCF file as downloaded; without one it is the hexapod, whose frame, loops and
    sensors are those of the testbed: it takes none of the options for these. The major rows are
    controlled in a closed loop through the mapping, at the joint positions of a keyframe or qpos0.
    An actuator that fails is diagnosed from the measurements, and the mapping is reconfigured. The
    errors are compared with the linear model of the plant, and where something fails or happens
    with the same run without diagnosis. A minute for most robots.

    Writes track.json, the tables as track.md, every tick as track.npz, the figure track.png, and
    the recording track.rrd with the mechanism in 3D, its path, actuators and failures.

    Example: fjh track panda.xml --site hand --major x,y,z --fail actuator4:locked@4 --out panda
    """,
    runs="experiments.track.runs:run_track",
    results="experiments.track.results:results",
    quick="The first half of the run only; failures and events come at half of their times.",
    seed="the sensors' noise, and what is drawn of events",
    options=(
        ROBOT,
        *TASK,
        Option(
            "fail",
            list[str],
            (),
            "A failure: actuator (or its joint), kind (locked, free, weak, loose) and time in "
            "seconds. May be repeated.",
            "NAME:KIND@S",
            parse=lambda text: resolve_name("sim:Failure.parse")(text),
        ),
        Option(
            "event",
            list[str],
            (),
            "Something else that happens: an event of docs/track.md, its actuator where it is of "
            "one, and time in seconds. May be repeated.",
            "NAME[:ACTUATOR]@S",
            parse=lambda text: resolve_name("experiments.rig.events:Event.parse")(text),
        ),
        Option(
            "path",
            str,
            "circle",
            "spiral, circle, steps, or FILE.npz with time_s (N,) and desired (N, rows): major "
            "displacements from the start, [rad] or [m].",
            "PATH",
        ),
        *PATH,
        DURATION,
        SENSE,
        *LOOPS,
        Option(
            "diagnosis",
            Switch,
            "on",
            "on: failures are diagnosed, and the mapping is reconfigured; off: it goes on.",
        ),
        DITHER,
        CONTROLLER,
    ),
    in_report=None,
)
