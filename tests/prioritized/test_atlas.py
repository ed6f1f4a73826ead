"""Test the failure atlas: every condition has the classification that it has alone."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas
from tests import spaces
from tests.random_systems import SEEDS, failures, pairs, rows_of, springs, systems, with_stiffness

FLAGS = (
    "unmanipulable",
    "unmanipulable_task",
    "unstable",
    "unstable_major",
    "irresolvable",
    "constrained_active",
)


def assert_classified(classes, row: int, system: ConstrainedSystem, major, secondary) -> None:
    """Compare one row of the atlas with the kinematics of that condition."""
    kin = system.kinematics()
    report = kin.manipulability(major)
    for flag in FLAGS:
        assert getattr(classes, flag)[row] == getattr(report, flag), flag
    assert classes.possible[row] == (not report.unmanipulable and not report.unstable_major)
    np.testing.assert_allclose(classes.worst_gain[row], report.worst_gain, atol=1e-7)
    # Singular values of the major task on admissible rates.
    admissible = kin.J[major] @ spaces.projector(spaces.null(kin.active_constraint))
    gains = np.zeros(len(major))
    sigma = np.linalg.svd(admissible, compute_uv=False)
    gains[: len(sigma)] = sigma[: len(major)]
    np.testing.assert_allclose(classes.gains[row], gains, atol=1e-6)
    assert classes.major_rank[row] == len(major) - report.bases["unmanipulable"].shape[1]
    # Columns of zeros do not change the projector.
    spaces.assert_same(classes.self_motion[row], kin.self_motion)

    # Secondary velocities of admissible rates without major motion.
    rates = spaces.null(np.vstack([kin.active_constraint, kin.J[major]]))
    aside = kin.J[secondary] @ rates
    assert classes.secondary_rank[row] == np.linalg.matrix_rank(aside, tol=1e-7)
    lost = spaces.projector(spaces.null(aside.T))
    np.testing.assert_allclose(spaces.projector(classes.lost_secondary[row]), lost, atol=1e-6)
    assert classes.gap[row] >= 1.0


def assert_limited(classes, row: int, system: ConstrainedSystem, major, rates, torques) -> None:
    """Compare worst speed and force of one row with the attainable sets of that condition."""
    kin = system.kinematics()
    speed, force = kin.attainable(major, rates).radius, kin.attainable_force(major, torques).radius
    np.testing.assert_allclose(classes.worst_speed[row], speed, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(classes.worst_force[row], force, rtol=1e-7, atol=1e-9)
    assert classes.possible[row] or speed == 0.0


def rigid(system: ConstrainedSystem) -> ConstrainedSystem:
    """Return the system without springs."""
    known = system.failures
    made = ConstrainedSystem(system.J_T, system.J_C, system.active)
    return made.with_failures(known.locked, known.free, known.locked_passive)


def conditions_alone(data, sample, count: int | None) -> None:
    """Compare row by row: redundant rows, self-motion, springs, existing failures, any limits."""
    system, n = sample.system, len(sample.system.active)
    elastic = data.draw(st.booleans())
    if elastic:
        R = data.draw(springs(system.J_T.shape[1], sample.rng))
        system = with_stiffness(system, R.T @ R)
    if data.draw(st.booleans()):
        system = data.draw(failures(system))
    m = len(system.J_T)
    major = rows_of(data, m)
    secondary = sorted(set(range(m)) - set(major))
    codes = None if count is None else sample.rng.integers(0, 3, size=(count, n))
    rates, torques = (data.draw(pairs(n)), data.draw(pairs(n))) if len(major) <= 3 else (None, None)
    atlas = failure_atlas(system, major, None, codes, rate_limits=rates, torque_limits=torques)
    if codes is None:
        assert atlas.codes.tolist() == [list(of) for of in itertools.product(range(3), repeat=n)]
    assert (atlas.elastic is not None) == elastic
    for row, code in enumerate(atlas.codes):
        # A free actuator of the list may already be locked.
        failed = np.flatnonzero(code == 1), np.flatnonzero(code == 2)
        for classes, of in ((atlas, rigid(system)), (atlas.elastic, system)):
            if classes is not None:
                condition = of.with_failures(*failed)
                assert_classified(classes, row, condition, major, secondary)
                if len(major) <= 3:
                    assert_limited(classes, row, condition, major, rates, torques)


@given(st.data(), systems(actives=(1, 3), tasks=(1, 3)))
def test_some_conditions_have_the_classification_they_have_alone(data, sample):
    conditions_alone(data, sample, 3)


@pytest.mark.long
@given(st.data(), systems())
def test_every_condition_has_the_classification_it_has_alone(data, sample):
    conditions_alone(data, sample, None)


@given(SEEDS, st.integers(1, 4))
def test_directions_are_as_good_as_rows(seed, m1):
    """Check that a task rotated together with its major directions has the same atlas."""
    rng = np.random.default_rng(seed)
    J_T, J_C = rng.normal(size=(4, 5)), rng.normal(size=(3, 5))
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    rows = failure_atlas(ConstrainedSystem(J_T, J_C, [0, 1, 2]), range(m1))
    turned = ConstrainedSystem(turn @ J_T, J_C, [0, 1, 2])
    directions = failure_atlas(turned, turn.T[:m1], turn.T[m1:])
    for flag in (*FLAGS, "possible", "major_rank", "secondary_rank"):
        np.testing.assert_array_equal(getattr(rows, flag), getattr(directions, flag))
    np.testing.assert_allclose(rows.worst_gain, directions.worst_gain, atol=1e-7)


def test_an_arm_of_twelve_joints_needs_a_list():
    """Check that 3^12 conditions are refused and single locks are not."""
    arm = ConstrainedSystem(np.random.default_rng(0).normal(size=(3, 12)), None, range(12))
    with pytest.raises(ValueError, match="codes must be given for 12 actuators, more than 10"):
        failure_atlas(arm, [0])
    atlas = failure_atlas(arm, [0], codes=np.eye(12, dtype=int))
    assert atlas.possible.all()
    assert atlas.row(locked=[11]) == 11
    assert not failure_atlas(arm, [0], codes=2 * np.eye(12, dtype=int)).possible.any()
    with pytest.raises(ValueError, match="must be in codes of the atlas, got actuator 0 free"):
        atlas.row(free=[0])


@given(SEEDS)
def test_each_condition_may_have_limits_of_its_own(seed):
    """Compare all conditions at once, in blocks, with one after the other."""
    rng = np.random.default_rng(seed)
    arm, codes = (
        ConstrainedSystem(rng.normal(size=(2, 4)), None, range(4)),
        rng.integers(0, 3, (3, 4)),
    )
    own = -rng.uniform(0, 2, size=(3, 4)), rng.uniform(0, 2, size=(3, 4))
    both = failure_atlas(arm, [0, 1], codes=codes, rate_limits=own, torque_limits=own)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("prioritized._analysis.worst.BLOCK", 4)
        parts = failure_atlas(arm, [0, 1], codes=codes, rate_limits=own, torque_limits=own)
    for row, code in enumerate(codes):
        limits = own[0][row], own[1][row]
        one = failure_atlas(arm, [0, 1], codes=[code], rate_limits=limits, torque_limits=limits)
        for name in ("worst_speed", "worst_force"):
            for many in (both, parts):
                result = getattr(many, name)[row]
                np.testing.assert_allclose(result, getattr(one, name)[0], rtol=1e-9)


def test_the_limits_of_failed_actuators_do_not_matter():
    """Check limits that require motion or force of a failed joint, which has none."""
    arm, limits = ConstrainedSystem(np.eye(2), None, [0, 1]), ([0.25, -1], [1, 1])
    atlas = failure_atlas(
        arm, [1], codes=[[0, 0], [1, 0]], rate_limits=limits, torque_limits=limits
    )
    assert atlas.worst_speed is not None and atlas.worst_force is not None
    np.testing.assert_allclose([atlas.worst_speed, atlas.worst_force], 1.0)
    assert arm.with_failures(locked=[0]).kinematics().attainable([1], limits).radius == 1.0


def test_a_task_without_rows_has_no_worst_speed():
    """Compare with the radius of the attainable set."""
    arm = ConstrainedSystem(np.eye(2), None, [0, 1])
    speed = failure_atlas(arm, [], rate_limits=(-1, 1)).worst_speed
    assert speed is not None and np.isposinf(speed).all()
    assert arm.kinematics().attainable([], (-1, 1)).radius == np.inf


@given(SEEDS)
def test_one_motor_moves_the_task_at_its_gain_with_soft_springs(seed):
    """Check that round-off of fast passive joints on soft springs does not constrain the motor."""
    rng = np.random.default_rng(seed)
    J_T, J_C = rng.normal(size=(1, 6)), rng.normal(size=(3, 6))
    free = spaces.null(np.vstack([J_C, np.eye(6)[5]])).T
    combined = spaces.null(free) @ rng.normal(size=4)
    R = np.vstack([rng.normal(size=6), 1.5e-3 * free[1] + combined])
    system = ConstrainedSystem(J_T, J_C, [5], stiffness=R.T @ R)
    classes = failure_atlas(system, [0], codes=[[0]], rate_limits=(-1, 1)).elastic
    assert classes is not None and classes.worst_speed is not None
    if classes.possible[0]:
        np.testing.assert_allclose(classes.worst_speed, classes.worst_gain, rtol=1e-9)


STRUTS_M = (-635e-6, 635e-6)
COILS_N = (-80.0, 80.0)


@pytest.fixture(scope="module")
def sprung(hexapod, model) -> ConstrainedSystem:
    """Return the hexapod with springs on the struts alone."""
    K = np.zeros(hexapod.J_T.shape[1])
    K[hexapod.active] = model.actuator_gainprm[:, 0]
    return with_stiffness(hexapod, np.diag(K))


def test_the_hexapod_can_point_in_54_of_729_conditions(hexapod):
    """Check the 64 sets of locks, of which 10 leave too few struts or an antipodal pair."""
    atlas = failure_atlas(hexapod, [0, 1])
    assert atlas.codes.shape == (729, 6)
    assert atlas.possible.sum() == 54
    assert atlas.gap.min() >= 1e4
    locks_only = (atlas.codes != 2).all(axis=1)
    assert not atlas.possible[~locks_only].any()
    assert atlas.unstable_major[~locks_only].all()
    pointing = hexapod.kinematics().J[:2]
    for row in np.flatnonzero(locks_only):
        left = pointing[:, atlas.codes[row] == 0]
        assert atlas.possible[row] == (np.linalg.matrix_rank(left, tol=1e-9) == 2)
    pairs = locks_only & ((atlas.codes == 1).sum(axis=1) == 4) & ~atlas.possible
    assert pairs.sum() == 3
    # Each lock of six struts removes one direction, a secondary one if possible.
    locks = (atlas.codes == 1).sum(axis=1)
    possible = atlas.possible
    np.testing.assert_array_equal(atlas.secondary_rank[possible], 4 - locks[possible])


def test_springs_on_the_struts_act_as_locks_on_free_struts(sprung):
    """Check that 64 + 6 x 32 + 3 x 16 conditions lack two healthy struts that are not antipodal."""
    elastic = failure_atlas(sprung, [0, 1]).elastic
    assert elastic is not None
    assert elastic.possible.sum() == 729 - 64 - 192 - 48
    assert not elastic.unstable.any()
    assert elastic.gap.min() >= 1e4  # the rest is rounding: 4e4 to 2e5 by processor


def test_the_hexapod_points_three_quarters_as_far_with_a_strut_locked(sprung):
    """Check half as far with two; four struts share the worst direction equally."""
    atlas = failure_atlas(sprung, [0, 1], rate_limits=STRUTS_M, torque_limits=COILS_N)
    assert atlas.elastic is not None and atlas.elastic.worst_speed is not None
    speed, force = atlas.worst_speed, atlas.worst_force
    assert speed is not None and force is not None
    healthy, one, free = atlas.row(), atlas.row(locked=[0]), atlas.row(free=[0])
    assert speed[healthy] == pytest.approx(4.42e-3, abs=5e-6)
    kinds = (atlas.codes == 1).sum(axis=1), (atlas.codes == 2).sum(axis=1)
    for locks, fraction in ((0, 1.0), (1, 0.75), (2, 0.5)):
        left = speed[(kinds[0] == locks) & (kinds[1] == 0)] / speed[healthy]
        np.testing.assert_allclose(left, fraction)
    elastic = atlas.elastic.worst_speed
    np.testing.assert_allclose(elastic[free], elastic[one], rtol=1e-9)
    assert speed[free] == 0.0
    # A locked strut bears the force of its coil; without it the moment decreases as the speed.
    assert force[healthy] == pytest.approx(45.98, abs=0.01)
    assert force[one] == pytest.approx(force[healthy])
    assert force[free] == pytest.approx(34.48, abs=0.01)
    assert (speed > 0).sum() == atlas.possible.sum() == 54
