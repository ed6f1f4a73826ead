"""Mappings of batches: each problem gets the answer that it gets alone."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import force_mapping, velocity_mapping
from tests.random_systems import SEEDS

LEAD = (2, 3)
AXES = st.sampled_from([None, (), (3,), LEAD])
"""Batch axes of an argument; None leaves it out."""
TALL = st.sampled_from([0, 1, 3])


@pytest.mark.parametrize("made", [velocity_mapping, force_mapping])
@given(st.data(), SEEDS, st.integers(1, 4), st.integers(1, 3))
def test_any_arguments_may_be_batches_with_or_without_secondary_rows(made, data, seed, n, m):
    """J, weights, metrics, constraint, self-motion and all three velocities or forces."""
    rng, m1 = np.random.default_rng(seed), data.draw(st.integers(1, m))
    m2 = m - m1 if data.draw(st.booleans()) else 0
    W = "joint_weight" if made is velocity_mapping else "torque_weight"
    shapes = {
        W: (data.draw(TALL), n),
        "secondary_weight": (data.draw(TALL), m2),
        "active_constraint": (1, n),
        "self_motion": (m, 1),
        "major_metric": (m1, m1),
        "tie_metric": (data.draw(TALL), n),
    }
    J = rng.normal(size=(*(data.draw(AXES) or ()), m, n))
    axes = {name: data.draw(AXES) for name in shapes}
    given_ = {
        k: rng.normal(size=(*lead, *shapes[k])) for k, lead in axes.items() if lead is not None
    }
    inputs = [rng.normal(size=(*(data.draw(AXES) or ()), size)) for size in (m1, n, m2)]
    task: dict[str, Any] = {"major": range(m1), "secondary": range(m1, m1 + m2)}

    mapping = made(J, **task, **given_)
    answer, rest = mapping(*inputs), mapping.residual(inputs[0])
    leads = [A.shape[:-2] for A in (J, *given_.values())]
    lead = np.broadcast_shapes(*leads, *(x.shape[:-1] for x in inputs))
    assert answer.shape == (*lead, n)
    assert mapping.rank.shape == mapping.gap.shape == np.broadcast_shapes(*leads)
    for at in np.ndindex(lead):

        def part(A: np.ndarray, own: int, at: tuple[int, ...] = at) -> np.ndarray:
            return np.broadcast_to(A, (*lead, *A.shape[A.ndim - own :]))[at]

        alone = made(part(J, 2), **task, **{name: part(A, 2) for name, A in given_.items()})
        expected = alone(*(part(x, 1) for x in inputs))
        size = 1 + np.abs(expected).max()
        np.testing.assert_allclose(answer[at], expected, atol=1e-6 * size)
        np.testing.assert_allclose(
            np.broadcast_to(rest, (*lead, m1))[at], alone.residual(part(inputs[0], 1)), atol=1e-7
        )


@pytest.mark.parametrize("of_J", [(), LEAD])
@pytest.mark.parametrize("of_W1", [(), (3,), LEAD])
@pytest.mark.parametrize("of_v", [(), (3,), LEAD])
@pytest.mark.parametrize("m2", [0, 2])
def test_the_fast_way_of_batches_agrees_with_the_gains(of_J, of_W1, of_v, m2):
    """Full weights and no constraint: rates without gains, secondary rows or not."""
    rng = np.random.default_rng(0)
    J, W1 = rng.normal(size=(*of_J, 1 + m2, 4)), rng.normal(size=(*of_W1, 4, 4))
    v, rates_d, v_sd = (rng.normal(size=(*of_v, size)) for size in (1, 4, m2))
    mapping = velocity_mapping(J, [0], joint_weight=W1, secondary_weight=np.ones(m2))
    gains = mapping.major, mapping.joint, mapping.secondary
    expected = sum(
        (gain @ x[..., None])[..., 0] for gain, x in zip(gains, (v, rates_d, v_sd), strict=True)
    )
    np.testing.assert_allclose(mapping(v, rates_d, v_sd), expected, atol=1e-9)


@pytest.mark.parametrize(("n", "p", "m"), [(6, 2, 6), (9, 2, 4), (4, 3, 5), (3, 3, 3)])
def test_a_batch_has_the_rates_of_its_problems_one_by_one_near_a_singularity_too(n, p, m):
    """The first major row fades from problem to problem, to below what counts."""
    rng, count = np.random.default_rng(0), 53
    J = rng.normal(size=(count, m, n))
    J[:, 0] = J[:, p - 1] + np.logspace(0, -16, count)[:, None] * J[:, 0]
    v, joint, secondary = (rng.normal(size=(count, k)) for k in (p, n, m - p))
    weights = rng.uniform(0.5, 2.0, size=n), rng.uniform(0.5, 2.0, size=m - p)
    together = velocity_mapping(J, list(range(p)), None, *weights)(v, joint, secondary)
    for k in range(count):
        alone = velocity_mapping(J[k], list(range(p)), None, *weights)(v[k], joint[k], secondary[k])
        least = np.linalg.svd(J[k, :p], compute_uv=False)[-1]
        error = 1e-14 / least if least > 1e-11 else 1e-9
        np.testing.assert_allclose(together[k], alone, rtol=0, atol=error * (1 + abs(alone).max()))
