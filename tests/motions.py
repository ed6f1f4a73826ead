"""Everything that a mechanism can do, as the mappings know it."""

import numpy as np
import scipy.linalg

from prioritized import ConstrainedSystem
from prioritized._kinematics import Kinematics
from sim import Jacobians


def kinematics(jac: Jacobians) -> Kinematics:
    """Of the sound system."""
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active).kinematics()


def motions(kin: Kinematics) -> np.ndarray:
    """Basis (N, .) of all admissible velocities, those of surviving actuators included."""
    active = np.eye(len(kin.active))
    if kin.active_constraint.size:
        active = scipy.linalg.null_space(kin.active_constraint)
    free = kin.passive_self_motion
    basis = np.zeros((len(kin.active) + len(kin.passive), active.shape[1] + free.shape[1]))
    basis[kin.active, : active.shape[1]] = active
    basis[kin.passive] = np.hstack([kin.passive_gain @ active, free])
    return basis
