"""Hexapod for the control loop: settled plant, detector, gauges, amplifiers, floor."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import mujoco
import numpy as np

import argument_checks as check
from fjh.rig.hexapod.mismatch import ALL, SIZES, Differences, sampled_differences
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.rig.mismatch import EXACT, Mismatch, without
from fjh.rig.run import zero_padded
from sim import Array, Bench, Failure, Plant, Pose
from sim.plant import Reading

THIRD_OCTAVE = 2 ** (1 / 6) - 2 ** (-1 / 6)
"""Width of a one-third-octave band over its centre frequency."""

FLOOR_BAND_HZ = (8.0, 80.0)
"""Frequency band [Hz] in which the generic vibration criteria have a constant velocity."""


@dataclass(frozen=True, eq=False)
class HexapodMachine:
    """Simulated hexapod whose plant may differ from its controllers' model.

    Attributes:
        testbed: Model of the controllers, and constants of the testbed.
        differs: Differences of the plant; by default none.
        start_m: Strut displacements (6,) at the start of a run; None: zero. A strut that locks at
            time 0 is then off center.
        floor_m_per_s2: Acceleration of the floor in base axes at each tick of the path, shape (N,
            3), zero in a lead-in; None: zero.
    """

    everything: ClassVar[Mismatch] = ALL
    unknown: ClassVar[tuple[str, ...]] = without(SIZES)

    testbed: Testbed
    differs: Differences = field(default_factory=Differences)
    start_m: Array | None = None
    floor_m_per_s2: Array | None = None

    def with_mismatch(self, sizes: Mismatch, seed: int) -> "HexapodMachine":
        """Return the same machine with a plant that is sampled with these sizes and seed."""
        if sizes == EXACT:
            return replace(self, differs=Differences())
        return replace(self, differs=sampled_differences(self.testbed.model, sizes, seed))

    @property
    def model(self) -> mujoco.MjModel:
        """Model of the plant itself."""
        model = self.differs.model
        return self.testbed.model if model is None else model

    @cached_property
    def equilibrium(self) -> mujoco.MjData:
        """State of the settled machine, computed once for all runs.

        Raises:
            sim.SimulationDiverged: The simulated state became non-finite.
        """
        plant = Plant(self.model)
        plant.settle(self.testbed.bench.settling_s, self.start_m)
        return plant.data

    def bench(
        self, time_s: Array, failures: Sequence[Failure], seed: int, events: object = None
    ) -> Bench:
        """Return the settled machine for times (N,), with sensor noise of this seed."""
        bench, ticks, plant = self.testbed.bench, len(time_s), Plant(self.model)
        mujoco.mj_copyData(plant.data, plant.model, self.equilibrium)
        floors = [self.floor(ticks), self._given_floor(time_s)]
        moves = [motion for motion in floors if motion is not None]
        return Bench(
            plant,
            HexapodSensors(bench, seed, self.zero_rad(ticks)),
            time_s=time_s,
            period_s=bench.control_period_s,
            failures=failures,
            drives=self._drives(),
            floor_m_per_s2=np.sum(moves, axis=0) if moves else None,
            delay_ticks=self.differs.delay_ticks,
            hysteresis=self.differs.hysteresis,
            log_qpos=True,
            events=events,
        )

    def floor(self, ticks: int) -> Array | None:
        """Return the sampled acceleration of the floor at each tick, (N, 3); None: at rest."""
        differs, period_s = self.differs, self.testbed.bench.control_period_s
        if not differs.floor_m_per_s:
            return None
        return floor_acceleration(ticks, period_s, differs.floor_m_per_s, differs.floor_seed)

    def _given_floor(self, time_s: Array) -> Array | None:
        """Return the given acceleration of the floor at times (N,), with zeros in a lead-in."""
        if self.floor_m_per_s2 is None:
            return None
        lead_in = int((time_s == time_s[0]).sum()) - 1
        ticks = len(time_s) - lead_in
        return zero_padded(lead_in, check.array("floor_m_per_s2", self.floor_m_per_s2, ticks, 3))

    def zero_rad(self, ticks: int) -> Array:
        """Return the drift of the detector's zero in (alpha, beta) at each tick, shape (N, 2)."""
        period_s = self.testbed.bench.control_period_s
        return np.outer(np.arange(ticks) * period_s, self.differs.drift_rad_per_s)

    def _drives(self) -> Callable[[Array], Array]:
        """Return a function from inputs (n,) to displacements (n,), called once per tick.

        A :class:`sim.Plant` compensates its own springs and gains; the factor relative to the
        nominal ones is restored here.
        """
        nominal, amplifiers = self.testbed.model, self.testbed.amplifier().displacements
        if self.model is nominal:  # a model that may have servos without springs
            return amplifiers
        reached = _per_control(self.model) / _per_control(nominal)
        drift = np.array(self.differs.gain_drift_per_s) * self.testbed.bench.control_period_s
        return DriftingDrives(amplifiers, reached, drift)


