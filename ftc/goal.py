"""The goal of a controller: secondary weights and known failures."""

from dataclasses import dataclass, field

import argument_checks as check

MOST_ACTUATORS = 10_000


@dataclass(frozen=True)
class Goal:
    """Weights of the secondary goal, and the failures known to the controller.

    Actuators are numbered 0..n-1; displacements are in their own units, [m] or [rad].

    Attributes:
        joint_weight: W1, diagonal over the n actuators; None is zero.
        secondary_weight: W2, diagonal over the secondary rows; None is zero.
        locked_at: Actuators known to be locked, and the displacement at which each stands.
        free: Actuators known to exert no force, their springs intact.
        spring_lost: Actuators known to have lost force and spring.
        effectiveness: Actuators known to be weakened, and the part of the force that each has left,
            above zero and up to one.
    """

    joint_weight: tuple[float, ...] | None = None
    secondary_weight: tuple[float, ...] | None = None
    locked_at: dict[int, float] = field(default_factory=dict)
    free: tuple[int, ...] = ()
    spring_lost: tuple[int, ...] = ()
    effectiveness: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("joint_weight", "secondary_weight"):
            if (weight := getattr(self, name)) is not None:
                diagonal = check.array(name, check.array(name, weight, None), least=0.0)
                vars(self)[name] = tuple(diagonal.tolist())
        for name in ("free", "spring_lost"):
            vars(self)[name] = tuple(
                check.indices(name, getattr(self, name), MOST_ACTUATORS).tolist()
            )
        for name in ("locked_at", "effectiveness"):
            known = check.instance(name, getattr(self, name), dict)
            actuators = check.indices(name, list(known), MOST_ACTUATORS).tolist()
            vars(self)[name] = {
                k: check.number(name, value)
                for k, value in zip(actuators, known.values(), strict=True)
            }
        for left in self.effectiveness.values():
            check.number("effectiveness", left, check.SMALLEST, 1.0)

    @property
    def failed(self) -> set[int]:
        """Actuators known to have failed, all or in part."""
        return {*self.locked_at, *self.free, *self.spring_lost, *self.effectiveness}

    def of(self, actuators: int) -> "Goal":
        """The goal itself, checked to name no other than these actuators."""
        check.integer("actuators", actuators)
        for name in ("free", "spring_lost", "locked_at", "effectiveness"):
            check.indices(name, list(getattr(self, name)), actuators)
        return self
