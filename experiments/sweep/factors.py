"""What a sweep can vary, one at a time: a few choices, or a range."""

from dataclasses import dataclass, fields
from typing import Literal, get_args

from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.columns import COLUMNS
from experiments.hexapod.testbed import LIMITS as BENCH_LIMITS
from experiments.hexapod.testbed import Bench

Value = float | int | str | bool

ACTIVE = tuple(f"joint_weight_{k}" for k in range(1, 7))
SECONDARY = tuple(f"secondary_weight_{name}" for name in ("t_x", "t_y", "t_z", "gamma"))
"""Factors on the diagonals of W1 and W2, in the order of the paper's."""

_NOT_SWEPT = (
    "duration_s",
    "quick_duration_s",
    "spiral_exponent",
    "spiral_start_deg",
    "spiral_direction",
    "demand_limit_urad",
    "anti_windup",
)
"""How long a run lasts is the design's; spiral and limit are mapped by `fjh uncorrected`."""

BENCH = tuple(field.name for field in fields(Bench) if field.name not in _NOT_SWEPT)
"""Constants of the bench that a design can vary."""

_ONES = (1.0,) * 6
WEIGHTS = {
    column.name: (column.goal.joint_weight, column.goal.secondary_weight) for column in COLUMNS[:5]
} | {"both": (_ONES, _ONES[:4])}
"""W1 and W2 by name: the paper's five, and all ones in both."""

CONDITIONS = {"S": None, "L": "locked", "F": "free", "B": "loose"}
"""A letter for each state of a strut, and the failure it stands for."""

Kind = Literal["real", "integer", "name", "switch", "struts"]

KINDS: dict[str, Kind] = {
    "struts": "struts",
    "failure_time_s": "real",
    "known": "switch",
    "weight": "name",
    **dict.fromkeys(ACTIVE + SECONDARY, "real"),
    "jacobian": "name",
    "seed": "integer",
    **dict.fromkeys(BENCH, "real"),
    "dac_bits": "integer",
}
"""All that can be varied, and what its values are."""

LIMITS: dict[str, tuple[float, float]] = {
    "failure_time_s": (0.0, 3600.0),
    **dict.fromkeys(ACTIVE + SECONDARY, (0.0, 1e6)),
    "seed": (0, 2**32 - 1),
    **{name: BENCH_LIMITS[name] for name in BENCH},
}
"""Least and largest value of what is a number."""

NAMES = {"weight": tuple(WEIGHTS), "jacobian": get_args(JacobianChoice)}


@dataclass(frozen=True)
class Choice:
    """Some values; one of them is a constant."""

    name: str
    values: tuple[Value, ...]

    def at(self, u: float) -> Value:
        """The value at u in [0, 1): each has the same share."""
        return self.values[int(u * len(self.values))]

    @property
    def count(self) -> int:
        """Of the values."""
        return len(self.values)


@dataclass(frozen=True)
class Range:
    """From low to high, both included.

    Attributes:
        name: Of what is varied.
        low: Least value; `high`: largest.
        log: Whether its logarithm is what is spread evenly.
        points: So many values in a grid; None: any value between.
    """

    name: str
    low: float
    high: float
    log: bool
    points: int | None

    def at(self, u: float) -> Value:
        """The value at u in [0, 1]."""
        if KINDS[self.name] == "integer":
            return int(min(self.low + u * (self.high - self.low + 1), self.high))
        if self.log:
            return self.low * (self.high / self.low) ** u
        return self.low + u * (self.high - self.low)

    @property
    def values(self) -> tuple[Value, ...]:
        """The points of a grid, ends included."""
        return tuple(self.at(k / max(self.count - 1, 1)) for k in range(self.count))

    @property
    def count(self) -> int:
        """Of the points of a grid."""
        return self.points or 1


Factor = Choice | Range
