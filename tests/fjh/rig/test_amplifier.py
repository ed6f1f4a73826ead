"""Converters and amplifiers: codes, saturation, and limits of displacements against MuJoCo."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from fjh.rig.hexapod.amplifier import Amplifier, displacement_limits
from fjh.rig.hexapod.testbed import TestbedConfig
from sim import Plant

CURRENTS_A = [0.5, 1.0, 2.0, 3.0, 4.0, 9.0]
PLAIN = Amplifier(bits=16, full_input_a=4.0, limit_a=4.0, newton_per_a=20.0, newton_per_m=1e5)
STEP_M, STEP_PERCENT = 4.0 * 20.0 / 1e5 / 2**15, 100 / 2**15


@pytest.fixture(scope="module")
def amplifier(model):
    return TestbedConfig().amplifier(model.actuator_gainprm[0, 0])


def at_rest(model, amplifier, command_m):
    """A plant that has settled at what the converters make of a command."""
    plant = Plant(model)
    plant.settle(0.5, amplifier.displacements(amplifier.inputs(command_m)))
    return plant


def test_the_converter_sends_the_nearest_code_and_none_beyond_its_range():
    """-32768..32767: the largest positive input is one step short of 100 %."""
    steps = np.array([-1.6, -1.4, -0.6, -0.4, 0.4, 0.6, 1.4, 1.6])
    codes = PLAIN.inputs(steps * STEP_M) / STEP_PERCENT
    np.testing.assert_array_equal(codes, [-2, -1, -1, 0, 0, 1, 1, 2])
    far = np.array([-40000, -32768, 32767, 32768, 40000])
    codes = PLAIN.inputs(far * STEP_M) / STEP_PERCENT
    np.testing.assert_array_equal(codes, [-32768, -32768, 32767, 32767, 32767])


def test_beyond_its_limit_the_amplifier_gives_no_more_current():
    weak = replace(PLAIN, limit_a=3.0)
    fine = weak.displacements(weak.inputs(np.linspace(0, 5, 200) * STEP_M))
    np.testing.assert_allclose(np.unique(fine), np.arange(6) * STEP_M, atol=1e-18)
    assert weak.current_a(np.array([50.0, -100.0])).tolist() == [2.0, -3.0]
    assert weak.displacements(np.array(100.0)) == pytest.approx(3.0 * 20.0 / 1e5)


def test_the_amplifiers_full_scale_is_the_coils_force_limit(model, amplifier):
    """100 % input, largest current, largest coil force and full stroke are one point."""
    coil, strut = model.actuator("coil1"), model.joint("strut1")
    assert coil.gainprm[0] == strut.stiffness[0]
    full_force = amplifier.current_a(np.array(100.0)) * amplifier.newton_per_a
    assert full_force == pytest.approx(coil.forcerange[1], rel=1e-9)
    assert amplifier.displacements(np.array(100.0)) == pytest.approx(strut.range[1], rel=1e-9)


@pytest.mark.parametrize("side", [0, 1], ids=["lower", "upper"])
def test_a_strut_at_its_limit_rests_there_with_the_stated_current(model, amplifier, side):
    """The coil balances the spring: k l = (N/A) I, but for flexures of 0.1 % of the stiffness."""
    limits = displacement_limits(model, amplifier, CURRENTS_A)[side]
    for strut, (limit_m, most_a) in enumerate(zip(limits, CURRENTS_A, strict=True)):
        plant = at_rest(model, amplifier, limit_m * np.eye(6)[strut])
        current_a = plant.coil_force_n()[strut] / amplifier.newton_per_a
        stated_a = (2 * side - 1) * min(most_a, amplifier.limit_a)
        assert plant.displacements()[strut] == pytest.approx(limit_m, rel=2e-3)
        # Half a step of the converter; a whole one at the upper end of its codes.
        step_a = amplifier.full_input_a / 2 ** (amplifier.bits - 1)
        assert current_a == pytest.approx(stated_a, abs=1.01 * step_a)


def test_a_shorter_stroke_is_the_limit_and_the_strut_rests_on_it(model, amplifier):
    """Whichever comes first, stop or current; a stop carries what the coil pushes too much."""
    short = copy.copy(model)
    short.jnt_range[short.actuator_trnid[1, 0]] = [-1e-4, 2e-4]
    short.jnt_limited[short.actuator_trnid[0, 0]] = False
    lower, upper = displacement_limits(short, amplifier)
    assert (lower[1], upper[1]) == (-1e-4, 2e-4)
    assert -lower[0] == pytest.approx(amplifier.limit_a * 20.0 / 126e3)
    assert upper[2:] == pytest.approx(635e-6, rel=1e-4)
    for limit_m in (lower[1], upper[1]):
        plant = at_rest(short, amplifier, 2 * limit_m * np.eye(6)[1])
        assert plant.displacements()[1] == pytest.approx(limit_m, rel=1e-2)
    np.testing.assert_array_equal(displacement_limits(model, amplifier, 0.0), np.zeros((2, 6)))
