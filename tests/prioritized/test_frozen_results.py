"""No array that `prioritized` returns in a record can be written to."""

import numpy as np
import pytest

import prioritized
from prioritized import (
    ConstrainedSystem,
    Task,
    failure_atlas,
    lexicographic_least_squares,
    viable_rates,
)
from tests.frozen import writable

J = np.random.default_rng(5).normal(size=(3, 4))
SYSTEM = ConstrainedSystem(np.eye(3, 5) + 0.1, np.ones((1, 5)), [0, 1, 2], stiffness=np.ones(5))
KIN = SYSTEM.kinematics()
BOX = (-0.1 * np.ones(3), np.ones(3))
RECORDS = {
    "system": SYSTEM,
    "kinematics": KIN,
    "postures": SYSTEM.postures(np.stack([SYSTEM.J_T, 2 * SYSTEM.J_T])),
    "manipulability": KIN.manipulability([0]),
    "atlas": failure_atlas(SYSTEM, [0]),
    "velocity": KIN.velocity_mapping([0], rate_limits=BOX).solve([1.0]),
    "scaled": KIN.velocity_mapping([0], rate_limits=BOX, when_limited="scaled").solve([1.0]),
    "inside": KIN.velocity_mapping([0], rate_limits=BOX).solve([1e-3]),
    "force": KIN.force_mapping([0], torque_limits=BOX).solve([1.0]),
    "hierarchy": KIN.hierarchy([Task([0]), Task([1])], rate_limits=BOX).solve([[1.0], [0.5]]),
    "lexicographic": lexicographic_least_squares(
        [(J, np.ones(3))], -np.ones(4), 0.1 * np.ones(4), rows=J[:1], rows_lower=[9.0]
    ),
    "viable": viable_rates(
        [0.0],
        [0.0],
        position_limits=(-1, 1),
        rate_limits=(-1, 1),
        acceleration_limits=(-1, 1),
        period_s=0.1,
    ),
}
SOLVED = {"velocity": "rates", "inside": "rates", "force": "torques", "hierarchy": "rates"}
SOLVED |= {"lexicographic": "x"}


@pytest.mark.parametrize("record", RECORDS)
def test_a_result_cannot_be_written_to(record):
    assert list(writable(prioritized, record, RECORDS[record])) == []


@pytest.mark.parametrize("record", SOLVED)
def test_an_answer_cannot_be_written_to(record):
    """The next tick starts from it."""
    with pytest.raises(ValueError, match="read-only"):
        getattr(RECORDS[record], SOLVED[record])[:] = 0.0
