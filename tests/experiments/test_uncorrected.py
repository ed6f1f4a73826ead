"""Tests of the study `uncorrected`: physics of the candidates, and their evaluation."""

import copy

import mujoco
import numpy as np
import pytest
import scipy.linalg

from experiments import uncorrected
from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.controller import StrutMapping
from fjh.rig.hexapod.machine import FLOOR_BAND_HZ, floor_acceleration
from fjh.rig.hexapod.paper import TABLE_I_URAD
from fjh.rig.hexapod.rig import hexapod_rig
from fjh.rig.hexapod.testbed import Testbed, TestbedConfig
from fjh.rig.run import rms
from ftc import Goal
from sim import NOMINAL, Failure, Plant, linearize
from tests.sim.machines import pole_of, ring_down


def test_a_candidate_with_the_columns_of_the_paper_explains_them(study):
    """Candidates that fit only with settled loops do not explain them."""
    candidates, runs = study.tables["candidates"], study.tables["runs"]
    assert not uncorrected.evaluated(candidates, runs).explains.any()
    paper = runs.set_index(["candidate", "column"])
    for column in ("W_a", "W_d", "W_e", "W_a_uncorrected"):
        for angle, urad in zip(("alpha", "beta"), TABLE_I_URAD[column], strict=True):
            paper.loc[("off_centre", column), f"{angle}_rms_urad"] = urad
            paper.loc[("off_centre", column), f"{angle}_settled_urad"] = urad
    table = uncorrected.evaluated(candidates, paper.reset_index())
    assert table.name[table.explains].tolist() == ["off_centre"]
    paper.loc[("off_centre", "W_d"), "alpha_rms_urad"] *= 2
    table = uncorrected.evaluated(candidates, paper.reset_index())
    settled = table.set_index("name").loc["off_centre"]
    assert settled.meets_ratios and settled.meets_w_a and settled.explains_if_corrected_settled
    assert not settled.meets_corrected and not settled.explains


def test_a_steady_acceleration_of_the_floor_is_a_sag(model):
    """The sag is that of a force -m a at the centre of mass, plus a part of the struts' mass."""
    acceleration = np.array([0.02, -0.01, 0.03])
    plant = Plant(model)
    plant.shake(acceleration)
    plant.settle(1.0)
    linear = linearize(plant.model, Plant(model).data)
    sag = -linear.C_twist @ np.linalg.solve(linear.A, linear.B_floor @ acceleration)
    np.testing.assert_allclose(plant.displacement(), sag, rtol=2e-3, atol=2e-9)

    pushed = Plant(model)
    mass_kg = model.body_mass[model.body("payload").id] + 6 * 0.05
    pushed.push(np.array([0, 0, 0, *(-mass_kg * acceleration)]))
    pushed.settle(1.0)
    by_push = pushed.displacement()[3:]
    assert np.linalg.norm(sag[3:]) > np.linalg.norm(by_push)
    np.testing.assert_allclose(sag[3:], by_push, rtol=0.25)


def test_the_floor_meets_its_criterion_in_every_third_octave_band():
    criterion = 50e-6
    acceleration = floor_acceleration(16000, 1e-3, criterion, [3])
    frequency = np.fft.rfftfreq(len(acceleration), 1e-3)
    spectrum = np.fft.rfft(acceleration, axis=0)[1:] / (2 * np.pi * frequency[1:, None])
    power = 2 * np.abs(spectrum / len(acceleration)) ** 2
    for centre in FLOOR_BAND_HZ[0] * 2 ** (np.arange(10) / 3):
        low, high = centre * 2 ** (-1 / 6), centre * 2 ** (1 / 6)
        band = (frequency[1:] >= low) & (frequency[1:] < high)
        np.testing.assert_allclose(np.sqrt(power[band].sum(axis=0)), criterion, rtol=0.02)
    outside = (frequency < 7) | (frequency > 90)
    assert np.abs(spectrum[outside[1:]]).max() < 1e-12
    assert not np.array_equal(acceleration, floor_acceleration(16000, 1e-3, criterion, [4]))


