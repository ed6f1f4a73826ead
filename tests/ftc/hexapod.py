"""Controllers and supervisor of the hexapod in loops without physics."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.controller import controller_for, nominal_loops
from fjh.rig.hexapod.fault_tolerance import HEAVE
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from ftc import Goal, Measurement, PrioritizedController, Supervisor
from ftc.control import DisplacementForm
from ftc.fdi import Diagnosis, Dither, Fault
from sim import NOMINAL

EQUAL = Goal(joint_weight=(1.0,) * 6)
DESIRED = np.array([6e-5, -3e-5])
DITHER = Dither(0.5e-6, 20.0, HEAVE)
LSB_PERCENT = 100 / 2**15
FADE = 100
"""Ticks of a handover."""


@cache
def jacobian() -> np.ndarray:
    return np.linalg.inv(hexapod(hexapod_rig().model).inverse_jacobian(NOMINAL))


def pointing_of(displacements: np.ndarray) -> np.ndarray:
    """Return the pointing angles (2,) by the linear model."""
    return jacobian()[MAJOR] @ displacements


def supervisor(dither: Dither | None = None) -> Supervisor:
    return _supervisor(dither)


@cache
def _supervisor(dither: Dither | None) -> Supervisor:
    return hexapod_rig().supervisor(dither)


@cache
def testbed() -> Testbed:
    bench, model = replace(TestbedConfig(), handover_s=0.1), hexapod_rig().model
    return Testbed(model, bench, nominal_loops(model, bench))


def controller(goal: Goal, form: DisplacementForm = "absolute") -> PrioritizedController[Any]:
    return controller_for(testbed(), goal, jacobian="constant", form=form)


def reading(output: np.ndarray) -> Measurement:
    return Measurement(output, np.zeros(6))


def steady(controller, state, ticks: int, secondary_reference=None):
    """Step a controller without an error, so that its demand is constant."""
    for _ in range(ticks):
        state = controller.step(state, DESIRED, reading(DESIRED), secondary_reference)
    return state


def pulled(controller, secondary_reference=None):
    """Displace the mechanism by an error that lasts a tenth of a second."""
    state = controller.start()
    for _ in range(100):
        state = controller.step(state, DESIRED, reading(0.7 * DESIRED), secondary_reference)
    return steady(controller, state, 200, secondary_reference)


@cache
def displaced_state(form: DisplacementForm = "absolute"):
    """Return the displaced state of the controller of the healthy machine."""
    return pulled(controller(EQUAL, form))


def diagnosis(fault: Fault, displacement_m: float = 0.0, *, confirmed: bool = False) -> Diagnosis:
    return Diagnosis(fault, (fault.kind,), 1.0, 1.0, displacement_m, 0, 0, 10, confirmed=confirmed)


@dataclass(frozen=True)
class Script:
    """Monitor that returns scripted diagnoses and counts the confirmed ones before it."""

    script: tuple[Diagnosis | None, ...]
    after: int = 0
    ticks: int = 1

    @property
    def nominal(self):
        return hexapod_rig().nominal

    def step(self, state, measured, commanded_m):
        return replace(state, ticks=state.ticks + 1, diagnosis=self.script[state.ticks])

    def with_diagnosis(self, state):
        return replace(self, after=self.after + 1), replace(state, diagnosis=None)


@cache
def far_out(dither: Dither | None):
    controller = supervisor(dither)
    return replace(controller.start(), controller=pulled(controller.first))


def supervised(*script: Diagnosis | None, dither: Dither | None = None) -> list[Any]:
    """Return the supervisor's states, from a displaced one, with scripted diagnoses."""
    states = [replace(far_out(dither), monitor=Script(script))]
    for tick in range(len(script)):  # exactly repeated readings would count as stuck
        seen = reading(DESIRED * (1 + 1e-9 * (tick % 2)))
        states.append(supervisor(dither).step(states[-1], DESIRED, seen))
    return states[1:]
