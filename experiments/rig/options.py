"""What a command says of its robot: the options that several studies have."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.rig.bounds import check_number, weights_of
from experiments.rig.choices import Feedforward, Limited, Sensing
from experiments.rig.units import ROW_NAMES, ROWS
from experiments.study.spelling import check_file, nearest
from experiments.study.study import Option, WrongInput

_ROWS = {each: k for k in range(6) for each in (ROW_NAMES[k], ROWS[k], str(k))}
"""Rows of a twist, by what each may be called."""

DITHER_SIZE = 0.1
"""Of a dither: no actuator moves further than this part of what the path moves one, nor a major row
than this part of the path's size. A failed actuator leaves its part of the dither uncancelled."""


COST_PART = 0.5
"""Of a dither by default: while nothing has failed no major row moves further than this part of one
standard deviation of a sample of its sensor."""


@dataclass(frozen=True)
class RobotOptions:
    """How a robot is controlled, in the words of the command; its options are below.

    Raises:
        WrongInput: A number out of its bounds, or no rows of a twist, or no weights.
    """

    site: str = "payload"
    axes: str | None = None
    major: str = "0,1"
    size: float | None = None
    noise: float | None = None
    crossover: float | None = None
    period: float = 1e-3
    joint_weight: str | None = None
    secondary_weight: str | None = None
    limits: Limited = "stated"
    keyframe: str | None = None
    servo: float | None = None
    sense: Sensing = "both"
    feedforward: Feedforward = "default"
    pinned: str | None = None

    def __post_init__(self) -> None:
        for name in ("size", "noise", "crossover", "period", "servo"):
            if (value := getattr(self, name)) is not None or name == "period":
                check_number(name, value)
        for name in ("joint_weight", "secondary_weight"):
            if (text := getattr(self, name)) is not None:
                weights_of(f"--{name.replace('_', '-')}", text)
        _ = self.rows, self.pins

    @property
    def pins(self) -> tuple[tuple[str, bool], ...]:
        """Frames that stand, and whether each is welded: NAME is, NAME:point may turn."""
        given = [] if self.pinned is None else self.pinned.split(",")
        names = [each.strip().removesuffix(":point") for each in given]
        if not all(names):
            raise WrongInput(f"--pinned must be NAME or NAME:point,..., got {self.pinned}")
        return tuple((name, name == each.strip()) for name, each in zip(names, given, strict=True))

    @property
    def rows(self) -> tuple[int, ...]:
        """The major ones, of the twist."""
        parts = [part.strip() for part in self.major.split(",")]
        found = tuple(_ROWS[part] for part in parts if part in _ROWS)
        if len(set(found)) < len(parts):
            said = f"different rows from 0 to 5 or of {','.join(ROW_NAMES)}"
            raise WrongInput(f"--major must be {said}, got {self.major:.80}")
        return found


