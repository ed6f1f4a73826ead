"""The controller of Fig. 3: one compensator for each major channel, then the mapping."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Generic, Protocol

import numpy as np
from scipy.linalg import block_diag

import argument_checks as check
from argument_checks import Array
from ftc.control.anti_windup import SLOWNESS, tracking_gain
from ftc.control.bumpless_transfer import BumplessTransfer, bumpless_transfer
from ftc.control.compensator import Channel
from ftc.control.frequency_response import channels
from ftc.control.geometry import Pose
from ftc.control.local_mapping import PreviousCommand
from ftc.control.mapping import PrioritizedMapping
from kernels import lib, pointer


@dataclass(frozen=True)
class Measurement:
    """Measurements of a controller at one tick.

    Attributes:
        output: The major task, shape (m1,).
        displacement: Displacements of the actuators, shape (n,), where they have sensors.
    """

    output: Array
    displacement: Array


class Converter(Protocol):
    """Conversion between actuator displacements and inputs of the drives."""

    def inputs(self, displacements: Array, /) -> Array:
        """Inputs of the drives, shape (n,)."""
        ...

    def displacements(self, inputs: Array, /) -> Array:
        """Displacements at which the actuators hold, shape (n,)."""
        ...


class DirectDrive:
    """Drives that take displacements as they are, such as position servos."""

    def inputs(self, displacements: Array) -> Array:
        """The displacements themselves."""
        return displacements

    def displacements(self, inputs: Array) -> Array:
        """The displacements themselves."""
        return inputs


def checked_drives(drives: Converter, actuators: int) -> Any:
    """The drives themselves, which convert the displacements of so many actuators at rest.

    Raises:
        ValueError, TypeError: They do not.
    """
    check.methods("drives", drives, "inputs", "displacements")
    still = check.exactly("drives.inputs(0)", drives.inputs(np.zeros(actuators)), actuators)
    check.exactly("drives.displacements", drives.displacements(still), actuators)
    return drives


@dataclass(frozen=True)
class ControllerState(Generic[Pose]):
    """State of the controller between ticks.

    Attributes:
        compensator: States of all compensators, one after the other.
        inputs: What was last sent to the drives, shape (n,).
        pose: Estimated from it.
        asked: What was last demanded of the mapping, and its answer.
        bumpless_transfer: From the mapping before; None where there was none.
    """

    compensator: Array
    inputs: Array
    pose: Pose
    asked: PreviousCommand
    bumpless_transfer: BumplessTransfer | None = None


_PARTS = ("A", "B"), ("C", "D")


class PrioritizedController(Generic[Pose]):
    """Controller from measurements to inputs of the drives, without access to the plant.

    `step` is a pure function: the state goes in and comes out.
    """

    def __init__(
        self,
        loops: Sequence[Channel],
        mapping: PrioritizedMapping[Pose],
        drives: Converter,
        handover_s: float,
        demand_limit: float = inf,
        *,
        anti_windup: bool = False,
        tracking_slowness: float = 1.0,
        reference_feedforward: bool = False,
    ) -> None:
        """Take the compensators, one for each major row, the mapping, and the drives.

        `handover_s` is the time in which the secondary motion of a former mapping fades out;
        `demand_limit` bounds the output of each compensator, and `anti_windup` keeps the
        state of a compensator that is there while its error would drive it further (conditional
        integration: Astrom and Hagglund, Advanced PID Control, 2006, section 3.5). Where the
        mapping has limits, it also makes the compensators observe the major task that is achieved;
        `tracking_slowness` as in :func:`ftc.control.anti_windup.tracking_gain`. With
        `reference_feedforward` the reference itself is demanded where no other feedforward is
        known, and the compensators add what is missing.

        Raises:
            ValueError, TypeError: Not one compensator for each major row, all of one period, no
                mapping, no drives of its actuators; or a number or switch that is none.
        """
        check.instance("mapping", mapping, PrioritizedMapping)
        self.mapping = mapping
        self.drives = checked_drives(drives, mapping.actuators)  # clients know their own
        self.handover_s = check.duration("handover_s", handover_s, least=0.0)
        unlimited = isinstance(demand_limit, float) and demand_limit == inf
        self.demand_limit = inf if unlimited else check.number("demand_limit", demand_limit)
        self.anti_windup = check.flag("anti_windup", anti_windup)
        self.reference_feedforward = check.flag("reference_feedforward", reference_feedforward)
        self._m1 = len(mapping.nothing().demand)
        channels("loops", loops, self._m1)
        check.within("tracking_slowness", tracking_slowness, *SLOWNESS)
        self._effectiveness = np.ones(mapping.actuators)
        for actuator, left in mapping.goal.effectiveness.items():
            self._effectiveness[actuator] = left
        self._is_weakened = bool((self._effectiveness != 1.0).any())
        self.period_s = loops[0].dt
        # All loops at once: [next states; demands] = M [states; errors].
        orders = [len(loop.A) for loop in loops]
        self._order = sum(orders)
        self._channel = np.repeat(np.arange(len(loops)), orders)
        self._M = np.block(
            [
                [block_diag(*(getattr(loop, part) for loop in loops)) for part in row]
                for row in _PARTS
            ]
        )
        self._tracking = None
        if anti_windup and mapping.limits is not None:
            gains = (tracking_gain(loop, tracking_slowness)[:, None] for loop in loops)
            self._tracking = block_diag(*gains)
        self._still = np.zeros(mapping.actuators)
        self._unused = mapping.unused.astype(float)

    def start(self) -> ControllerState[Pose]:
        """State at rest at the nominal pose."""
        mapping = self.mapping
        still = np.zeros(self._order), np.zeros(mapping.actuators)
        return ControllerState(*still, mapping.nominal, mapping.nothing())

    def estimate(self, state: ControllerState[Pose]) -> Pose:
        """The present pose, estimated from the inputs sent one tick before.

        Raises:
            TypeError: No state of a controller.
        """
        check.instance("state", state, ControllerState)
        return self.mapping.estimate(self._commanded(state), state.pose)

    def step(
        self,
        state: ControllerState[Pose],
        reference: Array,
        measurement: Measurement,
        secondary_reference: Array | None = None,
        *,
        feedforward: Array | None = None,
        unused_reference: Array | None = None,
        pose: Pose | None = None,
    ) -> ControllerState[Pose]:
        """One control tick; the new state holds the inputs to send.

        Args:
            state: From the tick before.
            reference: Reference of the major task, shape (m1,).
            measurement: This controller uses the measured major task.
            secondary_reference: Reference of the secondary goal, displacements of the actuators,
                shape (n,); None is zero.
            feedforward: Added to what the compensators demand, shape (m1,); None is the reference
                with `reference_feedforward`, else zero.
            unused_reference: Displacements that actuators out of use are commanded after a
                transfer, shape (n,), beside what they keep; None is zero.
            pose: As :meth:`estimate` gives it, for a caller that has it already.

        Raises:
            ValueError, TypeError: No state, or not finite numbers of these shapes. A task that may
                not be measured is a supervisor's.
        """
        n = len(self._still)
        check.instance("state", state, ControllerState)
        reference = check.exactly("reference", reference, self._m1)
        output = check.exactly("measurement.output", _output(measurement), self._m1)
        if secondary_reference is not None:
            secondary_reference = check.exactly("secondary_reference", secondary_reference, n)
        if feedforward is not None:
            feedforward = check.exactly("feedforward", feedforward, self._m1)
        if unused_reference is not None:
            unused_reference = check.exactly("unused_reference", unused_reference, n)
        commanded = self._commanded(state)
        if pose is None:
            pose = self.mapping.estimate(commanded, state.pose)

        error, after = reference - output, np.empty(len(self._M))
        sizes = len(after), self._order, self._m1
        given = pointer(self._M), *sizes, pointer(state.compensator), pointer(error)
        lib.compensate(*given, pointer(after))
        compensator, demand = after[: self._order], after[self._order :]
        if self.demand_limit < inf:
            demanded = demand
            demand = demanded.clip(-self.demand_limit, self.demand_limit)
            if self.anti_windup:
                held = (demand != demanded) & (error * demanded > 0)
                compensator = np.where(held[self._channel], state.compensator, compensator)
        if feedforward is None and self.reference_feedforward:
            feedforward = reference
        if feedforward is not None:
            demand = feedforward + demand
        owed = state.bumpless_transfer
        if owed is not None:
            demand = demand + owed.demanded(self.handover_s)
            faded = owed.faded(owed.secondary_reference, self.handover_s)
            secondary_reference = (
                faded if secondary_reference is None else faded + secondary_reference
            )
        required, residual = self.mapping.tick(
            demand, pose, commanded, state.asked, secondary_reference
        )
        if self._tracking is not None and residual is not None:
            compensator = compensator - self._tracking.dot(residual)
        asked = PreviousCommand(
            demand, required, self._still if secondary_reference is None else secondary_reference
        )
        if owed is not None:
            followed = self.mapping.followed(required)
            required = required + owed.unfollowed(self.handover_s)
            if followed is not None:
                required = required + followed
            if unused_reference is not None:
                required = required + self._unused * unused_reference
            owed = replace(owed, age_s=owed.age_s + self.period_s)
        exerted = required / self._effectiveness if self._is_weakened else required
        return ControllerState(compensator, self.drives.inputs(exerted), pose, asked, owed)

    def transfer(
        self,
        state: ControllerState[Pose],
        lost_displacements: Array | None = None,
        acting: Array | None = None,
        keeps: Array | None = None,
        *,
        unused_reference: Array | None = None,
    ) -> ControllerState[Pose]:
        """The state of another controller, changed so that this one continues without a step.

        Args:
            state: Of the other controller.
            lost_displacements: What each actuator is about to lose of its displacement, shape
                (n,), because it no longer holds it. The others step, to make up for its part in the
                major task; None is nothing.
            acting: Part of its command that each actuator still follows once it is out of use,
                shape (n,); None is nothing.
            keeps: Which actuators keep their last commands if they are out of use, 0 or 1 each,
                shape (n,); those of the rest fade in `handover_s`, and the others take over what
                they did. None: they all fade.
            unused_reference: As the next step is given it: actuators out of use go on with it.

        Raises:
            ValueError, TypeError: No state, or not finite numbers of these shapes.
        """
        commanded = self._commanded(check.instance("state", state, ControllerState))
        pose, owed = self.mapping.estimate(commanded, state.pose), state.bumpless_transfer

        def given(name: str, value: Array | None) -> Array:
            return self._still if value is None else check.exactly(name, value, len(self._still))

        new = bumpless_transfer(
            self.mapping,
            state.asked,
            commanded,
            pose,
            given("lost_displacements", lost_displacements),
            given("acting", acting),
            given("unused_reference", unused_reference),
            given("keeps", keeps),
        )
        if owed is not None:
            new = new.after(owed, self.handover_s)
        return replace(state, bumpless_transfer=new)

    def _commanded(self, state: ControllerState[Pose]) -> Array:
        """Displacements that the actuators hold at the inputs last sent, shape (n,)."""
        exerted = self.drives.displacements(state.inputs)
        return self._effectiveness * exerted if self._is_weakened else exerted


def _output(measurement: Measurement) -> Array:
    try:
        return measurement.output
    except AttributeError:
        raise TypeError(
            f"measurement must have an output, got {check.shown(measurement)}"
        ) from None
