"""Constants of the testbed, most of which the paper does not give, and the testbed."""

import copy
from dataclasses import dataclass, replace

import mujoco
import numpy as np

import argument_checks as check
from fjh.rig.hexapod.amplifier import Amplifier
from fjh.rig.hexapod.detector import Detector
from fjh.rig.hexapod.strut_sensors import StrutSensors
from fjh.rig.hexapod.trajectory import spiral
from fjh.rig.within import check_within
from ftc.control import Compensator
from sim import Array

LIMITS: dict[str, tuple[float, float]] = {
    "duration_s": (1e-3, 3600.0),
    "quick_duration_s": (1e-3, 3600.0),
    "spiral_radius_urad": (1e-3, 1e6),
    "spiral_period_s": (1e-2, 3600.0),
    "spiral_exponent": (0.1, 1.0),
    "spiral_start_deg": (-360.0, 360.0),
    "demand_limit_urad": (1e-3, 1e6),
    "alpha_crossover_hz": (1e-3, 1e3),
    "beta_crossover_hz": (1e-3, 1e3),
    "roll_off_hz": (1e-2, 1e4),
    "roll_off_damping": (1e-2, 100.0),
    "control_period_s": (1e-4, 0.1),
    "focal_length_m": (1e-3, 1e3),
    "detector_half_width_m": (1e-6, 100.0),
    "detector_noise_m": (0.0, 0.1),
    "dac_bits": (2, 32),
    "dac_full_input_a": (1e-6, 1e4),
    "amplifier_limit_a": (1e-6, 1e4),
    "coil_newton_per_a": (1e-3, 1e5),
    "settling_s": (1e-3, 3600.0),
    "strut_sensor_noise_m": (0.0, 0.1),
    "handover_s": (0.0, 3600.0),
}
"""Smallest and largest accepted value of each constant."""


