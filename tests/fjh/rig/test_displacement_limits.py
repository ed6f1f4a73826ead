"""Stroke and current as limits of displacements, against MuJoCo."""

import copy

import numpy as np
import pytest

from fjh.rig.hexapod.amplifier import displacement_limits
from fjh.rig.hexapod.testbed import TestbedConfig
from sim import Plant

CURRENTS_A = [0.5, 1.0, 2.0, 3.0, 4.0, 9.0]


@pytest.fixture(scope="module")
def amplifier(model):
    return TestbedConfig().amplifier(model.actuator_gainprm[0, 0])


def at_rest(model, amplifier, command_m):
    """A plant that has settled at what the converters make of a command."""
    plant = Plant(model)
    plant.settle(0.5, amplifier.displacements(amplifier.inputs(command_m)))
    return plant


@pytest.mark.parametrize("strut", range(6))
@pytest.mark.parametrize("side", [0, 1], ids=["lower", "upper"])
def test_a_strut_commanded_to_its_limit_rests_there_with_the_stated_current(
    model, amplifier, strut, side
):
    """The coil balances the spring: k l = (N/A) I, but for flexures of 0.1 % of the stiffness."""
    limit_m = displacement_limits(model, amplifier, CURRENTS_A)[side][strut]
    plant = at_rest(model, amplifier, limit_m * np.eye(6)[strut])
    current_a = plant.coil_force_n()[strut] / amplifier.newton_per_a
    stated_a = (2 * side - 1) * min(CURRENTS_A[strut], amplifier.limit_a)
    assert plant.displacements()[strut] == pytest.approx(limit_m, rel=2e-3)
    # Half a step of the converter; a whole one at the upper end of its codes.
    step_a = amplifier.full_input_a / 2 ** (amplifier.bits - 1)
    assert current_a == pytest.approx(stated_a, abs=1.01 * step_a)


def test_a_shorter_stroke_is_the_limit_and_the_strut_rests_on_it(model, amplifier):
    """Whichever comes first, stop or current; a stop carries what the coil pushes too much."""
    short = copy.copy(model)
    joint = short.actuator_trnid[1, 0]
    short.jnt_range[joint] = [-1e-4, 2e-4]
    lower, upper = displacement_limits(short, amplifier)
    assert (lower[1], upper[1]) == (-1e-4, 2e-4)
    assert np.delete(upper, 1) == pytest.approx(635e-6, rel=1e-4)
    for limit_m in (lower[1], upper[1]):
        plant = at_rest(short, amplifier, 2 * limit_m * np.eye(6)[1])
        assert plant.displacements()[1] == pytest.approx(limit_m, rel=1e-2)


def test_a_locked_strut_rests_away_from_its_centre_without_current(model, amplifier):
    """The lock carries the spring: displacement limits are of working actuators only."""
    _, upper = displacement_limits(model, amplifier)
    plant = at_rest(model, amplifier, upper * np.eye(6)[2])
    plant.lock(2)
    plant.settle(0.5)
    assert plant.displacements()[2] == pytest.approx(upper[2], rel=2e-3)
    assert np.abs(plant.coil_force_n()).max() == 0.0


def test_without_a_stop_the_current_is_the_limit_and_without_current_there_is_no_motion(
    model, amplifier
):
    """A range that the file does not state is infinite; without force a spring stays at rest."""
    endless = copy.copy(model)
    endless.jnt_limited[endless.actuator_trnid[0, 0]] = False
    lower, upper = displacement_limits(endless, amplifier)
    assert -lower[0] == pytest.approx(amplifier.limit_a * 20.0 / 126e3)
    assert upper[0] == pytest.approx(-lower[0], rel=1e-4)
    for limits in displacement_limits(model, amplifier, 0.0):
        assert np.array_equal(limits, np.zeros(6))


def test_currents_of_another_number_or_sign_are_refused(model, amplifier):
    with pytest.raises(ValueError, match="current_limit_a must be one number or 6, got shape"):
        displacement_limits(model, amplifier, [1.0, 2.0])
    with pytest.raises(ValueError, match="current_limit_a must not be negative"):
        displacement_limits(model, amplifier, -1.0)
    with pytest.raises(TypeError, match="amplifier must be a Amplifier"):
        displacement_limits(model, None)  # pyright: ignore[reportArgumentType]
