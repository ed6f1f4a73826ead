"""Tests of the study `release`: a strut without coil, or without coil and spring."""

from dataclasses import replace

import mujoco
import numpy as np
import pandas as pd
import pytest
import scipy.linalg

from experiments.release import EQUAL, RATIOS
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.controller import StrutMapping
from fjh.rig.hexapod.fault_tolerance import elastic_system, strut_and_payload_stiffness
from sim import NOMINAL, Failure, Plant, jacobians, linearize
from sim.mjcf import joint_stiffness, weightless


@pytest.fixture(scope="module")
def spirals(study):
    return {spiral["name"]: spiral for spiral in study.summary["spirals"]}


@pytest.mark.parametrize("goal", [replace(EQUAL, free=(0,)), replace(EQUAL, spring_lost=(4,))])
def test_the_strut_mapping_has_the_springs_of_the_whole_mechanism(model, goal):
    """The reference has 42 velocities with all springs, the mapping six struts and a twist."""
    mapping = StrutMapping(hexapod(model), goal, "constant", strut_and_payload_stiffness(model))
    suspension = dict.fromkeys(goal.spring_lost, 0.0)
    failed = elastic_system(model, suspension).with_failures(free=[*goal.free, *goal.spring_lost])
    whole = failed.kinematics()
    gain = whole.velocity_mapping(MAJOR, joint_weight=np.ones(6)).major
    np.testing.assert_allclose(mapping.major_gain(), whole.expand(gain.T).T, atol=1e-12)


def test_a_loose_strut_is_estimated_at_its_elastic_equilibrium(model):
    """The pose estimate does not assume a strut without coil at its centre."""
    stiffness = strut_and_payload_stiffness(model)
    mapping = StrutMapping(hexapod(model), replace(EQUAL, spring_lost=(0,)), "constant", stiffness)
    command = mapping.displacements(np.array([1e-4, 0.0]), NOMINAL)
    pose = mapping.estimate(command, NOMINAL)
    np.testing.assert_allclose(pose.rotation[[2, 0], [1, 2]], [1e-4, 0.0], atol=1e-8)
    assert command[0] == 0.0
    assert abs(hexapod(model).displacements(pose)[0]) > 1e-6


@pytest.mark.parametrize("kind", ["free", "loose"])
def test_the_static_gain_of_the_linear_model_is_that_of_the_springs(model, kind):
    """The gain is Z (Z^T K Z)^-1 Z^T B u; with soft constraints a loose strut is 13 % too stiff."""
    orbit = weightless(model)
    plant = Plant(orbit)
    Failure(0, kind).inject(plant)
    linear = linearize(plant.model, plant.data)
    command = 1e-5 * np.arange(1.0, 7.0)
    jac = jacobians(orbit, mujoco.MjData(orbit), "payload", "base")
    K = joint_stiffness(plant.model)
    force = np.zeros(orbit.nv)
    force[jac.active[1:]] = 126e3 * command[1:]
    Z = scipy.linalg.null_space(jac.J_C)
    by_springs = jac.J_T @ Z @ np.linalg.solve(Z.T @ (K[:, None] * Z), Z.T @ force)
    by_model = -linear.C_twist @ np.linalg.solve(linear.A, linear.B @ command)
    # Finite differences of the linearization are accurate to 1e-7.
    np.testing.assert_allclose(by_model, by_springs, rtol=1e-6)


def test_a_free_strut_with_spring_has_the_errors_of_a_locked_one(spirals, table1):
    """A failure that becomes known during the spiral causes no transient."""
    locked = table1["by_name"]["W_a_uncorrected"]
    for angle in ("alpha", "beta"):
        key = f"{angle}_rms_urad"
        assert spirals["free_from_start_uncorrected"][key] == pytest.approx(locked[key], rel=0.005)
        for when in ("from_start", "in_flight"):
            corrected = spirals[f"free_{when}_corrected"][key]
            assert corrected == pytest.approx(spirals["healthy"][key], rel=0.005)
            peak = f"{angle}_peak_urad"
            assert spirals[f"free_{when}_corrected"][peak] < 1.05 * spirals["healthy"][peak]


def test_without_spring_the_loop_needs_the_mapping_for_its_bandwidth(spirals):
    """The damper fixes a loose strut at crossover; the static mapping is nearly unstable."""
    healthy, corrected = spirals["healthy"], spirals["loose_in_flight_corrected"]
    as_locked = spirals["loose_in_flight_as_locked"]
    assert healthy["sensitivity_peak"] < 2.0
    assert corrected["sensitivity_peak"] > 5.0
    assert as_locked["sensitivity_peak"] < 2.1
    for switched in (corrected, as_locked):  # the switch causes no transient
        assert switched["alpha_peak_urad"] < 1.05 * healthy["alpha_peak_urad"]
    for when in ("from_start", "in_flight"):
        uncorrected = spirals[f"loose_{when}_uncorrected"]
        for angle in ("alpha", "beta"):
            key = f"{angle}_rms_urad"
            assert spirals[f"loose_{when}_as_locked"][key] < 0.9 * uncorrected[key]


def test_motion_equals_the_linear_model_and_is_not_quasi_static(spirals):
    failing = pd.DataFrame(spirals.values()).dropna(subset="kind")
    assert (failing.motion_mismatch_linear_model_percent < 0.1).all()
    # Modes of 31 Hz (with spring) follow a spiral of 0.5 Hz; a time constant of 0.5 s does not.
    quasi_static = failing.groupby("kind").motion_mismatch_quasi_static_percent
    assert quasi_static.max()["free"] < 4.0
    assert quasi_static.min()["loose"] > 30.0


def test_only_the_elastic_mapping_is_correct_at_all_stiffnesses(study):
    sweep = study.tables["sweep"]
    assert list(sweep.suspension_over_swing) == list(RATIOS)
    # Coils are forces against springs, compliant by 0.25 %, which only the linear model has.
    assert (sweep.mismatch_elastic_percent < 0.3).all()
    assert (sweep.mismatch_linear_model_percent < 0.01).all()
    np.testing.assert_allclose(sweep.alpha_corrected_urad, 100.0, rtol=0.003)
    assert (sweep.beta_corrected_urad.abs() < 0.1).all()
    np.testing.assert_allclose(sweep.strut_1_simulated_um, sweep.strut_1_elastic_um, rtol=4e-3)
    np.testing.assert_allclose(sweep.all_flexures_n_per_m, 197.0, atol=0.5)
    as_if_locked = sweep.mismatch_as_if_locked_percent.to_numpy()
    assert as_if_locked[0] < 0.4 and as_if_locked[-1] > 45.0
    assert np.all(np.diff(as_if_locked) > 0)


def test_a_mapping_of_a_free_strut_needs_springs(model):
    with pytest.raises(ValueError, match="stiffness must be given for a goal with free or loose"):
        StrutMapping(hexapod(model), replace(EQUAL, free=(0,)), "constant")
