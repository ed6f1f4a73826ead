"""A floor that vibrates as a generic criterion allows."""

from collections.abc import Sequence

import numpy as np

from sim import Array

THIRD_OCTAVE = 2 ** (1 / 6) - 2 ** (-1 / 6)
"""Width of a one-third-octave band over its centre frequency."""

FLOOR_BAND_HZ = (8.0, 80.0)
"""Where the generic vibration criteria are constant in velocity."""


def floor_acceleration(
    ticks: int, period_s: float, velocity_m_per_s: float, seed: Sequence[int]
) -> Array:
    """Acceleration of a floor that meets a vibration criterion exactly, shape (N, 3), [m]/[s^2].

    The RMS velocity in every one-third-octave band from 8 to 80 Hz is the criterion's, in each of
    the three axes, independently: S_v(f) = v^2 / (0.2316 f). Criteria: ISO 2631-2 (workshop 800,
    office 400, residence 200 um/s) and VC-A 50 to VC-E 3 um/s (Amick, Gertsenfeld, Gendreau and
    Gordon, Proc. SPIE 5933, 2005). The seed is of the phases.
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
