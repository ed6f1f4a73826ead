"""What a diagnosis is made from: outputs of the linear machine, in units of their noise."""

from dataclasses import dataclass

import numpy as np

from experiments.hexapod.goal import MAJOR
from experiments.hexapod.testbed import Bench
from ftc.controller import Sensed
from ftc.fdi.fault_model import SoundMachine
from sim import Array


@dataclass(frozen=True)
class Sensing:
    """Outputs divided by the standard deviation of their noise.

    Attributes:
        C: Outputs per state of the sound machine, shape (p, s).
        strut_sensors: Whether the struts' gauges are among them, after (alpha, beta).
        noise: Standard deviations, shape (p,), [rad] and [m].
    """

    C: Array
    strut_sensors: bool
    noise: Array

    def whitened(self, sensed: Sensed) -> Array:
        """One sample of the outputs, shape (p,), with noise of unit variance."""
        struts_m = sensed.strut_m if self.strut_sensors else np.zeros(0)
        return np.concatenate([sensed.pointing_rad, struts_m]) / self.noise


def sensing(sound: SoundMachine, bench: Bench, strut_sensors: bool) -> Sensing:
    """The detector, and with the switch the gauges beside the struts."""
    linear = sound.linear
    detector = np.full(2, bench.detector_noise_m / bench.focal_length_m)
    rows, noise = [linear.C_twist[MAJOR]], [detector]
    if strut_sensors:
        rows.append(linear.C_active)
        noise.append(np.full(len(linear.C_active), bench.strut_sensor_noise_m))
    sigma = np.concatenate(noise)
    return Sensing(np.vstack(rows) / sigma[:, None], strut_sensors, sigma)
