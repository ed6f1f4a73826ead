"""Options of a robot's control: declarations, checks and parsers for commands and code.

It imports only modules that load fast, because the command line's help needs it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from fjh.rig.units import ROW_NAMES, ROWS
from fjh.rig.within import check_within
from fjh.study.errors import WrongInput
from fjh.study.input_checks import short
from fjh.study.option import Option

Sensing = Literal["task", "joints", "both"]
"""Sensors: of the task frame, encoders of the actuators with forward kinematics, or both."""

Limited = Literal["stated", "none"]
"""Limits of the displacements: those that the file states, or none."""

Feedforward = Literal["default", "on", "off"]
"""Feedforward of the path through the inverse of the linear model; "default" is "on", but "off" for
the hexapod, as in the paper."""

JacobianChoice = Literal["analytic", "constant"]
"""Jacobian of the hexapod's mapping: at the estimated pose at every control tick, or at the nominal
pose as eq. (39)."""

Switch = Literal["on", "off"]

DITHER_SIZE = 0.1
"""Largest dither of an actuator as a fraction of its motion on the path, and of a major row as a
fraction of the path's size."""

COST_PART = 0.5
"""Largest motion of a major row by the default dither without failures, in standard deviations of
one sample of its sensor."""

LARGEST_WEIGHT = 1e12

BOUNDS = {
    "size": (1e-12, 1e3),
    "servo": (1e-3, 1e6),
    "noise": (1e-15, 1e3),
    "crossover": (1e-6, 1e6),
    "period": (1e-7, 1.0),
    "turn": (1e-3, 1e6),
    "duration": (1e-6, 1e4),
}
"""Smallest and largest value of each number, in its unit."""

Model = Annotated[
    Path | None,
    Option(
        metavar="MODEL.xml", help="MJCF file of the robot.  [default: the hexapod]", positional=True
    ),
]
MachineFile = Annotated[
    Path | None,
    Option(metavar="FILE", help="MJCF file of another hexapod.  [default: the testbed's]"),
]
Site = Annotated[
    str, Option(metavar="NAME", help="Task frame: a site or a body, by name or number.")
]
Axes = Annotated[
    str | None, Option(metavar="NAME", help="Site whose axes the rows have.  [default: world]")
]
MAJOR = Option(
    metavar="ROWS",
    help="Rows of the twist to control exactly: names among rx, ry, rz (rotations), x, y, z "
    "(translations), or numbers 0 to 5.",
)
Keyframe = Annotated[
    str | None,
    Option(
        metavar="KEY",
        help="Keyframe of the start, by name or number.  [default: the first, or qpos0]",
    ),
]
Pinned = Annotated[
    tuple[str, ...] | None,
    Option(
        metavar="NAME,...",
        help="Sites or bodies fixed to the world, such as feet: NAME is welded at the robot's "
        "start, NAME:point may rotate.",
    ),
]
Turn = Annotated[
    float, Option(metavar="S", help="Time of one turn of a circle or spiral, in seconds.")
]
Dither = Annotated[
    str,
    Option(
        metavar="HZ",
        help="A small motion in the null space of the major rows, for the diagnosis: none, "
        "designed (the direction and frequency that separate failures best, at 2, 5, 10 or 20 "
        f"Hz), or a frequency in Hz. No actuator moves more than {DITHER_SIZE:g} times its motion "
        f"on the path, and no major row more than {DITHER_SIZE:g} times the path's size. default: "
        f"designed at 10 or 20 Hz, with major rows moving at most {COST_PART:g} standard "
        "deviations of a sample; none if it separates no failure.",
    ),
]
Controller = Annotated[
    str | None,
    Option(
        metavar="NAME",
        help="Another controller, package.module:factory (docs/control-without-simulator.md).",
    ),
]


