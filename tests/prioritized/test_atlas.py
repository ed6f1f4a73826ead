"""The failure atlas: every condition at once says what each says alone."""

import itertools

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas
from sim import jacobians
from tests.random_systems import (
    SEEDS,
    failures,
    null,
    projector,
    rows_of,
    springs,
    systems,
    with_stiffness,
)

FLAGS = (
    "unmanipulable",
    "unmanipulable_task",
    "unstable",
    "unstable_major",
    "irresolvable",
    "constrained_active",
)


def assert_says(classes, row: int, system: ConstrainedSystem, major, secondary) -> None:
    """One row of the atlas against the kinematics of that one condition."""
    kin = system.kinematics()
    report = kin.manipulability(major)
    for flag in FLAGS:
        assert getattr(classes, flag)[row] == getattr(report, flag), flag
    assert classes.possible[row] == (not report.unmanipulable and not report.unstable_major)
    np.testing.assert_allclose(classes.worst_gain[row], report.worst_gain, atol=1e-7)
    # Singular values of the major task on the rates that the loops admit.
    admissible = kin.J[major] @ projector(null(kin.active_constraint))
    gains = np.zeros(len(major))
    sigma = np.linalg.svd(admissible, compute_uv=False)
    gains[: len(sigma)] = sigma[: len(major)]
    np.testing.assert_allclose(classes.gains[row], gains, atol=1e-6)
    assert classes.major_rank[row] == len(major) - report.bases["unmanipulable"].shape[1]
    # Padding with zeros leaves the projector as it is.
    moved = projector(classes.self_motion[row])
    np.testing.assert_allclose(moved, projector(kin.self_motion), atol=1e-6)

    # Secondary velocities at will: what admissible rates make while the major task stands still.
    rates = null(np.vstack([kin.active_constraint, kin.J[major]]))
    aside = kin.J[secondary] @ rates
    assert classes.secondary_rank[row] == np.linalg.matrix_rank(aside, tol=1e-7)
    lost = projector(null(aside.T))
    np.testing.assert_allclose(projector(classes.lost_secondary[row]), lost, atol=1e-6)
    assert classes.gap[row] >= 1.0


@pytest.mark.long
@given(st.data(), systems(), st.booleans())
def test_each_condition_gets_the_verdict_it_gets_alone(data, drawn, elastic):
    """Redundant rows, self-motion, springs, failures already there: row by row the same."""
    system, n = drawn.system, len(drawn.system.active)
    if elastic:
        R = data.draw(springs(system.J_T.shape[1], drawn.rng))
        system = with_stiffness(system, R.T @ R)
    if data.draw(st.booleans()):
        system = data.draw(failures(system))
    m = len(system.J_T)
    major = rows_of(data, m)
    secondary = sorted(set(range(m)) - set(major))
    atlas = failure_atlas(system, major)
    assert atlas.codes.tolist() == [list(code) for code in itertools.product(range(3), repeat=n)]
    rigid = ConstrainedSystem(system.J_T, system.J_C, system.active).with_failures(
        system.failures.locked, system.failures.free, system.failures.locked_passive
    )
    assert (atlas.elastic is not None) == elastic
    for row, code in enumerate(atlas.codes):
        locked, free = np.flatnonzero(code == 1), np.flatnonzero(code == 2)
        # One by one: a free actuator of the list may already be locked.
        assert_says(atlas, row, rigid.with_failures(locked, free), major, secondary)
        if atlas.elastic is not None:
            assert_says(atlas.elastic, row, system.with_failures(locked, free), major, secondary)


@given(st.data(), systems(actives=(2, 4)))
def test_a_list_of_conditions_gets_the_rows_of_the_whole(data, drawn):
    """Any conditions, in any order, repeated: each row stands alone."""
    n, m = len(drawn.system.active), len(drawn.system.J_T)
    major = rows_of(data, m)
    codes = data.draw(
        st.lists(st.lists(st.integers(0, 2), min_size=n, max_size=n), min_size=1, max_size=5)
    )
    whole, some = (
        failure_atlas(drawn.system, major),
        failure_atlas(drawn.system, major, None, codes),
    )
    np.testing.assert_array_equal(some.codes, codes)
    for row, code in enumerate(codes):
        locked, free = ([k for k in range(n) if code[k] == what] for what in (1, 2))
        at = whole.row(locked, free)
        assert whole.codes[at].tolist() == code
        for flag in (*FLAGS, "possible", "major_rank", "secondary_rank"):
            assert getattr(some, flag)[row] == getattr(whole, flag)[at]
        np.testing.assert_allclose(some.worst_gain[row], whole.worst_gain[at], atol=1e-9)
    if codes[0] not in codes[1:]:
        assert some.row(*([k for k in range(n) if codes[0][k] == what] for what in (1, 2))) == 0


@given(SEEDS, st.integers(1, 4))
def test_directions_are_as_good_as_rows(seed, m1):
    """The task turned, the major directions with it: the same mechanism, the same atlas."""
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
    """3^12 conditions do not fit; those of single locks do."""
    arm = ConstrainedSystem(np.random.default_rng(0).normal(size=(3, 12)), None, range(12))
    with pytest.raises(ValueError, match="codes must be given for more than 10 actuators"):
        failure_atlas(arm, [0])
    atlas = failure_atlas(arm, [0], codes=np.eye(12, dtype=int))
    assert atlas.possible.all()
    assert atlas.row(locked=[11]) == 11
    assert not failure_atlas(arm, [0], codes=2 * np.eye(12, dtype=int)).possible.any()


@pytest.fixture(scope="module")
def hexapod(model) -> ConstrainedSystem:
    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active)


def test_54_of_the_729_conditions_of_the_hexapod_can_still_point(hexapod):
    """A released strut gives way under the payload, so only the 64 sets of locks are in question.

    Of these 10 leave fewer than two independent pointing directions: 1 with no strut left, 6 with
    one, and 3 with two struts that push the same way, an antipodal pair.
    """
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
    # Six struts for six freedoms: each lock costs one direction, of the secondary while it can.
    locks = (atlas.codes == 1).sum(axis=1)
    possible = atlas.possible
    np.testing.assert_array_equal(atlas.secondary_rank[possible], 4 - locks[possible])


def test_springs_on_the_struts_alone_hold_released_struts_as_locks_would(hexapod):
    """A pointing hexapod needs two sound struts that are no antipodal pair, and nothing else.

    Of 729 conditions 64 have no sound strut, 6 x 32 have one, 3 x 16 just an antipodal pair.
    """
    K = np.zeros(hexapod.J_T.shape[1])
    K[hexapod.active] = 1e4
    elastic = failure_atlas(with_stiffness(hexapod, np.diag(K)), [0, 1]).elastic
    assert elastic is not None
    assert elastic.possible.sum() == 729 - 64 - 192 - 48
    assert not elastic.unstable.any()
    assert elastic.gap.min() >= 1e4  # what is nil is rounding: 4e4 to 2e5 by processor


def test_an_atlas_tells_where_it_is_asked_for_what_it_does_not_hold():
    system = ConstrainedSystem(np.eye(2), None, [0, 1])
    atlas = failure_atlas(system, [0], codes=[[0, 1]])
    assert atlas.row(locked=[1]) == 0
    with pytest.raises(ValueError, match=r"the atlas holds no condition \[2, 0\]"):
        atlas.row(free=[0])
    with pytest.raises(ValueError, match=r"locked must lie in 0\.\.1, got \[2\]"):
        atlas.row(locked=[2])
    with pytest.raises(ValueError, match=r"either locked or free, got both for \[1\]"):
        atlas.row(locked=[1], free=[1])
