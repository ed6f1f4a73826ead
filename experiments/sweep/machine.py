"""The machine on its bench, made once in each process however many runs it does."""

from functools import cache, lru_cache

import mujoco
import numpy as np

from experiments.hexapod.compensator import Loop, compensators
from experiments.hexapod.simulation import nominal_plant
from experiments.hexapod.springs import strut_and_payload_stiffness
from experiments.hexapod.testbed import Bench
from sim import Array, LinearPlant, load_model


@cache
def machine() -> mujoco.MjModel:
    """The hexapod; plants copy it."""
    return load_model()


@cache
def stiffness() -> Array:
    """Where free struts go, (12, 12)."""
    return strut_and_payload_stiffness(machine())


@lru_cache(maxsize=64)
def loops(bench: Bench) -> tuple[Loop, Loop]:
    """The (alpha, beta) compensators of a bench; their margins, which take a second, are NaN.

    Raises:
        sim.ModelError: They cannot be closed.
    """
    plant, pointing = _nominal()
    alpha, beta = (
        Loop(
            numerator=np.empty(0),
            denominator=np.empty(0),
            A=each.A,
            B=each.B,
            C=each.C,
            D=each.D,
            period_s=bench.control_period_s,
            crossover_hz=np.nan,
            gain_margin_db=np.nan,
            phase_margin_deg=np.nan,
            phase_crossover_hz=np.nan,
        )
        for each in compensators(plant, pointing, bench)
    )
    return alpha, beta


@cache
def _nominal() -> tuple[LinearPlant, Array]:
    return nominal_plant(machine())
