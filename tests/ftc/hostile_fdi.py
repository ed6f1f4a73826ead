"""What is attacked of the diagnosis and of the design: functions of `docs/api/ftc.md`."""

from typing import Any

import control
import numpy as np

from ftc import SensorCheck
from ftc.control import circle_margin, sensitivity_peak
from ftc.control.anti_windup import tracking_gain
from ftc.fdi import DEFAULT_CONFIG, Diagnosis, Dither, Fault, monitor, static_share
from ftc.fdi.diagnosis import FdiConfig
from ftc.fdi.fault_model import resting_displacements, static_gain
from tests.ftc.hostile_loop import FAULTY, SWING
from tests.ftc.hostile_machine import (
    LOOP,
    M1,
    NOMINAL,
    PERIOD_S,
    PILOT,
    PLANT,
    STILL,
    WATCH,
    N,
)
from tests.hostile import Target

GAINED = control.ss(PLANT.A, PLANT.B @ PILOT.mapping.major_gain(), PLANT.C, 0)
SAMPLED = control.c2d(GAINED, PERIOD_S)
LOOPED = SAMPLED * control.append(LOOP.discrete, LOOP.discrete)
DISCRETE = control.c2d(PLANT, PERIOD_S)
ENOUGH = 3 * WATCH.ticks
CONFIG = {name: value for name, value in vars(DEFAULT_CONFIG).items() if name != "uncertainty"}


def watched(config: FdiConfig) -> Any:
    """What a monitor knows after some samples of zeros."""
    watch = monitor(NOMINAL, config=config)
    state = watch.start()
    for _ in range(min(3 * watch.ticks, 100)):
        state = watch.step(state, np.zeros(M1), STILL)
    return state.observer.residual, state.observer.parameters.mean, state.last_commanded


def sampled(**given: Any) -> Any:
    """What a monitor knows after steps with these."""
    state = given.pop("state")
    for _ in range(ENOUGH):
        state = WATCH.step(state, **given)
    return state.observer.residual, state.last_commanded


def checked(**given: Any) -> Any:
    """What sensors say after a reading."""
    check = SensorCheck(**given)
    return check.step(check.start(2), None, STILL).held_ticks


TARGETS = {
    "sensitivity_peak": Target(sensitivity_peak, {"L": LOOPED}),
    "tracking_gain": Target(tracking_gain, {"channel": LOOP, "slowness": 1.0}),
    "circle_margin": Target(
        circle_margin, {"plant": SAMPLED, "compensators": [LOOP] * M1, "anti_windup": True}
    ),
    "static_gain": Target(static_gain, {"nominal": NOMINAL, "faults": FAULTY}),
    "static_share": Target(static_share, {"nominal": NOMINAL, "fault": FAULTY[0]}),
    "resting_displacements": Target(
        resting_displacements, {"nominal": NOMINAL, "faults": FAULTY, "commanded": STILL}
    ),
    "FdiConfig": Target(lambda **a: watched(FdiConfig(**a)), CONFIG | {"dither_hz": 20.0}),
    "FdiConfig of a model": Target(
        lambda uncertainty: watched(FdiConfig(uncertainty)),
        {"uncertainty": DEFAULT_CONFIG.uncertainty},
    ),
    "Monitor.step": Target(
        sampled, {"state": WATCH.start(), "measured": np.zeros(M1), "commanded": STILL}
    ),
    "Diagnosis.told": Target(
        lambda **a: Diagnosis.told(**a), {"fault": Fault(0, "locked"), "displacement": 1e-3}
    ),
    "Dither": Target(
        lambda **a: Dither(**a).at(0.1),
        {"amplitude": 1.0, "frequency_hz": 20.0, "direction": np.ones(N), "offset": np.ones(N)},
    ),
    "Dither.at": Target(SWING.at, {"time_s": 0.1}),
    "SensorCheck": Target(
        checked,
        {"period_s": PERIOD_S, "limits": np.ones(2), "noisy": True},
    ),
}
