"""The controller of Fig. 3: one compensator for each pointing angle, then the strut mapping."""

from dataclasses import dataclass

import numpy as np

from experiments.compensator import Loop
from experiments.mapping import NOTHING_YET, Asked, StrutMapping
from sim import NOMINAL, Amplifier, Array, Pose


@dataclass(frozen=True)
class ControllerState:
    """What the controller remembers from tick to tick.

    Attributes:
        compensator: States of the alpha and beta compensators, shape (2, order).
        input_percent: Strut inputs it last sent, shape (6,).
        pose: Payload pose estimated from them.
        asked: What the compensators last asked of the mapping, and its answer.
    """

    compensator: Array
    input_percent: Array
    pose: Pose
    asked: Asked


class Controller:
    """Detector angles in, strut inputs out; it never sees the plant.

    `step` is a pure function: the state goes in and comes out.
    """

    def __init__(
        self, loops: tuple[Loop, Loop], mapping: StrutMapping, amplifier: Amplifier
    ) -> None:
        """Take the (alpha, beta) compensators, the mapping, and the converters it drives."""
        self.mapping = mapping
        self.amplifier = amplifier
        self._A = np.stack([loop.A for loop in loops])
        self._B = np.stack([loop.B[:, 0] for loop in loops])
        self._C = np.stack([loop.C[0] for loop in loops])
        self._D = np.array([loop.D[0, 0] for loop in loops])

    def start(self) -> ControllerState:
        """At rest at the nominal pose."""
        return ControllerState(np.zeros_like(self._B), np.zeros(6), NOMINAL, NOTHING_YET)

    def step(
        self, state: ControllerState, desired_rad: Array, measured_rad: Array
    ) -> ControllerState:
        """One control tick; the new state holds the inputs to send."""
        sent_m = self.amplifier.displacement_m(state.input_percent)
        pose = self.mapping.estimate(sent_m, state.pose)

        error = desired_rad - measured_rad
        pointing = np.einsum("ij,ij->i", self._C, state.compensator) + self._D * error
        compensator = np.einsum("ijk,ik->ij", self._A, state.compensator) + self._B * error[:, None]
        wanted_m = self.mapping.displacements(pointing, pose, sent_m, state.asked)
        percent = self.amplifier.input_percent(wanted_m)
        return ControllerState(compensator, percent, pose, Asked(pointing, wanted_m))
