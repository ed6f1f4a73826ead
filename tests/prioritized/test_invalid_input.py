"""Test that invalid input raises an error that names the expected value."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas, force_mapping, velocity_mapping

J = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 0.0]])
SYSTEM = ConstrainedSystem(J, None, [0, 1])
"""System of two motors and a loose hinge."""
ALONG = ([0], [0, 1], [[1.0, 1.0], [1.0, -1.0]])
"""Secondary directions along the major one."""
ROWS = [([-1], r"must lie in 0\.\.1"), ([0, 0], "must not repeat")]
NO_METRIC = [
    (np.triu(np.ones((3, 3))), "must be 3 numbers or a symmetric matrix"),
    ([1.0, 1.0, -1.0], "no negative eigenvalue, got -1"),
]
"""Matrices that are not symmetric or not positive semidefinite."""
CALLS = {
    "velocity_mapping": lambda **a: velocity_mapping(**{"J": J, "major": [0]} | a),
    "force_mapping": lambda **a: force_mapping(**{"J": J, "major": [0]} | a),
    "system": lambda **a: ConstrainedSystem(J, None, [0, 1], **a),
    "kinematics": SYSTEM.kinematics,
    "atlas": lambda **a: failure_atlas(**{"system": SYSTEM, "major": [0]} | a),
    "with_failures": SYSTEM.with_failures,
    "row": lambda **a: failure_atlas(SYSTEM, [0]).row(**a),
}
TABLE: list[tuple[str, str, Any, str]] = [
    *((call, "major", *row) for call in ("velocity_mapping", "force_mapping") for row in ROWS),
    ("velocity_mapping", "secondary", [1, 1], "must not repeat"),
    ("velocity_mapping", "major_metric", [0.0], "must weigh every major direction"),
    *(("velocity_mapping", f"{of}_weight", np.zeros(0), "shape") for of in ("joint", "secondary")),
    # It would cancel the major force, and every torque would be zero.
    *(("force_mapping", "secondary", along, "must exclude the major") for along in ALONG),
    *(("system", "stiffness", *row) for row in NO_METRIC),
    *(("kinematics", "passive_metric", *row) for row in NO_METRIC),
    *(("atlas", "codes", [[0, code]], r"must be 0 \(healthy\), 1 \(locked\)") for code in (0.5, 3)),
    *((call, kind, [-1], "") for call in ("with_failures", "row") for kind in ("locked", "free")),
]


@pytest.mark.parametrize(("call", "name", "value", "message"), TABLE)
def test_invalid_input_raises_an_error_with_its_name(call, name, value, message):
    with pytest.raises(ValueError, match=f"{name} .*{message}"):
        CALLS[call](**{name: value})


SHAPES = {"J": (2, 3), "major": (1, 2), "secondary": (1, 2), "torque_weight": (3, 3)}
SHAPES |= {"secondary_weight": (1, 1), "active_constraint": (1, 3), "self_motion": (2, 1)}
SHAPES |= {"major_metric": (1, 1), "tie_metric": (3, 3), "scale": (1, 1), "rank_tolerance": (1, 1)}


@given(st.sampled_from([np.nan, np.inf, -np.inf]), st.sampled_from(sorted(SHAPES)), st.data())
def test_one_number_that_is_not_finite_raises(bad, name, data):
    """Check a non-finite number anywhere in any argument of the force mapping."""
    value = np.ones(SHAPES[name])
    value[tuple(data.draw(st.integers(0, size - 1)) for size in value.shape)] = bad
    arguments: dict[str, Any] = {"J": J, "major": [0]} | {name: value}
    with pytest.raises(ValueError, match=f"^{name} must be finite, got NaN or infinity"):
        force_mapping(**arguments)


def test_round_off_in_a_product_is_no_negative_eigenvalue():
    """Check R^T R, whose zero eigenvalues may be slightly negative."""
    R = np.random.default_rng(0).normal(size=(1, 3))
    ConstrainedSystem(J, None, [0, 1], stiffness=R.T @ R - 1e-16 * np.eye(3))


@pytest.mark.parametrize("secondary", ALONG)
def test_a_secondary_velocity_may_lie_along_the_major_one(secondary):
    """Check that only the force mapping refuses it."""
    assert velocity_mapping(J, [0], secondary, secondary_weight=np.ones(len(secondary)))


@np.errstate(over="ignore", invalid="ignore")
def test_overflowing_products_raise():
    huge = np.full((2, 3), 9e119)
    mapping = velocity_mapping(huge, huge[:1, :2], major_metric=[[9e119]])
    with pytest.raises(ValueError, match="J, weights and metrics must be smaller"):
        _ = mapping.major
