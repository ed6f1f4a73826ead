"""Settings and results of a diagnosis."""

from dataclasses import dataclass

import argument_checks as check
from ftc.fdi.fault_model import Fault, FaultKind
from ftc.fdi.uncertainty import TYPICAL, Uncertainty

_SHORTEST_S, _LONGEST_S = 1e-4, 3600.0


@dataclass(frozen=True)
class FdiConfig:
    """Settings of the diagnosis: what a machine and its user decide.

    Its constants stand beside the rules that use them, each with its reason.

    Attributes:
        uncertainty: Of the model of the healthy plant.
        dither_hz: Frequency of the dither, above once an hour; None or zero: there is none.
        false_alarms_per_hour: Of the residual test, at most; an alarm names no actuator yet.
        sample_s: Commands and outputs are averaged over so long, from 0.1 ms to an hour, or over
            one control tick; by default a dozen samples in a period of a dither of 20 Hz.
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


@dataclass(frozen=True)
class Diagnosis:
    """One failure, as far as it is known; times are control ticks.

    Attributes:
        fault: Actuator and kind.
        kinds: Those that cannot be told apart yet, the most likely first.
        actuator_confidence: Probability of the actuator.
        kind_confidence: Probability of the kind, given the actuator.
        displacement: Of the actuator by this diagnosis.
        onset_tick: Most likely time of the failure.
        alarm_tick: When the residual test raised the alarm.
        tick: When this was found.
        confirmed: Whether the time in which it could be revised is over.
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
        """Whether a controller obeys it: that an actuator works again is to be confirmed first."""
        return self.confirmed or not self.fault.is_healthy

    @classmethod
    def known(cls, fault: Fault, displacement: float = 0.0) -> "Diagnosis":
        """Make the diagnosis of a failure that is known for certain, and from the start."""
        check.instance("fault", fault, Fault)
        displacement = check.number("displacement", displacement)
        return cls(fault, (fault.kind,), 1.0, 1.0, displacement, 0, 0, 0, confirmed=True)
