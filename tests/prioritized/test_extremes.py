"""Numbers near the ends of what floats hold, hidden numbers, and batches where none can be."""

import numpy as np
import pytest

from prioritized import ConstrainedSystem, Status, failure_atlas, force_mapping, velocity_mapping

RNG = np.random.default_rng(5)
J = RNG.normal(size=(3, 4))
SYSTEM = ConstrainedSystem(J, None, [0, 1, 2, 3])
V = np.array([0.3, -0.2])
SIZES = (5e-324, 1e-310, 1e-308, 1e-200, 1e-60, 1e60, 1e110)


@pytest.mark.parametrize("size", SIZES)
def test_a_common_factor_of_all_weights_changes_nothing_however_small_or_large(size):
    """Ratios of 1, 2 and 4 are exact even among denormals; all at 1e-309 gave NaN, called exact."""
    W1, W2 = np.array([1.0, 2.0, 4.0, 1.0]), np.array([2.0])
    plain = velocity_mapping(J, [0, 1], joint_weight=W1, secondary_weight=W2)
    scaled = velocity_mapping(J, [0, 1], joint_weight=size * W1, secondary_weight=size * W2)
    assert scaled.status is Status.EXACT
    np.testing.assert_allclose(scaled(V, np.ones(4), [0.1]), plain(V, np.ones(4), [0.1]), rtol=1e-9)
    np.testing.assert_allclose(scaled.joint, plain.joint, atol=1e-9)
    one, same = (force_mapping(J, [0], torque_weight=factor * W1) for factor in (1.0, size))
    np.testing.assert_allclose(same([1.0], np.ones(4)), one([1.0], np.ones(4)), rtol=1e-9)


@pytest.mark.parametrize("size", SIZES)
def test_a_common_factor_of_the_tie_metric_changes_nothing(size):
    T = np.array([1.0, 2.0, 4.0, 1.0])
    plain, scaled = (velocity_mapping(J, [0], tie_metric=factor * T) for factor in (1.0, size))
    np.testing.assert_allclose(scaled([1.0]), plain([1.0]), rtol=1e-9)


def test_each_of_a_batch_of_weights_has_a_factor_of_its_own():
    W = np.stack([np.diag([1.0, 2.0, 4.0, 1.0])] * 3)
    factors = np.array([1.0, 1e-310, 1e60])[:, None, None]
    rates = velocity_mapping(J, [0, 1], joint_weight=factors * W)(V)
    np.testing.assert_allclose(rates, velocity_mapping(J, [0, 1], joint_weight=W)(V), rtol=1e-9)


def test_one_jacobian_serves_a_batch_of_weights_as_it_serves_each_of_them():
    """Asked for its rates alone, such a mapping raised numpy's words."""
    W1, W2 = RNG.normal(size=(2, 4, 4)), RNG.normal(size=(2, 1, 1))
    rates = velocity_mapping(J, [0, 1], joint_weight=W1, secondary_weight=W2)(V)
    for k in range(2):
        alone = velocity_mapping(J, [0, 1], joint_weight=W1[k], secondary_weight=W2[k])
        np.testing.assert_allclose(rates[k], alone(V), rtol=1e-9)


def test_a_batch_whose_rows_are_all_major_is_answered():
    """There is no secondary task then, and that raised numpy's words."""
    batch = RNG.normal(size=(2, 3, 4))
    rates = velocity_mapping(batch, [0, 1, 2], joint_weight=np.ones(4))(np.ones(3))
    np.testing.assert_allclose(np.einsum("bij,bj->bi", batch, rates), 1.0)


@pytest.mark.parametrize("size", [5e-324, 1e-310, 1e-130, 1e130, 1e308])
def test_a_mechanism_of_a_size_that_products_cannot_carry_is_refused_by_name(size):
    for name, build in (
        ("J", lambda A: velocity_mapping(A, [0])),
        ("J", lambda A: velocity_mapping(np.stack([J, A]), [0])),
        ("J", lambda A: force_mapping(A, [0])),
        ("J_T", lambda A: ConstrainedSystem(A, None, [0])),
        ("J_C", lambda A: ConstrainedSystem(J, A, [0])),
        ("active_constraint", lambda A: velocity_mapping(J, [0], active_constraint=A)),
        ("stiffness", lambda A: ConstrainedSystem(J, None, [0], stiffness=np.abs(A[0]))),
        ("passive_metric", lambda A: SYSTEM.kinematics(passive_metric=np.abs(A[0]))),
        ("major_metric", lambda A: velocity_mapping(J, [0, 1, 2], major_metric=A[:, :3])),
    ):
        with pytest.raises(ValueError, match=f"^{name} must be .*1e[+-]120"):
            build(size * np.sign(J))


