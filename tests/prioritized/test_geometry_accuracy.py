"""The rank tolerance as what it is, the accuracy of the geometry."""

import dataclasses

import numpy as np
import pytest

from prioritized import ConstrainedSystem, Manipulability, failure_atlas, velocity_mapping
from prioritized._solver.rank import RANK_TOLERANCE

ANCHOR_AXES = [0, 3, 6]
IN_PLANE = [2, 3, 4]
"""Of a twist: the turn about z, and x, y."""


def planar_3rrr(rng: np.random.Generator, accuracy: float) -> tuple[np.ndarray, np.ndarray]:
    """J_T (6, 9) and J_C (12, 9), in spatial form, of three legs of three parallel hinges each.

    Legs of random length and angle; each axis is off by an angle, each point by a length.
    """
    legs = []
    for k in range(3):
        around, elbow = 2 * np.pi * k / 3, rng.uniform(0, 2 * np.pi)
        anchor = np.array([np.cos(around), np.sin(around), 0.0])
        corner = 0.3 * np.array([np.cos(around + 0.4), np.sin(around + 0.4), 0.0])
        knee = anchor + rng.uniform(0.4, 0.9) * np.array([np.cos(elbow), np.sin(elbow), 0.0])
        axes = np.array([0.0, 0.0, 1.0]) + accuracy * rng.uniform(-1, 1, size=(3, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        points = np.array([anchor, knee, corner]) + accuracy * rng.uniform(-1, 1, size=(3, 3))
        legs.append(np.hstack([axes, np.cross(points, axes)]).T)
    A, B, C = legs
    none = np.zeros((6, 3))
    return np.hstack([A, none, none]), np.block([[A, -B, none], [A, none, -C]])


def moves_freely(report: Manipulability) -> bool:
    """Three degrees of freedom, of which the three actuators determine every one."""
    conditions = ("constrained_active", "unstable", "idle", "unmanipulable")
    return not any(getattr(report, name) for name in conditions)


@pytest.mark.parametrize("accuracy", [1e-8, 1e-6])
def test_a_planar_mechanism_moves_although_its_axes_are_not_quite_parallel(accuracy):
    """At 1e-10 the errors are constraints; at ten times the accuracy they are none, by far."""
    draws = 0
    for seed in range(100):
        exact = planar_3rrr(np.random.default_rng(seed), 0.0)
        at_ease = ConstrainedSystem(*exact, ANCHOR_AXES, geometry_accuracy=accuracy).kinematics()
        if min(at_ease.manipulability(IN_PLANE).gaps.values()) < 10:
            continue  # singular to within the accuracy
        draws += 1
        assert moves_freely(at_ease.manipulability(IN_PLANE))
        J_T, J_C = planar_3rrr(np.random.default_rng(seed), accuracy)
        system = ConstrainedSystem(J_T, J_C, ANCHOR_AXES, geometry_accuracy=accuracy)
        report = system.kinematics().manipulability(IN_PLANE)
        assert moves_freely(report)
        assert report.gaps["constrained_active"] > 5
        atlas = failure_atlas(system, IN_PLANE, codes=[[0, 0, 0]])
        assert atlas.possible[0]
        assert not atlas.constrained_active[0]
        default = ConstrainedSystem(J_T, J_C, ANCHOR_AXES).kinematics().manipulability(IN_PLANE)
        assert default.constrained_active
        assert default.unmanipulable
    assert draws > 90


def test_it_sets_the_tolerance_and_stays_visible():
    system = ConstrainedSystem(np.eye(2), None, [0, 1], geometry_accuracy=1e-6)
    assert system.geometry_accuracy == 1e-6
    assert system.rank_tolerance == pytest.approx(1e-5)
    failed = dataclasses.replace(system, J_T=2 * np.eye(2)).with_failures(locked=[0])
    assert (failed.geometry_accuracy, failed.rank_tolerance) == (1e-6, system.rank_tolerance)
    assert ConstrainedSystem(np.eye(2), None, [0, 1]).geometry_accuracy is None
    # Round-off is there however exact the geometry.
    exact = ConstrainedSystem(np.eye(2), None, [0, 1], geometry_accuracy=0.0)
    assert exact.rank_tolerance == RANK_TOLERANCE


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"geometry_accuracy": 1e-6, "rank_tolerance": 1e-8}, "with another rank_tolerance, got"),
        ({"geometry_accuracy": -1e-6}, r"^geometry_accuracy must be from 0 to 0\.05"),
        ({"geometry_accuracy": 0.1}, r"^geometry_accuracy must be from 0 to 0\.05, got 0\.1"),
        ({"geometry_accuracy": np.nan}, "^geometry_accuracy must be finite"),
        ({"geometry_accuracy": "fine"}, "^geometry_accuracy must hold real numbers"),
    ],
)
def test_an_accuracy_that_is_none_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        ConstrainedSystem(np.eye(2), None, [0, 1], **arguments)


@pytest.mark.parametrize("batched", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_joint_weights_are_exact_whatever_the_geometry(seed, batched):
    """A hot actuator spared 1e5 times as much as another, on a robot known to 1e-4."""
    rng = np.random.default_rng(seed)
    J, target = rng.normal(size=(2, 5)), rng.normal(size=2)
    J = np.stack([J, J]) if batched else J
    weight = np.array([1.0, 2.0, 3.0, 1e5, 0.5])
    rates = {
        tolerance: velocity_mapping(J, [0, 1], joint_weight=weight, rank_tolerance=tolerance)
        for tolerance in (1e-10, 1e-3)
    }
    np.testing.assert_allclose(rates[1e-3].major, rates[1e-10].major, rtol=1e-9)
    np.testing.assert_allclose(rates[1e-3](target), rates[1e-10](target), rtol=1e-9)
