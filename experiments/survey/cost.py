"""Which actuator's failure costs most."""

from dataclasses import dataclass

import numpy as np

from argument_checks.ties import exceeds, least
from experiments.rig.conditions import SOUND
from experiments.rig.examined import Examined
from experiments.survey.survey import Survey, Workspace
from sim import Array


@dataclass(frozen=True, eq=False)
class Cost:
    """Of each of n actuators.

    Attributes:
        left: Speed, or effect, left in the worst direction after its failure, a part of that of the
            sound robot, in the mean over start and workspace; locked and free, shape (n, 2).
        doubles: Part of the double failures with it that are survived at the start, shape (n,).
        actuator: Number of the costliest: the most lost in the mean of locked and free, then the
            fewest doubles.
        equal: Numbers of all that are as costly.
    """

    left: Array
    doubles: Array
    actuator: int
    equal: tuple[int, ...]


def cost_of(survey: Survey) -> Cost | None:
    """The costs of all actuators; None where the sound robot does the task nowhere."""
    of_speed = _everywhere(survey)
    able = np.isfinite(of_speed[:, 0])
    if not able.any():
        return None
    left = of_speed[able].mean(axis=0)[survey.start.singles]
    loss, doubles = 1.0 - left.mean(axis=1), _doubles(survey)
    near = ~exceeds(loss.max(), loss, _ALIKE)
    costliest = least(np.where(near, doubles, np.inf))
    equal = np.flatnonzero(near & ~exceeds(doubles, doubles[costliest], _ALIKE))
    return Cost(left, doubles, costliest, tuple(equal.tolist()))


_ALIKE = 0.02
"""Part by which equal losses may differ: postures that are drawn are never quite symmetric."""


def _everywhere(survey: Survey) -> Array:
    """Speed left at the start and the other postures, zero where the task is lost, (1 + P, C').

    NaN where the sound robot does not do it.
    """
    here, workspace = _kept(survey.start), survey.workspace
    if workspace is None:
        return here[None]
    there = _kept(workspace)
    return np.vstack([here[: there.shape[1]], there])


def _kept(at: Examined | Workspace) -> Array:
    return np.where(at.survived | np.isnan(at.speed_left), at.speed_left, 0.0)


def _doubles(survey: Survey) -> Array:
    """Part of the double failures of each actuator that are survived; 1 where none is listed."""
    start = survey.start
    pairs = start.failures == 2
    if not pairs.any():
        return np.ones(start.codes.shape[1])
    has = start.codes[pairs] != SOUND
    return (has & start.survived[pairs, None]).sum(axis=0) / has.sum(axis=0)
