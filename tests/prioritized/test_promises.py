"""What results promise: gaps that bound the verdict, axes of a batch, data that stay."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Status, failure_atlas, force_mapping, velocity_mapping
from prioritized._mechanism.failures import Failures


@given(st.floats(-9, 0))
def test_a_fast_passive_joint_that_the_task_does_not_see_hides_nothing(exponent):
    """The rotor of a screw of any lead: it turns fast, and no task row knows."""
    lead = 10.0**exponent
    system = ConstrainedSystem([[1, 0, 0], [0, 1e-5, 0]], [[1, 0, -lead]], [0, 1])
    report = system.kinematics().manipulability([0, 1])
    assert not report.unmanipulable
    assert system.kinematics().velocity_mapping([0, 1]).status is Status.EXACT
    assert failure_atlas(system, [0, 1]).possible[0]


@given(st.floats(-13, -7), st.booleans())
def test_no_verdict_is_safer_than_the_decision_that_closes_the_loop(exponent, more):
    """Whether a loop holds a passive joint at all is decided first; every verdict rests on it."""
    weak = 10.0**exponent
    t = 2e-10 if more else 1e-10
    system = ConstrainedSystem([[1, 1]], [[1, weak]], [0], rank_tolerance=t)
    report = system.kinematics().manipulability([0])
    distance = max(weak / t, t / weak)
    for name, gap in report.gaps.items():
        assert gap <= 1.01 * distance, name
    assert float(system.kinematics().velocity_mapping([0]).gap) <= 1.01 * distance
    assert float(system.kinematics().force_mapping([0]).gap) <= 1.01 * distance


@pytest.mark.parametrize("w", [1e9, 1e11])
def test_a_goal_weighed_away_shows_in_the_gap(w):
    """Beside a secondary weight of 1e11 a joint weight of one counts as zero: the gap warns."""
    J = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    velocity = velocity_mapping(J, [0], joint_weight=np.ones(3), secondary_weight=[w])
    assert velocity([0.0], joint_velocity=[0.0, 0.0, 5.0])[2] == pytest.approx(5.0 * (w < 1e10))
    assert float(velocity.gap) < 20.0


def test_damping_is_of_the_major_task_alone():
    """Its share of the rates is bounded; what a near-singular secondary goal asks for is not."""
    J = [[1.0, 0.0, 0.0], [1.0, 1e-6, 0.0]]
    damped = velocity_mapping(J, [0], secondary_weight=[1.0], damping=0.1)
    share = velocity_mapping(J, [0], damping=0.1)([1.0])
    assert np.linalg.norm(share) <= 1 / (2 * 0.1)
    assert np.linalg.norm(damped([1.0])) > 1e5
    tamed = velocity_mapping(J, [0], joint_weight=np.ones(3), secondary_weight=[1.0], damping=0.1)
    assert np.linalg.norm(tamed([1.0])) <= 1 / (2 * 0.1)


@given(st.integers(0, 2**32 - 1), st.floats(-10, 10))
def test_what_closures_bear_is_in_balance_in_any_unit_of_theirs(seed, exponent):
    """A stuck joint's reaction is not weighed against the units of J_C."""
    rng, unit = np.random.default_rng(seed), 10.0**exponent
    J_T, J_C = rng.normal(size=(2, 6)), unit * rng.normal(size=(3, 6))
    system = ConstrainedSystem(J_T, J_C, range(4)).with_failures(locked=[0])
    kin = system.kinematics()
    mapping = kin.force_mapping([0], None, np.ones(3), np.ones(1))
    torques, f_s = mapping([1.0], rng.normal(size=3)), mapping.secondary_force([1.0])
    f = np.append(1.0, f_s)
    torques = mapping([1.0])
    f_C = kin.constraint_force(f, torques)
    on_joints = J_T.T @ f + np.vstack([J_C, np.eye(6)[:1]]).T @ f_C
    # Round-off grows with the unit of the reaction's row beside that of J_C.
    tolerance = 1e-7 * max(1.0, unit * 1e-4)
    np.testing.assert_allclose(on_joints[kin.active], torques, atol=tolerance)
    np.testing.assert_allclose(on_joints[kin.passive], 0, atol=tolerance)


