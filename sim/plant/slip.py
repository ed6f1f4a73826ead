"""Hysteresis of springs: the Maxwell-slip chain."""

from dataclasses import dataclass

import numpy as np

import argument_checks as check
from sim.array import Array


@dataclass(frozen=True)
class MaxwellSlip:
    """Elastic elements with dry friction in series, m of them side by side on each of n springs.

    An element of stiffness k is stretched with the displacement x until its force is that of its
    friction, k s; then it slips. Its stretch z follows dx within -s..s, and its force is -k z. In a
    cycle of amplitude a each element dissipates 4 k s (a - s) where a > s, and nothing elsewhere.

    Source: Iwan, J. Appl. Mech. 33 (1966) 893, his parallel-series model; for joints, Segalman,
    SAND2001-0811 (2001).

    Attributes:
        stiffness: Of each element, shape (n, m), [N]/[m] or [N m]/[rad].
        slip: Its stretch when it slips, shape (n, m), [m] or [rad].

    Raises:
        ValueError: They are no matrices of one shape, or negative.
    """

    stiffness: Array
    slip: Array

    def __post_init__(self) -> None:
        """Check the arguments, and keep read-only copies."""
        for name in ("stiffness", "slip"):
            value = check.not_negative(name, getattr(self, name))
            if value.ndim != 2:
                raise ValueError(f"{name} must have shape (n, m), got {value.shape}")
            object.__setattr__(self, name, check.frozen(value))
        check.exactly("slip", self.slip, *self.stiffness.shape)

    def moved(self, stretch: Array, by: Array) -> Array:
        """Stretches (n, m) of the elements after displacements (n,) of their springs.

        Exact for displacements in one direction, whatever the steps.
        """
        stretch = check.exactly("stretch", stretch, *self.slip.shape)
        by = check.exactly("by", by, len(self.slip))
        # A third of the time of np.clip.
        return np.minimum(np.maximum(stretch + by[:, None], -self.slip), self.slip)

    def force(self, stretch: Array) -> Array:
        """Force on each spring's end, shape (n,), [N] or [N m]: against the stretch."""
        stretch = check.exactly("stretch", stretch, *self.slip.shape)
        return -(self.stiffness * stretch).sum(axis=1)
