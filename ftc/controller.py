"""The controller of Fig. 3: one compensator for each major channel, then the mapping.

And a controller to which a failure is known beforehand.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import cos, inf, pi
from typing import Any, Generic, Protocol

import numpy as np

import argument_checks as check
from argument_checks import Array
from ftc.control.anti_windup import SLOWNESS, Compensators, tracking_gains
from ftc.control.compensator import Channel
from ftc.control.frequency_response import channels
from ftc.control.geometry import Pose
from ftc.control.mapping import PreviousCommand, PrioritizedMapping


@dataclass(frozen=True)
class Measurement:
    """Measurements at one tick: the major task (m1,), and displacements (n,) of the actuators.

    The latter where they have sensors.
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
        """The displacements themselves, as another array: who sends inputs may change them."""
        return displacements.copy()

    def displacements(self, inputs: Array) -> Array:
        """The inputs themselves."""
        return inputs


def checked_drives(drives: Converter, actuators: int) -> Any:
    """Check that drives convert the displacements of so many actuators at rest."""
    check.attributes("drives", drives, "inputs", "displacements")
    still = check.array("drives.inputs(0)", drives.inputs(np.zeros(actuators)), actuators)
    check.array("drives.displacements", drives.displacements(still), actuators)
    return drives


@dataclass(frozen=True)
class BumplessTransfer:
    """Offsets that remain after a change of the mapping: (m1,) of the task, (n,) of actuators.

    The compensators are left alone. What the surviving actuators stand off from the new mapping's
    own answer is split: the part that moves the major task becomes a constant, which relieves the
    integrators; the rest is secondary motion, and fades out. An actuator that is taken out of use
    loses its command slowly: if it should have been sound, or works again, nothing jumps. One that
    stands keeps it, and one that the others take along is commanded where they take it.

    Attributes:
        demand: Added for good to what the compensators demand of the major task.
        secondary_reference: Secondary displacement in which the old mapping left the actuators.
        kept: Commands of actuators out of use that they keep.
        left: Commands that fade with the rest, beside where the others take the actuators.
        carried: Major task that these still cause: the others take it over.
        age_s: Since the transfer.
    """

    demand: Array
    secondary_reference: Array
    retained: Array
    fading: Array
    fading_task: Array
    age_s: float = 0.0

    def part(self, fade_s: float) -> float:
        """Of what fades, the part that is left: half a cosine over `fade_s`."""
        return 0.5 * (1 + cos(pi * self.age_s / fade_s)) if self.age_s < fade_s else 0.0


