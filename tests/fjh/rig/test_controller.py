"""The hexapod's controller: its loops, and its mapping through the exact geometry."""

import numpy as np
import pytest

from fjh.rig.hexapod.closed_form import hexapod
from fjh.rig.hexapod.controller import StrutMapping, nominal_loops
from fjh.rig.hexapod.detector import pointing_angles
from fjh.rig.hexapod.testbed import TestbedConfig
from ftc import Goal
from sim import NOMINAL

EQUAL = (1.0,) * 6
BENCH = TestbedConfig()


@pytest.fixture(scope="module")
def loops(model):
    return nominal_loops(model, BENCH)


def test_the_loops_have_textbook_margins_at_the_crossovers_asked_for(loops):
    for loop, crossover in zip(loops, BENCH.crossover_hz, strict=True):
        assert loop.crossover_hz == pytest.approx(crossover, rel=1e-3)
        assert loop.gain_margin_db > 6.0
        assert loop.phase_margin_deg > 45.0


@pytest.mark.parametrize("locked", [{}, {0: 0.0}, {3: 2e-4}])
def test_commanded_displacements_point_where_asked(model, locked):
    """Forward through the exact geometry; a strut stuck off centre is a known offset."""
    machine, asked = hexapod(model), np.array([8e-5, -5e-5])
    weighted, plain = (
        StrutMapping(machine, Goal(secondary_weight=weight, locked_at=locked), "analytic")
        for weight in ((10.0, 10.0, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0))
    )
    command, pose = np.zeros(6), NOMINAL
    for _ in range(4):  # the estimate settles in a tick or two
        command = weighted.displacements(asked, pose)
        pose = weighted.estimate(command, pose)
    assert all(command[k] == 0.0 for k in locked)
    lengths = command + [locked.get(k, 0.0) for k in range(6)]
    np.testing.assert_allclose(machine.displacements(pose), lengths, atol=1e-12)
    # J(x) l against the true x: the difference is of second order in the displacement.
    scale = np.abs(lengths).max()
    np.testing.assert_allclose(pointing_angles(pose.rotation), asked, atol=50 * scale**2 + 1e-9)
    translation = [
        np.linalg.norm(m.estimate(m.displacements(asked, pose), pose).translation_m[:2])
        for m in (weighted, plain)
    ]
    assert translation[0] <= translation[1] + 1e-12


def test_the_constant_jacobian_is_the_analytic_one_at_the_nominal_pose(model):
    analytic, constant = (
        StrutMapping(hexapod(model), Goal(joint_weight=EQUAL), choice)
        for choice in ("analytic", "constant")
    )
    moved = NOMINAL.moved(np.array([0.01, 0, 0, 0.001, 0, 0]))
    for name, value in (
        ("displacements", np.array([1e-4, 2e-5])),
        ("major_motion", np.linspace(0, 5e-6, 6)),
    ):
        at = getattr(constant, name)
        nominal, other = at(value, NOMINAL), getattr(analytic, name)
        np.testing.assert_array_equal(at(value, moved), nominal)
        np.testing.assert_array_equal(other(value, NOMINAL), nominal)
        assert np.abs(other(value, moved) - nominal).max() > 1e-8
