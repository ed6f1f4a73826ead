"""The machine on its bench, made once in each process however many runs it does."""

from functools import cache, lru_cache

import mujoco

from experiments.hexapod.controller import designed, nominal_plant
from experiments.hexapod.fault_tolerance import strut_and_payload_stiffness
from experiments.hexapod.testbed import Bench
from ftc.compensator import Compensator
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
def loops(bench: Bench) -> tuple[Compensator, Compensator]:
    """The (alpha, beta) compensators of a bench.

    Raises:
        sim.ModelError: They cannot be closed.
    """
    return designed(*_nominal(), bench)


@cache
def _nominal() -> tuple[LinearPlant, Array]:
    return nominal_plant(machine())
