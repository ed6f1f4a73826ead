"""A machine that is not quite its controller's model."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.rig.hexapod.floor import floor_acceleration
from sim import Array, MaxwellSlip


@dataclass(frozen=True, eq=False)
class InexactPlant:
    """What differs from the model that controllers have; by default all but the model is exact.

    Attributes:
        model: The machine itself: springs, dampers, inertias, gains of the coils, physics step.
        hysteresis: Of the suspensions, beside the springs of the model; None is none.
        gain_drift_per_s: Relative change of each coil's gain from the start of a run.
        delay_ticks: Control ticks by which commands come late.
        floor_m_per_s: RMS velocity of the floor in each third octave.
        floor_seed: Of its phases.
        drift_rad_per_s: Of the detector's zero in (alpha, beta), from the start of a run.
        rest: State of the model once it has settled without current, which runs begin with; None
            lets each of them settle. See :func:`experiments.rig.hexapod.bench.settled`.
    """

    model: mujoco.MjModel
    hysteresis: MaxwellSlip | None = None
    gain_drift_per_s: tuple[float, ...] = (0.0,) * 6
    delay_ticks: int = 0
    floor_m_per_s: float = 0.0
    floor_seed: tuple[int, ...] = (0,)
    drift_rad_per_s: tuple[float, ...] = (0.0, 0.0)
    rest: mujoco.MjData | None = None

    def floor(self, ticks: int, period_s: float) -> Array | None:
        """Acceleration of the floor tick by tick, shape (N, 3), [m]/[s^2]; None is at rest."""
        if not self.floor_m_per_s:
            return None
        return floor_acceleration(ticks, period_s, self.floor_m_per_s, self.floor_seed)

    def drives(
        self, known: mujoco.MjModel, amplifiers: Callable[[Array], Array], period_s: float
    ) -> Callable[[Array], Array]:
        """The drives of a run: displacements (n,) at which the plant rests under inputs (n,).

        A :class:`sim.Plant` is commanded by displacements and so balances its own springs and
        gains; these have to be put back. Made anew for each run, called once in each control tick.

        Args:
            known: The model by which inputs are made.
            amplifiers: Displacements of that model under inputs.
            period_s: Between ticks.
        """
        if self.model is known:  # which may have servos instead
            return amplifiers
        reached = _per_control(self.model) / _per_control(known)
        return _DriftingDrives(amplifiers, reached, np.array(self.gain_drift_per_s), period_s)

    def zero_rad(self, ticks: int, period_s: float) -> Array:
        """Where the detector's zero is in (alpha, beta), tick by tick, shape (N, 2)."""
        return np.outer(np.arange(ticks) * period_s, self.drift_rad_per_s)


class _DriftingDrives:
    """Displacements under inputs, of drives whose gains change with each call."""

    def __init__(
        self,
        amplifiers: Callable[[Array], Array],
        reached: Array,
        drift_per_s: Array,
        period_s: float,
    ) -> None:
        self._amplifiers, self._reached = amplifiers, reached
        self._drift_per_s, self._period_s, self._ticks = drift_per_s, period_s, 0

    def __call__(self, input_percent: Array) -> Array:
        gain = self._reached * (1 + self._drift_per_s * (self._ticks * self._period_s))
        self._ticks += 1
        return self._amplifiers(input_percent) * gain


def _per_control(model: mujoco.MjModel) -> Array:
    """Displacement of each suspension per control of its coil, shape (6,)."""
    return model.actuator_gainprm[:, 0] / model.jnt_stiffness[model.actuator_trnid[:, 0]]
