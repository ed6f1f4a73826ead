"""Coil gains from a commissioning flight: a model near enough to diagnose with."""

from dataclasses import replace

import numpy as np

from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import SoundMachine, failed_machine
from sim import Array

EXCITATION = (
    Dither(10e-6, 3.0, direction=(1.0, 0.0, 0.0, 1.0, 0.0, 0.0)),
    Dither(10e-6, 5.0, direction=(0.0, 1.0, 0.0, 0.0, 1.0, 0.0)),
    Dither(10e-6, 7.0, direction=(0.0, 0.0, 1.0, 0.0, 0.0, 1.0)),
    Dither(10e-6, 11.0, direction=(1.0, -1.0, 1.0, -1.0, 1.0, -1.0)),
)
"""Of a commissioning flight: every direction in the null space of J_m, each at its frequency.
Pointing alone shows two combinations of the six gains, and these the other four."""


def excitation(time_s: float) -> Array:
    """Desired strut displacements, shape (6,)."""
    return np.sum([dither.at(time_s) for dither in EXCITATION], axis=0)


def calibrated(sound: SoundMachine, C: Array, sent_m: Array, outputs: Array) -> SoundMachine:
    """The machine with each coil's gain as the outputs have it: linear least squares.

    Args:
        sound: As it was believed to be.
        C: Whitened outputs per state, shape (p, s).
        sent_m: Displacements commanded from each tick on, shape (N, 6).
        outputs: Whitened, as measured, shape (N, p).
    """
    machine = failed_machine(sound, ())
    shares, x = [], np.zeros((len(machine.A), sound.struts))
    for u in sent_m:
        shares.append(C @ x)
        x = machine.A @ x + machine.B * u
    by_coil = np.array(shares).reshape(outputs.size, sound.struts)
    gains = np.linalg.lstsq(by_coil, outputs.ravel(), rcond=None)[0]
    return replace(sound, linear=replace(sound.linear, B=sound.linear.B * gains))
