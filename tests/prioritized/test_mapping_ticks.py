"""A mapping from J_T and J_C in one compiled call is Problem 1, or it says nothing."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Status, VelocityMapping
from tests.profiles import examples
from tests.random_systems import SEEDS, failures, of_rank, rows_of, systems, weights

SURE = Status.EXACT, Status.LEAST_SQUARES


def freely(system: ConstrainedSystem) -> tuple[np.ndarray, np.ndarray]:
    unlimited = np.full(system.J_T.shape[1], np.inf)
    return -unlimited, unlimited


def ticked(mapping: VelocityMapping, system: ConstrainedSystem, *aims: np.ndarray):
    """All velocities by the compiled way, or None."""
    tick = mapping.tick()
    return (
        None if tick is None else tick(system.J_T, system.J_C, np.concatenate(aims), freely(system))
    )


def tied(rng: np.random.Generator, redundant: int) -> ConstrainedSystem:
    """Three passive velocities, five actuators, of which two rates follow; combinations of rows."""
    J_C = of_rank(rng, 5, 8, 5)
    J_C[:, :3] = of_rank(rng, 5, 3, 3)
    more = rng.normal(size=(redundant, 5)) @ J_C
    rows = rng.permutation(np.vstack([J_C, more]))
    return ConstrainedSystem(rng.normal(size=(4, 8)), rows, [3, 4, 5, 6, 7])


@given(st.data(), systems())
@examples(200)
def test_a_mapping_at_another_pose_is_what_the_gains_there_say_within_limits_and_without(
    data, drawn
):
    """Of any ranks, after any failures; within limits as the general solver finds it."""
    system, rng = data.draw(failures(drawn.system)), drawn.rng
    kin = system.kinematics()
    m, n = kin.J.shape
    major = rows_of(data, m)
    W1, W2 = data.draw(weights(n, rng)), data.draw(weights(m - len(major), rng))
    size = data.draw(st.sampled_from([0.3, 3.0, np.inf]))
    mapping = kin.velocity_mapping(major, None, W1, W2)
    aims = rng.normal(size=len(major)), rng.normal(size=n), rng.normal(size=m - len(major))
    there = mapping.at(system.at(J_T=system.J_T).kinematics(), rate_limits=(-size, size))
    expected = there.solve(*aims).rates
    scale = max(1.0, np.abs(expected).max(initial=0.0))
    np.testing.assert_allclose(there(*aims), expected, rtol=0, atol=1e-9 * scale)


@given(SEEDS, st.integers(0, 3), st.booleans())
def test_combinations_of_loop_rows_change_no_velocity(seed, redundant, in_secondary):
    """They are proved redundant: the compiled way answers, as it does without them."""
    rng = np.random.default_rng(seed)
    system = tied(rng, redundant)
    W2 = rng.uniform(0.5, 2.0, 2) if in_secondary else None
    mapping = system.kinematics().velocity_mapping([0], [1, 2], rng.uniform(0.5, 2.0, 5), W2)
    aims = [rng.normal(size=1), rng.normal(size=5), *([rng.normal(size=2)] if in_secondary else [])]
    found = ticked(mapping, system, *aims)
    assert found is not None
    assert mapping.status is Status.EXACT
    size = np.abs(found).max()
    np.testing.assert_allclose(system.J_C @ found, 0.0, atol=1e-10 * size)
    np.testing.assert_allclose(system.J_T[0] @ found, aims[0][0], atol=1e-10 * size)
    np.testing.assert_allclose(found[system.active], mapping.solve(*aims).rates, atol=1e-9 * size)


@given(SEEDS, st.floats(3.0, 17.0), st.floats(-3.0, 3.0))
@examples(200)
def test_while_a_loop_row_becomes_redundant_bit_by_bit_no_rank_is_claimed_that_is_not_decided(
    seed, nearness, unit
):
    """Where the compiled way answers, J_C has the rank that the decision of the library finds."""
    rng = np.random.default_rng(seed)
    exact = tied(rng, 1)
    J_C = 10.0**unit * exact.J_C
    J_C[-1] += 10.0**-nearness * np.abs(J_C[-1]).max() * rng.normal(size=8)
    system = ConstrainedSystem(exact.J_T, J_C, exact.active)
    kin = system.kinematics()
    mapping = kin.velocity_mapping([0], joint_weight=np.ones(5))
    aims = rng.normal(size=1), rng.normal(size=5)
    found = ticked(mapping, system, *aims)
    if found is None:
        assert nearness < 14.0
        return
    count = len(kin.active_constraint)
    assert count in (2, 3)
    np.testing.assert_allclose(
        found[system.active],
        mapping.solve(*aims).rates,
        rtol=0,
        atol=1e-8 * np.abs(found).max(),
    )
    assert mapping.status in SURE


@given(SEEDS, st.integers(0, 2), st.integers(1, 3), st.booleans())
def test_a_tick_with_secondary_weights_solves_the_conditions_of_the_optimum(
    seed, redundant, secondary, is_dense
):
    """By one linear system for all velocities, with Lagrange's multipliers."""
    rng = np.random.default_rng(seed)
    system = tied(rng, redundant)
    (_, N), active, rows = system.J_T.shape, system.active, list(range(1, 1 + secondary))
    W1 = rng.uniform(0.5, 2.0, 5)
    W2 = rng.normal(size=(2, secondary)) if is_dense else rng.uniform(0.5, 2.0, secondary)
    mapping = system.kinematics().velocity_mapping([0], rows, W1, W2)
    v, wanted, v_s = rng.normal(size=1), rng.normal(size=5), rng.normal(size=secondary)
    found = ticked(mapping, system, v, wanted, v_s)
    if found is None:  # task rows that the loops make nearly dependent
        return
    W = np.zeros((5, N))
    W[np.arange(5), active] = W1
    F = (W2 if is_dense else np.diag(W2)) @ system.J_T[rows]
    right = W.T @ (W1 * wanted) + F.T @ ((W2 if is_dense else np.diag(W2)) @ v_s)
    E = np.vstack([system.J_C, system.J_T[:1]])
    K = np.block([[W.T @ W + F.T @ F, E.T], [E, np.zeros((len(E), len(E)))]])
    b = np.concatenate([right, np.zeros(len(system.J_C)), v])
    expected = np.linalg.lstsq(K, b, rcond=1e-12)[0][:N]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_all_random_mechanisms_with_tied_rows_are_answered_where_no_rank_is_in_doubt():
    answered, count = 0, 100
    for seed in range(count):
        rng = np.random.default_rng(seed)
        system = tied(rng, seed % 3)
        mapping = system.kinematics().velocity_mapping([0, 1], [2], np.ones(5), [1.0])
        aims = rng.normal(size=2), rng.normal(size=5), rng.normal(size=1)
        found = ticked(mapping, system, *aims)
        if found is not None:
            answered += 1
            size = np.abs(found).max()
            general = mapping.solve(*aims).rates
            np.testing.assert_allclose(found[system.active], general, atol=1e-9 * size)
    assert answered >= 0.95 * count


