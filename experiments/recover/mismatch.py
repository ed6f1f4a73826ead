"""A machine that is not quite the model: how exactly the diagnosis must know it."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.hexapod.compensator import Loop
from experiments.hexapod.testbed import Bench
from experiments.recover.cases import DITHER, Case
from experiments.recover.false_alarms import expected_outputs, healthy_flight
from experiments.recover.flights import Found, find
from ftc.fdi.calibration import calibrated, excitation
from ftc.fdi.config import RULES
from ftc.fdi.fault_model import SoundMachine, sound_machine
from ftc.fdi.residual_test import chart
from ftc.fdi.sensing import sensing

ERRORS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
"""Of each coil's gain, relative, standard deviation."""


@dataclass(frozen=True)
class Mismatch:
    """Flights of one machine that differs from the model.

    Attributes:
        error: Of its coils' gains, relative.
        calibrated: Whether a commissioning flight has corrected the gains.
        healthy_alarm: Whether a flight on which nothing fails raises an alarm.
        found: What was made of failures.
    """

    error: float
    calibrated: bool
    healthy_alarm: bool
    found: list[Found]


def mismatched(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    error: float,
    cases: list[Case],
) -> list[Mismatch]:
    """Fly a machine whose coils differ; diagnosed as if they were alike, and once calibrated."""
    machine = copy.copy(model)
    rng = np.random.default_rng(cases[0].seed)
    machine.actuator_gainprm[:, 0] *= 1 + error * rng.standard_normal(model.nu)
    nominal = sound_machine(model, bench)
    C = sensing(nominal, bench, strut_sensors=False).C
    watch = chart(len(C), RULES.false_alarms_per_hour, bench.control_period_s)
    ways = (excitation, cases[0].dither(DITHER).at)
    commissioning, spiral = (
        healthy_flight(model, bench, loops, way, cases[0].seed, bench.duration_s, flown=machine)
        for way in ways
    )
    corrected = calibrated(nominal, C, commissioning.sent_m, commissioning.measured)

    def examined(sound: SoundMachine) -> Mismatch:
        found = [
            find(model, bench, loops, case, DITHER, False, flown=machine, sound=sound)[1]
            for case in cases
        ]
        residuals = spiral.measured - expected_outputs(sound, spiral.sent_m, C)
        return Mismatch(error, sound is corrected, bool(watch.alarms(residuals).any()), found)

    return [examined(nominal), examined(corrected)]
