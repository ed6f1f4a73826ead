"""The paper's other systems: what each is for, and what is made to fail."""

from dataclasses import dataclass
from pathlib import Path

from sim import HEXAPOD_MJCF

TASK_ROWS = ("turn x", "turn y", "turn z", "x", "y", "z")


@dataclass(frozen=True)
class Condition:
    """What is broken; actuators 0..n-1.

    Attributes:
        locked: Position failures.
        free: Torque failures.
    """

    locked: tuple[int, ...] = ()
    free: tuple[int, ...] = ()

    def __str__(self) -> str:
        parts = [
            f"{kind} {_numbers(which)}"
            for kind, which in (("locked", self.locked), ("free", self.free))
            if which
        ]
        return "; ".join(parts) or "sound"


@dataclass(frozen=True)
class Mechanism:
    """One MJCF file of `models/` and its task.

    Attributes:
        name: Of the file, without its ending.
        title: For people.
        task: Rows of the payload twist [angular; linear] that the mechanism is about.
        major: Which of these are the major task.
        conditions: What is tried.
    """

    name: str
    title: str
    task: tuple[int, ...]
    major: tuple[int, ...]
    conditions: tuple[Condition, ...]

    @property
    def path(self) -> Path:
        """Its MJCF file."""
        return HEXAPOD_MJCF.with_name(f"{self.name}.xml")

    @property
    def major_unit(self) -> str:
        """Of the major task: [rad] or [m]."""
        return "rad" if self.major_names[0].startswith("turn") else "m"

    @property
    def major_names(self) -> list[str]:
        """Major rows in words."""
        return [TASK_ROWS[self.task[row]] for row in self.major]


def _numbers(which: tuple[int, ...]) -> str:
    """Actuators 1..n for people; a run of three or more by its ends."""
    if len(which) > 2 and which == tuple(range(which[0], which[-1] + 1)):
        return f"{which[0] + 1}-{which[-1] + 1}"
    return ", ".join(str(k + 1) for k in which)


_SOUND = Condition()

MECHANISMS = (
    Mechanism(
        name="arm",
        title="7-joint serial arm, pointing",
        task=(0, 1, 2, 3, 4, 5),
        major=(0, 1),
        conditions=(
            _SOUND,
            Condition(locked=(1,)),
            Condition(locked=(3,)),
            Condition(free=(3,)),
            Condition(free=(6,)),
            Condition(locked=(1,), free=(6,)),
        ),
    ),
    Mechanism(
        name="hand",
        title="planar two-finger hand, placing an object",
        task=(2, 3, 4),
        major=(1, 2),
        conditions=(
            _SOUND,
            Condition(locked=(0,)),
            Condition(free=(0,)),
            Condition(free=(0, 1)),
            Condition(locked=(0,), free=(2,)),
            Condition(locked=(0, 1)),
        ),
    ),
    Mechanism(
        name="arms",
        title="two cooperating arms, carrying a load",
        task=(0, 1, 2, 3, 4, 5),
        major=(3, 4, 5),
        conditions=(
            _SOUND,
            Condition(locked=(1,)),
            Condition(free=(1,)),
            Condition(locked=(1,), free=(7,)),
            Condition(free=(0, 1, 2, 3, 4, 5)),
        ),
    ),
    Mechanism(
        name="platform",
        title="planar platform on four legs, positioning",
        task=(2, 3, 4),
        major=(1, 2),
        conditions=(
            _SOUND,
            Condition(locked=(0,)),
            Condition(free=(0,)),
            Condition(free=(0, 1)),
            Condition(locked=(0,), free=(1,)),
        ),
    ),
)
