"""One run of a sweep, by numbers alone: so small that it can be sent anywhere."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.goal import Goal
from experiments.hexapod.testbed import Bench
from experiments.sweep.factors import (
    ACTIVE,
    BENCH,
    CONDITIONS,
    SECONDARY,
    WEIGHTS,
    Value,
)
from sim import Failure

_KINDS = [kind for kind in CONDITIONS.values() if kind]


@dataclass(frozen=True)
class Case:
    """One run.

    Attributes:
        number: Counted from 0.
        seed: Of the detector noise.
        duration_s: So much of the spiral.
        struts: A letter of `CONDITIONS` for each strut, what becomes of it.
        failure_time_s: When it becomes so.
        known: Whether the mapping is told at that time.
        weight: Name of the weights; `joint_weight` and `secondary_weight` are what is made of them,
            diagonals of W1 over the struts and of W2 over [t_x, t_y, t_z, gamma], None is zero.
        jacobian: Of the mapping.
        bench: Constants around the plant.
    """

    number: int
    seed: int
    duration_s: float
    struts: str
    failure_time_s: float
    known: bool
    weight: str
    joint_weight: tuple[float, ...] | None
    secondary_weight: tuple[float, ...] | None
    jacobian: JacobianChoice
    bench: Bench

    @property
    def failures(self) -> tuple[Failure, ...]:
        """What happens to the plant while it runs."""
        if self.failure_time_s >= self.duration_s:
            return ()
        kinds = [CONDITIONS[letter] for letter in self.struts]
        return tuple(Failure(k, kind, self.failure_time_s) for k, kind in enumerate(kinds) if kind)

    @property
    def goal(self) -> Goal:
        """What the mapping is for before it is told of a failure."""
        return Goal(joint_weight=self.joint_weight, secondary_weight=self.secondary_weight)

    @property
    def reconfigured(self) -> Goal:
        """And after: it is told which struts, and takes those that lock to be at the centre."""
        if not self.known:
            return self.goal
        failed = {kind: [f.strut for f in self.failures if f.kind == kind] for kind in _KINDS}
        return replace(
            self.goal,
            locked_m=dict.fromkeys(failed["locked"], 0.0),
            free=tuple(failed["free"]),
            loose=tuple(failed["loose"]),
        )

    def parameters(self) -> dict[str, Any]:
        """The columns that tell it from other cases."""
        bench = asdict(self.bench)
        return {
            "case": self.number,
            "seed": self.seed,
            "duration_s": self.duration_s,
            "struts": self.struts,
            "failure_time_s": self.failure_time_s,
            "known": self.known,
            "weight": self.weight,
            **dict(zip(ACTIVE, self.joint_weight or (None,) * 6, strict=True)),
            **dict(zip(SECONDARY, self.secondary_weight or (None,) * 4, strict=True)),
            "jacobian": self.jacobian,
            **{name: bench[name] for name in BENCH},
        }


def case_of(number: int, duration_s: float, varied: Mapping[str, Value]) -> Case:
    """The case of these values; what is not among them is as on the bench, sound, with W_a."""
    weight = str(varied.get("weight", "W_a"))
    joint, secondary = WEIGHTS[weight]
    constants = {name: varied[name] for name in BENCH if name in varied}
    return Case(
        number=number,
        seed=int(varied["seed"]),
        duration_s=duration_s,
        struts=str(varied.get("struts", "SSSSSS")),
        failure_time_s=float(varied.get("failure_time_s", 0.0)),
        known=bool(varied.get("known", True)),
        weight=weight,
        joint_weight=_times(joint, ACTIVE, varied),
        secondary_weight=_times(secondary, SECONDARY, varied),
        jacobian="constant" if varied.get("jacobian") == "constant" else "analytic",
        bench=replace(Bench(), **constants),
    )


def _times(
    diagonal: tuple[float, ...] | None, factors: tuple[str, ...], varied: Mapping[str, Value]
) -> tuple[float, ...] | None:
    if diagonal is None:
        return None
    return tuple(
        weight * float(varied.get(name, 1.0))
        for weight, name in zip(diagonal, factors, strict=True)
    )
