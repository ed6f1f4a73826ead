"""Numbers of each failure condition: their entries in `survey.json`, and columns of the tables."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from experiments.rig.conditions import FREE, LOCKED, failed, in_words
from experiments.rig.examined import Examined, directions_in_words
from experiments.study.quantity import Quantity
from experiments.survey.survey import Subject, Survey
from sim import Array


@dataclass(frozen=True)
class Condition:
    """One of the failure conditions of a survey at the start, by its row."""

    survey: Survey
    row: int

    @property
    def start(self) -> Examined:
        """All conditions at the start."""
        return self.survey.start

    def of(self, values: Array | None) -> float | None:
        """The number of this condition; None where it is none, or infinite."""
        if values is None or not np.isfinite(values[self.row]):
            return None
        return float(values[self.row])

    @property
    def share_of_postures(self) -> float | None:
        """Part of the postures, with the start, at which it survives what the sound robot does."""
        every = survived_everywhere(self.survey)
        if self.row >= every.shape[1] or len(every) < 2 or not every[:, 0].any():
            return None
        return float(every[every[:, 0], self.row].mean())

    def over_postures(self, of: str, statistic: Any) -> float | None:
        """A statistic of a number of the workspace, over postures where that is finite."""
        workspace = self.survey.workspace
        values = None if workspace is None else getattr(workspace, of)
        if values is None or self.row >= values.shape[1]:
            return None
        finite = values[np.isfinite(values[:, self.row]), self.row]
        return float(statistic(finite)) if len(finite) else None

    @property
    def lost_in_words(self) -> str | None:
        """Secondary directions that the failures cost; None if there are none, or all is lost."""
        names = [self.survey.subject.rows[row] for row in self.survey.subject.secondary]
        if not (names and self.start.survived[self.row]):
            return None
        return directions_in_words(self.start.lost(self.row), names)


def survived_everywhere(survey: Survey) -> Array:
    """Survival at the start, then at the other postures, shape (1 + P, C').

    Where a posture stands for the start, it is among the others.
    """
    if survey.workspace is None:
        return survey.start.survived[None]
    elsewhere = survey.workspace.survived
    own = [] if survey.subject.instead else [survey.start.survived[: elsewhere.shape[1]]]
    return np.vstack([*own, elsewhere])


def common(units: tuple[str, ...]) -> str:
    """The unit that all have, else "mixed"."""
    return units[0] if len(set(units)) == 1 else "mixed"


@dataclass(frozen=True)
class Units:
    """Of the major task and the actuators: "rad", "m", "mixed", or "1" in a matrix."""

    major: str
    actuators: str

    @classmethod
    def of(cls, subject: Subject) -> "Units":
        """Those of a subject."""
        rows = tuple(subject.row_units[row] for row in subject.major)
        return cls(common(rows), common(subject.units))

    @property
    def speed(self) -> str:
        """Key of the worst speed, or effect."""
        known = {"rad": "worst_speed_rad_per_s", "m": "worst_speed_m_per_s", "1": "worst_effect"}
        return known.get(self.major, "worst_speed_rad_and_m_per_s")

    @property
    def force(self) -> str:
        """Key of the worst force."""
        known = {"rad": "worst_torque_nm", "m": "worst_force_n"}
        return known.get(self.major, "worst_force_n_and_nm")

    def ratio(self, name: str, over: str, under: str) -> str:
        """Key of a gain, with its unit where it has one."""
        if over == under:
            return name
        words = [each.replace("mixed", "rad_and_m") for each in (over, under)]
        return f"{name}_{words[0]}_per_{words[1]}"


def quantities(subject: Subject) -> tuple[Quantity, ...]:
    """Of every condition, keys with the units of this subject."""
    units, names = Units.of(subject), subject.actuators
    what = "effect" if subject.robot is None else "speed"
    gain = units.ratio("largest_gain", units.actuators, units.major)
    error = units.ratio("error_gain", units.major, units.actuators)
    found = [
        Quantity("locked", lambda c: failed(c.start.codes[c.row], names, LOCKED)),
        Quantity("free", lambda c: failed(c.start.codes[c.row], names, FREE)),
        Quantity("failed", lambda c: in_words(c.start.codes[c.row], names), heading="failed"),
        Quantity("survived", lambda c: bool(c.start.survived[c.row])),
        Quantity("major_task", lambda c: c.start.verdict(c.row), heading="major task"),
        Quantity(units.speed, lambda c: c.of(c.start.left.worst_speed)),
        _column(f"{what}_left", f"{what}\nleft", ".0%", lambda c: c.of(c.start.speed_left)),
        *(_forces(units) if subject.torques is not None else ()),
        _column(
            "relative_manipulability",
            "relative\nmanip.",
            ".3g",
            lambda c: c.of(c.start.relative_manipulability),
        ),
        _column("best_possible", "best\npossible", ".3g", lambda c: c.of(c.start.best_possible)),
        _column(gain, "largest\ngain", ".3g", lambda c: c.of(c.start.largest_gain)),
        _column(error, "error\ngain", ".3g", lambda c: c.of(c.start.error_gain)),
        Quantity("lost_secondary", lambda c: c.lost_in_words, heading="lost\nsecondary"),
        Quantity("lost_secondary_directions", lambda c: c.start.lost(c.row).T.tolist()),
        Quantity("rank_gap", lambda c: c.of(c.start.left.gap)),
    ]
    return (*found, *(_over_postures(units.speed, gain) if subject.robot is not None else ()))


def _column(key: str, heading: str, form: str, of: Callable[[Condition], Any]) -> Quantity:
    return Quantity(key, of, heading=heading, format=form)


def _forces(units: Units) -> tuple[Quantity, ...]:
    return (
        Quantity(units.force, lambda c: c.of(c.start.left.worst_force)),
        _column("force_left", "force\nleft", ".0%", lambda c: c.of(c.start.force_left)),
    )


def _over_postures(speed: str, gain: str) -> list[Quantity]:
    """Shares of the postures, and medians and worst values over them."""
    found = [_column("share_of_postures", "postures", ".0%", lambda c: c.share_of_postures)]
    for key, of, worst, extreme in (
        (speed, "speed", np.min, "least"),
        ("relative_manipulability", "relative", np.min, "least"),
        (gain, "largest_gain", np.max, "greatest"),
    ):
        for name, statistic in (("median", np.median), (extreme, worst)):
            called = f"{key}_{name}_over_postures"
            found.append(Quantity(called, partial(_statistic, of, statistic)))
    return found


def _statistic(of: str, statistic: Callable[[Array], Any], condition: Condition) -> float | None:
    return condition.over_postures(of, statistic)
