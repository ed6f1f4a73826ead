"""One run of a sweep, as numbers and words alone, and the factors that can be varied in it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal, get_args

from experiments.rig.conditions import failures_of
from experiments.rig.hexapod.columns import COLUMNS
from experiments.rig.hexapod.testbed import LIMITS as BENCH_LIMITS
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.rig.options import JacobianChoice
from ftc.goal import Goal
from sim import Failure

Value = float | int | str | bool

ACTIVE = tuple(f"joint_weight_{k}" for k in range(1, 7))
SECONDARY = tuple(f"secondary_weight_{name}" for name in ("t_x", "t_y", "t_z", "gamma"))
"""Factors on the diagonals of W1 and W2, in the order of the paper's."""

BENCH = tuple(
    field.name
    for field in fields(TestbedConfig)
    if field.name not in ("duration_s", "quick_duration_s")
)
"""Constants of the testbed that a design can vary; how long a run lasts is the design's."""

_ONES = (1.0,) * 6
WEIGHTS = {
    column.name: (column.goal.joint_weight, column.goal.secondary_weight) for column in COLUMNS[:5]
} | {"both": (_ONES, _ONES[:4])}
"""W1 and W2 by name: the paper's five, and all ones in both."""

KINDS: dict[str, Literal["real", "integer", "sign", "name", "switch", "struts"]] = {
    "struts": "struts",
    "failure_time_s": "real",
    "known": "switch",
    "weight": "name",
    **dict.fromkeys(ACTIVE + SECONDARY, "real"),
    "jacobian": "name",
    "seed": "integer",
    **dict.fromkeys(BENCH, "real"),
    "dac_bits": "integer",
    "spiral_direction": "sign",
    "anti_windup": "switch",
}
"""All that can be varied, and what its values are."""

LIMITS: dict[str, tuple[float, float]] = {
    "failure_time_s": (0.0, 3600.0),
    **dict.fromkeys(ACTIVE + SECONDARY, (0.0, 1e6)),
    "seed": (0, 2**32 - 1),
    **{name: BENCH_LIMITS[name] for name in BENCH if name in BENCH_LIMITS},
}
"""Least and largest value of each number."""

NAMES = {"weight": tuple(WEIGHTS), "jacobian": get_args(JacobianChoice)}


@dataclass(frozen=True)
class Choice:
    """A factor with a few values; one with a single value is a constant."""

    name: str
    values: tuple[Value, ...]

    def at(self, u: float) -> Value:
        """The value at u in [0, 1): each has the same share."""
        return self.values[int(u * self.count)]

    @property
    def count(self) -> int:
        """Number of the values."""
        return len(self.values)


@dataclass(frozen=True)
class Range:
    """A factor from low to high, both included.

    Attributes:
        log: Whether its logarithm is spread evenly.
        points: Number of values in a grid; None: any value between.
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
        """Number of the points of a grid, which may be too many to list."""
        return self.points or 1


Factor = Choice | Range


_COLUMNS = ("seed", "duration_s", "struts", "failure_time_s", "known", "weight")


@dataclass(frozen=True)
class SweepRun:
    """One run of a sweep: so small that it can be sent to any machine.

    Its weights are those of the name `weight` times their factors: diagonals of W1 over the struts
    and of W2 over [t_x, t_y, t_z, gamma]; None is zero.
    """

    number: int  # from 0 on; column `case` of the dataset
    seed: int  # of the detector noise
    duration_s: float  # of the spiral
    struts: str  # a letter of `LETTERS` for each strut: its state from `failure_time_s` on
    failure_time_s: float
    known: bool  # whether the mapping is reconfigured for the failures when they happen
    weight: str
    joint_weight: tuple[float, ...] | None
    secondary_weight: tuple[float, ...] | None
    jacobian: JacobianChoice
    bench: TestbedConfig

    @property
    def failures(self) -> tuple[Failure, ...]:
        """What happens to the plant during the run."""
        if self.failure_time_s >= self.duration_s:
            return ()
        return failures_of(self.struts, self.failure_time_s)

    @property
    def goal(self) -> Goal:
        """Goal of the mapping before the failures."""
        return Goal(joint_weight=self.joint_weight, secondary_weight=self.secondary_weight)

    @property
    def reconfigured(self) -> Goal:
        """Goal after them; locked struts are taken to be at the centre."""
        if not self.known:
            return self.goal
        locked, free, spring_lost = (
            tuple(failure.actuator for failure in self.failures if failure.kind == kind)
            for kind in ("locked", "free", "loose")
        )
        return replace(
            self.goal, locked_at=dict.fromkeys(locked, 0.0), free=free, spring_lost=spring_lost
        )

    def parameters(self) -> dict[str, Any]:
        """The columns in which runs of a sweep differ before they are simulated."""
        bench = asdict(self.bench)
        return {
            "case": self.number,
            **{name: getattr(self, name) for name in _COLUMNS},
            **dict(zip(ACTIVE, self.joint_weight or (None,) * 6, strict=True)),
            **dict(zip(SECONDARY, self.secondary_weight or (None,) * 4, strict=True)),
            "jacobian": self.jacobian,
            **{name: bench[name] for name in BENCH},
        }


def sweep_run(number: int, duration_s: float, varied: Mapping[str, Value]) -> SweepRun:
    """The run with these values; all others as on the testbed, without failures, W_a."""
    weight = str(varied.get("weight", "W_a"))
    joint, secondary = WEIGHTS[weight]
    bench = {name: varied[name] for name in BENCH if name in varied}
    return SweepRun(
        number=number,
        seed=int(varied["seed"]),
        duration_s=duration_s,
        struts=str(varied.get("struts", "SSSSSS")),
        failure_time_s=float(varied.get("failure_time_s", 0.0)),
        known=bool(varied.get("known", True)),
        weight=weight,
        joint_weight=joint and _times(joint, ACTIVE, varied),
        secondary_weight=secondary and _times(secondary, SECONDARY, varied),
        jacobian="constant" if varied.get("jacobian") == "constant" else "analytic",
        bench=replace(TestbedConfig(), **bench),
    )


def _times(
    diagonal: tuple[float, ...], factors: tuple[str, ...], varied: Mapping[str, Value]
) -> tuple[float, ...]:
    pairs = zip(diagonal, factors, strict=True)
    return tuple(weight * float(varied.get(name, 1.0)) for weight, name in pairs)