@dataclass(frozen=True)
class TestbedConfig:
    """Constants around the plant; *calibrated* ones are fitted to Table I, columns W_a to W_e.

    Attributes:
        duration_s: Length of a run (paper).
        quick_duration_s: Length of a run with --quick.
        spiral_radius_urad: Final radius of the spiral (calibrated).
        spiral_period_s: Time of one turn; eight turns in 16 s (calibrated).
        spiral_exponent: Exponent of radius and angle, (t / duration)^exponent: 1 is a constant
            angular rate, 1/2 a constant speed along the spiral.
        spiral_start_deg: Initial direction of the spiral, an angle from alpha towards beta.
        spiral_direction: 1 turns from alpha towards beta, -1 the other way.
        alpha_crossover_hz: Gain crossover of the alpha loop (calibrated).
        beta_crossover_hz: Gain crossover of the beta loop (calibrated).
        roll_off_hz: Corner of the second-order low-pass in both compensators: below the plant's
            modes, and far enough above crossover for 57 degrees of phase margin.
        roll_off_damping: Damping ratio of this low-pass.
        demand_limit_urad: Largest pointing, each of alpha and beta, that the compensators may
            demand of the mapping; None is no limit.
        anti_windup: Whether a compensator at its limit stops integrating.
        control_period_s: Fixed rate of the controller, 1 kHz; eight physics steps.
        focal_length_m: Effective focal length of the telescope (paper).
        detector_half_width_m: Half the side of a 10 mm detector; 5 mrad of range.
        detector_noise_m: Standard deviation of the spot in one sample: 0.3 urad (calibrated).
        dac_bits: Resolution of the converters (paper).
        dac_full_input_a: Coil current commanded at 100 % input: 80.01 N, full stroke.
        amplifier_limit_a: Current at which the amplifier saturates, equal to `dac_full_input_a`.
        coil_newton_per_a: Motor constant.
        settling_s: Time at rest before a run, in which the sag settles: fifteen periods of the
            slowest mode.
        strut_sensor_noise_m: Standard deviation of one sample of a strut's eddy-current gauge.
        handover_s: Time in which the secondary motion of a previous mapping fades: long compared
            with the suspension modes, short compared with the spiral.

    Raises:
        ValueError: A constant is no number or outside its `LIMITS`, or `spiral_direction` is not 1
            or -1.
        TypeError: `anti_windup` is no boolean.
    """

    duration_s: float = 16.0
    quick_duration_s: float = 4.0
    spiral_radius_urad: float = 100.0
    spiral_period_s: float = 2.0
    spiral_exponent: float = 1.0
    spiral_start_deg: float = 0.0
    spiral_direction: int = 1
    alpha_crossover_hz: float = 8.6
    beta_crossover_hz: float = 6.6
    roll_off_hz: float = 25.0
    roll_off_damping: float = 0.7
    demand_limit_urad: float | None = None
    anti_windup: bool = False
    control_period_s: float = 1e-3
    focal_length_m: float = 1.0
    detector_half_width_m: float = 5e-3
    detector_noise_m: float = 0.3e-6
    dac_bits: int = 16
    dac_full_input_a: float = 4.0005
    amplifier_limit_a: float = 4.0005
    coil_newton_per_a: float = 20.0
    settling_s: float = 0.5
    strut_sensor_noise_m: float = 50e-9
    handover_s: float = 0.5

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if name != "demand_limit_urad" or value is not None:
                check_within(name, value, low, high)
        if check.number("spiral_direction", self.spiral_direction) not in (1, -1):
            raise ValueError(f"spiral_direction must be 1 or -1, got {self.spiral_direction}")
        check.flag("anti_windup", self.anti_windup)

    @property
    def crossover_hz(self) -> tuple[float, float]:
        """Gain crossovers of the (alpha, beta) loops."""
        return self.alpha_crossover_hz, self.beta_crossover_hz

    def time_s(self, seconds: float) -> Array:
        """Return the times of the control ticks of the first `seconds` of a run, shape (N,).

        Raises:
            ValueError: The time is less than one tick.
        """
        if not seconds >= self.control_period_s:
            raise ValueError(f"a run lasts at least one control period, got {seconds} s")
        return np.arange(round(seconds / self.control_period_s)) * self.control_period_s

    def desired_rad(self, time_s: Array) -> Array:
        """Return the desired (alpha, beta) at times (N,) [s], shape (N, 2), [rad]."""
        return spiral(
            time_s,
            self.spiral_radius_urad * 1e-6,
            self.spiral_direction * self.duration_s / self.spiral_period_s,
            self.duration_s,
            exponent=self.spiral_exponent,
            start_rad=np.radians(self.spiral_start_deg),
        )

    def spiral_rad(self, duration_s: float | None = None, begin_s: float = 0.0) -> Array:
        """Return the spiral at each tick from `begin_s` on, (N, 2), [rad]; None: `duration_s`."""
        duration_s = self.duration_s if duration_s is None else duration_s
        return self.desired_rad(begin_s + self.time_s(duration_s))

    @property
    def demand_limit_rad(self) -> float:
        """Limit of the compensators' output [rad]; infinite without limit."""
        return np.inf if self.demand_limit_urad is None else self.demand_limit_urad * 1e-6

    def detector(self) -> Detector:
        """Return the position-sensitive detector behind its telescope."""
        return Detector(self.focal_length_m, self.detector_half_width_m, self.detector_noise_m)

    def strut_sensors(self) -> StrutSensors:
        """Return the displacement gauges of the struts."""
        return StrutSensors(noise_m=self.strut_sensor_noise_m)

    def amplifier(self, newton_per_m: float) -> Amplifier:
        """Return one strut's converter, amplifier and coil for a coil gain of the model."""
        return Amplifier(
            bits=self.dac_bits,
            full_input_a=self.dac_full_input_a,
            limit_a=self.amplifier_limit_a,
            newton_per_a=self.coil_newton_per_a,
            newton_per_m=newton_per_m,
        )


@dataclass(frozen=True)
class Testbed:
    """Machine, with its constants and compensators, that many runs share.

    Attributes:
        model: Model for the controllers, which copy it.
        bench: Constants of the testbed.
        loops: The (alpha, beta) compensators, see
            :func:`fjh.rig.hexapod.controller.nominal_loops`.
        stiffness: Stiffness of the struts and the payload, shape (12, 12), for goals with free
            struts; see :func:`fjh.rig.hexapod.fault_tolerance.strut_and_payload_stiffness`.
    """

    __test__ = False  # pytest must not collect this class

    model: mujoco.MjModel
    bench: TestbedConfig
    loops: tuple[Compensator, Compensator]
    stiffness: Array | None = None

    def scaled(self, *, stroke: float = 1.0, spiral: float = 1.0) -> "Testbed":
        """Return a machine with scaled stroke (and coils, amplifiers) and scaled spiral.

        The detector covers the spiral; its noise and the crossovers are unchanged.
        """
        model = copy.copy(self.model)
        model.jnt_range[model.actuator_trnid[:, 0]] *= stroke
        model.actuator_forcerange[:] *= stroke
        model.actuator_ctrlrange[:] *= stroke
        bench = replace(
            self.bench,
            spiral_radius_urad=self.bench.spiral_radius_urad * spiral,
            detector_half_width_m=self.bench.detector_half_width_m * spiral,
            dac_full_input_a=self.bench.dac_full_input_a * stroke,
            amplifier_limit_a=self.bench.amplifier_limit_a * stroke,
        )
        return replace(self, model=model, bench=bench)

    def amplifier(self) -> Amplifier:
        """Return one strut's converter, amplifier and coil, with the gain of the model's coils."""
        return self.bench.amplifier(newton_per_m=float(self.model.actuator_gainprm[0, 0]))
