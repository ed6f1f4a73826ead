"""Wrong input that would pass for numbers, or mean another task, raises and says what it must be.

All else that is hostile is in `test_hostile.py`.
"""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas, force_mapping, velocity_mapping

J = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 0.0]])
SYSTEM = ConstrainedSystem(J, None, [0, 1])
"""Two motors and a loose hinge."""
KIN = SYSTEM.kinematics()
ALONG = ([0], [0, 1], [[1.0, 1.0], [1.0, -1.0]])
"""Secondary directions along the major one."""
NO_TASK = [
    ([2], r"must lie in 0\.\.1, got \[2\]"),
    ([-1], r"must lie in 0\.\.1"),
    ([0, 0], "must not repeat"),
    ([0.5], "must be a list of integers"),
    ([[1.0, 0.0, 0.0]], r"must have shape \(any, 2\), got \(1, 3\)"),
]
NO_METRIC = [
    ([1.0, 2.0], r"must have shape \(3,\) or \(\.\.\., any, 3\)"),
    (np.ones((2, 3)), "must be a diagonal of 3 or a symmetric matrix"),
    (np.triu(np.ones((3, 3))), "must be a diagonal of 3 or a symmetric matrix"),
    ([1.0, 1.0, -1.0], "no negative eigenvalue, got -1"),
    ([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "no negative eigenvalue, got -1"),
]
"""Energy theta^T K theta / 2 is that of a symmetric K, and it is not negative."""
NO_MAPPING = [
    *(("major", value, said) for value, said in NO_TASK),
    ("secondary", [1, 1], "must not repeat"),
    ("weight", [1.0], r"must have shape \(3,\) or \(\.\.\., any, 3\), got \(1,\)"),
    ("weight", 2.0, r"must have shape \(3,\)"),
    ("secondary_weight", [[1.0, 2.0]], r"must have shape \(1,\) or"),
    ("active_constraint", [1.0, 2.0, 3.0], r"must have shape \(\.\.\., any, 3\)"),
    ("self_motion", np.ones((5, 1)), r"must have shape \(\.\.\., 2, any\)"),
    ("major_metric", [0.0], "must weigh every major direction"),
    ("tie_metric", [[1.0]], r"must have shape \(3,\) or"),
]
NO_CODES = [
    *(([[0, code]], r"must be 0 \(sound\), 1 \(locked\) or 2 \(free\)") for code in (3, 0.5, -1)),
    ([[0]], r"must have shape \(any, 2\)"),
]
CALLS = {
    "velocity_mapping": lambda weight=None, **a: velocity_mapping(
        **{"J": J, "major": [0], "joint_weight": weight} | a
    ),
    "force_mapping": lambda weight=None, **a: force_mapping(
        **{"J": J, "major": [0], "torque_weight": weight} | a
    ),
    "system": lambda **a: ConstrainedSystem(J, None, [0, 1], **a),
    "kinematics": SYSTEM.kinematics,
    "manipulability": KIN.manipulability,
    "atlas": lambda **a: failure_atlas(**{"system": SYSTEM, "major": [0]} | a),
    "with_failures": SYSTEM.with_failures,
    "row": lambda **a: failure_atlas(SYSTEM, [0]).row(**a),
    "expand": KIN.expand,
    "f_major": lambda **a: force_mapping(J, [0])(**a),
}
TABLE: list[tuple[str, str, Any, str]] = [
    *((call, *row) for call in ("velocity_mapping", "force_mapping") for row in NO_MAPPING),
    # It would cancel the major force, and every torque would come out zero.
    *(
        ("force_mapping", "secondary", value, "must leave out the major directions")
        for value in ALONG
    ),
    *(("system", "stiffness", *row) for row in NO_METRIC),
    *(("kinematics", "passive_metric", *row) for row in NO_METRIC),
    *((call, "major", *row) for call in ("manipulability", "atlas") for row in NO_TASK),
    *(("atlas", "codes", *row) for row in NO_CODES),
    *(
        (call, kind, value, "must")
        for call in ("with_failures", "row")
        for kind in ("locked", "free")
        for value in (0, [0.5], [2], [-1])
    ),
    ("expand", "rates", [1.0], r"must have shape \(\.\.\., 2\)"),
    ("f_major", "f_major", [1.0, 2.0], r"must have shape \(\.\.\., 1\)"),
]


@pytest.mark.parametrize(("call", "name", "value", "said"), TABLE)
def test_wrong_input_is_refused_by_name(call, name, value, said):
    with pytest.raises(ValueError, match=f"{name} .*{said}") as refusal:
        CALLS[call](**{name: value})
    assert refusal.type is ValueError  # and no subclass


def test_batches_that_do_not_broadcast_are_named():
    for mapping in (velocity_mapping, force_mapping):
        with pytest.raises(ValueError, match=r"broadcast, got J \(2,\), secondary_weight \(3,\)"):
            mapping(np.ones((2, 2, 3)), [0], secondary_weight=np.ones((3, 1, 1)))


SHAPES = {"J": (2, 3), "major": (1, 2), "secondary": (1, 2), "torque_weight": (3, 3)}
SHAPES |= {"secondary_weight": (1, 1), "active_constraint": (1, 3), "self_motion": (2, 1)}
SHAPES |= {"major_metric": (1, 1), "tie_metric": (3, 3), "scale": (1, 1), "rank_tolerance": (1, 1)}


@given(st.sampled_from([np.nan, np.inf, -np.inf]), st.sampled_from(sorted(SHAPES)), st.data())
def test_one_number_that_is_not_finite_is_enough(bad, name, data):
    """Wherever it hides in whatever argument of the force mapping, it is named, never passed on."""
    value = np.ones(SHAPES[name])
    value[tuple(data.draw(st.integers(0, size - 1)) for size in value.shape)] = bad
    arguments: dict[str, Any] = {"J": J, "major": [0]} | {name: value}
    with pytest.raises(ValueError, match=f"^{name} must be finite, got NaN or infinity"):
        force_mapping(**arguments)


def test_round_off_in_a_product_is_no_negative_eigenvalue():
    """R^T R is known to 1e-16 of its norm: zero may come out just below."""
    R = np.random.default_rng(0).normal(size=(1, 3))
    ConstrainedSystem(J, None, [0, 1], stiffness=R.T @ R - 1e-16 * np.eye(3))


@pytest.mark.parametrize("secondary", ALONG)
def test_a_secondary_velocity_may_lie_along_the_major_one(secondary):
    """Only the force mapping refuses it."""
    assert velocity_mapping(J, [0], secondary, secondary_weight=np.ones(len(secondary)))
