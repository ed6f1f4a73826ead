"""Test failures, section 2.3, against a model that is rebuilt explicitly."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Kinematics, Task, velocity_mapping
from tests import spaces
from tests.random_systems import SEEDS, failures, systems


def assert_same_mechanism(one: Kinematics, two: Kinematics, atol: float = 1e-7) -> None:
    """Assert equal Jacobians on admissible rates, and equal spaces up to the choice of basis."""
    np.testing.assert_array_equal(one.active, two.active)
    np.testing.assert_array_equal(one.passive, two.passive)
    Z = spaces.null(one.active_constraint)
    np.testing.assert_allclose(one.J @ Z, two.J @ Z, atol=atol)
    np.testing.assert_allclose(one.passive_gain @ Z, two.passive_gain @ Z, atol=atol)
    for name in ("self_motion", "passive_self_motion"):
        spaces.assert_same(getattr(one, name), getattr(two, name), atol)
    for name in ("internal_force", "active_constraint"):
        spaces.assert_same(getattr(one, name).T, getattr(two, name).T, atol)
    forces = np.eye(len(one.J))
    np.testing.assert_allclose(
        one.constraint_force(forces), two.constraint_force(forces), atol=atol
    )


@given(st.data(), systems())
def test_a_mixture_of_failures_is_the_printed_model_with_unit_rows(data, sample):
    """Compare with section 2.3.2: E below J_C for stuck joints, failed ones among the passive."""
    failed = data.draw(failures(sample.system))
    gone = sorted(failed.failures.locked | failed.failures.free)
    left = np.delete(failed.active, gone)
    printed = ConstrainedSystem(failed.J_T, spaces.closure(failed), left)
    kin = failed.kinematics()
    assert_same_mechanism(printed.kinematics(), kin)
    # Stuck joints do not move for any motion of the others.
    stuck = np.isin(kin.passive, spaces.stuck_joints(failed))
    np.testing.assert_array_equal(kin.passive_gain[stuck], 0)
    np.testing.assert_array_equal(kin.passive_self_motion[stuck], 0)


@given(st.data(), systems(actives=(2, 4)))
def test_failures_commute_and_may_be_repeated(data, sample):
    """Compare failures one by one, repeated and shuffled, with all at once."""
    at_once = data.draw(failures(sample.system))
    broken = at_once.failures
    events = [{"locked": [k]} for k in broken.locked] + [{"free": [k]} for k in broken.free]
    events += [{"locked_passive": [k]} for k in broken.locked_passive]
    # An actuator both released and locked, in either order, is locked.
    events += [{"free": [k]} for k in data.draw(st.sets(st.sampled_from([*broken.locked, -1])))]
    events = [event for event in events if event != {"free": [-1]}]
    system = sample.system
    for event in data.draw(st.permutations(events + events)):
        system = system.with_failures(**event)
    assert system.failures == broken
    np.testing.assert_array_equal(system.kinematics().J, at_once.kinematics().J)
    assert not sample.system.failures.locked  # the healthy one is unchanged


@given(st.data(), systems(actives=(2, 4)), st.booleans(), st.booleans())
def test_arguments_for_all_actuators_are_restricted_to_the_survivors(
    data, sample, square, tie_square
):
    """Check that weights of failed actuators have no effect."""
    system, n = data.draw(failures(sample.system)), len(sample.system.active)
    kin, rng = system.kinematics(), sample.rng
    W, T = (rng.uniform(0.5, 2.0, size=(n, n) if each else n) for each in (square, tie_square))
    limits, R = (-rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)), rng.normal(size=(1, n))
    left = kin.actuators
    cut = W[..., left], T[..., left], (limits[0][left], limits[1][left]), R[:, left]
    result = []
    for weight, metric, box, rows in ((W, T, limits, R), cut):
        levels = [Task([0]), Task.joints(weight)]
        bounds = {"rate_limits": box, "rate_rows": (rows, -0.1, 0.1)}
        hierarchy = kin.hierarchy(levels, tie_metric=metric, **bounds)
        limited = kin.velocity_mapping([0], None, weight, tie_metric=metric, **bounds)
        result.append(
            [
                kin.velocity_mapping([0], None, weight, tie_metric=metric).major,
                kin.force_mapping([0], None, weight, tie_metric=metric).major,
                limited.solve([1.0]).rates,
                hierarchy.solve([[1.0], None]).rates,
            ]
        )
    for wide, narrow in zip(*result, strict=True):
        np.testing.assert_array_equal(wide, narrow)
    everyone = kin.expand(np.arange(1.0, n + 1)[left])
    np.testing.assert_array_equal(np.flatnonzero(everyone), left)


def four_bar(angles: np.ndarray, lengths: np.ndarray) -> ConstrainedSystem:
    """Return a planar loop of four hinges, two with motors; the task is the coupler's twist."""
    turned = np.cumsum(angles)
    bars = lengths[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    hinges = np.vstack([np.zeros(2), np.cumsum(bars, axis=0)])
    twists = np.array([[1.0, y, -x] for x, y in hinges]).T
    J_T = np.hstack([twists[:, :2], np.zeros((3, 2))])
    return ConstrainedSystem(J_T, twists, [0, 1])


@given(SEEDS, st.integers(0, 1))
def test_a_locked_four_bar_linkage_cannot_move(seed, locked):
    """Check the paper's closing warning: with one of two motors locked, the loop cannot move."""
    rng = np.random.default_rng(seed)
    system = four_bar(rng.uniform(0.3, 1.2, size=3), rng.uniform(0.5, 2.0, size=3))
    healthy = system.kinematics()
    assert healthy.manipulability([0]).constrained_active
    kin = system.with_failures(locked=[locked]).kinematics()
    assert kin.manipulability([0]).unmanipulable
    assert spaces.motions(system.with_failures(locked=[locked])).shape == (4, 0)
    np.testing.assert_allclose(kin.velocity_mapping([0])([1.0]), 0.0, atol=1e-9)
    dropped = velocity_mapping(np.delete(healthy.J, locked, axis=1), [0])([1.0])
    rates = np.insert(dropped, locked, 0.0)
    assert np.abs(healthy.active_constraint @ rates).max() > 1e-2  # the loop would open
    # The remaining motor exerts internal forces only, so the structure bears the whole task force.
    mapping = kin.force_mapping([0], torque_weight=[1.0])
    np.testing.assert_allclose(mapping([1.0]), 0.0, atol=1e-9)
    np.testing.assert_allclose(mapping.reaction, np.eye(3), atol=1e-9)
