"""Table I on plants off the model: what is flown, what is charged to the controller, what fails."""

import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.rig.hexapod.columns import COLUMNS
from experiments.rig.hexapod.machine import detector_noise_rad
from experiments.rig.hexapod.metrics import each_angle
from experiments.rig.hexapod.rig import hexapod_rig, pursuing
from experiments.rig.hexapod.testbed import TestbedConfig
from experiments.study.quantity import checks_of, entry_of
from experiments.table1.quantities import MISMATCHED
from experiments.table1.robustness import (
    REPRESENTATIVE,
    TOLERANCE,
    MismatchedRun,
    measured,
    mismatched_rigs,
    robustness,
    robustness_checks,
)

RIG = hexapod_rig()


def test_every_column_has_a_plant_of_its_own():
    rigs = {column.name: pursuing(RIG, column.goal) for column in COLUMNS}
    found = mismatched_rigs(rigs, 7, quick=False)
    assert tuple(found) == REPRESENTATIVE
    gains = [rig.machine.model.actuator_gainprm[:, 0] for rig in found.values()]
    assert len({tuple(each) for each in gains}) == len(found)
    assert tuple(mismatched_rigs(rigs, 7, quick=True)) == REPRESENTATIVE[:1]
    servos = copy.copy(RIG.model)
    servos.jnt_stiffness[servos.actuator_trnid[:, 0]] = 0.0
    without = {name: replace(rig, model=servos) for name, rig in rigs.items()}
    assert not mismatched_rigs(without, 7, quick=False)


def test_the_drift_of_the_detectors_zero_is_not_charged_and_the_floor_is_expected():
    drawn, path = RIG.drawn("all", 3), TestbedConfig().spiral_rad(0.3)
    run = RIG.fly(RIG.controller(), path)
    perfect = replace(run, true=path - drawn.machine.zero_rad(300))
    found = measured("W_a", drawn, COLUMNS[0], perfect, 7)
    np.testing.assert_allclose(found.rms_rad, 0.0, atol=1e-20)
    noise, floor = detector_noise_rad(TestbedConfig(), 7, 300), drawn.machine.floor(300)
    expected, still = (
        RIG.predict(path, noise=noise, floor_m_per_s2=each).rms for each in (floor, None)
    )
    np.testing.assert_allclose(found.predicted_rad, expected)
    assert (found.predicted_rad > 1.1 * still).any()


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
