"""One tick of the locked hexapod, by the general path and in closed form, beside mink.

LAPACK on MuJoCo's Jacobians is the judge between them.
"""

from collections.abc import Sequence
from copy import deepcopy

import mujoco
import numpy as np
from mink import Configuration
from scipy.linalg.lapack import dgglse

from experiments.benchmark.agreement import Agreement, compare
from experiments.benchmark.case import STUCK, Case, strut_mapping, strut_velocities
from experiments.benchmark.general import general_tick
from experiments.benchmark.mink_ik import arguments, solve_ik
from experiments.benchmark.stopwatch import Contender
from experiments.hexapod.goal import MAJOR
from sim import Array, Pose, jacobians

TOLERANCE = 1e-5
"""mink closes the 0.7 nm by which the loops sag, too: that is 1e-6 of the answer."""
_SAMPLES = 10


def contenders(model: mujoco.MjModel, cases: Sequence[Case]) -> list[Contender]:
    """One tick in each way, and mink's kinematics, which the general path includes."""
    theirs = arguments(model, cases)
    updates = [(each[0], case.qpos) for each, case in zip(theirs, cases, strict=True)]
    asked = [(case.pointing_rad, case.qpos) for case in cases]

    def asked_at_poses() -> list[tuple[Array, Pose]]:
        return [(case.pointing_rad, deepcopy(case.pose)) for case in cases]

    return [
        Contender("tick", general_tick(model).displacements, lambda: asked, samples=_SAMPLES),
        Contender(
            "hexapod_tick", strut_mapping(model).displacements, asked_at_poses, samples=_SAMPLES
        ),
        Contender("mink", solve_ik, lambda: theirs, samples=_SAMPLES),
        Contender("mink_update", Configuration.update, lambda: updates, samples=_SAMPLES),
    ]


def by_lapack(model: mujoco.MjModel, case: Case) -> Array:
    """The same strut displacements (6,) from MuJoCo's Jacobians, in all joints at once."""
    data = mujoco.MjData(model)
    data.qpos[:] = case.qpos
    jac = jacobians(model, data, "payload", "base")
    struts = np.eye(model.nv)[jac.active]
    equal = np.vstack([jac.J_T[MAJOR], jac.J_C, struts[[STUCK]]])
    wanted = np.zeros(len(equal))
    wanted[: len(MAJOR)] = case.pointing_rad
    return dgglse(struts, equal, np.zeros(len(struts)), wanted)[3][jac.active]


def agreement(model: mujoco.MjModel, cases: Sequence[Case]) -> Agreement:
    """Strut displacements of all four."""
    general, mapping = general_tick(model), strut_mapping(model)
    struts = strut_velocities(model)
    answers = {
        "tick": [general.displacements(case.pointing_rad, case.qpos) for case in cases],
        "hexapod_tick": [mapping.displacements(case.pointing_rad, case.pose) for case in cases],
        "mink": [solve_ik(*each)[struts] for each in arguments(model, cases)],
        "dgglse": [by_lapack(model, case) for case in cases],
    }
    arrays = {name: np.array(each) for name, each in answers.items()}
    return compare("pointing with strut 1 locked", arrays, TOLERANCE)
