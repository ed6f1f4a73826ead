"""Settings, state and diagnoses of a monitor."""

from dataclasses import dataclass

from argument_checks import Array
from ftc.fdi.fault_model import Fault
from ftc.fdi.hypotheses import Evidence, Verdict


@dataclass(frozen=True)
class FdiConfig:
    """Settings of the diagnosis, from which all thresholds follow.

    Attributes:
        false_alarms_per_hour: Of the residual test, at most.
        confidence: An actuator is named when it is this likely; an alarm dismissed when it is this
            likely that nothing has failed.
        look_back_s: How far onsets are looked for.
        onset_growth: The onsets looked for are so much further back from one to the next, or a
            tick: what fails slowly enough to be found late need not be dated sharply.
        confirmation_s: How long a diagnosis may be revised.
        effectiveness_step: A diagnosed effectiveness is revised when it has changed by this much.
        least_p_value: No actuator is named whose residuals have a smaller p-value.
    """

    false_alarms_per_hour: float = 0.01
    confidence: float = 0.999
    look_back_s: float = 2.0
    onset_growth: float = 1.03
    confirmation_s: float = 1.0
    effectiveness_step: float = 0.05
    least_p_value: float = 1e-6


DEFAULT_CONFIG = FdiConfig()


@dataclass(frozen=True)
class Diagnosis:
    """One failure, as far as it is known.

    Attributes:
        fault: Actuator and kind.
        actuator_confidence: Probability of the actuator.
        kind_confidence: Probability of the kind, given the actuator.
        displacement: Of the actuator by this diagnosis.
        onset_tick: Most likely time of the failure.
        alarm_tick: When the residual test raised the alarm.
        tick: When this was found.
        confirmed: Whether the time in which it could be revised is over.
    """

    fault: Fault
    actuator_confidence: float
    kind_confidence: float
    displacement: float
    onset_tick: int
    alarm_tick: int
    tick: int
    confirmed: bool

    @classmethod
    def told(cls, fault: Fault, displacement: float = 0.0) -> "Diagnosis":
        """A failure that is known for certain, from elsewhere and from the start."""
        return cls(fault, 1.0, 1.0, displacement, 0, 0, 0, confirmed=True)


@dataclass(frozen=True)
class Moment:
    """One tick of history.

    Attributes:
        tick: Counted from the first.
        x: State of the believed model, shape (s,).
        commanded: Displacements since the tick before, shape (n,).
        y: Whitened outputs, shape (p,).
    """

    tick: int
    x: Array
    commanded: Array
    y: Array


@dataclass(frozen=True)
class MonitorState:
    """State of a monitor.

    Attributes:
        history: The latest moments, the newest last.
        recent: Latest residuals, for their test: of the believed model, and once an actuator is
            named of that diagnosis.
        evidence: Of the hypotheses, from an alarm on.
        alarm_ticks: Of all alarms so far, the last of them the one that is looked into.
        verdict: What the evidence says now.
        named_tick: When an actuator was first named.
        diagnosis: Of the present failure, from then on.
        unexplained: Whether an alarm was given up once: no single failure after another explained
            the outputs. The monitor goes on with what was confirmed before.
    """

    history: tuple[Moment, ...]
    recent: Array
    evidence: Evidence | None = None
    alarm_ticks: tuple[int, ...] = ()
    verdict: Verdict | None = None
    named_tick: int = 0
    diagnosis: Diagnosis | None = None
    unexplained: bool = False
