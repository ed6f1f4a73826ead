"""The task, and what is left free for: which rows matter, and the secondary goal."""

from dataclasses import dataclass, field

MAJOR = [0, 1]
"""Task rows (alpha, beta): the pointing task."""
SECONDARY = [3, 4, 5, 2]
"""[t_x, t_y, t_z, gamma], the order of the paper's W_d and W_e."""


@dataclass(frozen=True)
class Goal:
    """What the secondary freedom is spent on.

    Attributes:
        joint_weight: W1, diagonal over the six struts; None is zero.
        secondary_weight: W2, diagonal over [t_x, t_y, t_z, gamma]; None is zero.
        locked_m: Struts known to be stuck, and where: displacement by strut 0..5.
        free: Struts known to be without coil, their suspension spring intact.
        loose: Struts known to be without coil and spring.
        strength: Struts known to have a weakened coil, and the part of its force that is left.
    """

    joint_weight: tuple[float, ...] | None = None
    secondary_weight: tuple[float, ...] | None = None
    locked_m: dict[int, float] = field(default_factory=dict)
    free: tuple[int, ...] = ()
    loose: tuple[int, ...] = ()
    strength: dict[int, float] = field(default_factory=dict)
