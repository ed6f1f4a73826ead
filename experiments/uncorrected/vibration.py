"""Vibration: the damping of the pointing modes, and the motion of the floor."""

import copy

import mujoco
import numpy as np

from experiments.hexapod.columns import COLUMNS
from experiments.hexapod.controller import StrutMapping
from experiments.hexapod.testbed import Bench
from sim import Array, Plant, hexapod, linearize

W_A = COLUMNS[0].goal
"""All struts sound and weighted alike."""

THIRD_OCTAVE = 2 ** (1 / 6) - 2 ** (-1 / 6)
"""Width of a one-third-octave band over its centre frequency."""

FLOOR_BAND_HZ = (8.0, 80.0)
"""Where the generic vibration criteria are constant in velocity."""


def damped(model: mujoco.MjModel, ratio: float) -> mujoco.MjModel:
    """The machine with all suspension dampers scaled to a damping ratio of the pointing modes.

    Raises:
        ValueError: The ratio is not between 0 and 1.
    """
    if not 0 < ratio < 1:
        raise ValueError(f"ratio must lie between 0 and 1, got {ratio}")
    altered = copy.copy(model)
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    altered.dof_damping[dofs] *= ratio / pointing_mode(model)[1]
    return altered


def pointing_mode(model: mujoco.MjModel) -> tuple[float, float]:
    """Frequency [Hz] and damping ratio of the sound machine's mode that alpha commands move most.

    The largest residue of the transfer from commanded to true alpha.
    """
    sound = Plant(model)
    linear = linearize(sound.model, sound.data)
    drive = linear.B @ StrutMapping(hexapod(model), W_A, "constant").pointing_gain()[:, 0]
    poles, shapes = np.linalg.eig(linear.A)
    residues = (linear.C_twist[0] @ shapes) * np.linalg.solve(shapes, drive.astype(complex))
    pole = poles[np.argmax(np.abs(residues))]
    return float(abs(pole) / (2 * np.pi)), float(-pole.real / abs(pole))


def floor_acceleration(bench: Bench, velocity_m_per_s: float, seed: int) -> Array:
    """Acceleration of a floor that meets a vibration criterion exactly, shape (N, 3), [m]/[s^2].

    The RMS velocity in every one-third-octave band from 8 to 80 Hz is the criterion's, in each of
    the three axes, independently: S_v(f) = v^2 / (0.2316 f). Criteria: ISO 2631-2 (workshop 800,
    office 400, residence 200 um/s) and VC-A 50 to VC-E 3 um/s (Amick, Gertsenfeld, Gendreau and
    Gordon, Proc. SPIE 5933, 2005).

    Args:
        bench: Length and rate.
        velocity_m_per_s: Of the criterion.
        seed: Of the phases; the detector's noise has another stream.
    """
    time_s = bench.time_s(bench.duration_s)
    frequency = np.fft.rfftfreq(len(time_s), bench.control_period_s)
    low, high = FLOOR_BAND_HZ[0] * 2 ** (-1 / 6), FLOOR_BAND_HZ[1] * 2 ** (1 / 6)
    inside = (frequency >= low) & (frequency <= high)
    density = np.zeros(len(frequency))
    density[inside] = velocity_m_per_s**2 / (THIRD_OCTAVE * frequency[inside])
    density *= (2 * np.pi * frequency) ** 2
    phases = np.random.default_rng([seed, 1]).uniform(0, 2 * np.pi, (3, len(frequency)))
    # A line of variance S df has the amplitude sqrt(2 S df); irfft halves and divides by N.
    line = np.sqrt(2 * density * frequency[1]) * len(time_s) / 2
    return np.fft.irfft(line * np.exp(1j * phases), len(time_s)).T
