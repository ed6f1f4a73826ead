"""Tests of Table I at full length."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.app.cli import main
from experiments.table1 import CONFIGURATIONS, mismatched_errors
from fjh.rig.hexapod import paper
from fjh.rig.hexapod.columns import COLUMNS
from fjh.rig.hexapod.machine import detector_noise_rad
from fjh.rig.hexapod.rig import hexapod_rig, nominal_testbed
from fjh.rig.hexapod.testbed import TestbedConfig
from tests.fjh.rigs import shared_rig


@pytest.fixture(scope="module")
def runs(study):
    """Arrays of each column, by name."""
    return {column["name"]: study.arrays(column["data"]) for column in study.summary["columns"]}


CORRECTED = ["W_a", "W_b", "W_c", "W_d", "W_e"]
ANGLES = ["alpha", "beta"]


@pytest.mark.parametrize(("angle", "off"), [("alpha", 0.020), ("beta", -0.038)])
def test_calibrated_levels_are_near_the_papers_means_with_less_scatter(table1, angle, off):
    """Numbers are within 13.9 % of the paper's with one fitted level per angle."""
    columns = [table1["by_name"][name] for name in CORRECTED]
    here = np.array([column[f"{angle}_rms_urad"] for column in columns])
    printed = np.array([column[f"paper_{angle}_rms_urad"] for column in columns])
    assert here.mean() / printed.mean() - 1 == pytest.approx(off, abs=0.005)
    assert np.abs(here / printed - 1).max() < 0.139


@pytest.mark.parametrize("angle", ANGLES)
def test_weights_and_a_known_lock_do_not_change_the_tracking(table1, angle):
    """J_m M = I with any weights: differences are 0.007 %, 0.06 % with a lock, over eight seeds."""
    rms = [table1["by_name"][name][f"{angle}_rms_urad"] for name in CORRECTED]
    assert max(rms[:3]) < 1.0003 * min(rms[:3])
    assert rms[3:] == pytest.approx([rms[0]] * 2, rel=0.0015)


@pytest.mark.parametrize(("name", "spared"), [("W_b", [0, 2, 4]), ("W_c", [1, 3, 5])])
def test_weighted_struts_have_smaller_inputs_and_the_others_larger_ones(table1, name, spared):
    rms = (table1["by_name"][k]["strut_input_rms_percent"] for k in (name, "W_a"))
    change = np.divide(*rms)
    others = np.setdiff1d(range(6), spared)
    assert np.all(change[spared] < 0.7)
    assert np.all(change[others] > 1.0)


def test_translation_across_the_line_of_sight_falls_by_more_than_twenty(table1):
    peaks = [table1["by_name"][name]["secondary_peak"] for name in ("W_d", "W_e")]
    for axis in ("t_x_um", "t_y_um"):
        assert peaks[0][axis] > 20.0 * peaks[1][axis]  # section 4.2.2


def test_an_uncorrected_lock_has_the_error_of_theory_not_of_the_paper(table1):
    """Errors without row 1 of the mapping are 1.39 and 1.15 times the healthy ones."""
    A = np.linalg.inv(paper.JACOBIAN)
    J_m = np.linalg.inv(A)[:2]
    mapping = np.linalg.pinv(J_m)
    mapping[0] = 0.0
    gain = J_m @ mapping
    np.testing.assert_allclose(gain, [[0.750, -0.144], [-0.144, 0.917]], atol=1e-3)
    ratio = [
        table1["by_name"]["W_a_uncorrected"][f"{angle}_rms_urad"]
        / table1["by_name"]["W_a"][f"{angle}_rms_urad"]
        for angle in ANGLES
    ]
    np.testing.assert_allclose(ratio, [1.39, 1.15], rtol=0.02)
    printed = np.divide(paper.TABLE_I_URAD["W_a_uncorrected"], paper.TABLE_I_URAD["W_a"])
    np.testing.assert_allclose(printed, [4.01, 1.55], rtol=0.005)
    assert ratio[0] < 0.5 * printed[0]  # not reproduced


