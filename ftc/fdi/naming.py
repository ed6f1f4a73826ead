"""Decide whether to name an actuator, to revise, confirm or withdraw it, or to dismiss an alarm."""

from dataclasses import dataclass
from typing import Literal

from scipy.special import chdtri

from ftc.fdi.diagnosis import Diagnosis, FdiConfig
from ftc.fdi.fault_model import Fault
from ftc.fdi.isolation.verdict import Verdict

Action = Literal["wait", "dismiss", "name", "keep", "confirm", "begin", "give_up"]
"""Go on; nothing has failed; the verdict's failure is named, or instead of another; what was named
is confirmed as it is; as it is now; evidence begins anew; nothing explains what is seen."""

WINDOW_S = 0.2
"""So long no failure fits the residuals before evidence begins anew: what has happened before, such
as a bump, is left behind."""

MOST_LEFT = 0.8
"""A name is taken back once its failure leaves four times the energy that it explains."""


@dataclass(frozen=True)
class Naming:
    """The rules.

    Attributes:
        config: Settings.
        freedom: Numbers measured between two verdicts once an actuator is named.
        improbable: Probability at which these contradict what was named.
    """

    config: FdiConfig
    freedom: int
    improbable: float

    def action(
        self,
        found: Diagnosis | None,
        before: Verdict | None,
        verdict: Verdict,
        waited_s: float,
        seen_s: float,
    ) -> Action:
        """What to do.

        Args:
            found: What is named so far.
            before: The verdict before.
            verdict: The present one.
            waited_s: Since the alarm, or since an actuator was first named.
            seen_s: Since the evidence began.
        """
        config = self.config
        sound = verdict.fault_free_confidence >= config.confidence
        # What a name is taken back for must explain better than it does.
        if sound and (found is None or verdict.inflation <= config.largest_inflation):
            return "dismiss"
        if found is None:
            return self._first(verdict, waited_s, seen_s)
        return self._further(found, before, verdict, waited_s)

    def _first(self, verdict: Verdict, waited_s: float, seen_s: float) -> Action:
        config, fits = self.config, self.fits(verdict)
        certain = verdict.actuator_confidence >= config.confidence
        explained = fits and verdict.unexplained <= config.largest_unexplained
        if certain and explained and seen_s >= config.evidence_s:
            return "name"
        if waited_s >= config.look_back_s:
            return "give_up"
        return "begin" if not fits and seen_s >= WINDOW_S else "wait"

    def _further(
        self, found: Diagnosis, before: Verdict | None, verdict: Verdict, waited_s: float
    ) -> Action:
        config = self.config
        certain = verdict.actuator_confidence >= config.confidence
        if before is not None and self._contradicts(before, verdict):
            # One that comes and goes has not been sound for the time that a confirmation takes.
            return "dismiss" if found.fault.is_sound else "keep"
        if not self.fits(verdict) or verdict.unexplained > MOST_LEFT:
            return "give_up"
        if certain and waited_s >= config.confirmation_s:
            return "confirm"
        if certain and self._revises(found.fault, verdict):
            return "name"
        return "give_up" if not certain and waited_s >= 2 * config.confirmation_s else "wait"

    def fits(self, verdict: Verdict) -> bool:
        """Whether what the most likely failure leaves is noise, of a plant that there may be."""
        if verdict.strain > self.config.largest_strain:
            return False
        small = verdict.inflation <= self.config.largest_inflation
        return small or verdict.unexplained <= self.config.model_error

    def _contradicts(self, before: Verdict, verdict: Verdict) -> bool:
        """Whether the latest samples do not go on as those before: something else has happened."""
        if verdict.energy <= before.energy:
            return False
        limit = float(chdtri(self.freedom, self.improbable)) * before.inflation
        return verdict.energy - before.energy > limit

    def _revises(self, before: Fault, verdict: Verdict) -> bool:
        """Whether another actuator or kind is certain by now, or another effectiveness."""
        now, config = verdict.fault, self.config
        if now.actuator != before.actuator:
            return True
        if now.kind == before.kind:
            return abs(now.effectiveness - before.effectiveness) > config.effectiveness_step
        return max(verdict.kind_confidences) >= config.confidence