@pytest.mark.long
def test_a_lock_off_centre_keeps_the_position_set_by_the_coil(model):
    """The initial pointing is J[:, 0] l, with the other struts at their centre."""
    place_m, path = 80e-6, TestbedConfig().spiral_rad(1.5)
    rig = hexapod_rig(start_m=place_m * np.eye(6)[0])
    run, settled = (
        rig.fly(rig.controller(), path, failures=[Failure(0, "locked")], lead_in_s=lead_in_s)
        for lead_in_s in (0.0, 1.0)
    )
    J = np.linalg.inv(hexapod(model).inverse_jacobian(NOMINAL))
    # The flexures bear some thousandths of the coil's force.
    np.testing.assert_allclose(run.true[0], J[:2, 0] * place_m, rtol=6e-3)
    assert np.abs(run.displacement[:, 0] - place_m).max() < 6e-3 * place_m
    assert np.abs(run.displacement[0, 1:]).max() < 6e-3 * place_m
    # The integrators have removed it, except for the detector's noise.
    assert np.abs(settled.true[0]).max() < 1e-6


@pytest.mark.long
def test_damping_is_the_requested_one_and_the_integrator_adds_none(model):
    """The reference is the ring-down of the pointing mode at the least damping simulated."""
    least = 0.005
    quiet = uncorrected.damped(model, least)
    frequency_hz, ratio = uncorrected.pointing_mode(quiet)
    assert ratio == pytest.approx(least, rel=0.01)
    plant = Plant(quiet)
    squares, vectors = np.linalg.eig(-linearize(plant.model, plant.data).A[6:, :6])
    closed = scipy.linalg.null_space(plant.data.efc_J.reshape(-1, quiet.nv))
    shape = closed @ np.real(vectors[:, np.argsort(np.real(squares))[3]])
    pole = pole_of(ring_down(quiet, shape, 0.3), quiet.opt.timestep)
    assert abs(pole) / (2 * np.pi) == pytest.approx(frequency_hz, rel=0.01)
    assert -pole.real / abs(pole) == pytest.approx(least, rel=0.03)
    assert uncorrected.damped(model, 0.2).dof_damping.max() > 1.5 * model.dof_damping.max()
    discrete = copy.copy(quiet)
    discrete.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    pole = pole_of(ring_down(discrete, shape, 0.3), discrete.opt.timestep)
    assert -pole.real / abs(pole) > 1.5 * least
    with pytest.raises(ValueError, match="ratio must lie between 0 and 1, got 0"):
        uncorrected.damped(model, 0)


def test_the_strokes_of_the_page_are_those_of_the_mappings(model):
    """Peaks are those of the outermost turn: W_a, without correction, W_e and W_d."""
    J = np.linalg.inv(hexapod(model).inverse_jacobian(NOMINAL))[:2]
    W_a = np.linalg.pinv(J)
    gains = [W_a, W_a @ np.linalg.inv(J[:, 1:] @ W_a[1:])]
    for weight in (10.0, 1.0):
        goal = Goal(secondary_weight=(weight, weight, 1.0, 1.0), locked_at={0: 0.0})
        gains.append(StrutMapping(hexapod(model), goal, "constant").major_gain())
    peak_um = [100 * np.linalg.norm(gain, axis=1).max() for gain in gains]
    np.testing.assert_allclose(peak_um, [16.6, 24.9, 28.6, 31.5], atol=0.05)


@pytest.mark.long
def test_a_row_of_the_map_equals_the_prediction(model):
    bench, lost = uncorrected.at_crossover(6.0, 25.0), uncorrected.Candidate("lost_strut", {})
    quiet = uncorrected.damped(model, 0.05)
    testbed = Testbed(quiet, bench, uncorrected.nominal_loops(quiet, bench))
    errors, poles = uncorrected.map_row(0.05, np.array([6.0, 30.0]), 25.0, seed=0)
    for k, column in enumerate(("W_a", "W_a_uncorrected")):
        rig = lost.rig(testbed, column, 0, bench.duration_s)
        expected = uncorrected.predicted_error_rad(
            rig, column, 0, bench.duration_s, lost.constant("lead_in_s")
        )
        assert expected is not None
        np.testing.assert_allclose(errors[0, k], rms(expected), rtol=1e-3)
    # At 30 Hz the healthy loop is unstable.
    assert np.isinf(errors[1]).all()
    assert np.isinf(poles[1]).all()
    assert np.all(poles[0] < 1)
