"""The goal of a controller: secondary weights and known failures."""

from dataclasses import dataclass, field


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
        effectiveness: Actuators known to be weakened, and the part of the force that each has left.
    """

    joint_weight: tuple[float, ...] | None = None
    secondary_weight: tuple[float, ...] | None = None
    locked_at: dict[int, float] = field(default_factory=dict)
    free: tuple[int, ...] = ()
    spring_lost: tuple[int, ...] = ()
    effectiveness: dict[int, float] = field(default_factory=dict)