@dataclass(frozen=True)
class ControllerState(Generic[Pose]):
    """State of the controller between ticks.

    Attributes:
        compensator: States of all compensators, one after the other.
        inputs: Last sent to the drives, shape (n,).
        pose: Estimated from these.
        asked: Last demanded of the mapping, and its answer.
        bumpless_transfer: From the mapping before; None where there was none.
    """

    compensator: Array
    inputs: Array
    pose: Pose
    previous_command: PreviousCommand
    bumpless_transfer: BumplessTransfer | None = None


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
        """Take the compensators, one for each major row, all of one period, and what follows them.

        Args:
            loops: From errors of the major rows to demands.
            mapping: From these to displacements.
            drives: From displacements to inputs of as many actuators.
            handover_s: Time in which the secondary motion of a former mapping fades out.
            demand_limit: Largest output of each compensator.
            anti_windup: Whether compensators are held at that limit, and observe the major task
                that is achieved where the mapping has limits (:mod:`ftc.control.anti_windup`).
            tracking_slowness: Of this, as of :func:`ftc.control.anti_windup.tracking_gain`.
            reference_feedforward: Whether the reference itself is demanded where no other
                feedforward is known, and the compensators add what is missing.
        """
        check.instance("mapping", mapping, PrioritizedMapping)
        self.mapping = mapping
        self.drives = checked_drives(drives, mapping.actuators)
        self.handover_s = check.number("handover_s", handover_s, 0.0, check.DAY_S)
        unlimited = isinstance(demand_limit, float) and demand_limit == inf
        self.demand_limit = inf if unlimited else check.number("demand_limit", demand_limit, 0.0)
        self.anti_windup = check.flag("anti_windup", anti_windup)
        self.reference_feedforward = check.flag("reference_feedforward", reference_feedforward)
        self._m1 = len(mapping.initial_command().demand)
        channels("loops", loops, self._m1)
        self.period_s = loops[0].dt
        self._compensators = Compensators(loops)
        check.number("tracking_slowness", tracking_slowness, *SLOWNESS)
        self._tracking = None
        if anti_windup and mapping.limits is not None:
            self._tracking = tracking_gains(loops, tracking_slowness)
        self._still = np.zeros(mapping.actuators)
        self._unused = mapping.unused.astype(float)
        weakened, self._effectiveness = mapping.goal.effectiveness, np.ones(mapping.actuators)
        self._effectiveness[list(weakened)] = list(weakened.values())

    def start(self) -> ControllerState[Pose]:
        """State at rest at the nominal pose."""
        still = np.zeros(self._compensators.order), np.zeros(self.mapping.actuators)
        return ControllerState(*still, self.mapping.nominal, self.mapping.initial_command())

    def step(
        self,
        state: ControllerState[Pose],
        reference: Array,
        measurement: Measurement,
        secondary_reference: Array | None = None,
        *,
        feedforward: Array | None = None,
        unused_reference: Array | None = None,
    ) -> ControllerState[Pose]:
        """One control tick; the new state holds the inputs to send.

        Args:
            state: From the tick before.
            reference: Reference of the major task, shape (m1,).
            measurement: Only the major task is used, which must be measured.
            secondary_reference: Reference of the secondary goal, displacements of the actuators,
                shape (n,); None is zero.
            feedforward: Added to what the compensators demand, shape (m1,); None is the reference
                with `reference_feedforward`, else zero.
            unused_reference: Displacements that actuators out of use are commanded after a
                transfer, shape (n,), beside what they keep; None is zero.
        """
        check.instance("state", state, ControllerState)
        reference = check.array("reference", reference, self._m1)
        output: Any = getattr(measurement, "output", None)
        error = reference - check.array("measurement.output", output, self._m1)
        secondary_reference = self._of_actuators("secondary_reference", secondary_reference)
        unused_reference = self._of_actuators("unused_reference", unused_reference)
        if feedforward is not None:
            feedforward = check.array("feedforward", feedforward, self._m1)
        elif self.reference_feedforward:
            feedforward = reference
        commanded = self._commanded(state)
        pose = self.mapping.estimate(commanded, state.pose)

        if self.demand_limit == inf:
            compensator, demand = self._compensators.step(state.compensator, error)
        else:
            limits = self.demand_limit, self.anti_windup
            compensator, demand = self._compensators.limited(state.compensator, error, *limits)
        if feedforward is not None:
            demand = feedforward + demand
        if (transfer := state.bumpless_transfer) is not None:
            part = transfer.part(self.handover_s)
            demand = transfer.demand - part * transfer.fading_task + demand
            secondary_reference = part * transfer.secondary_reference + secondary_reference
        required, residual = self.mapping.tick(
            demand, pose, commanded, state.previous_command, secondary_reference
        )
        if self._tracking is not None and residual is not None:
            compensator = compensator - self._tracking.dot(residual)
        command = PreviousCommand(demand, required, secondary_reference)
        if transfer is not None:
            unused = transfer.retained + transfer.part(self.handover_s) * transfer.fading
            unused = unused + self.mapping.followed(required) + self._unused * unused_reference
            required = required + unused
            transfer = replace(transfer, age_s=transfer.age_s + self.period_s)
        if self.mapping.goal.effectiveness:
            required = required / self._effectiveness
        return ControllerState(compensator, self.drives.inputs(required), pose, command, transfer)

    def transfer(
        self,
        state: ControllerState[Pose],
        lost_displacements: Array | None = None,
        acting: Array | None = None,
        retained: Array | None = None,
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
            retained: Which actuators keep their last commands if they are out of use, 0 or 1 each,
                shape (n,); those of the rest fade in `handover_s`, and the others take over what
                they did. None: they all fade.
            unused_reference: As the next step is given it: actuators out of use go on with it.
        """
        last = check.instance("state", state, ControllerState).previous_command
        mapping, acting = self.mapping, self._of_actuators("acting", acting)
        retained = self._of_actuators("retained", retained)
        lost = self._of_actuators("lost_displacements", lost_displacements)
        test_command = self._of_actuators("unused_reference", unused_reference)
        commanded = self._commanded(state)
        pose = mapping.estimate(commanded, state.pose)
        target = mapping.displacements(last.demand, pose, commanded, last, last.secondary_reference)
        demand, secondary_reference, internal = mapping.split(commanded - target, pose)
        unused = commanded - test_command - mapping.followed(commanded)
        unused = np.where(mapping.unused, unused, 0.0)
        fading = (1 - retained) * unused
        fading_task = mapping.major_motion(acting * fading, pose)
        demand = demand + fading_task + mapping.major_motion(lost, pose)
        if (transfer := state.bumpless_transfer) is not None:
            # What it keeps and leaves is in the commands, hence in these parts of them.
            part = transfer.part(self.handover_s)
            demand = transfer.demand - part * transfer.fading_task + demand
            secondary_reference = part * transfer.secondary_reference + secondary_reference
        parts = demand, secondary_reference, retained * unused, fading + internal, fading_task
        return replace(state, bumpless_transfer=BumplessTransfer(*parts))

    def _commanded(self, state: ControllerState[Pose]) -> Array:
        """Displacements that the actuators hold at the inputs last sent, shape (n,)."""
        exerted = self.drives.displacements(state.inputs)
        return self._effectiveness * exerted if self.mapping.goal.effectiveness else exerted

    def _of_actuators(self, name: str, value: Array | None) -> Array:
        """A finite vector (n,); zero for None."""
        return self._still if value is None else check.array(name, value, len(self._still))


@dataclass(frozen=True)
class NestedState:
    """State of a controller inside another controller's state, and the number of ticks so far."""

    controller: ControllerState[Any]
    ticks: int

    @property
    def inputs(self) -> Array:
        """Inputs to send to the drives, shape (n,)."""
        return self.controller.inputs

    @property
    def pose(self) -> Any:
        """Estimated pose."""
        return self.controller.pose


@dataclass(frozen=True)
class OracleController:
    """Controller that switches from one controller to another at a given tick.

    Attributes:
        before: Controls first.
        after: Takes over at `tick`, counted from the first; None is never.
        lost_displacements: What each actuator loses then of its displacement, (n,); None: the
            displacement commanded of those that the goal of `after` says are free.
        secondary: Reference of the secondary goal (n,) at each time of the run; None is zero.
        acting: As of :meth:`ftc.PrioritizedController.transfer`.
    """

    initial: PrioritizedController[Any]
    reconfigured: PrioritizedController[Any]
    tick: int | None
    lost_displacements: Array | None = None
    secondary: Callable[[float], Array] | None = None
    acting: Array | None = None

    def __post_init__(self) -> None:
        initial, reconfigured = (
            check.instance(name, getattr(self, name), PrioritizedController).mapping.actuators
            for name in ("initial", "reconfigured")
        )
        if initial != reconfigured:
            raise ValueError(
                f"reconfigured must have the {initial} actuators of initial, got {reconfigured}"
            )
        if self.tick is not None:
            check.integer("tick", self.tick)
        if self.secondary is not None:
            check.function("secondary", self.secondary)
        for name in ("lost_displacements", "acting"):
            if (value := getattr(self, name)) is not None:
                vars(self)[name] = check.frozen(check.array(name, value, initial))

    def start(self) -> NestedState:
        """At rest at the nominal pose."""
        return NestedState(self.initial.start(), 0)

    def step(
        self,
        state: NestedState,
        reference: Array,
        measurement: Measurement,
        *,
        feedforward: Array | None = None,
    ) -> NestedState:
        """One control tick."""
        controller_state = check.instance("state", state, NestedState).controller
        if state.ticks == self.tick:
            if (lost := self.lost_displacements) is None:
                # An actuator that keeps its damper falls too slowly to be made up for at once.
                lost = self.initial.drives.displacements(controller_state.inputs)
                free = np.isin(range(len(lost)), self.reconfigured.mapping.goal.free)
                lost = np.where(free, lost, 0.0)
            controller_state = self.reconfigured.transfer(controller_state, lost, self.acting)
        has_switched = self.tick is not None and state.ticks >= self.tick
        active = self.reconfigured if has_switched else self.initial
        secondary = self.secondary and self.secondary(state.ticks * active.period_s)
        controller = active.step(
            controller_state, reference, measurement, secondary, feedforward=feedforward
        )
        return NestedState(controller, state.ticks + 1)