@pytest.mark.parametrize("column", COLUMNS, ids=lambda column: column.name)
def test_each_run_has_the_errors_of_the_table_and_of_the_linear_model(table1, runs, column):
    """The difference is within the 0.2 % of docs/testbed.md; at most 0.13 % over eight seeds."""
    run, stated = runs[column.name], table1["by_name"][column.name]
    assert {len(values) for values in run.values()} == {16000}
    assert all(np.isfinite(values).all() for values in run.values())
    for against, infix in (("true", ""), ("measured", "measured_")):
        error_urad = 1e6 * (run["desired_rad"] - run[f"{against}_rad"])
        rms = np.sqrt((error_urad**2).mean(axis=0))
        stated_urad = [stated[f"{angle}_{infix}rms_urad"] for angle in ANGLES]
        np.testing.assert_allclose(stated_urad, rms, rtol=1e-12)
    predicted = [stated[f"predicted_{angle}_rms_urad"] for angle in ANGLES]
    np.testing.assert_allclose([stated[f"{angle}_rms_urad"] for angle in ANGLES], predicted, 0.002)
    assert run["closure_residual_m"].max() == stated["closure_residual_max_m"]
    for strut in column.struts("locked"):
        assert np.ptp(run["strut_displacement_m"][:, strut]) < 1e-7
    working = np.setdiff1d(range(6), column.struts("locked"))
    assert np.all(np.ptp(run["strut_displacement_m"][:, working], axis=0) > 1e-6)


@pytest.mark.parametrize("name", CORRECTED)
def test_the_controllers_estimate_of_secondary_motion_is_near_the_truth(runs, name):
    """The error is below 2 % and 0.1 um or urad; with an unknown lock it is large."""
    truth, estimate = runs[name]["secondary"], runs[name]["secondary_estimated"]
    allowed = 0.02 * np.abs(truth).max(axis=0) + 1e-7
    assert np.all(np.abs(estimate - truth).max(axis=0) < allowed)
    lost = runs["W_a_uncorrected"]
    peak, assumed = (np.abs(lost[key]).max(axis=0) for key in ("secondary", "secondary_estimated"))
    assert np.all(peak > 100 * assumed)


def test_the_table_of_this_version_agrees_with_the_last_release(table1_folder):
    last = Path(__file__).parents[2] / "docs" / "data" / "table1.json"
    assert main(["results", str(table1_folder), "--against", str(last)]) == 0


@pytest.mark.long
@pytest.mark.parametrize("name", ["W_a", "W_e", "W_a_uncorrected"])
def test_the_second_configuration_is_within_15_percent_of_all_of_table_1(name):
    """Errors are those of the linear loop, 0.2 % from the simulation."""
    bench = CONFIGURATIONS["demand-limit"]
    column = next(column for column in COLUMNS if column.name == name)
    rig, path = hexapod_rig(nominal_testbed(bench), column.goal), bench.spiral_rad()
    noise = detector_noise_rad(bench, 0, len(path))
    predicted = rig.predict(path, failures=column.failures, told=False, noise=noise)
    np.testing.assert_allclose(1e6 * predicted.rms, paper.TABLE_I_URAD[name], rtol=0.15)


def test_errors_exclude_the_drift_of_the_detectors_zero():
    rig, path = shared_rig("hexapod"), TestbedConfig().spiral_rad(0.3)
    mismatched, run = rig.with_mismatch("all", 3), rig.fly(rig.controller(), path)
    perfect = replace(run, true=path - mismatched.machine.zero_rad(300))
    errors = mismatched_errors(mismatched, COLUMNS[0], perfect, 7)
    simulated, predicted = (
        [errors[f"mismatched_{of}{angle}_rms_urad"] for angle in ("alpha", "beta")]
        for of in ("", "predicted_")
    )
    np.testing.assert_allclose(simulated, 0.0, atol=1e-14)
    noise, floor = detector_noise_rad(TestbedConfig(), 7, 300), mismatched.machine.floor(300)
    expected, still = (
        1e6 * rig.predict(path, noise=noise, floor_m_per_s2=a).rms for a in (floor, None)
    )
    np.testing.assert_allclose(predicted, expected)
    assert (predicted > 1.1 * still).any()
