"""How much of a subject is examined: failures at once, and which limits; and what is left out."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb

import numpy as np

from experiments.rig.conditions import KINDS
from experiments.survey.survey import Subject
from prioritized import Kinematics

MOST_CONDITIONS = 20_000
"""Of one posture: a second or two for ten actuators."""
MOST_SETS = 1_000_000
"""Sets of actuators that are tried for the worst directions of all conditions: a few seconds."""
BOTH_UP_TO = 12
"""Actuators; with more, other postures than the start are examined for single failures alone."""


@dataclass(frozen=True)
class Extent:
    """What is examined.

    Attributes:
        listed: Failures at once of which every condition is listed.
        counted: Failures at once of which conditions are counted.
        elsewhere: Failures at once at other postures than the start.
        speed: Whether the worst speed is computed.
        force: Whether the worst force is.
        left_out: A sentence each.
    """

    listed: int
    counted: int
    elsewhere: int
    speed: bool
    force: bool
    left_out: tuple[str, ...]


def extent_of(subject: Subject) -> Extent:
    """What can be examined within seconds, from the numbers of actuators, rows and constraints."""
    n = len(subject.actuators)
    counted = _failures_within(n)
    listed = min(counted, 2)
    conditions = conditions_up_to(n, listed)
    kin, m1 = subject.system.kinematics(), len(subject.major)
    of_speed = _sets(n, m1 + len(kin.active_constraint))
    of_force = _sets(n, m1 + n - _independent_torques(kin))
    speed, force = (conditions * sets <= MOST_SETS for sets in (of_speed, of_force))
    elsewhere = listed if n <= BOTH_UP_TO else 1
    said = [*_conditions_left_out(n, listed, counted), *_numbers_left_out(subject, speed, force)]
    if subject.robot is not None and elsewhere < listed:
        said.append(
            f"At other postures than the start only single failures were examined: with {n} "
            f"actuators there are {conditions - conditions_up_to(n, 1):,} double ones."
        )
    return Extent(listed, counted, elsewhere, speed, force, tuple(said))


def conditions_up_to(n: int, failures: int) -> int:
    """Number of conditions with at most so many failures, the sound one among them."""
    return sum(comb(n, count) * len(KINDS) ** count for count in range(failures + 1))


def _failures_within(n: int) -> int:
    """Largest number of failures at once whose conditions are few enough; one at least."""
    possible = (k for k in range(n, 1, -1) if conditions_up_to(n, k) <= MOST_CONDITIONS)
    return next(possible, min(n, 1))


def _sets(n: int, rank: int) -> int:
    """Sets of columns to which a facet may be orthogonal, for rows of this rank."""
    return comb(n, max(rank - 1, 0))


def _independent_torques(kin: Kinematics) -> int:
    """Dimension of the torques that forces at the task and inside the loops hold."""
    return int(np.linalg.matrix_rank(np.vstack([kin.J, kin.active_constraint])))


def _conditions_left_out(n: int, listed: int, counted: int) -> Iterator[str]:
    if counted < n:
        more = "singles and doubles" if counted == 2 else f"at most {counted} failures at once"
        more = "single failures" if counted == 1 else more
        yield (
            f"Of the {len(KINDS) + 1}^{n} conditions of {n} actuators {more} were examined "
            f"({conditions_up_to(n, counted):,} conditions); {counted + 1} at once would be "
            f"{conditions_up_to(n, counted + 1) - conditions_up_to(n, counted):,} more."
        )


def _numbers_left_out(subject: Subject, speed: bool, force: bool) -> Iterator[str]:
    wanted = {"speed" if subject.robot else "effect": speed}
    if subject.torques is not None:
        wanted["force"] = force
    for what, computed in wanted.items():
        if not computed:
            yield (
                f"The {what} left in the worst direction was not computed: with "
                f"{len(subject.actuators)} actuators and {len(subject.major)} major rows too many "
                "sets of actuators would have to be tried; fewer major rows need fewer."
            )
    if not speed:
        yield "Whether a failure is survived was decided without limits of the speed or effect."
