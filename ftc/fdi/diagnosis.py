"""Settings and results of the diagnosis."""

from dataclasses import dataclass

import argument_checks as check
from ftc.fdi.fault_model import Fault, FaultKind
from ftc.fdi.uncertainty import TYPICAL, Uncertainty

_SHORTEST_S, _LONGEST_S = 1e-4, 3600.0
"""Shortest and longest sample [s]."""


@dataclass(frozen=True)
class FdiConfig:
    """Settings of the diagnosis that depend on the machine and its user.

    Attributes:
        uncertainty: Uncertainty of the model of the healthy plant.
        dither_hz: Frequency of the dither, above once an hour; None or zero: no dither.
        false_alarms_per_hour: Largest rate of false alarms of the residual test; an alarm does not
            isolate an actuator yet.
        sample_s: Time over which commands and outputs are averaged, from 0.1 ms to an hour, and at
            least one control tick; by default a dozen samples in a period of a 20 Hz dither.
    """

    uncertainty: Uncertainty = TYPICAL
    dither_hz: float | None = None
    false_alarms_per_hour: float = 0.01
    sample_s: float = 4e-3

    def __post_init__(self) -> None:
        check.instance("uncertainty", self.uncertainty, Uncertainty)
        check.number("sample_s", self.sample_s, _SHORTEST_S, _LONGEST_S)
        if self.dither_hz is not None:
            hz = check.number("dither_hz", self.dither_hz, 0.0)
            check.number("dither_hz", hz or 1.0, 1 / _LONGEST_S)
        check.number("false_alarms_per_hour", self.false_alarms_per_hour, check.SMALLEST)


DEFAULT_CONFIG = FdiConfig()
"""Default settings of the diagnosis."""


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis of one failure; times are control ticks.

    Attributes:
        fault: Most likely actuator, kind and effectiveness.
        kinds: Kinds that are not excluded yet, the most likely first.
        actuator_confidence: Probability of the actuator.
        kind_confidence: Probability of the kind, given the actuator.
        displacement: Estimated displacement of the actuator, [m] or [rad].
        onset_tick: Most likely time of the failure.
        alarm_tick: Time of the alarm of the residual test.
        tick: Time of this diagnosis.
        confirmed: Whether the diagnosis is final: the time in which it may be revised is over.
    """

    fault: Fault
    kinds: tuple[FaultKind, ...]
    actuator_confidence: float
    kind_confidence: float
    displacement: float
    onset_tick: int
    alarm_tick: int
    tick: int
    confirmed: bool

    @property
    def is_acted_on(self) -> bool:
        """Return whether a controller has to react: to a failure, or to a confirmed recovery."""
        return self.confirmed or not self.fault.is_healthy

    @classmethod
    def known(cls, fault: Fault, displacement: float = 0.0) -> "Diagnosis":
        """Return the confirmed diagnosis of a fault that is known for certain from the start."""
        check.instance("fault", fault, Fault)
        displacement = check.number("displacement", displacement)
        return cls(fault, (fault.kind,), 1.0, 1.0, displacement, 0, 0, 0, confirmed=True)
