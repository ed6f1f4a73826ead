"""Test the recovery by reversing the opposite motor: PX4-Autopilot, pull request 28078."""

import numpy as np
import pytest

from prioritized import ConstrainedSystem
from tests.published.faces import ARM, DRAG, LARGEST, WEIGHT, distances, effectiveness

IN_PX4 = 0.4
"""Default of CA_REV_THR_FRAC: "a standard prop has about 40 %" of its thrust in reverse."""

PAIR = 3 * DRAG * ARM * LARGEST / np.hypot(2 * DRAG, ARM)
"""Distance of hover from a face that only two opposite motors change, all motors healthy."""
YAW = 2 * DRAG * (2 * LARGEST - WEIGHT / 2) / np.hypot(1, DRAG)
"""Distance from the face of the two remaining motors of one sense without the third."""


@pytest.mark.parametrize("lost", range(6))
def test_a_fraction_of_thrust_restores_that_fraction_of_authority(authority, lost):
    assert authority("PNPNPN") == pytest.approx(PAIR, abs=1e-12)
    for x in (IN_PX4, *np.linspace(0, 1, 21)):
        left = authority("PNPNPN", [lost], reverse=((lost + 3) % 6, x))
        assert left == pytest.approx(min(x * PAIR, YAW), abs=1e-12)


@pytest.mark.parametrize("turns", ["PNPNPN", "PPNNPN"])
@pytest.mark.parametrize("x", [0.1, IN_PX4, 1.0])
def test_every_motor_restores_the_authority_of_the_formula_of_du_et_al(authority, turns, x):
    B, hover = effectiveness(turns), np.array([WEIGHT, 0, 0, 0])
    for lost, motor in ((0, 3), (1, 4), (1, 5), (4, 2)):
        upper = np.where(np.arange(6) == lost, 0.0, LARGEST)
        lower = np.where(np.arange(6) == motor, -x * LARGEST, 0.0)
        expected = max(distances(B, hover, lower, upper).min(), 0.0)
        assert authority(turns, [lost], reverse=(motor, x)) == pytest.approx(expected, abs=1e-9)


def test_a_stopped_opposite_motor_leaves_equal_pitch_and_yaw():
    system = ConstrainedSystem(effectiveness("PNPNPN"), None, range(6))
    kin = system.with_failures(locked=[0, 3]).kinematics()
    report = kin.manipulability([0, 1, 2, 3])
    (lost,) = report.bases["unmanipulable"].T
    assert lost[:2] == pytest.approx(0, abs=1e-12) and abs(lost[2:]).min() > 0.1
    assert not kin.manipulability([0, 1, 2]).unmanipulable


def test_on_the_other_hexacopter_a_neighbour_helps_and_the_opposite_does_not(authority):
    healthy, without = authority("PPNNPN"), authority("PPNNPN", [1])
    assert round(100 * without / healthy) == 40
    assert authority("PPNNPN", [1], reverse=(4, 1.0)) == pytest.approx(without, abs=1e-12)
    for x in (0.2, 1.0):
        assert round(100 * authority("PPNNPN", [1], reverse=(5, x)) / healthy) == 64
