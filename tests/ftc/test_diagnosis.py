"""The hexapod's diagnosis on linear plants that are not its model."""

from dataclasses import replace

import control
import numpy as np
import pytest

from fjh.rig.hexapod.fault_tolerance import HEAVE
from fjh.rig.hexapod.rig import hexapod_rig, pursuing
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.prediction import linear_run
from ftc.fdi import DEFAULT_CONFIG, KINDS, Diagnosis, Dither, Fault, NominalModel, monitor
from ftc.fdi.decision import CONFIDENCE
from ftc.fdi.monitor import Monitor, MonitorState
from ftc.fdi.uncertainty import STEP, TYPICAL, perturbed

BENCH, RIG = TestbedConfig(), hexapod_rig()
DITHER = Dither(0.5e-6, 20.0, HEAVE)
ANGLES = RIG.nominal
ONSET = 1500
CONFIG = replace(DEFAULT_CONFIG, dither_hz=DITHER.frequency_hz)


def drawn(nominal: NominalModel, seed: int) -> NominalModel:
    """A plant whose errors are drawn as uncertain as the model is said to be."""
    rng, plant = np.random.default_rng([seed, 21]), nominal.plant
    A, B = plant.A.copy(), plant.B.copy()
    for each in perturbed(nominal, TYPICAL):
        size = rng.standard_normal() / STEP
        A, B = A + size * (each.plant.A - plant.A), B + size * (each.plant.B - plant.B)
    return replace(nominal, plant=control.ss(A, B, plant.C, 0))


def flown(seed: int, fault: Fault | None, duration_s: float = 1.9, late: int = 1):
    """Commands that came before each tick, and outputs, of a drawn plant with late commands."""
    rig, faults = pursuing(RIG, RIG.goal, nominal=drawn(ANGLES, seed)), [fault] if fault else []
    path = BENCH.spiral_rad(duration_s, begin_s=6.0)
    states, sent = linear_run(rig, path, DITHER, faults, ONSET)
    rng = np.random.default_rng(seed)
    y = states @ ANGLES.plant.C.T + ANGLES.noise * rng.standard_normal((len(states), 2))
    before = np.vstack([np.zeros((1, 6)), sent[:-1]])
    return np.vstack([before[late:], before[:late]]), y


def watched(sent, y, seen: NominalModel = ANGLES) -> tuple[Monitor, MonitorState, list[Diagnosis]]:
    watch, named = monitor(seen, config=CONFIG), []
    state = watch.start()
    for u, measured in zip(sent, y, strict=True):
        state = watch.step(state, measured, u)
        found = state.diagnosis
        if found is not None and (not named or named[-1] is not found):
            named.append(found)
        if found is not None and found.confirmed:
            watch, state = watch.believing(state)
    return watch, state, named


SHORT = [(0, "free"), (1, "weak"), (4, "locked")]
EACH = [
    pytest.param(strut, kind, marks=[] if (strut, kind) in SHORT else pytest.mark.long)
    for strut in range(6)
    for kind in KINDS
]


@pytest.mark.parametrize(("strut", "kind"), EACH)
def test_each_failure_is_found_in_a_plant_that_is_not_the_model(strut, kind):
    """Gains, springs, dampers and inertia drawn, and a tick of delay."""
    fault = Fault(strut, kind, 0.4 * (kind == "weak"))
    _, _, named = watched(*flown(strut, fault))
    assert named
    assert {each.fault.actuator for each in named} == {strut}
    assert kind in named[-1].kinds
    assert named[0].alarm_tick > ONSET and named[0].tick < ONSET + 400
    assert all(each.actuator_confidence >= CONFIDENCE for each in named)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_a_plant_that_is_not_the_model_raises_no_alarm_while_it_is_sound(seed):
    """The errors are tracked, and what they may still do belongs to the threshold."""
    _, state, named = watched(*flown(seed, None, duration_s=3.0))
    assert (state.alarm_ticks, named, state.unexplained) == ((), [], False)
    assert np.diag(state.observer.parameters.covariance).min() < 0.1  # of a prior of one


@pytest.mark.long
def test_a_diagnosis_is_of_the_outputs_not_of_their_units():
    """Outputs and noise in microradians give the same verdicts."""
    sent, y = flown(0, Fault(4, "free"), duration_s=1.7)
    plant = ANGLES.plant
    scaled = control.ss(plant.A, plant.B, 1e6 * plant.C, 0)
    other = replace(ANGLES, plant=scaled, noise=1e6 * ANGLES.noise)
    (_, one, _), (_, two, _) = (
        watched(sent, factor * y, seen) for factor, seen in ((1.0, ANGLES), (1e6, other))
    )
    assert one.alarm_ticks == two.alarm_ticks
    assert one.diagnosis is not None and two.diagnosis is not None
    assert one.diagnosis.fault.actuator == two.diagnosis.fault.actuator == 4
    assert one.diagnosis.tick == two.diagnosis.tick
