"""Table I on plants off the model: what is flown, what is charged to the controller, what fails."""

import copy
from dataclasses import replace

import numpy as np

from experiments.table1 import (
    REPRESENTATIVE,
    mismatched_errors,
    mismatched_rigs,
)
from fjh.rig.hexapod.columns import COLUMNS
from fjh.rig.hexapod.machine import detector_noise_rad
from fjh.rig.hexapod.rig import pursuing
from fjh.rig.hexapod.testbed import TestbedConfig
from tests.fjh.rigs import rig


def test_every_column_has_a_plant_of_its_own():
    rigs = {column.name: pursuing(rig("hexapod"), column.goal) for column in COLUMNS}
    found = mismatched_rigs(rigs, 7, quick=False)
    assert tuple(found) == REPRESENTATIVE
    gains = [one.machine.model.actuator_gainprm[:, 0] for one in found.values()]
    assert len({tuple(each) for each in gains}) == len(found)
    assert tuple(mismatched_rigs(rigs, 7, quick=True)) == REPRESENTATIVE[:1]
    servos = copy.copy(rig("hexapod").model)
    servos.jnt_stiffness[servos.actuator_trnid[:, 0]] = 0.0
    without = {name: replace(one, model=servos) for name, one in rigs.items()}
    assert not mismatched_rigs(without, 7, quick=False)


def test_drift_of_the_detectors_zero_is_not_charged_to_the_controller():
    one, path = rig("hexapod"), TestbedConfig().spiral_rad(0.3)
    drawn, run = one.drawn("all", 3), one.fly(one.controller(), path)
    perfect = replace(run, true=path - drawn.machine.zero_rad(300))
    found = mismatched_errors(drawn, COLUMNS[0], perfect, 7)
    flown, predicted = (
        [found[f"mismatched_{of}{angle}_rms_urad"] for angle in ("alpha", "beta")]
        for of in ("", "predicted_")
    )
    np.testing.assert_allclose(flown, 0.0, atol=1e-14)
    noise, floor = detector_noise_rad(TestbedConfig(), 7, 300), drawn.machine.floor(300)
    expected, still = (
        1e6 * one.predict(path, noise=noise, floor_m_per_s2=each).rms for each in (floor, None)
    )
    np.testing.assert_allclose(predicted, expected)
    assert (predicted > 1.1 * still).any()