def test_sizes_whose_product_overflows_are_refused_before_lapack_sees_them():
    huge = 1e119
    with np.errstate(all="ignore"), pytest.raises(ValueError, match="got an overflow"):
        velocity_mapping(huge * J, huge * J[:1, :3], [1], major_metric=[huge]).rank  # noqa: B018


def masked(good: np.ndarray) -> np.ma.MaskedArray:
    return np.ma.array(good, mask=np.arange(np.size(good)).reshape(np.shape(good)) == 0)


@pytest.mark.parametrize("hide", [masked, lambda A: [masked(row) for row in np.atleast_2d(A)]])
def test_numbers_behind_a_mask_are_not_taken_for_data(hide):
    mapping = velocity_mapping(J, [0], joint_weight=np.ones(4))
    for name, call in (
        ("J", lambda: velocity_mapping(hide(J), [0])),
        ("joint_weight", lambda: velocity_mapping(J, [0], joint_weight=hide(np.eye(4)))),
        ("v_major", lambda: mapping(hide(np.ones((2, 1))))),
        ("major", lambda: velocity_mapping(J, hide(J[:1, :3]))),
        ("J_T", lambda: ConstrainedSystem(hide(J), None, [0])),
        ("codes", lambda: failure_atlas(SYSTEM, [0], codes=hide(np.zeros((1, 4))))),
    ):
        with pytest.raises(ValueError, match=f"^{name} must have all its numbers|^{name} must be"):
            call()
    for indices in (masked(np.array([0, 1])), [np.ma.masked, 1]):
        with pytest.raises(ValueError, match="active must be a list of integers"):
            ConstrainedSystem(J, None, indices)
        with pytest.raises(ValueError, match="locked must be a list of integers"):
            SYSTEM.with_failures(locked=indices)


@pytest.mark.parametrize("name", ["J_T", "J_C"])
def test_a_system_stands_at_one_pose_at_a_time(name):
    """A batch passed, and broke kinematics()."""
    with pytest.raises(ValueError, match=rf"^{name} must be one matrix, got shape \(2, 3, 4\)"):
        SYSTEM.at(**{name: np.stack([J, J])})


def test_lists_whose_rows_differ_are_refused_by_name():
    ragged = [0, [1, 2]]
    for name, call in (
        ("locked", lambda: SYSTEM.with_failures(locked=ragged)),
        ("free", lambda: SYSTEM.with_failures(free=ragged)),
        ("locked_passive", lambda: SYSTEM.with_failures(locked_passive=ragged)),
        ("active", lambda: ConstrainedSystem(J, None, ragged)),
        ("scale", lambda: velocity_mapping(J, [0], scale=ragged)),
        ("major", lambda: velocity_mapping(J, ragged)),
    ):
        with pytest.raises(ValueError, match=f"^{name} must be a (list|rectangular)"):
            call()


def test_a_scale_for_another_number_of_jacobians_is_refused():
    with pytest.raises(
        ValueError, match=r"leading axes must broadcast, got J \(2,\), scale \(3,\)"
    ):
        velocity_mapping(np.stack([J, J]), [0], scale=np.ones(3))


def test_things_of_another_kind_are_refused_by_name():
    mapping = SYSTEM.kinematics().velocity_mapping([0])
    for name, call in (
        ("system", lambda: failure_atlas(J, [0])),  # pyright: ignore[reportArgumentType]
        ("kinematics", lambda: mapping.at(J)),  # pyright: ignore[reportArgumentType]
        ("failures", lambda: ConstrainedSystem(J, None, [0], failures=[0])),  # pyright: ignore[reportArgumentType]
    ):
        with pytest.raises(TypeError, match=f"^{name} must be a "):
            call()
