"""What fails, when, and where the struts stand at that time."""

from dataclasses import dataclass, replace

import numpy as np

from experiments.hexapod.goal import Goal
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import KINDS, Fault, Kind
from sim import Failure

GOAL = Goal(joint_weight=(1.0,) * 6)
"""W_a, under which antipodal struts look alike."""

DITHER = Dither(amplitude_m=0.5e-6, frequency_hz=20.0)
"""A strut that fails is then seen at 1.2 urad, four times the detector's noise. Its frequency is
above the loops' crossovers, so that they do not fight it; below the modes from 32 Hz on, where the
linear model would have to be more exact; and high enough for inertia to move a free strut."""

BEFORE_S, AFTER_S = 1.2, 2.5
"""Of each flight, before and after the failure; the first half second is for catching up."""

RECOVERED_S = 0.5
"""After the failure: what counts as recovery begins here."""

_EARLIEST_S, _LATEST_S = 1.5, 13.4
_STANDING_M = 10e-6
_STRENGTHS = 0.2, 0.8
_EACH: list[tuple[Kind, int]] = [(kind, strut) for strut in range(6) for kind in KINDS]


@dataclass(frozen=True)
class Case:
    """One failure on the spiral.

    Attributes:
        strut: 0..5.
        kind: Of the failure.
        time_s: On the spiral.
        rest_m: Secondary displacement at which the struts stand, shape (6,).
        seed: Of the sensors' noise.
        strength: Part of its force that a weak coil has left.
    """

    strut: int
    kind: Kind
    time_s: float
    rest_m: tuple[float, ...]
    seed: int
    strength: float = 0.0

    @property
    def failure(self) -> Failure:
        """What happens to the plant."""
        return Failure(self.strut, self.kind, self.time_s, self.strength)

    @property
    def fault(self) -> Fault:
        """What there is to find."""
        return Fault(self.strut, self.kind, self.strength)

    @property
    def begin_s(self) -> float:
        """Where on the spiral the flight begins."""
        return self.time_s - BEFORE_S

    def dither(self, about: Dither) -> Dither:
        """The dither, about where the struts of this case stand."""
        return replace(about, rest_m=self.rest_m)


def draw(seed: int, number: int) -> list[Case]:
    """Each strut and kind in turn, at a random time on the spiral and in a random posture.

    Args:
        seed: Of the draw, and of the sensors' noise.
        number: Of cases; eighteen are one of each.
    """
    rng = np.random.default_rng([seed, 2])
    return [
        Case(
            strut=strut,
            kind=kind,
            # Whole control periods, so that all flights of a case are sampled alike.
            time_s=round(float(rng.uniform(_EARLIEST_S, _LATEST_S)), 3),
            rest_m=tuple(rng.normal(scale=_STANDING_M, size=6).tolist()),
            seed=int(rng.integers(2**32)),
            strength=float(rng.uniform(*_STRENGTHS)) if kind == "weak" else 0.0,
        )
        for kind, strut in (_EACH[k % len(_EACH)] for k in range(number))
    ]
