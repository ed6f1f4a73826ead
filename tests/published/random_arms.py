"""Random serial arms, and relative manipulabilities of a mechanism."""

from itertools import combinations

import numpy as np

from argument_checks import Array
from prioritized import ConstrainedSystem


def random_arm(n: int, rng: np.random.Generator) -> str:
    """Return the MJCF of an arm with n hinges, random axes, links and posture."""
    text, motors = '<site name="tool"/>', ""
    for k in range(n):
        place, axis = (" ".join(map(str, rng.normal(size=3))) for _ in range(2))
        hinge = f'<joint name="hinge{k}" axis="{axis}"/><geom size="0.1"/>'
        text = f'<body pos="{place}">{hinge}{text}</body>'
        motors += f'<motor joint="hinge{k}"/>'
    return f"<mujoco><worldbody>{text}</worldbody><actuator>{motors}</actuator></mujoco>"


def relative_manipulabilities(healthy: ConstrainedSystem, i: int) -> Array:
    """Return the relative manipulability of each choice of i locked actuators."""
    choices = [(), *combinations(range(len(healthy.active)), i)]
    J = [healthy.with_failures(locked=locked).kinematics().J for locked in choices]
    w = np.array([np.prod(np.linalg.svd(A, compute_uv=False)) for A in J])
    return w[1:] / w[0]