ARM = ConstrainedSystem([[1.0, 0.5, 0.2], [0.0, 1.0, 0.7]], None, [0, 1, 2])


@pytest.mark.parametrize(
    "arguments",
    [
        {"rate_rows": (np.ones((1, 3)), -1.0, 1.0)},
        {"rate_limits": (-1.0, 1.0), "when_limited": "scaled"},
    ],
)
def test_mappings_that_are_not_for_a_tick_have_none(arguments):
    assert ARM.kinematics().velocity_mapping([0], **arguments).tick() is None


def test_a_tick_follows_the_mechanism_after_a_failure():
    """Two actuators of the same number: which of them failed decides."""
    system = ARM.with_failures(locked=[0])
    mapping = system.kinematics().velocity_mapping([0], joint_weight=np.ones(2))
    other = ARM.with_failures(locked=[2]).kinematics()
    v, desired = np.ones(1), np.array([0.3, -0.2])
    made = other.velocity_mapping([0], joint_weight=np.ones(2))
    np.testing.assert_allclose(mapping.at(other)(v, desired), made(v, desired), atol=1e-14)


@given(SEEDS)
def test_other_limits_hold_after_a_call_within_the_first_ones(seed):
    """Of tied rates, whose mapping was called before and remembers its limits."""
    rng = np.random.default_rng(seed)
    system = tied(rng, 1)
    wide = system.kinematics().velocity_mapping(
        [0], joint_weight=np.ones(5), rate_limits=(-9.0, 9.0)
    )
    v, desired = 0.1 * rng.normal(size=1), rng.normal(size=5)
    first = wide(v, desired)
    limits = np.full(5, 0.9 * np.abs(first).max())
    narrow = wide.within((-limits, limits))
    there = wide.at(system.kinematics(), rate_limits=(-limits, limits))
    expected = narrow.solve(v, desired).rates
    for mapping in (narrow, there):
        np.testing.assert_allclose(mapping(v, desired), expected, atol=1e-9)
        assert np.all(np.abs(mapping(v, desired)) <= limits)


@given(SEEDS)
def test_a_body_beside_the_robot_rests_and_changes_nothing_until_the_task_knows_it(seed):
    """A cube on the floor has passive velocities in no row; a task on the cube is another one."""
    rng = np.random.default_rng(seed)
    alone = tied(rng, 1)
    v, desired = 0.1 * rng.normal(size=1), rng.normal(size=5)
    J_T, J_C = (np.hstack([A, np.zeros((len(A), 6))]) for A in (alone.J_T, alone.J_C))
    beside = ConstrainedSystem(J_T, J_C, alone.active)
    found = []
    for system in (alone, beside):
        mapping = system.kinematics().velocity_mapping([0], joint_weight=np.ones(5))
        found.append(ticked(mapping, system, v, desired))
    assume(found[0] is not None)
    np.testing.assert_allclose(found[1], np.append(found[0], np.zeros(6)), atol=1e-12)
    tick = beside.kinematics().velocity_mapping([0], joint_weight=np.ones(5)).tick()
    assert tick is not None
    N, asked = J_T.shape[1], np.concatenate([v, desired])
    lower, upper = np.full(N, -np.inf), np.full(N, np.inf)
    lower[-1] = 0.1  # it cannot be that the cube moves
    assert tick(J_T, J_C, asked, (lower, upper)) is None
    J_T[0, -1] = 1.0
    assert tick(J_T, J_C, asked, (-upper, upper)) is None
