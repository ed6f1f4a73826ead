"""What a diagnosis goes by; stated beforehand."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Rules:
    """What is stated beforehand; all thresholds follow from it.

    Attributes:
        false_alarms_per_hour: Of the chart, at most.
        confidence: A strut is named when it is this likely; an alarm dismissed when soundness is.
        look_back_s: How far onsets are looked for.
        onset_growth: The onsets looked for are so much further back from one to the next, or a
            tick: what fails slowly enough to be found late need not be dated sharply.
        confirmation_s: How long a diagnosis may be revised.
        strength_step: A weak coil's strength is revised when it has come out so much different.
        misfit: No strut is named whose residuals mere noise would exceed less often than this.
    """

    false_alarms_per_hour: float = 0.01
    confidence: float = 0.999
    look_back_s: float = 2.0
    onset_growth: float = 1.03
    confirmation_s: float = 1.0
    strength_step: float = 0.05
    misfit: float = 1e-6


RULES = Rules()
