"""What the figures show: a machine, its sampled control loops and its failure conditions."""

from dataclasses import dataclass
from pathlib import Path

import control
import mujoco
import numpy as np

from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.controller import ANGLES, Loop, design, nominal_plant, sampled
from experiments.rig.hexapod.fault_tolerance import elastic_system
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.study import OnProgress
from prioritized import FailureAtlas, failure_atlas
from sim import Array, Hexapod, LinearPlant, hexapod, load_model, model_sha256


@dataclass(frozen=True)
class OpenLoop:
    """Frequency response of one pointing loop as it runs: sampled, behind the zero-order hold."""

    angle: str
    loop: Loop
    frequency_hz: Array  # (F,), from 0.1 Hz to four fifths of the Nyquist frequency
    plant: Array  # complex response of the pointing angle to its commanded value, (F,)
    open_loop: Array  # the same behind the compensator


@dataclass(frozen=True)
class Portrait:
    """One machine on one bench."""

    seed: int
    model: mujoco.MjModel
    model_sha256: str
    geometry: Hexapod
    bench: TestbedConfig
    modes_hz: Array  # of the sound plant, ascending
    loops: tuple[OpenLoop, OpenLoop]  # alpha, beta
    atlas: FailureAtlas  # rigid and elastic, all 3^6 conditions, major task (alpha, beta)


def run_figures(
    *, seed: int, quick: bool, on_progress: OnProgress, model: Path | None = None
) -> Portrait:
    """Everything that is drawn of a machine file; None is `models/fjh.xml`."""
    return portray(model, TestbedConfig(), seed)


def portray(machine_file: Path | None, bench: TestbedConfig, seed: int) -> Portrait:
    """Design the loops and classify every failure condition; the seed is only noted.

    Raises:
        sim.ModelError: A missing, broken or incomplete machine file, or one that cannot point.
    """
    model = load_model(machine_file)
    plant, pointing = nominal_plant(model)
    alpha, beta = design(plant, pointing, bench)
    poles = np.linalg.eigvals(plant.A)
    return Portrait(
        seed=seed,
        model=model,
        model_sha256=model_sha256(machine_file),
        geometry=hexapod(model),
        bench=bench,
        modes_hz=np.sort(abs(poles[poles.imag > 0])) / (2 * np.pi),
        loops=(_opened(plant, pointing, alpha, 0), _opened(plant, pointing, beta, 1)),
        atlas=failure_atlas(elastic_system(model), MAJOR),
    )


def _opened(plant: LinearPlant, pointing: Array, loop: Loop, row: int) -> OpenLoop:
    frequency_hz = np.geomspace(0.1, 0.4 / loop.period_s, 1500)
    P = sampled(plant, pointing, loop.period_s)[row, row]

    def response(system: control.StateSpace) -> Array:
        return control.frequency_response(system, 2 * np.pi * frequency_hz).complex

    behind = response(P) * response(loop.discrete)
    return OpenLoop(ANGLES[row], loop, frequency_hz, response(P), behind)