class DriftingDrives:
    """Function from inputs to displacements, whose gains drift with each call."""

    def __init__(self, amplifiers: Callable[[Array], Array], gains: Array, per_tick: Array) -> None:
        """Take the drives, their initial gains (n,), and the relative drift per tick (n,)."""
        self._amplifiers, self._gains, self._per_tick, self._ticks = amplifiers, gains, per_tick, 0

    def __call__(self, input_percent: Array) -> Array:
        """Return the displacements (n,) with the gains of this tick."""
        gain = self._gains * (1 + self._per_tick * self._ticks)
        self._ticks += 1
        return self._amplifiers(input_percent) * gain


def _per_control(model: mujoco.MjModel) -> Array:
    """Return the displacement [m] of each suspension per control of its coil, shape (6,)."""
    return model.actuator_gainprm[:, 0] / model.jnt_stiffness[model.actuator_trnid[:, 0]]


class HexapodSensors:
    """Sensors of the hexapod: the detector, with a drifting zero (N, 2), and the strut gauges."""

    def __init__(self, bench: TestbedConfig, seed: int, zero_rad: Array) -> None:
        """Prepare for the first tick, with noise of this seed and the detector's zeros (N, 2)."""
        self._detector, self._gauges = bench.detector(), bench.strut_sensors()
        # Separate generators: reading the gauges must not change the detector's noise.
        self._detector_rng = np.random.default_rng(seed)
        self._gauge_rng = np.random.default_rng([seed, 1])
        self._zero_rad, self._tick = zero_rad, 0

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """Return pointing and strut displacements with noise."""
        zero_rad, self._tick = self._zero_rad[self._tick], self._tick + 1
        return Reading(
            output=self._detector.read(pose.rotation, self._detector_rng) + zero_rad,
            displacement=self._gauges.read(displacements, self._gauge_rng),
        )


def detector_noise_rad(bench: TestbedConfig, seed: int, ticks: int) -> Array:
    """Return the noise of a run's detector in (alpha, beta) at each tick, shape (N, 2)."""
    spot_m = bench.detector_noise_m * np.random.default_rng(seed).standard_normal((ticks, 2))
    return spot_m[:, ::-1] * np.array([1, -1]) / bench.focal_length_m


def floor_acceleration(
    ticks: int, period_s: float, velocity_m_per_s: float, seed: Sequence[int]
) -> Array:
    """Return the acceleration of a floor at a vibration criterion, shape (N, 3), [m]/[s^2].

    The RMS velocity in every one-third-octave band from 8 to 80 Hz is that of the criterion in each
    of the three axes, independently: S_v(f) = v^2 / (0.2316 f). Criteria: ISO 2631-2 (workshop 800,
    office 400, residence 200 um/s) and VC-A 50 to VC-E 3 um/s (Amick, Gertsenfeld, Gendreau and
    Gordon, Proc. SPIE 5933, 2005). The seed determines the phases.
    """
    frequency = np.fft.rfftfreq(ticks, period_s)
    low, high = FLOOR_BAND_HZ[0] * 2 ** (-1 / 6), FLOOR_BAND_HZ[1] * 2 ** (1 / 6)
    inside = (frequency >= low) & (frequency <= high)
    density = np.zeros(len(frequency))
    density[inside] = velocity_m_per_s**2 / (THIRD_OCTAVE * frequency[inside])
    density *= (2 * np.pi * frequency) ** 2
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, (3, len(frequency)))
    # A line of variance S df has the amplitude sqrt(2 S df); irfft halves and divides by N.
    line = np.sqrt(2 * density / (ticks * period_s)) * ticks / 2
    return np.fft.irfft(line * np.exp(1j * phases), ticks).T
