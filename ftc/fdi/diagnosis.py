"""Settings and results of a diagnosis."""

from dataclasses import dataclass

import argument_checks as check
from ftc.fdi.fault_model import Fault, FaultKind
from ftc.fdi.uncertainty import TYPICAL, Uncertainty

_LONGEST_S, _MOST_ORDER = 3600.0, 100


@dataclass(frozen=True)
class FdiConfig:
    """Settings of the diagnosis, from which all thresholds follow.

    Attributes:
        uncertainty: Of the model of the sound plant.
        dither_hz: Frequency of the dither, if there is one; no actuator is named before a period of
            it has passed since the alarm.
        false_alarms_per_hour: Of the residual test, at most; an alarm names no actuator yet.
        confidence: An actuator is named when it is this likely; an alarm dismissed when it is this
            likely that nothing has failed.
        largest_unexplained: An actuator is named only if its failure leaves at most this part of
            the energy that the residuals have without it, above noise: the square of the relative
            error of a model that is expected.
        largest_inflation: And only if the variance of the residuals since its onset is at most so
            many times that of before: what shakes a machine reaches its sensors another way after
            a failure.
        model_error: Or if the part that it leaves is at most this: the square of the relative error
            of a model that the largest failures show.
        largest_strain: And never if the parameters of the plant must be further than this, in
            standard deviations, from what is known of them: what moves a servo by some other cause
            is explained by a damper of a hundred times its uncertainty, too.
        sample_s: Commands and outputs are averaged over so long.
        learning_s: So long after the start the plant is taken for sound, and its spectrum measured.
        memory_s: Of the spectrum afterwards.
        order: Of the autoregressive model of the spectrum.
        look_back_s: How far onsets are looked for, and how long an alarm may stay unexplained.
        onset_growth: The onsets looked for are so much further back from one to the next, or a
            sample: what fails slowly enough to be found late need not be dated sharply.
        confirmation_s: How long a diagnosis may be revised.
        effectiveness_step: A diagnosed effectiveness is revised when it has changed by this much.

    Raises:
        ValueError, TypeError: Not numbers of their kind, no probabilities, times longer than an
            hour, a period of the dither included, or an order above 100.
    """

    uncertainty: Uncertainty = TYPICAL
    dither_hz: float | None = None
    false_alarms_per_hour: float = 0.01
    confidence: float = 0.999
    largest_unexplained: float = 0.3
    largest_inflation: float = 30.0
    model_error: float = 0.01
    largest_strain: float = 20.0
    sample_s: float = 4e-3
    learning_s: float = 0.8
    memory_s: float = 5.0
    order: int = 10
    look_back_s: float = 1.0
    onset_growth: float = 1.25
    confirmation_s: float = 1.0
    effectiveness_step: float = 0.1

    def __post_init__(self) -> None:
        check.instance("uncertainty", self.uncertainty, Uncertainty)
        for name in ("sample_s", "learning_s", "memory_s", "look_back_s", "confirmation_s"):
            check.duration(name, getattr(self, name), most=_LONGEST_S)
        if self.dither_hz is not None:
            hz = check.number("dither_hz", self.dither_hz)
            if 0 < hz < 1 / _LONGEST_S:
                raise ValueError(
                    f"dither_hz must be zero or at least {1 / _LONGEST_S:.3g}, got {hz}"
                )
        for name in ("largest_inflation", "largest_strain", "false_alarms_per_hour"):
            check.positive(name, getattr(self, name))
        for name in ("confidence", "largest_unexplained", "model_error", "effectiveness_step"):
            check.at_most_one(name, getattr(self, name))
        check.index("order", self.order, _MOST_ORDER + 1)
        if check.positive("onset_growth", self.onset_growth) < 1:
            raise ValueError(f"onset_growth must be at least 1, got {self.onset_growth}")

    @property
    def evidence_s(self) -> float:
        """Time from an alarm to a name, at least: a period of the dither, if there is one.

        In less of it an actuator that locks can look like another one that weakens, on a plant
        whose errors the believed model does not have.
        """
        return 1 / self.dither_hz if self.dither_hz else 0.0


DEFAULT_CONFIG = FdiConfig()


@dataclass(frozen=True)
class Diagnosis:
    """One failure, as far as it is known.

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
        return self.confirmed or not self.fault.is_sound

    @classmethod
    def told(cls, fault: Fault, displacement: float = 0.0) -> "Diagnosis":
        """A failure that is known for certain, from elsewhere and from the start.

        Raises:
            ValueError, TypeError: No fault, or no finite displacement.
        """
        check.instance("fault", fault, Fault)
        displacement = check.signed("displacement", displacement)
        return cls(fault, (fault.kind,), 1.0, 1.0, displacement, 0, 0, 0, confirmed=True)