@dataclass(frozen=True)
class RobotOptions:
    """Options of a robot's control; `major`, the weights and `pinned` may be comma-separated text.

    Raises:
        WrongInput: A value is invalid for every robot; names are checked when the robot is loaded.
    """

    site: Site = "payload"
    axes: Axes = None
    major: Annotated[tuple[int, ...], MAJOR] = (0, 1)
    size: Annotated[
        float | None,
        Option(
            metavar="R",
            help="Radius of the path, [rad] or [m].  [default: 1 mrad, or a thousandth of the "
            "model's extent; the hexapod's 0.1 mrad]",
        ),
    ] = None
    sense: Annotated[
        Sensing,
        Option(
            help="task: a sensor of the major rows; joints: encoders, and forward kinematics; "
            "both: the diagnosis uses both."
        ),
    ] = "both"
    noise: Annotated[
        float | None,
        Option(
            metavar="SIGMA",
            help="Standard deviation of one sample of each sensor, [rad] or [m].  [default: a "
            "hundredth of the signal's amplitude on a path of the default size: for a row 0.01 "
            "mrad, or 1e-5 of the model's extent]",
        ),
    ] = None
    crossover: Annotated[
        float | None,
        Option(
            metavar="HZ",
            help="Gain crossover of the loops.  [default: the highest with a sensitivity peak of "
            "1.7]",
        ),
    ] = None
    feedforward: Annotated[
        Feedforward,
        Option(
            help="Feedforward of the path through the inverse of the linear model, in addition to "
            "the loops. By default on; off for the hexapod, as in the paper."
        ),
    ] = "default"
    period: Annotated[
        float, Option(metavar="S", help="Control period: a whole number of physics steps.")
    ] = 1e-3
    joint_weight: Annotated[
        tuple[float, ...] | None,
        Option(
            metavar="W,...",
            help="W1 of the actuators, one number or one for each.  [default: 1, without a "
            "secondary weight]",
        ),
    ] = None
    secondary_weight: Annotated[
        tuple[float, ...] | None,
        Option(metavar="W,...", help="W2 of the other rows, a number for each."),
    ] = None
    limits: Annotated[
        Limited,
        Option(help="Limits of the actuators' displacements: ranges stated in the file, or none."),
    ] = "stated"
    keyframe: Keyframe = None
    pinned: Pinned = None
    servo: Annotated[
        float | None,
        Option(metavar="HZ", help="Natural frequency of position servos added to torque motors."),
    ] = None

    def __post_init__(self) -> None:
        parsed: dict[str, Any] = {"major": rows_of("major", self.major)}
        for name in ("joint_weight", "secondary_weight"):
            if (value := getattr(self, name)) is not None:
                parsed[name] = weights_of(name, value)
        parsed["pinned"] = pinned_of(self.pinned)
        for name, value in parsed.items():
            object.__setattr__(self, name, value)
        for name in ("size", "noise", "crossover", "period", "servo"):
            if (value := getattr(self, name)) is not None or name == "period":
                check_bounds(name, value)
        kinds = {"sense": Sensing, "feedforward": Feedforward, "limits": Limited}
        for name, kind in kinds.items():
            value = getattr(self, name)
            if not (isinstance(value, str) and value in get_args(kind)):
                expected = ", ".join(get_args(kind))
                raise WrongInput(f"{name} must be one of {expected}, got {short(value)}")


def check_bounds(name: str, value: Any, of: str | None = None) -> None:
    """Raise `WrongInput` unless a value is a number within :data:`BOUNDS` of its option."""
    try:
        check_within(name, value, *BOUNDS[of or name])
    except ValueError as error:
        raise WrongInput(str(error)) from None


def rows_of(name: str, given: Any, *names: Sequence[str]) -> tuple[int, ...]:
    """Parse major rows by name or number, from a sequence or comma-separated text.

    Args:
        name: Name of the argument, for messages.
        given: Rows, by names or numbers.
        names: Lists of names of all rows; by default those of a twist.

    Raises:
        WrongInput: There is no row, an unknown one, or one twice.
    """
    row_names = names or (ROWS, ROW_NAMES)
    numbers = [str(k) for k in range(len(row_names[0]))]
    number = {label: k for labels in (numbers, *row_names) for k, label in enumerate(labels)}
    parts = _parts(given)
    rows = tuple(number[part] for part in parts if part in number)
    if not rows or len(set(rows)) < len(parts):
        listed = ",".join(row_names[-1])
        expected = f"different rows from 0 to {len(numbers) - 1} or of {listed:.80}"
        raise WrongInput(f"{name} must be {expected}, got {short(given)}")
    return rows


def weights_of(name: str, given: Any) -> tuple[float, ...]:
    """Parse weights from a number, a sequence, or comma-separated text.

    Raises:
        WrongInput: A weight is no number, negative, or larger than :data:`LARGEST_WEIGHT`.
    """
    try:
        values = tuple(float(part) for part in _parts(given))
    except ValueError:
        raise WrongInput(
            f"{name} must be numbers separated by commas, got {short(given)}"
        ) from None
    if not all(0 <= value <= LARGEST_WEIGHT for value in values):
        raise WrongInput(f"{name} must be from 0 to {LARGEST_WEIGHT:g}, got {short(given)}")
    return values


def pinned_of(given: Any) -> tuple[str, ...] | None:
    """Parse pinned frames, NAME or NAME:point, from a sequence or comma-separated text.

    Returns None for an empty list.

    Raises:
        WrongInput: A name is empty.
    """
    names = () if given is None else tuple(_parts(given))
    if not all(name.removesuffix(":point") for name in names):
        raise WrongInput(f"pinned must be NAME or NAME:point,..., got {short(given)}")
    return names or None


def _parts(given: Any) -> list[str]:
    parts = given.split(",") if isinstance(given, str) else given
    return [str(part).strip() for part in (parts if isinstance(parts, Iterable) else [parts])]


DEFAULT_OPTIONS = RobotOptions()
"""Options of a command without arguments."""
