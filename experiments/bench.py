"""Every constant of the bench that the paper does not give, chosen once, here."""

from dataclasses import dataclass

import numpy as np

from sim import Amplifier, Array, Detector, spiral


@dataclass(frozen=True)
class Bench:
    """Constants around the plant; those marked *calibrated* were set to meet Table I's W_a..W_e.

    Attributes:
        duration_s: Length of a run (paper).
        spiral_radius_urad: Final radius of the spiral (calibrated).
        spiral_period_s: Time of one turn; eight turns in 16 s (calibrated).
        alpha_crossover_hz: Gain crossover of the alpha loop (calibrated).
        beta_crossover_hz: Gain crossover of the beta loop (calibrated).
        roll_off_hz: Corner of the second-order low-pass in both compensators: below the plant's
            modes, far enough above crossover to leave 55 degrees of phase margin.
        roll_off_damping: Its damping ratio.
        control_period_s: Fixed rate of the controller, 1 kHz; four physics steps.
        focal_length_m: Effective focal length of the telescope (paper).
        detector_half_width_m: Half the side of a 10 mm detector; 5 mrad of range.
        detector_noise_m: Spot noise of one sample, standard deviation: 0.3 urad (calibrated).
        dac_bits: Resolution of the converters (paper).
        stroke_m: Strut stroke, full scale of the strut input (paper).
        current_limit_a: Coil current at 100 %: 80 N at 20 N/A.
    """

    duration_s: float = 16.0
    spiral_radius_urad: float = 100.0
    spiral_period_s: float = 2.0
    alpha_crossover_hz: float = 8.6
    beta_crossover_hz: float = 6.6
    roll_off_hz: float = 25.0
    roll_off_damping: float = 0.7
    control_period_s: float = 1e-3
    focal_length_m: float = 1.0
    detector_half_width_m: float = 5e-3
    detector_noise_m: float = 0.3e-6
    dac_bits: int = 16
    stroke_m: float = 0.000635
    current_limit_a: float = 4.0

    @property
    def crossover_hz(self) -> tuple[float, float]:
        """Gain crossovers of the (alpha, beta) loops."""
        return self.alpha_crossover_hz, self.beta_crossover_hz

    def time_s(self, seconds: float) -> Array:
        """Control ticks of the first `seconds` of the run, shape (N,)."""
        return np.arange(round(seconds / self.control_period_s)) * self.control_period_s

    def desired_rad(self, time_s: Array) -> Array:
        """The spiral at the given times, shape (N, 2)."""
        turns = self.duration_s / self.spiral_period_s
        return spiral(time_s, self.spiral_radius_urad * 1e-6, turns, self.duration_s)

    def detector(self) -> Detector:
        """The position-sensitive detector behind its telescope."""
        return Detector(
            focal_length_m=self.focal_length_m,
            half_width_m=self.detector_half_width_m,
            noise_m=self.detector_noise_m,
        )

    def amplifier(self) -> Amplifier:
        """One channel of converter and current amplifier, alike for all struts."""
        return Amplifier(
            full_scale_m=self.stroke_m,
            bits=self.dac_bits,
            current_limit_a=self.current_limit_a,
        )
