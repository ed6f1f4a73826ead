"""A hierarchy at another pose is the one made there."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prioritized import ConstrainedSystem, Task
from tests.profiles import examples
from tests.random_systems import failures, major_and_rest, systems


class Measured:
    """Exact entries, in units of rad for some task rows and velocities and of m for the others."""

    error_bound = 0.0

    def __init__(self, rng: np.random.Generator, m: int, c: int, N: int) -> None:
        self.task_units, self.velocity_units = rng.choice([1.0, 0.4], m), rng.choice([1.0, 0.4], N)
        self.constraint_units = np.ones(c)
        self.J_T_error, self.J_C_error = np.zeros((m, N)), np.zeros((c, N))


def assert_same(found: Any, expected: Any, targets: list[Any]) -> None:
    """Not a bit of their answers differs."""
    a, b = found.solve(targets), expected.solve(targets)
    np.testing.assert_array_equal(a.rates, b.rates)
    np.testing.assert_array_equal(a.packed.A, b.packed.A)
    np.testing.assert_array_equal(a.packed.scales, b.packed.scales)
    assert (a.status, a.gap, str(a)) == (b.status, b.gap, str(b))


@given(st.data(), systems(tasks=(2, 5), actives=(2, 4)), st.integers(-18, 0), st.booleans())
@examples(100)
def test_levels_at_another_pose_are_those_made_there(data, drawn, nearness, in_metres):
    """After other failures, near singular poses, with weights of all actuators, in two units."""
    first, rng, n = drawn.system, drawn.rng, len(drawn.system.active)
    m, N = first.J_T.shape
    J_T = first.J_T.copy()
    J_T[-1] = J_T[0] + 10.0**nearness * rng.normal(size=N)
    loops = first.J_C, first.active
    units = [Measured(rng, m, len(first.J_C), N) if in_metres else None for _ in range(2)]
    here = data.draw(failures(ConstrainedSystem(first.J_T, *loops, accuracy=units[0])))
    there = ConstrainedSystem(J_T, *loops, failures=here.failures, accuracy=units[1])
    if data.draw(st.booleans()):
        there = data.draw(failures(there))
    before, there = here.kinematics(), there.kinematics()
    major, rest = major_and_rest(data, m)
    asked: dict[str, Any] = {
        "levels": [
            Task(major, rng.uniform(0.5, 2, len(major)) if rng.random() < 0.5 else None),
            *([Task(rest, damping=rng.choice([0.0, 0.1]))] if rest else []),
            Task.joints(rng.uniform(0.5, 2, n) if rng.random() < 0.5 else None),
        ]
    }
    if rng.random() < 0.5:
        asked["tie_metric"] = rng.uniform(0.5, 2, n)
    if rng.random() < 0.5:
        asked["rate_rows"] = rng.normal(size=(1, n)), -0.3, 0.3
    limits = -rng.uniform(0.1, 1, n), rng.uniform(0.1, 1, n)
    v, d = rng.normal(size=m), rng.normal(size=there.J.shape[1])
    targets = [v[: len(major)], *([v[len(major) :]] if rest else []), d]
    made = before.hierarchy(**asked, rate_limits=limits)
    assert_same(made.at(there), there.hierarchy(**asked, rate_limits=limits), targets)
    narrow = 0.1 * limits[0], 0.1 * limits[1]
    assert_same(
        made.at(before).at(there, rate_limits=narrow),
        there.hierarchy(**asked, rate_limits=narrow),
        targets,
    )


def test_limits_and_rows_elsewhere_are_those_given_there():
    kin = ConstrainedSystem(np.eye(2), None, [0, 1]).kinematics()
    here = kin.hierarchy([Task([0, 1])], rate_limits=(-1.0, 1.0))
    moved = here.at(kin, rate_rows=(np.eye(2)[:1], -0.5, 0.5))
    np.testing.assert_allclose(moved([[9.0, 9.0]]), [0.5, 1.0], atol=1e-15)
    np.testing.assert_allclose(here([[9.0, 9.0]]), [1.0, 1.0], atol=1e-15)
    again = moved.at(kin, rate_limits=(-0.2, 0.2))
    np.testing.assert_allclose(again([[9.0, 9.0]]), [0.2, 0.2], atol=1e-15)


def test_another_mechanism_is_refused_in_one_sentence():
    kin = ConstrainedSystem(np.eye(2), None, [0, 1]).kinematics()
    here = kin.hierarchy([Task([0])])
    taller = ConstrainedSystem(np.eye(3, 2), None, [0, 1]).kinematics()
    fewer = ConstrainedSystem(np.eye(2), None, [0]).kinematics()
    for other, error in ((taller, ValueError), (fewer, ValueError), (None, TypeError)):
        with pytest.raises(error, match=r"^kinematics must"):
            here.at(other)  # pyright: ignore[reportArgumentType]
