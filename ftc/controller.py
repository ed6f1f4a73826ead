"""Controller of Fig. 3: one compensator for each major channel, then the mapping.

An oracle controller, for comparison, switches at the known time of a failure.
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
    """Measurements at one tick: the major task (m1,) and the actuator displacements (n,).

    The displacements are used only if the actuators have sensors.
    """

    output: Array
    displacement: Array


class Converter(Protocol):
    """Protocol for the conversion between actuator displacements and drive inputs."""

    def inputs(self, displacements: Array, /) -> Array:
        """Return the drive inputs (n,) for displacements (n,)."""
        ...

    def displacements(self, inputs: Array, /) -> Array:
        """Return the displacements (n,) at which the actuators settle for inputs (n,)."""
        ...


class DirectDrive:
    """Drives whose inputs are the displacements, such as position servos."""

    def inputs(self, displacements: Array) -> Array:
        """Return a copy of the displacements, so that a sender may change the inputs."""
        return displacements.copy()

    def displacements(self, inputs: Array) -> Array:
        """Return the inputs themselves."""
        return inputs


def checked_drives(drives: Converter, actuators: int) -> Any:
    """Check that drives convert the zero displacements of n actuators, and return them."""
    check.attributes("drives", drives, "inputs", "displacements")
    still = check.array("drives.inputs(0)", drives.inputs(np.zeros(actuators)), actuators)
    check.array("drives.displacements", drives.displacements(still), actuators)
    return drives


@dataclass(frozen=True)
class BumplessTransfer:
    """Offsets after a change of the mapping: (m1,) of the task and (n,) of the actuators.

    The compensators are unchanged. The difference between the actual displacements of the surviving
    actuators and those of the new mapping is split: its effect on the major task becomes a constant
    offset, which relieves the integrators; the rest, a secondary motion, fades out. The command of
    an actuator that goes out of use fades, too, so that nothing jumps if it works after all; a
    locked one keeps its command, and a free one is commanded to where the others move it.

    Attributes:
        demand: Constant offset of the demanded major task.
        secondary_reference: Secondary displacement of the actuators under the old mapping.
        retained: Constant commands of actuators out of use.
        fading: Fading commands, relative to where the others move the actuators.
        fading_task: Major task caused by the fading commands, which the others take over.
        age_s: Time since the transfer [s].
    """

    demand: Array
    secondary_reference: Array
    retained: Array
    fading: Array
    fading_task: Array
    age_s: float = 0.0

    def part(self, fade_s: float) -> float:
        """Return the remaining fraction of the fading parts: half a cosine over `fade_s`."""
        return 0.5 * (1 + cos(pi * self.age_s / fade_s)) if self.age_s < fade_s else 0.0


@dataclass(frozen=True)
class ControllerState(Generic[Pose]):
    """State of the controller between ticks.

    Attributes:
        compensator: Concatenated states of all compensators.
        inputs: Inputs last sent to the drives, shape (n,).
        pose: Pose estimated from the inputs.
        previous_command: Last demand of the mapping and its result.
        bumpless_transfer: Offsets from the previous mapping; None if there was none.
    """

    compensator: Array
    inputs: Array
    pose: Pose
    previous_command: PreviousCommand
    bumpless_transfer: BumplessTransfer | None = None


class PrioritizedController(Generic[Pose]):
    """Controller from measurements to drive inputs, without access to the plant.

    `step` is a pure function of the state.
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
        """Combine compensators, one for each major row and all of one period, with a mapping.

        Args:
            loops: Compensators from errors of the major rows to demands.
            mapping: Mapping from demands to displacements.
            drives: Conversion from displacements to inputs of as many actuators.
            handover_s: Time in which the secondary motion of a previous mapping fades out [s].
            demand_limit: Largest output of each compensator.
            anti_windup: Whether compensators are held at that limit, and use back-calculation if
                the mapping has limits (:mod:`ftc.control.anti_windup`).
            tracking_slowness: Slowness of :func:`ftc.control.anti_windup.tracking_gain`.
            reference_feedforward: Whether the reference is the feedforward of steps without
                another one.
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
        """Return the state at rest at the nominal pose."""
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
        """Advance by one control tick; the new state has the inputs to send.

        Args:
            state: State after the previous tick.
            reference: Reference of the major task, shape (m1,).
            measurement: Measurement, of which only the major task is used and required.
            secondary_reference: Reference of the secondary goal, displacements of the actuators,
                shape (n,); None is zero.
            feedforward: Demand added to that of the compensators, shape (m1,); None is the
                reference for a controller with `reference_feedforward`, else zero.
            unused_reference: Displacements added to the commands of actuators out of use after a
                transfer, shape (n,); None is zero.
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
        """Return the state with which this controller takes over from another without a step.

        Args:
            state: State of the other controller.
            lost_displacements: Displacement that each actuator is about to lose, shape (n,). The
                commands of the others step to compensate this; None is zero.
            acting: Fraction of its command that each actuator out of use still follows, shape (n,);
                None is zero.
            retained: 1 for actuators that keep their last command when out of use, else 0, shape
                (n,). The other commands fade in `handover_s`, and their effect on the major task is
                taken over. None: all fade.
            unused_reference: Argument of the next :meth:`step`, so that its motion continues.
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
            # Its retained and fading commands are contained in `commanded`.
            part = transfer.part(self.handover_s)
            demand = transfer.demand - part * transfer.fading_task + demand
            secondary_reference = part * transfer.secondary_reference + secondary_reference
        parts = demand, secondary_reference, retained * unused, fading + internal, fading_task
        return replace(state, bumpless_transfer=BumplessTransfer(*parts))

    def _commanded(self, state: ControllerState[Pose]) -> Array:
        """Return the displacements (n,) that the actuators hold at the inputs last sent."""
        exerted = self.drives.displacements(state.inputs)
        return self._effectiveness * exerted if self.mapping.goal.effectiveness else exerted

    def _of_actuators(self, name: str, value: Array | None) -> Array:
        """Check a vector (n,); None is zero."""
        return self._still if value is None else check.array(name, value, len(self._still))


@dataclass(frozen=True)
class NestedState:
    """State of an inner controller, and the number of ticks so far."""

    controller: ControllerState[Any]
    ticks: int

    @property
    def inputs(self) -> Array:
        """Inputs (n,) to send to the drives."""
        return self.controller.inputs

    @property
    def pose(self) -> Any:
        """Pose estimated by the inner controller."""
        return self.controller.pose


@dataclass(frozen=True)
class OracleController:
    """Controller that switches from one controller to another at a given tick.

    Attributes:
        initial: Controller before the switch.
        reconfigured: Controller from `tick` on.
        tick: Tick of the switch, counted from zero; None is never.
        lost_displacements: Displacement that each actuator loses at the switch, shape (n,); None:
            the commanded displacement of the actuators that are free in the goal of `reconfigured`.
        secondary: Function of the time of the run [s] that returns the reference (n,) of the
            secondary goal; None is zero.
        acting: Argument `acting` of :meth:`ftc.PrioritizedController.transfer`.
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
            expected = f"reconfigured must have the {initial} actuators of initial"
            raise ValueError(f"{expected}, got {reconfigured}")
        if self.tick is not None:
            check.integer("tick", self.tick)
        if self.secondary is not None:
            check.function("secondary", self.secondary)
        for name in ("lost_displacements", "acting"):
            if (value := getattr(self, name)) is not None:
                vars(self)[name] = check.frozen(check.array(name, value, initial))

    def start(self) -> NestedState:
        """Return the state at rest at the nominal pose."""
        return NestedState(self.initial.start(), 0)

    def step(
        self,
        state: NestedState,
        reference: Array,
        measurement: Measurement,
        *,
        feedforward: Array | None = None,
    ) -> NestedState:
        """Advance by one control tick."""
        last = check.instance("state", state, NestedState).controller
        if state.ticks == self.tick:
            if (lost := self.lost_displacements) is None:
                # An actuator with a damper falls slower than this compensation assumes.
                lost = self.initial.drives.displacements(last.inputs)
                free = np.isin(range(len(lost)), self.reconfigured.mapping.goal.free)
                lost = np.where(free, lost, 0.0)
            last = self.reconfigured.transfer(last, lost, self.acting)
        has_switched = self.tick is not None and state.ticks >= self.tick
        active = self.reconfigured if has_switched else self.initial
        secondary = self.secondary and self.secondary(state.ticks * active.period_s)
        controller = active.step(last, reference, measurement, secondary, feedforward=feedforward)
        return NestedState(controller, state.ticks + 1)
