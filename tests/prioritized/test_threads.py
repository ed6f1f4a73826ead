"""No answer depends on which call came before it, in whichever thread."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from prioritized import ConstrainedSystem, Task, lexicographic_least_squares

RNG = np.random.default_rng(37)
TARGETS = RNG.uniform(-1.0, 1.0, size=(500, 2))
KIN = ConstrainedSystem(RNG.normal(size=(4, 6)), None, range(6)).kinematics()
LIMITED = KIN.velocity_mapping([0, 1], joint_weight=np.ones(6), rate_limits=(-0.1, 0.1))
HIERARCHY = KIN.hierarchy([Task([0, 1]), Task.joints()], rate_limits=(-0.1, 0.1))
CALLS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "velocity": KIN.velocity_mapping([0, 1], joint_weight=np.ones(6)),
    "limited": LIMITED,
    "solved": lambda v: LIMITED.solve(v).rates,
    "scaled": KIN.velocity_mapping(
        [0, 1], joint_weight=np.ones(6), rate_limits=(-0.1, 0.1), when_limited="scaled"
    ),
    "force": KIN.force_mapping([0, 1], torque_limits=(-0.1, 0.1)),
    "hierarchy": lambda v: HIERARCHY([v, None]),
    "attainable": KIN.attainable([0, 1], (-1.0, 1.0)).support,
    "least squares": lambda v: (
        lexicographic_least_squares([(KIN.J[:2], v)], lower=-np.ones(6), upper=np.ones(6)).x
    ),
}


@pytest.mark.usefixtures("switching")
@pytest.mark.parametrize("name", CALLS)
def test_four_threads_get_the_answers_of_one(name):
    call = CALLS[name]
    targets = TARGETS[: 500 if name in ("velocity", "limited", "solved") else 60]
    alone = [call(v) for v in targets]
    with ThreadPoolExecutor(4) as pool:
        orders = [np.roll(np.arange(len(targets)), 17 * k) for k in range(4)]
        for order, answers in zip(
            orders, pool.map(lambda order: [call(targets[k]) for k in order], orders), strict=True
        ):
            for k, answer in zip(order, answers, strict=True):
                np.testing.assert_array_equal(answer, alone[k])
