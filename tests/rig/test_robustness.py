"""Table I on plants off the model: what is flown, what is charged to the controller, what fails."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from experiments.rig.hexapod.prediction import predicted_error_rad
from experiments.rig.hexapod.simulation import SpiralRun, track_spiral

from experiments.rig.hexapod.columns import COLUMNS
from experiments.rig.hexapod.controller import nominal_loops
from experiments.rig.hexapod.metrics import each_angle
from experiments.rig.hexapod.mismatch import ALL, mismatched
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.study.quantity import checks_of, entry_of
from experiments.table1.quantities import MISMATCHED
from experiments.table1.robustness import (
    REPRESENTATIVE,
    TOLERANCE,
    MismatchedRun,
    measured,
    mismatched_flights,
    robustness,
    robustness_checks,
)
from sim import load_model

RUNS = {column.name: SpiralRun(column.goal, column.failures, seed=7) for column in COLUMNS}


@pytest.fixture(scope="module")
def testbed(model) -> Testbed:
    bench = TestbedConfig()
    return Testbed(model, bench, nominal_loops(model, bench))


def test_every_column_flown_has_a_plant_of_its_own(testbed):
    flights = mismatched_flights(testbed, RUNS, quick=False)
    assert tuple(flights) == REPRESENTATIVE
    gains = [flights[name][0].machine.model.actuator_gainprm[:, 0] for name in flights]
    assert len({tuple(each) for each in gains}) == len(flights)
    assert tuple(mismatched_flights(testbed, RUNS, quick=True)) == REPRESENTATIVE[:1]
    servos = load_model()
    servos.jnt_stiffness[servos.actuator_trnid[:, 0]] = 0.0
    assert not mismatched_flights(replace(testbed, model=servos), RUNS, quick=False)


def test_the_drift_of_the_detectors_zero_is_not_charged_and_the_floor_is_expected(testbed):
    machine = mismatched(testbed, ALL, 3)
    run = replace(RUNS["W_a"], duration_s=0.3, jacobian="constant")
    flown = track_spiral(testbed, run)
    zero = machine.machine.zero_rad(300, 1e-3)
    perfect = replace(flown, true_rad=flown.desired_rad - zero)
    found = measured("W_a", machine, run, perfect)
    np.testing.assert_allclose(found.rms_rad, 0.0, atol=1e-20)
    floor = machine.machine.floor(300, 1e-3)
    expected = predicted_error_rad(testbed, replace(run, floor_m_per_s2=floor))
    assert expected is not None
    np.testing.assert_allclose(found.predicted_rad, np.sqrt((expected**2).mean(axis=0)))
    still = predicted_error_rad(testbed, run)
    assert still is not None
    assert (found.predicted_rad > 1.1 * np.sqrt((still**2).mean(axis=0))).any()


ANGLES = each_angle(*MISMATCHED)


def column(run: MismatchedRun | None) -> dict:
    return entry_of(ANGLES, SimpleNamespace(mismatched=run))


def off_by(off: float) -> MismatchedRun:
    return MismatchedRun(np.array([2.5e-6, 3e-6 * (1 + off)]), np.array([2.5e-6, 3e-6]), 1e-9)


@pytest.mark.parametrize("sign", [-1, 1])
def test_pointing_that_does_not_hold_fails_the_check_by_name(sign):
    for check in checks_of(ANGLES, column(off_by(sign * 0.9 * TOLERANCE)), "W_a"):
        assert check.passed
    found = checks_of(ANGLES, column(off_by(sign * 1.1 * TOLERANCE)), "W_a")
    (failed,) = [check for check in found if not check.passed]
    assert "RMS error of beta with all mismatches" in str(failed)


def test_loops_that_open_fail_and_where_nothing_was_flown_nothing_is_checked():
    opened = robustness({"W_a": replace(off_by(0.0), closure_residual_max_m=1e-6)})
    (failed,) = [c for c in robustness_checks({"mismatch": opened}) if not c.passed]
    assert failed.where == "mismatched plants"
    assert robustness({}) is None
    assert not robustness_checks({"mismatch": None})
    assert set(column(None).values()) == {None}
    assert not checks_of(ANGLES, column(None), "W_a")
