"""Whether to go over to another controller: by the errors that the linear model predicts of both.

A diagnosis is a probability, and acting on it is a decision under risk: that with the least
expected cost (Berger, Statistical Decision Theory and Bayesian Analysis, 1985, section 1.3). The
cost is the RMS error of the major task in the time to come, from where machine and controllers
stand now; the states of the machine are the failure that was named, and the machine as it was
believed to be before.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np

from argument_checks import Array
from ftc.controller import ControllerState, Measurement, PrioritizedController
from ftc.fdi.fault_model import Fault, NominalModel, fault_model

_ABOVE = 1 + 1e-9
"""What exceeds so many times a number does so whatever round-off there is."""


@dataclass(frozen=True)
class Case:
    """What may be true.

    Attributes:
        probability: That it is.
        faults: Of the machine then.
        x: Its state then, shape (s,).
    """

    probability: float
    faults: Sequence[Fault]
    x: Array


@dataclass(frozen=True)
class Outlook:
    """The time to come, as far as it can be foreseen.

    Attributes:
        nominal: Linear model of the sound machine; its first outputs are the major task.
        output: The major task as last measured, shape (m1,): what the model is off now stays.
        references: Of the major task, tick by tick, shape (N, m1).
        secondary: Reference of the secondary goal (n,) so many ticks ahead.
        unused: What actuators out of use are commanded, likewise.
        feedforward: What is demanded beside the compensators, tick by tick, shape (N, m1); None:
            as the controllers do without.
    """

    nominal: NominalModel
    output: Array
    references: Array
    secondary: Callable[[int], Array]
    unused: Callable[[int], Array]
    feedforward: Array | None = None

    def rms(
        self,
        pilot: PrioritizedController[Any],
        state: ControllerState[Any],
        case: Case,
        enough: float = np.inf,
    ) -> float:
        """RMS error of the major task under a controller that begins in this state; or infinite.

        In standard deviations of the sensors' noise: rows of different units count alike. Once it
        is sure to exceed `enough`, this much of it is returned.
        """
        model, x, square = fault_model(self.nominal, case.faults), case.x, 0.0
        C, noise = (part[: len(self.output)] for part in (self.nominal.plant.C, self.nominal.noise))
        off, most = self.output - C @ x, enough * enough * len(self.references)
        for tick, reference in enumerate(self.references):
            secondary, unused = self._motions[tick]
            output = C.dot(x) + off
            error = (reference - output) / noise
            square += float(error.dot(error))
            if not isfinite(square):
                return np.inf
            if square > most:
                break
            measured = Measurement(output, self.nominal.displacement.dot(x))
            state = pilot.step(
                state,
                reference,
                measured,
                secondary,
                feedforward=None if self.feedforward is None else self.feedforward[tick],
                unused_reference=unused,
            )
            x = model.step(x, pilot.drives.displacements(state.inputs))
        return float(np.sqrt(square / len(self.references)))

    def goes_over(
        self,
        stays: tuple[PrioritizedController[Any], ControllerState[Any]],
        goes: tuple[PrioritizedController[Any], ControllerState[Any]],
        cases: Sequence[Case],
    ) -> bool:
        """Whether the expected error of a new controller is at most that of the present one.

        Errors that are smaller than the sensors' noise matter to nobody.

        Args:
            stays: The present controller, and its state.
            goes: The new one.
            cases: What may be true.
        """
        cases = [case for case in cases if case.probability > 0]  # certain ones round to one
        going = sum(case.probability * self.rms(*goes, case) for case in cases)
        bearable, staying = float(np.sqrt(len(self.output))), 0.0
        for case in cases:
            if going <= max(staying, bearable):  # staying only grows with further cases
                return True
            enough = (_ABOVE * going - staying) / case.probability
            staying += case.probability * self.rms(*stays, case, enough)
        return going <= max(staying, bearable)

    @cached_property
    def _motions(self) -> list[tuple[Array, Array]]:
        """Both references at each tick, the same in all cases."""
        return [(self.secondary(k), self.unused(k)) for k in range(len(self.references))]
