"""Limits of a matrix' inputs about what they exert at rest, with failed inputs stuck or out."""

import numpy as np

from experiments.rig.conditions import FREE, SOUND, Codes
from experiments.rig.examined import Limits
from experiments.survey.survey import Subject
from prioritized import RANK_TOLERANCE


def limits_about_rest(subject: Subject, codes: Codes) -> Limits:
    """Limits of the working inputs less what these exert at rest in each condition, (C, n) each.

    (n,) where nothing is held, because they exert nothing.

    Locked inputs are stuck at what they exert at rest without failures, free ones are zero, and
    the others hold what is then missing, with least norm. Where they cannot, the task is lost.
    """
    lower, upper = subject.rates.values
    if subject.hold is None:
        return lower, upper
    at_rest = subject.system.kinematics().velocity_mapping(
        subject.major,
        joint_weight=np.ones(len(subject.actuators)),  # of least norm within the limits
        rate_limits=subject.rates.values,
    )
    B, works = subject.system.J_T[list(subject.major)], codes == SOUND
    stuck = np.where(works | (codes == FREE), 0.0, at_rest(subject.hold))
    missing = subject.hold - stuck @ B.T
    inverse = np.linalg.pinv(B * works[:, None, :], rcond=RANK_TOLERANCE)
    resting = (inverse @ missing[..., None])[..., 0]
    return lower - resting, upper - resting
