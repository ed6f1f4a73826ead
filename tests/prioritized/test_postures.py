"""Test batches of postures: each has the results of the system at that posture alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Status
from tests import spaces
from tests.random_systems import (
    RandomSystem,
    failures,
    major_and_secondary,
    of_rank,
    orthogonal,
    springs,
    systems,
    weights,
    with_stiffness,
)

WORST = [Status.SELF_MOTION, Status.LEAST_SQUARES, Status.EXACT]


@st.composite
def batches(draw: st.DrawFn) -> tuple[RandomSystem, ConstrainedSystem, np.ndarray, np.ndarray]:
    """Sample a mechanism with failures at four postures, some singular, some with weak loops."""
    sample = draw(systems())
    system, rng = sample.system, sample.rng
    if draw(st.booleans()):
        R = draw(springs(system.J_T.shape[1], rng))
        system = with_stiffness(system, R.T @ R)
    (m, N), c = system.J_T.shape, len(system.J_C)
    J_T = [orthogonal(rng, m) @ system.J_T for _ in range(2)]
    J_T += [of_rank(rng, m, N, draw(st.integers(0, min(m, N)))) for _ in range(2)]
    looser = of_rank(rng, c, N, draw(st.integers(0, min(c, N))))
    J_C = [system.J_C, 0.0 * system.J_C, looser, orthogonal(rng, c) @ system.J_C]
    return sample, draw(failures(system)), np.array(J_T), np.array(J_C)


def agrees_with(batch: np.ndarray, alone: list[np.ndarray], accuracy: float = 1e-9) -> None:
    for here, there in zip(batch, alone, strict=True):
        np.testing.assert_allclose(here, there, atol=accuracy * (1 + np.abs(there).max(initial=0)))


@given(batches())
def test_a_batch_of_postures_has_the_kinematics_of_each(sample):
    of, system, J_T, J_C = sample
    postures = system.postures(J_T, J_C)
    alone = [system.at(*pair).kinematics() for pair in zip(J_T, J_C, strict=True)]
    rates = of.rng.normal(size=(4, len(postures.actuators)))
    agrees_with(postures.J, [kin.J for kin in alone])
    for name in ("passive_rates", "velocities"):
        result = getattr(postures, name)(rates)
        agrees_with(result, [getattr(kin, name)(x) for kin, x in zip(alone, rates, strict=True)])
    for name, own in (("active_constraint", np.transpose), ("self_motion", np.asarray)):
        bases = [spaces.projector(own(getattr(kin, name))) for kin in alone]
        agrees_with(np.array([spaces.projector(own(A)) for A in getattr(postures, name)]), bases)


@given(st.data(), batches(), st.sampled_from([None, (-0.2, 0.3)]))
def test_a_batch_of_postures_has_the_mapping_of_each(data, sample, box):
    """Compare rates, rank and status; singular postures must not affect others."""
    of, system, J_T, J_C = sample
    n, (major, others) = len(system.active), major_and_secondary(data, J_T.shape[1])
    W1 = data.draw(weights(n, of.rng))
    W2 = data.draw(weights(len(others), of.rng)) if others else None
    postures = system.postures(J_T, J_C)
    together, *alone = (
        kin.velocity_mapping(major, others, joint_weight=W1, secondary_weight=W2)
        for kin in (postures, *postures.kinematics)
    )
    assert together.rank.tolist() == [int(one.rank) for one in alone]
    assert together.status is next(s for s in WORST if s in [one.status for one in alone])
    if box is not None:
        together, *alone = (mapping.with_limits(box) for mapping in (together, *alone))
    inputs = [
        of.rng.normal(size=(4, k)) for k in (len(major), len(postures.actuators), len(others))
    ]
    expected = [one(*target) for one, *target in zip(alone, *inputs, strict=True)]
    agrees_with(together(*inputs), expected, 1e-6)


@given(batches())
def test_the_axes_of_a_batch_stay(sample):
    _, system, J_T, J_C = sample
    flat = system.postures(J_T, J_C)
    square = system.postures(J_T.reshape(2, 2, *J_T.shape[1:]), J_C.reshape(2, 2, *J_C.shape[1:]))
    one = system.postures(J_T[0], J_C[0])
    same_loops = system.postures(J_T)
    for name in ("J", "active_constraint"):
        result = getattr(square, name)
        np.testing.assert_array_equal(result.reshape(4, *result.shape[2:]), getattr(flat, name))
    np.testing.assert_array_equal(one.J, flat.J[0])
    np.testing.assert_array_equal(same_loops.J[1], system.at(J_T[1]).kinematics().J)
    np.testing.assert_array_equal(
        one.velocity_mapping([0]).rank, one.kinematics[0].velocity_mapping([0]).rank
    )


@pytest.mark.parametrize(
    ("J_T", "J_C", "message"),
    [
        (np.ones((2, 3, 4)), np.ones((3, 1, 4)), r"leading axes must broadcast, got J_T \(2,\)"),
        (np.ones((0, 3, 4)), None, r"J_T and J_C must hold at least one posture"),
    ],
)
def test_incompatible_postures_raise(J_T, J_C, message):
    system = ConstrainedSystem(np.eye(3, 4), np.ones((1, 4)), [0, 1, 2])
    with pytest.raises(ValueError, match=message):
        system.postures(J_T, J_C)
    for made in (system.at, lambda J: ConstrainedSystem(J, None, [0])):
        with pytest.raises(ValueError, match=r"one matrix.*ConstrainedSystem\.postures"):
            made(np.ones((2, 3, 4)))
