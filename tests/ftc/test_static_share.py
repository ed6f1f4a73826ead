"""What a weak actuator's commands still move it by at rest, against statics."""

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftc import WEAKEST
from ftc.fdi import Fault, NominalModel, static_share
from ftc.fdi.fault_model import static_gain
from ftc.reconfiguration import used_share
from tests.cart_runs import carts
from tests.ftc.test_servo_faults import Carts
from tests.profiles import examples

SEEDS, NUMBERS = st.integers(0, 2**16), st.integers(1, 4)
LEFT = st.floats(0.01, 1.0)


@examples(30)
@given(SEEDS, NUMBERS, LEFT)
def test_a_coil_against_its_spring_moves_by_the_part_of_its_force_that_is_left(seed, n, left):
    """The spring stays what it was, so that displacement is proportional to force."""
    for k in range(n):
        assert abs(static_share(carts(seed, n), Fault(k, "weak", left)) - left) < 1e-9


@examples(30)
@given(SEEDS, NUMBERS, LEFT)
def test_a_servo_goes_where_it_is_told_within_the_compliance_of_its_load(seed, n, left):
    """Of stiffness e k against a load s: e k / (s + e k), which of a stiff servo is almost one."""
    plant = Carts.random(n, seed)
    for k in range(n):
        others = np.where(np.arange(n) == k, 0.0, plant.kp)
        s, kp = 1 / np.linalg.inv(plant.springs + np.diag(others))[k, k], plant.kp[k]
        expected = left * (s + kp) / (s + left * kp)
        share = static_share(plant.nominal(), Fault(k, "weak", left))
        assert abs(share - expected) < 2e-3
        assert left - 1e-9 <= share <= 1 and 1 - share < s / (left * kp) + 2e-3


@examples(20)
@given(SEEDS, st.lists(st.floats(0.0, 1.0), min_size=2, max_size=6, unique=True))
def test_the_more_force_is_left_the_more_a_command_moves(seed, parts):
    """From nothing, of an actuator without force, to one, of a sound one."""
    for nominal in (carts(seed), Carts.random(2, seed).nominal()):
        found = [static_share(nominal, Fault(0, "weak", e)) for e in (0.0, *sorted(parts), 1.0)]
        assert found[0] == 0.0 and found[-1] == 1.0
        assert (np.diff(found) >= -1e-9).all()


@examples(20)
@given(SEEDS, NUMBERS)
def test_what_is_locked_or_without_force_moves_by_nothing(seed, n):
    for nominal in (carts(seed, n), Carts.random(n, seed).nominal()):
        for kind in ("locked", "free"):
            assert static_share(nominal, Fault(0, kind)) < 1e-6
            assert used_share(nominal, Fault(0, kind)) == 0.0


def test_a_mass_that_nothing_holds_is_moved_by_the_part_of_the_force_that_is_left():
    """At rest its response has no limit: the ratio does, at frequencies that go to zero."""
    plant = control.ss([[0.0, 1.0], [0.0, 0.0]], [[0.0], [3.0]], [[1.0, 0.0]], 0)
    floating = NominalModel(plant, np.eye(1, 2), np.ones(1), period_s=2e-3, step_s=1e-3)
    assert abs(static_share(floating, Fault(0, "weak", 0.3)) - 0.3) < 1e-9


@pytest.mark.parametrize("ticks_a_second", [2000, 1000, 500, 250])
def test_what_nothing_brings_to_rest_has_moved_as_far_at_any_control_rate(ticks_a_second):
    """In a hundred seconds, by 3 m/s^2 against a damper of 5 /s; a servo beside it is at rest."""
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [np.diag([0.0, -900.0]), np.diag([-5.0, -30.0])]])
    plant = control.ss(A, np.vstack([np.zeros((2, 2)), np.diag([3.0, 900.0])]), np.eye(1, 4), 0)
    slides = NominalModel(plant, np.eye(2, 4), np.ones(1), 1 / ticks_a_second, step_s=5e-4)
    np.testing.assert_allclose(static_gain(slides), np.diag([3 / 5 / 1e-2, 1.0]), rtol=3e-3)


def test_what_moves_less_than_half_of_what_it_is_told_is_not_used():
    coil, servo = carts(0), Carts.random(2, 0).nominal()
    assert used_share(coil, Fault(0, "weak", WEAKEST + 0.01)) > WEAKEST
    assert used_share(coil, Fault(0, "weak", WEAKEST - 0.01)) == 0.0
    assert used_share(servo, Fault(0, "weak", WEAKEST - 0.01)) > 0.8
