"""Wrong input raises at once and names the argument, what was expected and what came."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, failure_atlas, force_mapping, velocity_mapping

NAN, INF = np.nan, np.inf
J = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 0.0]])
SYSTEM = ConstrainedSystem(J, None, [0, 1])
"""Two motors and a loose hinge."""

NOT_FINITE = st.sampled_from([NAN, INF, -INF])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"J": [1.0, 2.0]}, r"J must be a matrix, got shape \(2,\)"),
        ({"J": [[1j, 0.0]]}, "J must hold real numbers, got complex128"),
        ({"J": [[1.0, 2.0], [3.0]]}, "J must be a rectangular array, got rows that differ"),
        ({"major": [2]}, r"major must lie in 0\.\.1, got \[2\]"),
        ({"major": [-1]}, r"major must lie in 0\.\.1, got \[-1\]"),
        ({"major": [0, 0]}, r"major must not repeat an index, got \[0, 0\]"),
        ({"major": [0.5]}, r"major must be a list of integers, got \[0.5\]"),
        ({"major": None}, "major must be a list of integers, got None"),
        ({"major": [[1.0, 0.0, 0.0]]}, r"major must have 2 columns, got shape \(1, 3\)"),
        ({"major": [[1.0, 0.0], [1.0]]}, "major must be a rectangular array, got rows that differ"),
        ({"secondary": [1, 1]}, r"secondary must not repeat an index, got \[1, 1\]"),
        ({"weight": [1.0]}, r"weight must have 3 columns, got shape \(1,\)"),
        ({"weight": 2.0}, "weight must be a diagonal or a matrix, got the scalar 2.0"),
        ({"secondary_weight": [[1.0, 2.0]]}, r"secondary_weight must have 1 columns, got shape"),
        ({"active_constraint": [[1.0, 2.0]]}, r"active_constraint must have 3 columns, got shape"),
        ({"active_constraint": [1.0, 2.0, 3.0]}, r"active_constraint must be a matrix, got shape"),
        ({"self_motion": np.ones((5, 1))}, r"self_motion must have 2 rows, got shape \(5, 1\)"),
        ({"self_motion": [1.0, 0.0]}, r"self_motion must be a matrix, got shape \(2,\)"),
        ({"major_metric": [1.0, 2.0]}, r"major_metric must have 1 columns, got shape \(2,\)"),
        ({"major_metric": [0.0]}, r"major_metric must weigh every major direction, got \[0.0\]"),
        (
            {"J": np.ones((2, 2, 3)), "secondary_weight": np.ones((3, 1, 1))},
            r"leading axes must broadcast, got J \(2,\), secondary_weight \(3,\)",
        ),
        ({"tie_metric": [[1.0]]}, r"tie_metric must have 3 columns, got shape \(1, 1\)"),
        ({"scale": -1.0}, "scale must not be negative, got -1"),
        ({"scale": "large"}, "scale must hold real numbers, got <U5"),
        ({"rank_tolerance": -1e-9}, "rank_tolerance must not be negative, got -1e-09"),
        ({"rank_tolerance": [1e-9]}, r"rank_tolerance must be one number, got shape \(1,\)"),
    ],
)
@pytest.mark.parametrize(
    ("mapping", "weight"), [(velocity_mapping, "joint_weight"), (force_mapping, "torque_weight")]
)
def test_both_mappings_refuse_what_they_cannot_use(mapping, weight, arguments, message):
    """The two duals take the same arguments, but for what weighs the joints."""
    good = {"J": J, "major": [0]}
    named = {weight if name == "weight" else name: value for name, value in arguments.items()}
    with pytest.raises(ValueError, match=message):
        mapping(**(good | named))


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


@given(NOT_FINITE, st.sampled_from(sorted(FORCE_ARGUMENTS)), st.data())
def test_one_number_that_is_not_finite_is_enough(bad, name, data):
    """Wherever it hides in whatever argument of the force mapping, it is named, never passed on."""
    value = np.ones(FORCE_ARGUMENTS[name])
    value[tuple(data.draw(st.integers(0, size - 1)) for size in value.shape)] = bad
    arguments: dict[str, Any] = {"J": J, "major": [0]} | {name: value}
    with pytest.raises(ValueError, match=f"^{name} must be finite, got NaN or infinity"):
        force_mapping(**arguments)


@pytest.mark.parametrize(
    ("wishes", "message"),
    [
        ((None,), "f_major must hold real numbers, got None"),
        (([1.0, 2.0],), r"f_major must have shape \(\.\.\., 1\), got \(2,\)"),
        ((1.0,), r"f_major must have shape \(\.\.\., 1\), got \(\)"),
        (([1j],), "f_major must hold real numbers, got complex128"),
        (([NAN],), "f_major must be finite"),
        (([1.0], [INF, 0.0, 0.0]), "torque must be finite"),
        (([1.0], [1.0]), r"torque must have shape \(\.\.\., 3\), got \(1,\)"),
        (([1.0], None, [NAN]), "secondary_force must be finite"),
        (([1.0], None, [1.0, 2.0]), r"secondary_force must have shape \(\.\.\., 1\), got \(2,\)"),
    ],
)
def test_a_force_mapping_refuses_wishes_by_name(wishes, message):
    mapping = force_mapping(J, [0])
    for answer in (mapping, mapping.secondary_force, mapping.internal_force):
        with pytest.raises(ValueError, match=message):
            answer(*wishes)
    if len(wishes) == 1:
        with pytest.raises(ValueError, match=message):
            mapping.residual(*wishes)


@pytest.mark.parametrize("value", [None, [1.0, 2.0], [NAN], [1j], [[1.0], [2.0, 3.0]]])
def test_a_velocity_mapping_refuses_the_required_velocity_by_name(value):
    mapping = velocity_mapping(J, [0])
    for answer in (mapping, mapping.residual):
        with pytest.raises(ValueError, match=r"^v_major must"):
            answer(value)


@pytest.mark.parametrize("damping", [-1.0, NAN, INF, None, [1.0]])
def test_damping_is_one_number_that_is_not_negative(damping):
    with pytest.raises(ValueError, match=r"^damping must"):
        velocity_mapping(J, [0], damping=damping)


@pytest.mark.parametrize(
    ("metric", "message"),
    [
        ([1.0, 2.0], r"must have 3 columns, got shape \(2,\)"),
        (1.0, "must be a diagonal or a matrix, got the scalar 1.0"),
        (np.ones((2, 3)), "must be a diagonal of 3 or a symmetric matrix, got"),
        (np.ones((2, 3, 3)), "must be a diagonal of 3 or a symmetric matrix, got"),
        (np.triu(np.ones((3, 3))), "must be a diagonal of 3 or a symmetric matrix, got"),
        ([1.0, 1.0, -1.0], "must have no negative eigenvalue, got -1"),
        ([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "no negative eigenvalue, got -1"),
        ([1.0, NAN, 1.0], "must be finite, got NaN or infinity"),
        ([1.0, INF, 1.0], "must be finite, got NaN or infinity"),
        ("stiff", "must hold real numbers, got <U5"),
    ],
)
def test_springs_and_metrics_that_no_energy_has_are_refused(metric, message):
    """Energy theta^T K theta / 2 is that of a symmetric K, and it is not negative."""
    with pytest.raises(ValueError, match=f"^stiffness .*{message}"):
        ConstrainedSystem(J, None, [0, 1], stiffness=metric)
    with pytest.raises(ValueError, match=f"^passive_metric .*{message}"):
        SYSTEM.kinematics(passive_metric=metric)


def test_round_off_in_a_product_is_no_negative_eigenvalue():
    """R^T R is known to 1e-16 of its norm: zero may come out just below."""
    R = np.random.default_rng(0).normal(size=(1, 3))
    ConstrainedSystem(J, None, [0, 1], stiffness=R.T @ R - 1e-16 * np.eye(3))


@pytest.mark.parametrize(
    ("major", "message"),
    [
        ([2], r"major must lie in 0\.\.1, got \[2\]"),
        ([0, 0], r"major must not repeat an index, got \[0, 0\]"),
        (None, "major must be a list of integers, got None"),
        ([[NAN, 0.0]], "major must be finite, got NaN or infinity"),
        ([[1.0, 0.0, 0.0]], r"major must have 2 columns, got shape \(1, 3\)"),
    ],
)
def test_a_major_task_that_is_none_is_refused_by_report_and_atlas(major, message):
    with pytest.raises(ValueError, match=message):
        SYSTEM.kinematics().manipulability(major)
    with pytest.raises(ValueError, match=message):
        failure_atlas(SYSTEM, major)


@pytest.mark.parametrize(
    ("codes", "message"),
    [
        ([[0, 3]], r"codes must be 0 \(sound\), 1 \(locked\) or 2 \(free\), got 3"),
        ([[0, 0.5]], r"codes must be 0 \(sound\), 1 \(locked\) or 2 \(free\), got 0.5"),
        ([[0, -1]], r"codes must be 0 \(sound\), 1 \(locked\) or 2 \(free\), got -1"),
        ([[0]], r"codes must have 2 columns, got shape \(1, 1\)"),
        ([0, 1], r"codes must be a matrix, got shape \(2,\)"),
        ([[[0, 1]]], r"codes must be one matrix, got shape \(1, 1, 2\)"),
        ([[NAN, 0]], "codes must be finite"),
        ("all", "codes must hold real numbers"),
    ],
)
def test_codes_that_are_no_condition_are_refused(codes, message):
    with pytest.raises(ValueError, match=message):
        failure_atlas(SYSTEM, [0], codes=codes)


@pytest.mark.parametrize("failed", [0, None, [0.5], ["a"], [2], [-1]])
@pytest.mark.parametrize("kind", ["locked", "free"])
def test_failures_are_listed_whoever_asks(kind, failed):
    atlas = failure_atlas(SYSTEM, [0])
    for take in (SYSTEM.with_failures, atlas.row):
        with pytest.raises(ValueError, match=f"^{kind} must"):
            take(**{kind: failed})


def test_rates_and_forces_of_a_mechanism_are_checked_like_all_else():
    kin = SYSTEM.kinematics()
    for answer, name in (
        (kin.expand, "rates"),
        (kin.passive_rates, "rates"),
        (kin.constraint_force, "f"),
    ):
        with pytest.raises(ValueError, match=rf"^{name} must have shape \(\.\.\., 2\), got \(1,\)"):
            answer([1.0])
        with pytest.raises(ValueError, match=f"^{name} must be finite"):
            answer([1.0, NAN])
    with pytest.raises(ValueError, match="torque_weight must have 2 columns"):
        kin.force_mapping([0], torque_weight=[1.0])


@pytest.mark.parametrize("secondary", [[0], [0, 1], [[1.0, 1.0], [1.0, -1.0]]])
def test_a_secondary_force_along_the_major_one_is_refused(secondary):
    """It would cancel the major force, and every torque would come out zero."""
    with pytest.raises(ValueError, match="secondary must leave out the major directions"):
        force_mapping(J, [0], secondary)
    assert velocity_mapping(J, [0], secondary, secondary_weight=np.ones(len(secondary)))
