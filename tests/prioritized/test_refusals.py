"""Wrong input raises at once and names the argument, what was expected and what came."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas, force_mapping, velocity_mapping
from tests.hostile import Target, refusals

NAN, INF = np.nan, np.inf
J = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 0.0]])
SYSTEM = ConstrainedSystem(J, None, [0, 1])
"""Two motors and a loose hinge."""
KIN = SYSTEM.kinematics()
RATES, FORCES = velocity_mapping(J, [0]), force_mapping(J, [0])
TASK = {"J": J, "major": [0]}

MAPPINGS = [
    Target(lambda weight=None, **a: velocity_mapping(joint_weight=weight, **a), TASK),
    Target(lambda weight=None, **a: force_mapping(torque_weight=weight, **a), TASK),
]
"""The two duals take the same arguments, but for what weighs the joints."""
OF_TWO = [Target(each.call, {"J": np.ones((2, 2, 3)), "major": [0]}) for each in MAPPINGS]
UNEQUAL = r"leading axes must broadcast, got J \(2,\), secondary_weight \(3,\)"
CANNOT_BE_MAPPED = [
    ("J", [1.0, 2.0], r"J must have shape \(\.\.\., any, any\), got \(2,\)"),
    ("J", [[1j, 0.0]], "J must hold real numbers, got complex128"),
    ("J", [[1.0, 2.0], [3.0]], "J must be a rectangular array, got rows that differ"),
    ("major", [2], r"major must lie in 0\.\.1, got \[2\]"),
    ("major", [-1], r"major must lie in 0\.\.1, got \[-1\]"),
    ("major", [0, 0], r"major must not repeat an index, got \[0, 0\]"),
    ("major", [0.5], r"major must be a list of integers, got \[0.5\]"),
    ("major", None, "major must be a list of integers, got None"),
    ("major", [[1.0, 0.0, 0.0]], r"major must have shape \(any, 2\), got \(1, 3\)"),
    ("major", [[1.0, 0.0], [1.0]], "major must be a rectangular array, got rows that differ"),
    ("secondary", [1, 1], r"secondary must not repeat an index, got \[1, 1\]"),
    ("weight", [1.0], r"weight must have shape \(3,\) or \(\.\.\., any, 3\), got \(1,\)"),
    ("weight", 2.0, r"weight must have shape \(3,\) or \(\.\.\., any, 3\), got \(\)"),
    (
        "secondary_weight",
        [[1.0, 2.0]],
        r"secondary_weight must have shape \(1,\) or \(\.\.\., any, 1\), got",
    ),
    (
        "active_constraint",
        [[1.0, 2.0]],
        r"active_constraint must have shape \(\.\.\., any, 3\), got",
    ),
    (
        "active_constraint",
        [1.0, 2.0, 3.0],
        r"active_constraint must have shape \(\.\.\., any, 3\), got",
    ),
    (
        "self_motion",
        np.ones((5, 1)),
        r"self_motion must have shape \(\.\.\., 2, any\), got \(5, 1\)",
    ),
    ("self_motion", [1.0, 0.0], r"self_motion must have shape \(\.\.\., 2, any\), got \(2,\)"),
    (
        "major_metric",
        [1.0, 2.0],
        r"major_metric must have shape \(1,\) or \(\.\.\., any, 1\), got \(2,\)",
    ),
    ("major_metric", [0.0], r"major_metric must weigh every major direction, got \[0.0\]"),
    (
        "tie_metric",
        [[1.0]],
        r"tie_metric must have shape \(3,\) or \(\.\.\., any, 3\), got \(1, 1\)",
    ),
    ("scale", -1.0, "scale must not be negative, got -1"),
    ("scale", "large", "scale must hold real numbers, got <U5"),
    ("rank_tolerance", -1e-9, r"rank_tolerance must be from 0 to 0\.5, got -1e-09"),
    ("rank_tolerance", [1e-9], r"rank_tolerance must be one number, got shape \(1,\)"),
]

ALONG = ([0], [0, 1], [[1.0, 1.0], [1.0, -1.0]])
"""Secondary directions along the major one."""

WISH = {"f_major": [1.0]}
ANSWERS = [Target(ask, WISH) for ask in (FORCES, FORCES.secondary_force, FORCES.internal_force)]
RESIDUAL = Target(FORCES.residual, WISH)
NO_MAJOR_FORCE = [
    (None, "f_major must hold real numbers, got None"),
    ([1.0, 2.0], r"f_major must have shape \(\.\.\., 1\), got \(2,\)"),
    (1.0, r"f_major must have shape \(\.\.\., 1\), got \(\)"),
    ([1j], "f_major must hold real numbers, got complex128"),
    ([NAN], "f_major must be finite"),
]
TRACKED = [Target(ask, {"v_major": [1.0]}) for ask in (RATES, RATES.residual)]

SPRUNG = [Target(ConstrainedSystem, {"J_T": J, "J_C": None, "active": [0, 1]})]
POSED = [Target(SYSTEM.kinematics, {})]
NO_METRIC = [
    ([1.0, 2.0], r"must have shape \(3,\) or \(\.\.\., any, 3\), got \(2,\)"),
    (1.0, r"must have shape \(3,\) or \(\.\.\., any, 3\), got \(\)"),
    (np.ones((2, 3)), "must be a diagonal of 3 or a symmetric matrix, got"),
    (np.ones((2, 3, 3)), "must be a diagonal of 3 or a symmetric matrix, got"),
    (np.triu(np.ones((3, 3))), "must be a diagonal of 3 or a symmetric matrix, got"),
    ([1.0, 1.0, -1.0], "must have no negative eigenvalue, got -1"),
    ([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "no negative eigenvalue, got -1"),
    ([1.0, NAN, 1.0], "must be finite, got NaN or infinity"),
    ([1.0, INF, 1.0], "must be finite, got NaN or infinity"),
    ("stiff", "must hold real numbers, got <U5"),
]
"""Energy theta^T K theta / 2 is that of a symmetric K, and it is not negative."""
NO_TASK = [
    ([2], r"major must lie in 0\.\.1, got \[2\]"),
    ([0, 0], r"major must not repeat an index, got \[0, 0\]"),
    (None, "major must be a list of integers, got None"),
    ([[NAN, 0.0]], "major must be finite, got NaN or infinity"),
    ([[1.0, 0.0, 0.0]], r"major must have shape \(any, 2\), got \(1, 3\)"),
]
NO_CONDITION = [
    ([[0, 3]], r"codes must be 0 \(sound\), 1 \(locked\) or 2 \(free\), got 3"),
    ([[0, 0.5]], r"codes must be 0 \(sound\), 1 \(locked\) or 2 \(free\), got 0.5"),
    ([[0, -1]], r"codes must be 0 \(sound\), 1 \(locked\) or 2 \(free\), got -1"),
    ([[0]], r"codes must have shape \(any, 2\), got \(1, 1\)"),
    ([0, 1], r"codes must have shape \(any, 2\), got \(2,\)"),
    ([[[0, 1]]], r"codes must have shape \(any, 2\), got \(1, 1, 2\)"),
    ([[NAN, 0]], "codes must be finite"),
    ("all", "codes must hold real numbers"),
]

REPORT = Target(KIN.manipulability, {"major": [0]})
ATLAS = Target(failure_atlas, {"system": SYSTEM, "major": [0]})
KINDS = ("locked", "free")
FAILED = [Target(take, {}) for take in (SYSTEM.with_failures, failure_atlas(SYSTEM, [0]).row)]

MOVED = [Target(ask, {"rates": [1.0, 1.0]}) for ask in (KIN.expand, KIN.passive_rates)]
HELD = [Target(KIN.constraint_force, {"f": [1.0, 1.0]})]
NO_RATES = [
    ([1.0], r"must have shape \(\.\.\., 2\), got \(1,\)"),
    ([1.0, NAN], "must be finite"),
]

TABLE = [
    *((MAPPINGS, name, [value], said) for name, value, said in CANNOT_BE_MAPPED),
    (OF_TWO, "secondary_weight", [np.ones((3, 1, 1))], UNEQUAL),
    # It would cancel the major force, and every torque would come out zero.
    (MAPPINGS[1:], "secondary", ALONG, "secondary must leave out the major directions"),
    *(([*ANSWERS, RESIDUAL], "f_major", [value], said) for value, said in NO_MAJOR_FORCE),
    (ANSWERS, "torque", [[INF, 0.0, 0.0]], "torque must be finite"),
    (ANSWERS, "torque", [[1.0]], r"torque must have shape \(\.\.\., 3\), got \(1,\)"),
    (ANSWERS, "secondary_force", [[NAN]], "secondary_force must be finite"),
    (
        ANSWERS,
        "secondary_force",
        [[1.0, 2.0]],
        r"secondary_force must have shape \(\.\.\., 1\), got \(2,\)",
    ),
    (TRACKED, "v_major", [None, [1.0, 2.0], [NAN], [1j], [[1.0], [2.0, 3.0]]], "^v_major must"),
    (MAPPINGS[:1], "damping", [-1.0, NAN, INF, None, [1.0]], "^damping must"),
    *((SPRUNG, "stiffness", [metric], f"^stiffness .*{said}") for metric, said in NO_METRIC),
    *(
        (POSED, "passive_metric", [metric], f"^passive_metric .*{said}")
        for metric, said in NO_METRIC
    ),
    *(([REPORT, ATLAS], "major", [major], said) for major, said in NO_TASK),
    *(([ATLAS], "codes", [codes], said) for codes, said in NO_CONDITION),
    *((FAILED, kind, [0, None, [0.5], ["a"], [2], [-1]], f"^{kind} must") for kind in KINDS),
    *((MOVED, "rates", [value], f"^rates {said}") for value, said in NO_RATES),
    *((HELD, "f", [value], f"^f {said}") for value, said in NO_RATES),
    (
        [Target(KIN.force_mapping, {"major": [0]})],
        "torque_weight",
        [[1.0]],
        r"torque_weight must have shape \(2,\) or \(\.\.\., any, 2\)",
    ),
]
"""What is called, the argument, values in place of its good one, and what the sentence says."""


@pytest.mark.parametrize(("target", "name", "value", "error", "said"), refusals(ValueError, TABLE))
def test_wrong_input_is_refused_by_name(target, name, value, error, said):
    target.call(**target.good)
    with pytest.raises(error, match=said) as refusal:
        target.call(**(target.good | {name: value}))
    assert refusal.type is error  # and no subclass


FORCE_ARGUMENTS = {
    "J": (2, 3),
    "major": (1, 2),
    "secondary": (1, 2),
    "torque_weight": (3, 3),
    "secondary_weight": (1, 1),
    "active_constraint": (1, 3),
    "self_motion": (2, 1),
    "major_metric": (1, 1),
    "tie_metric": (3, 3),
    "scale": (1, 1),
    "rank_tolerance": (1, 1),
}


@given(st.sampled_from([NAN, INF, -INF]), st.sampled_from(sorted(FORCE_ARGUMENTS)), st.data())
def test_one_number_that_is_not_finite_is_enough(bad, name, data):
    """Wherever it hides in whatever argument of the force mapping, it is named, never passed on."""
    value = np.ones(FORCE_ARGUMENTS[name])
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
