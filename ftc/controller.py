"""The controller of Fig. 3: one compensator for each pointing angle, then the strut mapping."""

from dataclasses import dataclass, replace
from math import inf

import numpy as np
from scipy.linalg import block_diag

from experiments.hexapod.compensator import Loop
from experiments.hexapod.mapping import NOTHING_YET, Asked, StrutMapping
from sim import NOMINAL, Amplifier, Array, Pose


@dataclass(frozen=True)
class Sensed:
    """What a controller can measure at one tick.

    Attributes:
        pointing_rad: The detector's (alpha, beta), shape (2,).
        strut_m: Strut displacements, shape (6,), from sensors that not every machine has.
    """

    pointing_rad: Array
    strut_m: Array


@dataclass(frozen=True)
class Handover:
    """What one mapping owes to the one before it, so that no strut command steps.

    Attributes:
        pointing_rad: Added to what the compensators ask, for good: their integrators stand where
            the old mapping needed them, shape (2,).
        rest_m: Secondary displacement in which the old mapping left the struts, faded out without
            moving the pointing, shape (6,).
        age_s: Time since.
    """

    pointing_rad: Array
    rest_m: Array
    age_s: float


NOTHING_OWED = Handover(np.zeros(2), np.zeros(6), np.inf)


@dataclass(frozen=True)
class ControllerState:
    """What the controller remembers from tick to tick.

    Attributes:
        compensator: States of the alpha and beta compensators, shape (2, order).
        input_percent: Strut inputs it last sent, shape (6,).
        pose: Payload pose estimated from them.
        asked: What the compensators last asked of the mapping, and its answer.
        handover: From the mapping before.
    """

    compensator: Array
    input_percent: Array
    pose: Pose
    asked: Asked
    handover: Handover = NOTHING_OWED


_PARTS = ("A", "B"), ("C", "D")


class Controller:
    """Sensors in, strut inputs out; it never sees the plant.

    `step` is a pure function: the state goes in and comes out.
    """

    def __init__(
        self,
        loops: tuple[Loop, Loop],
        mapping: StrutMapping,
        amplifier: Amplifier,
        handover_s: float,
        demand_limit_rad: float = inf,
        *,
        anti_windup: bool = False,
    ) -> None:
        """Take the (alpha, beta) compensators, the mapping, and the converters it drives.

        `handover_s` is how long the secondary motion of a former mapping takes to fade;
        `demand_limit_rad` bounds each of the compensators' outputs, and `anti_windup` keeps the
        state of a compensator that is there while its error would drive it further (conditional
        integration: Astrom and Hagglund, Advanced PID Control, 2006, section 3.5).
        """
        self.mapping = mapping
        self.amplifier = amplifier
        self.handover_s = handover_s
        self.demand_limit_rad = demand_limit_rad
        self.anti_windup = anti_windup
        self._strength = np.ones(6)
        for strut, left in mapping.goal.strength.items():
            self._strength[strut] = left
        self.period_s = loops[0].period_s
        # Both loops at once: [next states; pointing] = M [states; errors].
        self._orders = len(loops), len(loops[0].A)
        self._M = np.block(
            [
                [block_diag(*(getattr(loop, part) for loop in loops)) for part in row]
                for row in _PARTS
            ]
        )

    def start(self) -> ControllerState:
        """At rest at the nominal pose."""
        return ControllerState(np.zeros(self._orders), np.zeros(6), NOMINAL, NOTHING_YET)

    def step(
        self,
        state: ControllerState,
        desired_rad: Array,
        sensed: Sensed,
        rest_m: Array | None = None,
    ) -> ControllerState:
        """One control tick; the new state holds the inputs to send.

        Args:
            state: From the tick before.
            desired_rad: (alpha, beta), shape (2,).
            sensed: Of which this controller uses the detector.
            rest_m: Desired strut displacements of the secondary goal, shape (6,); None is zero.
        """
        sent_m = self._sent_m(state)
        pose = self.mapping.estimate(sent_m, state.pose)

        error = desired_rad - sensed.pointing_rad
        after = self._M.dot(np.concatenate([state.compensator.ravel(), error]))
        compensator, pointing = after[:-2].reshape(self._orders), after[-2:]
        if self.demand_limit_rad < inf:
            demanded = pointing
            pointing = demanded.clip(-self.demand_limit_rad, self.demand_limit_rad)
            if self.anti_windup:
                held = (pointing != demanded) & (error * demanded > 0)
                compensator = np.where(held[:, None], state.compensator, compensator)
        owed = state.handover
        if owed is not NOTHING_OWED:
            pointing = pointing + owed.pointing_rad
            faded_m = self._faded(owed)
            rest_m = faded_m if rest_m is None else faded_m + rest_m
            owed = replace(owed, age_s=owed.age_s + self.period_s)
        wanted_m = self.mapping.displacements(pointing, pose, sent_m, state.asked, rest_m)
        return ControllerState(
            compensator,
            self.amplifier.input_percent(wanted_m / self._strength),
            pose,
            Asked(pointing, wanted_m, NOTHING_YET.rest_m if rest_m is None else rest_m),
            owed,
        )

    def take_over(self, state: ControllerState, falling_m: Array | None = None) -> ControllerState:
        """The state of another controller, such that this one goes on from the strut commands sent.

        Bumpless transfer: the compensators are left alone. What the surviving struts stand off
        from what this mapping asks for is split into pointing, which becomes a constant that the
        integrators are relieved of, and secondary motion, which is faded out.

        Args:
            state: Of the other controller.
            falling_m: What each strut is just about to lose of its displacement, shape (6,),
                because its coil no longer holds it. The others step, to make up for its pointing.
        """
        asked, owed, sent_m = state.asked, state.handover, self._sent_m(state)
        pose = self.mapping.estimate(sent_m, state.pose)
        own_m = self.mapping.displacements(asked.pointing_rad, pose, sent_m, asked, asked.rest_m)
        pointing_rad, rest_m = self.mapping.split(sent_m - own_m, pose)
        if falling_m is not None:
            pointing_rad = pointing_rad + self.mapping.pointing(falling_m, pose)
        handover = Handover(owed.pointing_rad + pointing_rad, self._faded(owed) + rest_m, age_s=0.0)
        return replace(state, handover=handover)

    def _sent_m(self, state: ControllerState) -> Array:
        """Strut displacements that the coils' last forces hold, shape (6,)."""
        return self._strength * self.amplifier.displacement_m(state.input_percent)

    def _faded(self, owed: Handover) -> Array:
        """What is left of the former mapping's secondary displacement, shape (6,)."""
        if owed.age_s >= self.handover_s:
            return np.zeros(6)
        return 0.5 * (1 + np.cos(np.pi * owed.age_s / self.handover_s)) * owed.rest_m
