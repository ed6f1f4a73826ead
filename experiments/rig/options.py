"""Options that several studies have of their robot: each declared, bounded and parsed here alone.

Nothing is imported that takes time: the help text does not wait for it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from experiments.rig.units import ROW_NAMES, ROWS
from experiments.study.spelling import check_file
from experiments.study.study import Option

Sensing = Literal["task", "joints", "both"]
"""A sensor of the task frame; encoders of the actuators and forward kinematics; or both sensors."""

Limited = Literal["stated", "none"]
"""Limits of the displacements: those that the file states, or none."""

Feedforward = Literal["default", "on", "off"]
"""Whether the path is demanded through the inverse of the linear model; by default on, but for the
hexapod, as in the paper."""

JacobianChoice = Literal["analytic", "constant"]
"""Jacobian of the hexapod's mapping: of the estimated pose at every control tick, or of the nominal
pose as eq. (39)."""

Switch = Literal["on", "off"]

DITHER_SIZE = 0.1
"""Largest dither as a part of the path: of what it moves an actuator, and of its size for a major
row. A failed actuator leaves its part of the dither uncancelled."""

COST_PART = 0.5
"""Largest motion of a major row by the default dither while nothing has failed, as a part of one
standard deviation of a sample of its sensor."""

LARGEST_WEIGHT = 1e12

TURN_S, DURATION_S = (1e-3, 1e6), (1e-6, 1e4)
"""Least and largest time of a turn, and of a run."""

_ROWS = {each: k for k in range(6) for each in (ROW_NAMES[k], ROWS[k], str(k))}
"""Rows of a twist, by what each may be called."""


def rows_of(text: str | Sequence[int | str]) -> tuple[int, ...]:
    """Parse major rows: names or numbers, as text with commas between.

    Raises:
        ValueError: There are none, others, or one twice.
    """
    parts = _parts(text)
    found = tuple(_ROWS[part] for part in parts if part in _ROWS)
    if not found or len(set(found)) < len(parts):
        expected = f"different rows from 0 to 5 or of {','.join(ROW_NAMES)}"
        raise ValueError(f"text must be {expected}, got {text!s:.80}")
    return found


def weights_of(text: str | float | Iterable[float]) -> tuple[float, ...]:
    """Parse weights, as text with commas between.

    Raises:
        ValueError: They are no numbers, negative, or larger than :data:`LARGEST_WEIGHT`.
    """
    try:
        values = tuple(float(part) for part in _parts(text))
    except ValueError:
        raise ValueError(f"text must be numbers with commas between, got {text!s:.80}") from None
    if not all(0 <= value <= LARGEST_WEIGHT for value in values):
        raise ValueError(f"text must be from 0 to {LARGEST_WEIGHT:g}, got {text!s:.80}")
    return values


def pinned_of(text: str | Sequence[str]) -> tuple[str, ...]:
    """Parse frames that stand, NAME or NAME:point, as text with commas between.

    Raises:
        ValueError: One has no name.
    """
    names = tuple(_parts(text))
    if not all(name.removesuffix(":point") for name in names):
        raise ValueError(f"text must be NAME or NAME:point,..., got {text}")
    return names


def _parts(given: Any) -> list[str]:
    parts = given.split(",") if isinstance(given, str) else given
    return [str(part).strip() for part in (parts if isinstance(parts, Iterable) else [parts])]


MAJOR = Option(
    "major",
    str,
    "0,1",
    "Major rows of the twist [rx, ry, rz, x, y, z], turns about axes and then motions along "
    "them: controlled exactly. Names, such as x,y,z, or numbers, 0 to 5.",
    "ROWS",
    parse=rows_of,
)
TASK = (
    Option("site", str, "payload", "Task frame: a site, or a body, by name or number.", "NAME"),
    Option("axes", str | None, None, "Site that gives the axes.  [default: world]", "NAME"),
    MAJOR,
)
START = (
    Option(
        "keyframe",
        str | None,
        None,
        "Where the robot starts: name or number.  [default: the first, or qpos0]",
        "KEY",
    ),
    Option(
        "pinned",
        str | None,
        None,
        "Sites or bodies that stand, such as feet: welded where the robot starts, or NAME:point, "
        "which may turn.",
        "NAME,...",
        parse=pinned_of,
    ),
)
SIZE = Option(
    "size",
    float | None,
    None,
    "Radius of the path, [rad] or [m].  [default: 1 mrad, or a thousandth of the model's "
    "extent; the hexapod's 0.1 mrad]",
    "R",
    bounds=(1e-12, 1e3),
)
_TURN = "Time of one turn of a circle or spiral, in seconds."
TURN = Option("turn", float, 4.0, _TURN, "S", bounds=TURN_S)
PATH = (SIZE, TURN)
DURATION = Option("duration", float, 8.0, "Of the run, in seconds.", "S", bounds=DURATION_S)
SENSE = Option(
    "sense",
    Sensing,
    "both",
    "task: a sensor of the major rows; joints: encoders, and forward kinematics; both: the "
    "diagnosis looks at both.",
)
SERVO = Option(
    "servo",
    float | None,
    None,
    "Natural frequency of the position servos that torque motors get.",
    "HZ",
    bounds=(1e-3, 1e6),
)
LOOPS = (
    Option(
        "noise",
        float | None,
        None,
        "Standard deviation of one sample of each sensor, [rad] or [m].  [default: a hundredth "
        "of what a path of the default size moves it: of a row 0.01 mrad, or 1e-5 of the model's "
        "extent]",
        "SIGMA",
        bounds=(1e-15, 1e3),
    ),
    Option(
        "crossover",
        float | None,
        None,
        "Gain crossover of the loops.  [default: the highest with a sensitivity peak of 1.7]",
        "HZ",
        bounds=(1e-6, 1e6),
    ),
    Option(
        "feedforward",
        Feedforward,
        "default",
        "Whether the path is demanded through the inverse of the linear model, and the loops add "
        "to it. By default on; off for the hexapod, as in the paper.",
    ),
    Option(
        "period",
        float,
        1e-3,
        "Control period, in whole physics steps.",
        "S",
        bounds=(1e-7, 1.0),
    ),
    Option(
        "joint_weight",
        str | None,
        None,
        "W1, one number or one an actuator.  [default: 1, unless there is a secondary weight]",
        "W,...",
        parse=weights_of,
    ),
    Option(
        "secondary_weight",
        str | None,
        None,
        "W2, one number a secondary row.",
        "W,...",
        parse=weights_of,
    ),
    Option(
        "limits",
        Limited,
        "stated",
        "Displacements of the actuators: within the ranges that the file states, or unlimited.",
    ),
    *START,
    SERVO,
)
OF_ROBOT = {option.name: option for option in (*TASK, SIZE, SENSE, *LOOPS)}
"""The options that :class:`RobotOptions` has values of."""

DITHER = Option(
    "dither",
    str,
    "default",
    "A small motion in the null space of the major rows, for the diagnosis: none, designed (the "
    "direction and frequency that separate failures best, at 2, 5, 10 or 20 Hz), or a frequency in "
    f"Hz. No actuator moves further than {DITHER_SIZE:g} of what the path moves one, and by "
    f"dynamics no major row further than {DITHER_SIZE:g} of the path's size. default: designed at "
    f"10 or 20 Hz, and no major row moves further than {COST_PART:g} of the noise of a sample; "
    "none where no failure is separated by it.",
    "HZ",
)
ROBOT = Option(
    "model",
    Path | None,
    None,
    "The robot, MJCF.  [default: the hexapod]",
    "MODEL.xml",
    positional=True,
    parse=check_file,
)
"""The file, of a command that takes the hexapod without one."""

_MACHINE = "Another machine file, MJCF.  [default: the hexapod, fjh.xml]"
MACHINE_FILE = Option("model", Path | None, None, _MACHINE, "FILE", parse=check_file)
"""The file, of studies that run on any hexapod."""


@dataclass(frozen=True)
class RobotOptions:
    """How a robot is controlled: values of the options above, as these parse them."""

    site: str = "payload"
    axes: str | None = None
    major: tuple[int, ...] = (0, 1)
    size: float | None = None
    noise: float | None = None
    crossover: float | None = None
    period: float = 1e-3
    joint_weight: tuple[float, ...] | None = None
    secondary_weight: tuple[float, ...] | None = None
    limits: Limited = "stated"
    keyframe: str | None = None
    servo: float | None = None
    sense: Sensing = "both"
    feedforward: Feedforward = "default"
    pinned: tuple[str, ...] | None = None