def test_the_gap_of_a_passive_metric_is_told():
    """Inertias of 1e-11 and 3e-11 beside one: the first counts as none, and little decides it."""
    system = ConstrainedSystem([[1, 0, 0, 0]], [[1, 1, 1, 0]], [0])
    kin = system.kinematics(passive_metric=[0, 1e-11, 3e-11, 1])
    assert kin.gap < 10.0
    assert system.kinematics(passive_metric=[0, 1, 3, 1]).gap > 1e9


def test_results_cannot_be_written_to():
    """A report shares its bases with the mechanism: whoever zeroed one would open a loop."""
    system = ConstrainedSystem(np.ones((1, 3)), [[1, -1, 0]], [0, 1])
    kin = system.kinematics()
    report, atlas = kin.manipulability([0]), failure_atlas(system, [0])
    velocity, force = kin.velocity_mapping([0]), kin.force_mapping([0])
    arrays = [*report.bases.values(), kin.J, kin.active_constraint, velocity.major, velocity.rank]
    arrays += [force.major, force.reaction, atlas.possible, atlas.codes, system.J_T]
    for A in arrays:
        with pytest.raises(ValueError, match="read-only"):
            A[...] = 0


def test_a_mechanism_keeps_its_failures_at_another_pose():
    system = ConstrainedSystem(np.eye(2), None, [0, 1]).with_failures(locked=[0])
    moved = dataclasses.replace(system, J_T=2 * np.eye(2))
    assert moved.failures == Failures(locked=frozenset({0}))
    np.testing.assert_array_equal(moved.kinematics().J, [[0.0], [2.0]])
    with pytest.raises(ValueError, match=r"locked must lie in 0\.\.1, got \[7\]"):
        ConstrainedSystem(np.eye(2), None, [0, 1], failures=Failures(locked=frozenset({7})))


@pytest.mark.parametrize("argument", ["active_constraint", "self_motion", "tie_metric", "weight"])
def test_an_answer_has_every_batch_axis_whatever_it_depends_on(argument):
    J = np.arange(6.0).reshape(2, 3)
    reference: dict[str, Any] = {
        argument: np.zeros((5, 2, 1) if argument == "self_motion" else (5, 0, 3))
    }
    velocity = velocity_mapping(J, [0], **{_joint(name): A for name, A in reference.items()})
    force = force_mapping(J, [0], **{_torque(name): A for name, A in reference.items()})
    for answer in (velocity, force):
        assert answer.rank.shape == answer.gap.shape == (5,)
        assert answer.major.shape == (5, 3, 1)
        assert answer.achieved.shape == (5, 1, 1)
    assert force.reaction.shape == (5, 2, 2)


def _joint(name: str) -> str:
    return name.replace("weight", "joint_weight")


def _torque(name: str) -> str:
    return name.replace("weight", "torque_weight")


def test_results_can_be_compared_and_kept_in_sets():
    kin = ConstrainedSystem(np.eye(2), None, [0, 1]).kinematics()
    mapping = kin.velocity_mapping([0])
    assert kin != ConstrainedSystem(np.eye(2), None, [0, 1]).kinematics()
    assert len({kin, mapping, kin.manipulability([0])}) == 3


def test_major_directions_and_their_complement_are_split_by_the_same_tolerance():
    """Two directions that differ by 3e-10 are one at 1e-8, and the rest is secondary."""
    mapping = velocity_mapping(np.eye(2), [[1, 0], [1, 3e-10]], rank_tolerance=1e-8)
    assert mapping.rank == 1
    assert mapping.secondary.shape == (2, 1)


def test_numbers_at_the_edge_of_what_floats_hold_are_answered_or_refused():
    """Denormals count as zero; a norm that overflows is no scale."""
    tiny = velocity_mapping([[1, 0], [0, 1e-320]], [0, 1])
    assert tiny.rank == 1
    assert ConstrainedSystem(np.eye(2), [[1, 1e-320]], [0]).kinematics().self_motion.shape == (2, 1)
    with np.errstate(over="ignore"), pytest.raises(ValueError, match="J must be smaller than 1e"):
        velocity_mapping(1e200 * np.eye(2), [0])
