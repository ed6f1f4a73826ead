"""A detector off the focus, which takes translations of the payload for angles: beam walk."""

import control
import mujoco
import numpy as np

from experiments.hexapod.compensator import Loop, sampled
from experiments.hexapod.goal import MAJOR
from experiments.hexapod.mapping import StrutMapping
from experiments.hexapod.metrics import rms
from experiments.hexapod.prediction import detector_noise_rad
from experiments.hexapod.testbed import Bench
from experiments.uncorrected.candidate import COLUMNS
from experiments.uncorrected.candidates import BENCH
from sim import Array, failed_plant, hexapod, linearize


def offsets_m(*, quick: bool) -> Array:
    """Of the detector behind the focal plane; -1 m, at the telescope itself, is no telescope."""
    return np.linspace(-1.0, 1.0, 3 if quick else 41)


def beam_walk_urad(
    model: mujoco.MjModel, bench: Bench, loops: tuple[Loop, Loop], offset_m: float, seed: int
) -> Array:
    """RMS errors of the linear loops, shape (4, 2, 2), [urad]; infinite where a loop is unstable.

    A thin lens of focal length f puts a ray of height h and slope theta at f theta + d (theta - h /
    f), d behind its focal plane. The factor f + d of the angle is calibrated away; what is left is
    an angle read for a translation t of the payload, of d t / f^2 but for that factor.

    Args:
        model: The hexapod.
        bench: Spiral, noise, focal length.
        loops: Compensators.
        offset_m: d.
        seed: Of the detector noise.

    Returns:
        Each of COLUMNS; desired minus true and desired minus read; alpha and beta.
    """
    walk = offset_m / bench.focal_length_m**2
    reading = np.eye(6)[MAJOR]
    reading[:, 3:5] = walk * np.array([[0.0, -1.0], [1.0, 0.0]])
    time_s = bench.time_s(bench.duration_s)
    desired = bench.desired_rad(time_s)
    noise = detector_noise_rad(bench, seed, len(time_s))
    compensators = control.append(*(loop.discrete for loop in loops))
    errors = np.full((len(COLUMNS), 2, 2), np.inf)
    for k, name in enumerate(COLUMNS):
        run = BENCH.run(name, seed)
        gain = StrutMapping(hexapod(model), run["goal"], "constant").pointing_gain()
        plant = failed_plant(model, run["failures"])
        L = sampled(linearize(plant.model, plant.data), gain, bench.control_period_s) * compensators
        closed = control.ss(
            L.A - L.B @ reading @ L.C, L.B, np.vstack([L.C[MAJOR], reading @ L.C]), 0, L.dt
        )
        if np.abs(closed.poles()).max() >= 1:
            continue
        outputs = control.forced_response(closed, time_s, (desired - noise).T).outputs
        true, read = np.split(np.asarray(outputs).T, 2, axis=1)
        errors[k] = 1e6 * np.array([rms(desired - true), rms(desired - read - noise)])
    return errors