def written(value: Any) -> Any:
    """Names or numbers as an option of a command has them, with commas; anything else as it is."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        return value
    return ",".join(str(each) for each in value)


PATHS = ("spiral", "circle", "steps")


def check_path(path: str) -> None:
    """Refuse what is neither the name of a path nor a file of one.

    Raises:
        WrongInput: It is not.
    """
    if path in PATHS:
        return
    if Path(path).suffix == ".npz" and not Path(path).is_file():
        raise WrongInput(f"--path {path} cannot be read: there is no such file")
    if Path(path).suffix != ".npz":
        raise WrongInput(
            f"--path must be {', '.join(PATHS)} or FILE.npz, got {path}{nearest(path, PATHS)}"
        )


def check_dither(dither: str) -> None:
    """Refuse what is neither a word of the option nor a number.

    Raises:
        WrongInput: It is not.
    """
    words = ("none", "default", "designed")
    if dither in words:
        return
    try:
        float(dither)
    except ValueError:
        raise WrongInput(
            f"--dither must be {', '.join(words)}, or a frequency in Hz, got {dither}"
            f"{nearest(dither, words)}"
        ) from None


@contextmanager
def by_argument() -> Iterator[None]:
    """Refuse by the names that :meth:`experiments.rig.Rig.of_mjcf` gives to options of a command.

    Raises:
        WrongInput, sim.ModelError: What is refused inside.
    """
    try:
        yield
    except (WrongInput, ValueError) as error:
        if (said := re.sub(r"--([a-z-]+)( HZ)?", _argument, str(error))) == str(error):
            raise
        raise type(error)(said) from None


def _argument(option: re.Match[str]) -> str:
    name = option[1].replace("-", "_")
    said = {"servo": "servo_hz", "keyframe": "start", "path": "name"}.get(name, name)
    return f"{said}=10" if option[2] else said


_USUAL = RobotOptions

ROBOT = Option(
    "model",
    Path | None,
    None,
    "The robot, MJCF.  [default: the hexapod]",
    "MODEL.xml",
    positional=True,
    check=check_file,
)
"""The file, of a command that takes the hexapod without one."""

TASK = (
    Option("site", str, _USUAL.site, "Task frame: a site, or a body, by name or number.", "NAME"),
    Option("axes", str | None, _USUAL.axes, "Site that gives the axes.  [default: world]", "NAME"),
    Option(
        "major",
        str,
        _USUAL.major,
        "Major rows of the twist [rx, ry, rz, x, y, z], turns about axes and then motions along "
        "them: controlled exactly. Names, such as x,y,z, or numbers, 0 to 5.",
        "ROWS",
    ),
)
START = (
    Option(
        "keyframe",
        str | None,
        _USUAL.keyframe,
        "Where the robot starts: name or number.  [default: the first, or qpos0]",
        "KEY",
    ),
    Option(
        "pinned",
        str | None,
        _USUAL.pinned,
        "Sites or bodies that stand, such as feet: welded where the robot starts, or NAME:point, "
        "which may turn.",
        "NAME,...",
    ),
)
PATH = (
    Option(
        "size",
        float | None,
        _USUAL.size,
        "Radius of the path, [rad] or [m].  [default: 1 mrad, or a thousandth of the model's "
        "extent; the hexapod's 0.1 mrad]",
        "R",
    ),
    Option("turn", float, 4.0, "Time of one turn of a circle or spiral, in seconds.", "S"),
)
SENSE = Option(
    "sense",
    Sensing,
    _USUAL.sense,
    "task: a sensor of the major rows; joints: encoders, and forward kinematics; both: the "
    "diagnosis looks at both.",
)
LOOPS = (
    Option(
        "noise",
        float | None,
        _USUAL.noise,
        "Standard deviation of one sample of each sensor, [rad] or [m].  [default: a hundredth "
        "of what a path of the default size moves it: of a row 0.01 mrad, or 1e-5 of the model's "
        "extent]",
        "SIGMA",
    ),
    Option(
        "crossover",
        float | None,
        _USUAL.crossover,
        "Gain crossover of the loops.  [default: the highest with a sensitivity peak of 1.7]",
        "HZ",
    ),
    Option(
        "feedforward",
        Feedforward,
        _USUAL.feedforward,
        "Whether the path is demanded through the inverse of the linear model, and the loops add "
        "to it. By default on; off for the hexapod, as in the paper.",
    ),
    Option("period", float, _USUAL.period, "Control period, in whole physics steps.", "S"),
    Option(
        "joint_weight",
        str | None,
        _USUAL.joint_weight,
        "W1, one number or one an actuator.  [default: 1, unless there is a secondary weight]",
        "W,...",
    ),
    Option(
        "secondary_weight",
        str | None,
        _USUAL.secondary_weight,
        "W2, one number a secondary row.",
        "W,...",
    ),
    Option(
        "limits",
        Limited,
        _USUAL.limits,
        "Displacements of the actuators: within the ranges that the file states, or unlimited.",
    ),
    *START,
    Option(
        "servo",
        float | None,
        _USUAL.servo,
        "Natural frequency of the position servos that torque motors get.",
        "HZ",
    ),
)
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
    check=check_dither,
)
