"""Motions that tell failures apart, and sensors that do."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.columns import MAJOR
from fjh.rig.hexapod.fault_tolerance import HEAVE, nominal_model
from fjh.rig.hexapod.testbed import TestbedConfig
from ftc.fdi import (
    KINDS,
    Cost,
    Dither,
    Fault,
    NominalModel,
    Uncertainty,
    designed_dither,
    fault_model,
    fault_responses,
    ranked_sensors,
    separations,
    separations_at,
)
from sim import NOMINAL
from tests.ftc.machines import LOOSE, mechanism, random_dither, twins
from tests.random_systems import bits

servos = pytest.mark.parametrize("servo", [False, True])


def test_groups_name_what_is_alike_and_a_sensor_that_ends_it():
    """In step, twins leave the same gap; in turn, gaps of opposite sign."""
    nominal, known = twins(), (1.0,)
    step = Dither(1e-2, 5.0, (1.0, 1.0, 1.0))
    found = separations(nominal, step, *known)
    assert found.alike_actuators() == ((0, 1),) and found.least == 0.0
    assert found.undetected() == tuple(Fault(2, kind, 0.5 * (kind == "weak")) for kind in KINDS)
    # Uncoupled, each stands still when locked and when free.
    assert not found.distance[[0, 3, 6], [1, 4, 7]].any()
    in_turn = separations(nominal, replace(step, direction=(1.0, -1.0, 1.0)), *known)
    assert in_turn.alike_actuators() == () and found.isolable() == ()
    assert [fault.actuator for fault in in_turn.isolable()] == [0, 0, 0, 1, 1, 1]

    sum_again, third, first = np.eye(1, 6)[0] + np.eye(1, 6, 1)[0], np.eye(1, 6, 2)[0], np.eye(6)[0]
    candidates = {"sum": (sum_again, 1e-5), "third": (third, 1e-5), "first": (first, 1e-5)}
    ranked = ranked_sensors(nominal, candidates, step, *known)
    assert [each.alike for each in ranked] == [1, 1, 2]
    assert {each.name for each in ranked[:2]} == {"third", "first"}
    assert ranked_sensors(nominal, {}, step, *known) == ()


@servos
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_one_more_sensor_is_one_more_output_and_never_lowers_a_separation(seed, servo):
    """It can be ignored; with an uncertain model, too."""
    nominal, dither = mechanism(seed, servo=servo), random_dither(seed)
    known = 0.5, LOOSE
    before = separations(nominal, dither, *known)
    encoders = {str(k): (row, 1e-4) for k, row in enumerate(nominal.displacement)}
    ranked = ranked_sensors(nominal, encoders, dither, *known)
    for each in ranked:
        slack, (row, noise) = 1e-6 * before.distance.max(), encoders[each.name]
        C = np.vstack([nominal.plant.C, row])
        beside = nominal.measured(C, np.append(nominal.noise, noise))
        alone = separations(beside, dither, *known)
        np.testing.assert_allclose(each.separations.distance, alone.distance, atol=slack)
        assert (each.separations.distance >= before.distance - slack).all()
        assert (each.separations.from_none >= before.from_none - slack).all()
    order = [(each.alike, -each.separations.least) for each in ranked]
    assert order == sorted(order) and len(ranked) == 3


def spent(nominal: NominalModel, commanded: np.ndarray, hz: float) -> np.ndarray:
    """Commands, motions of actuators and of the first output, in units of what is allowed."""
    model, z = fault_model(nominal), np.exp(2j * np.pi * hz * nominal.period_s)
    x = np.linalg.solve(z * np.eye(len(model.A)) - model.A, model.B @ commanded)
    task = np.abs(nominal.plant.C[:1] @ x) / 1e-4
    return np.concatenate([np.abs(commanded) / 1e-3, np.abs(nominal.displacement @ x) / 1e-3, task])


@servos
@pytest.mark.parametrize("uncertainty", [Uncertainty(), LOOSE], ids=["exact", "uncertain"])
@pytest.mark.parametrize("seed", range(2))
def test_no_random_dither_of_equal_cost_is_better_than_the_designed_one(seed, uncertainty, servo):
    """And that costs what it may, and keeps the null space."""
    nominal = mechanism(seed, servo=servo)
    plant, known = nominal.plant, (0.5, uncertainty)
    J = (-plant.C @ np.linalg.solve(plant.A, plant.B))[:1]  # of the first output, at rest
    N, frequencies = scipy.linalg.null_space(J), np.array([4.0, 16.0])
    cost = Cost(1e-3, np.asarray(plant.C)[:1], 1e-4)
    best = designed_dither(nominal, N, frequencies, cost, *known)
    u = best.dither.amplitude * np.array(best.dither.direction)
    assert np.abs(J @ u).max() < 1e-12 * np.abs(J).max()
    assert best.dither.frequency_hz in frequencies
    used = spent(nominal, u, best.dither.frequency_hz)
    assert used.max() == pytest.approx(1.0, rel=1e-9)
    np.testing.assert_allclose(best.displacement, 1e-3 * used[3:6], rtol=1e-6)
    np.testing.assert_allclose(best.task_motion, 1e-4 * used[6:], rtol=1e-6)

    responses = fault_responses(nominal, frequencies, *known)
    rng = np.random.default_rng([seed, 2])
    for number in range(50):
        k = number % 2
        other = N @ rng.normal(size=N.shape[1])
        other /= spent(nominal, other, frequencies[k]).max()
        found = separations_at(responses, k, other)
        reached = [each.between_actuators[best.separable] for each in (found, best.separations)]
        assert reached[0].min() <= reached[1].min() * (1 + 1e-6)


def test_a_task_that_leaves_no_freedom_gets_no_dither():
    nominal = mechanism(0)
    cost = Cost(1e-3, np.asarray(nominal.plant.C), 1e-4)
    for none in (np.zeros((3, 0)), np.zeros((3, 3))):
        found = designed_dither(nominal, none, [5.0], cost, 1.0)
        assert found.dither.amplitude == 0.0 and found.separations.least == 0.0
        assert len(found.separations.undetected()) == 9


def test_for_the_hexapod_the_heave_is_found(model):
    """All struts alike: by symmetry pointing stays still, and each strut has a direction."""
    nominal = nominal_model(model, TestbedConfig())
    J_m = np.linalg.inv(hexapod(model).inverse_jacobian(NOMINAL))[MAJOR]
    known, cost = (0.2, LOOSE), Cost(0.5e-6, np.asarray(nominal.plant.C), 1e-7)
    found = designed_dither(nominal, scipy.linalg.null_space(J_m), [20.0], cost, *known)
    np.testing.assert_allclose(found.dither.direction, HEAVE, atol=1e-3)
    assert found.task_motion.max() < 1e-10
    heave = separations(nominal, replace(found.dither, direction=HEAVE), *known)
    assert found.separable.all()
    assert found.separations.least == pytest.approx(heave.least, rel=1e-3)


# Symmetric machines: a choice among equals does not hang on the last bits of numbers.


def test_a_dither_is_the_same_however_its_freedom_is_given():
    """Any columns that span it will do; the search begins with directions, not with coordinates."""
    nominal, rng = mechanism(0, n=4), np.random.default_rng(1)
    J = rng.normal(size=(1, 4))
    P = np.eye(4) - np.linalg.pinv(J) @ J
    cost = Cost(1e-3, np.asarray(nominal.plant.C)[:1], 1e-4)
    found = [
        designed_dither(nominal, P @ mix, [4.0, 16.0], cost, 0.5, LOOSE).dither
        for mix in (np.eye(4), np.eye(4) * (1 + 1e-15), rng.normal(size=(4, 4)))
    ]
    for each in found[1:]:
        assert each.frequency_hz == found[0].frequency_hz
        np.testing.assert_allclose(each.direction, found[0].direction, atol=1e-6)


def test_equally_good_sensors_stay_in_the_order_in_which_they_are_named():
    """Each is of one of the twins and of the third mass, and separates as much."""
    nominal, step = twins(), Dither(1e-2, 5.0, (1.0, 1.0, 1.0))
    for seed in range(12):
        rng = np.random.default_rng(seed)
        rows = [bits(rng, sign * np.eye(6)[k] + np.eye(6)[2]) for k in (0, 1) for sign in (1, -1)]
        for order in (range(4), [3, 1, 0, 2]):
            sensors = {str(k): (rows[k], 1e-5) for k in order}
            ranked = ranked_sensors(nominal, sensors, step, 1.0)
            assert [int(each.name) for each in ranked] == list(order)
