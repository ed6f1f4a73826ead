"""The compensators G_alpha(s) and G_beta(s) of Fig. 3: textbook single-loop design."""

from dataclasses import dataclass

import control
import numpy as np

from experiments.hexapod.testbed import Bench
from sim import Array, LinearPlant, ModelError

ANGLES = ("alpha", "beta")
_FREQUENCIES_RAD_S = 2 * np.pi * np.geomspace(0.1, 400.0, 8000)


@dataclass(frozen=True)
class Loop:
    """One pointing channel, designed and measured; plain arrays, so that it travels to workers.

    Attributes:
        numerator: Of G(s), highest power first; `denominator` alike.
        A: State matrix of the Tustin discretization; `B`, `C`, `D` alike.
        period_s: Control period.
        crossover_hz: Gain crossover of the sampled loop.
        gain_margin_db: At `phase_crossover_hz`.
        phase_margin_deg: At `crossover_hz`.
        phase_crossover_hz: Where the phase passes -180 degrees.
    """

    numerator: Array
    denominator: Array
    A: Array
    B: Array
    C: Array
    D: Array
    period_s: float
    crossover_hz: float
    gain_margin_db: float
    phase_margin_deg: float
    phase_crossover_hz: float

    @property
    def discrete(self) -> control.StateSpace:
        """The compensator as it runs."""
        return control.ss(self.A, self.B, self.C, self.D, self.period_s)

    def __str__(self) -> str:
        return (
            f"crossover {self.crossover_hz:.2f} Hz, "
            f"gain margin {self.gain_margin_db:.1f} dB at {self.phase_crossover_hz:.1f} Hz, "
            f"phase margin {self.phase_margin_deg:.1f} deg"
        )


def design(plant: LinearPlant, pointing: Array, bench: Bench) -> tuple[Loop, Loop]:
    """The alpha and beta loops on the sound plant.

    G(s) = K / s * w^2 / (s^2 + 2 zeta w s + w^2): an integrator, so that the error falls with
    frequency, and a roll-off that keeps the suspension modes from closing the loop again. K puts
    |G P| = 1 at the chosen crossover.

    Args:
        plant: Linear model of the sound plant.
        pointing: Gains from commanded (alpha, beta) to strut displacements, shape (n, 2).
        bench: Crossovers, roll-off and control period.

    Raises:
        sim.ModelError: The plant has not six degrees of freedom, a coil moves nothing, or a loop
            comes out unstable.
    """
    if plant.A.shape != (12, 12):
        raise ModelError(
            f"the sound machine must have six degrees of freedom, it has {len(plant.A) // 2}"
        )
    return _loop(plant, pointing, bench, 0), _loop(plant, pointing, bench, 1)


def compensators(
    plant: LinearPlant, pointing: Array, bench: Bench
) -> tuple[control.StateSpace, control.StateSpace]:
    """The (alpha, beta) compensators of :func:`design` as they run, their margins not measured.

    Raises:
        sim.ModelError: As there.
    """
    return _closing(plant, pointing, bench, 0)[1], _closing(plant, pointing, bench, 1)[1]


def sampled(plant: LinearPlant, gain: Array, period_s: float) -> control.StateSpace:
    """The plant behind a zero-order hold, from `gain`'s inputs to the twist."""
    continuous = control.ss(plant.A, plant.B @ gain, plant.C_twist, 0)
    return control.c2d(continuous, period_s, method="zoh")


def _closing(
    plant: LinearPlant, pointing: Array, bench: Bench, row: int
) -> tuple[control.TransferFunction, control.StateSpace, control.StateSpace]:
    """Compensator, continuous and discrete, and the sampled open loop, which closes stably."""
    w, zeta = 2 * np.pi * bench.roll_off_hz, bench.roll_off_damping
    crossover = 2 * np.pi * bench.crossover_hz[row]
    shape = control.tf([w**2], [1, 2 * zeta * w, w**2, 0])
    P = control.ss(plant.A, plant.B @ pointing[:, [row]], plant.C_twist[[row]], 0)
    response = abs(shape(1j * crossover) * P(1j * crossover))
    if not 0 < response < np.inf:
        raise ModelError(f"the coils do not move {ANGLES[row]}")
    G = shape * (1 / response)
    period_s = bench.control_period_s
    G_d = control.c2d(control.ss(G), period_s, "tustin", prewarp_frequency=crossover)
    P_d = sampled(plant, pointing, period_s)[row, row]
    if np.abs(control.feedback(P_d * G_d, 1).poles()).max() >= 1:
        raise ModelError(
            f"the {ANGLES[row]} loop is unstable on this machine at a crossover of "
            f"{bench.crossover_hz[row]} Hz: lower it, or give the struts more damping"
        )
    return G, G_d, P_d * G_d


def _loop(plant: LinearPlant, pointing: Array, bench: Bench, row: int) -> Loop:
    G, G_d, L = _closing(plant, pointing, bench, row)
    # On the frequency response: the polynomial method loses its digits on twelve plant states.
    curve = control.frequency_response(L, _FREQUENCIES_RAD_S)
    gain_margin, phase_margin, _, at_phase, at_gain, _ = control.stability_margins(curve)
    return Loop(
        numerator=G.num[0][0],
        denominator=G.den[0][0],
        A=G_d.A,
        B=G_d.B,
        C=G_d.C,
        D=G_d.D,
        period_s=bench.control_period_s,
        crossover_hz=at_gain / (2 * np.pi),
        gain_margin_db=20 * np.log10(gain_margin),
        phase_margin_deg=phase_margin,
        phase_crossover_hz=at_phase / (2 * np.pi),
    )
