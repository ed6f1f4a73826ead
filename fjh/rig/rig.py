"""A robot with its loops: fly it, predict it, let it fail."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

import argument_checks as check
from fjh.rig.dither import dither_of
from fjh.rig.events import Event
from fjh.rig.events.hooks import events_of
from fjh.rig.mismatch import Known, Mismatch, sizes_of
from fjh.rig.options import (
    BOUNDS,
    RobotOptions,
    Sensing,
    check_bounds,
    pinned_of,
    rows_of,
)
from fjh.rig.paths import path_of
from fjh.rig.prediction import Learns, Prediction, predicted
from fjh.rig.run import Run, simulate, tick_of
from fjh.rig.units import ROWS
from fjh.study.errors import WrongInput
from fjh.study.input_checks import nearest
from ftc import (
    ControlTask,
    Goal,
    OracleController,
    PrioritizedController,
    PrioritizedMapping,
    Supervisor,
    Unused,
    inverse_feedforward,
)
from ftc.control import Channel, Margins
from ftc.fdi import Dither, Fault, NominalModel
from prioritized import Manipulability
from sim import Array, Bench, Body, Failure, Pose
from sim.mjcf import Part, model_sha256, number_of

_TURNS = 3
"""First rows of a twist."""

_LOOPS = ("crossover", "period", "size", "joint_weight", "secondary_weight", "limits")
"""What :meth:`Rig.of_mjcf` takes besides its own arguments."""

LARGEST_DISPLACEMENT = 1e4
"""Of a path, [rad] or [m]: MuJoCo takes controls beyond 1e10 for zeros."""

MOST_TICKS = 100_000_000
"""Of a path: more would fill the memory."""


@dataclass(frozen=True)
class Rig:
    """A robot with its loops.

    Attributes:
        title: For people.
        model: Of all that the file holds; the controller has what belongs to the task.
        actuators: Their names: the file's own; of several on one joint or tendon, or of one
            without a name, that of the joint or tendon.
        aliases: Other names of each, of its joint for one.
        bodies: The body that each moves, for the eye; None of what is no joint.
        units: Of their displacements, "rad" or "m".
        major: Rows of the twist.
        size: Of the path, [rad] or [m].
        noise: Of the sensors of the major rows, [rad] or [m].
        encoder_noise: Of the sensors of the actuators, [rad] or [m].
        travel: Lower and upper displacements (n,) at which the plant's actuators can rest.
        task: What somebody else's controller is told.
        warnings: What was left out of the model, and what a user would not expect.
        payload_body: The body that carries the task frame.
        control: Its loops, and what the diagnosis knows of the robot: a
            :class:`ftc.tracking.Tracking`, or what has the same members for the hexapod,
            `HexapodControl` of `fjh.rig.hexapod.rig`.
        machine: Its plant with sensors and drives: `bench` makes one for a run, `drawn` is the same
            machine on a plant that differs from the model; of a file
            `RobotMachine` of `fjh.rig.robot_machine`, of the hexapod `HexapodMachine` of
            `fjh.rig.hexapod.machine`.
        coordinates: Task coordinates (N, 6) of poses of the task frame: rotation vector and
            translation, or the hexapod's angles and translation.
        dither: What "default" stands for in :meth:`supervisor`.
        part: What of the model the task involves; None is everything.
        file: The MJCF as the user named it; None is the hexapod's own.
        soft_locks: Actuators by number whose lock gives way, which a warning says.
    """

    title: str
    model: mujoco.MjModel
    actuators: tuple[str, ...]
    aliases: tuple[tuple[str, ...], ...]
    bodies: tuple[str | None, ...]
    units: tuple[str, ...]
    major: tuple[int, ...]
    size: float
    noise: float
    encoder_noise: float
    travel: tuple[Array, Array]
    task: ControlTask
    warnings: tuple[str, ...]
    payload_body: int
    control: Any
    machine: Any
    coordinates: Callable[[Pose], Array]
    dither: str | Dither = "default"
    part: Part | None = None
    file: Path | None = None
    soft_locks: frozenset[int] = frozenset()

    @staticmethod
    def hexapod(
        *,
        size: float | None = None,
        feedforward: bool = False,
        mismatch: Known | Mismatch = "exact",
        seed: int = 0,
    ) -> "Rig":
        """The testbed's own machine: detector, amplifiers, closed-form kinematics, goal W_a.

        Args:
            size: Radius of its path, [rad]; None is that of the testbed's spiral.
            feedforward: Whether the path is demanded as of :meth:`feedforward_demands`; in the
                paper it is not.
            mismatch: How the plant differs from the controller's model.
            seed: Of what is drawn of the plant.
        """
        from fjh.rig.hexapod.rig import hexapod_rig  # which makes one of these

        check.flag("feedforward", feedforward)
        check.integer("seed", seed)
        if size is not None:
            check_bounds("size", size)
        return hexapod_rig(size=size, feedforward=feedforward).drawn(mismatch, seed)

    def __repr__(self) -> str:
        """One line, for interactive use: the model's own numbers fill pages."""
        rows = ", ".join(ROWS[row] for row in self.major)
        return f"<Rig {self.title}: {', '.join(self.actuators)}; major rows {rows}>"

    @staticmethod
    def of_mjcf(
        file: str | Path,
        *,
        major: Sequence[int | str],
        site: str | int | Body = "payload",
        axes: str | None = None,
        start: str | int | ArrayLike | None = None,
        sense: Sensing = "both",
        noise: float | None = None,
        servo_hz: float | None = None,
        feedforward: bool = True,
        pinned: Sequence[str] = (),
        mismatch: Known | Mismatch = "exact",
        seed: int = 0,
        **loops: Any,
    ) -> "Rig":
        """Any robot.

        Args:
            file: MJCF.
            major: Rows of the twist [rx, ry, rz, x, y, z], turns about the axes and then motions
                along them, that are controlled exactly: names, or numbers 0 to 5.
            site: Task frame: a site, or a body; by its number where it has no name.
            axes: Site that gives the axes; None is the world.
            start: Keyframe by name or number, or joint positions (nq,); None is the first
                keyframe, or qpos0. Beyond a joint's range it begins inside, and a warning says so,
                as of a collision.
            sense: What the diagnosis looks at: a sensor of the task, encoders, or both.
            noise: Standard deviation of one sample of each sensor, [rad] or [m]; None is a
                hundredth of what a path of the default size moves it: of a row 0.01 mrad, or a
                hundred-thousandth of the model's extent.
            servo_hz: Natural frequency of the position servos that torque motors get.
            feedforward: Whether the path is demanded as of :meth:`feedforward_demands`, and the
                loops add to it.
            pinned: Frames that stand, such as feet: names of sites or bodies, welded to the world,
                or "NAME:point" where they may turn.
            mismatch: How the plant differs from the controller's model.
            seed: Of what is drawn of the plant.
            loops: Others of :class:`fjh.rig.options.RobotOptions`: `crossover` [Hz],
                `period` [s], `size`, `joint_weight`, `secondary_weight`, `limits`.

        Raises:
            WrongInput: Something that the robot does not have, or cannot do.
            sim.ModelError: The file, or what it says.
        """
        from fjh.rig.mjcf import robot_rig  # which makes one of these

        check.instance("file", file, str, Path)
        check.instance("site", site, str, int, Body)
        check.flag("feedforward", feedforward)
        check.integer("seed", seed)
        if servo_hz is not None:
            check_bounds("servo_hz", servo_hz, "servo")
        if not isinstance(pinned, str):
            check.members("pinned", pinned, str)
        for name in loops:
            if name not in _LOOPS:
                near = nearest(name, _LOOPS, listed=True)
                raise TypeError(f"there is no argument {name}{near}")
        options = RobotOptions(
            site=str(site.name if isinstance(site, Body) else site),
            axes=axes,
            servo=servo_hz,
            keyframe=str(start) if isinstance(start, str | int) else None,
            feedforward="on" if feedforward else "off",
            major=rows_of("major", major),
            sense=sense,
            noise=noise,
            pinned=pinned_of(pinned),
            **loops,
        )
        at = None
        if start is not None and not isinstance(start, str | int):
            at = check.array("start", start)
        return robot_rig(Path(file), options, at).drawn(mismatch, seed)

    @property
    def row_units(self) -> tuple[str, ...]:
        """Of the major rows, "rad" or "m"."""
        return tuple("rad" if row < _TURNS else "m" for row in self.major)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Joints of the model, or bodies, that are no part of the task, by name."""
        return () if self.part is None else self.part.left_out

    @property
    def period_s(self) -> float:
        """Of control."""
        return self.nominal.period_s

    @cached_property
    def model_sha256(self) -> str:
        """SHA-256 of the MJCF file, which identifies the robot of a result."""
        return model_sha256(self.file)

    def number(self, actuator: int | str) -> int:
        """The number of an actuator, by it, by its name, or by that of its joint.

        Raises:
            WrongInput: There is none; the nearest is named.
        """
        try:
            if isinstance(actuator, str):
                names = zip(self.actuators, self.aliases, strict=True)
                return number_of(actuator, [(name, *others) for name, others in names])
            return check.integer("actuator", actuator, len(self.actuators))
        except ValueError as error:
            raise WrongInput(str(error)) from None

    @property
    def goal(self) -> Goal:
        """What the controller pursues while all actuators work."""
        return self.control.goal

    @property
    def nominal(self) -> NominalModel:
        """Linear model from displacements to the major rows."""
        return self.control.nominal

    @property
    def watched(self) -> NominalModel:
        """Linear model from displacements to what the diagnosis looks at."""
        return self.control.watched

    @property
    def loops(self) -> Sequence[Channel]:
        """One compensator for each major row."""
        return self.control.loops

    @property
    def margins(self) -> Sequence[Margins]:
        """Stability margins of each loop."""
        return self.control.margins

    @property
    def limits(self) -> tuple[Array, Array] | None:
        """Lower and upper displacements (n,) that the mapping respects; None is none."""
        return self.control.limits

    @property
    def feedforward(self) -> bool:
        """Whether a path is demanded through the inverse of the linear model."""
        return self.control.feedforward

    @property
    def unused(self) -> Unused:
        """What an actuator without force counts as: its own spring holds it, or not."""
        return self.control.unused

    def drawn(self, mismatch: Known | Mismatch, seed: int) -> "Rig":
        """The same rig with a plant that differs so from the controller's model.

        Raises:
            WrongInput: A size that this robot does not have.
        """
        machine = self.machine
        sizes = sizes_of(mismatch, machine.everything, machine.unknown)
        return replace(self, machine=machine.drawn(sizes, check.integer("seed", seed)))

    def mapping(self, goal: Goal) -> PrioritizedMapping[Any]:
        """The mapping for a goal, failures that it knows included."""
        return self.control.mapping(check.instance("goal", goal, Goal))

    def controller(self, goal: Goal | None = None) -> PrioritizedController[Any]:
        """A controller that does not diagnose; None is the goal of the rig."""
        return self.control.controller(self._goal(goal))

    def reconfigured(self, before: Goal, after: Goal, time_s: float) -> OracleController:
        """A controller that goes over to another goal at a time of the run, as if it were told."""
        check.instance("before", before, Goal)
        check.instance("after", after, Goal)
        check.number("time_s", time_s, 0.0, 1e9)
        first, then = self.controller(before), self.controller(after)
        return OracleController(first, then, tick_of(time_s, self.period_s))

    def supervisor(
        self, dither: str | Dither | None = "default", goal: Goal | None = None
    ) -> Supervisor:
        """A controller that diagnoses failures and reconfigures itself.

        Args:
            dither: "default" is 20 Hz of heave on the hexapod, as `fjh paper recover` uses it, and
                that of `fjh track` elsewhere; another as of
                :func:`fjh.rig.dither.rig_dither`; None is none.
            goal: While all actuators work; None is that of the rig.
        """
        chosen = dither_of(self, dither, self.dither)
        control = self.control
        if goal is not None:
            control = replace(control, goal=self._goal(goal))
        return control.supervisor(dither=chosen)

    def bench(
        self, time_s: Array, failures: Sequence[Failure], seed: int, events: object = None
    ) -> Bench:
        """The simulated machine for times (N,); noise of this seed."""
        time_s, seed = check.array("time_s", time_s, None), check.integer("seed", seed)
        return self.machine.bench(time_s, failures, seed, events)

    def classified(self, faults: Sequence[Fault]) -> Manipulability:
        """What the actuators that are left can do with these faults."""
        return self.control.classified(faults)

    def reached(self, pose: Pose) -> Array:
        """The major rows (N, m1) of poses of the task frame, as the task's sensors have them."""
        return self.coordinates(check.instance("pose", pose, Pose))[:, list(self.major)]

    def path(self, name: str, *, duration_s: float, turn_s: float = 4.0) -> Array:
        """Desired displacements of the major rows at each tick, shape (N, m1).

        Args:
            name: As of :func:`fjh.rig.paths.path_of`.
            duration_s: Of it.
            turn_s: Time of one turn.
        """
        check.instance("name", name, str, Path)
        ticks = self._ticks("duration_s", duration_s, BOUNDS["duration"][0])
        check.number("turn_s", turn_s, BOUNDS["turn"][0], 1e9)
        time_s = np.arange(max(2, ticks)) * self.period_s
        return path_of(str(name), len(self.major), self.size, time_s, turn_s, self.period_s)

    def _ticks(self, name: str, seconds: float, least: float) -> int:
        most = min(BOUNDS["duration"][1], MOST_TICKS * self.period_s)
        return round(check.number(name, seconds, least, most) / self.period_s)

    def _checked_path(self, path: ArrayLike) -> Array:
        """A path (N, m1) of at least one tick, of displacements that a machine can be asked for."""
        desired = check.array("path", path, None, len(self.major))
        if not len(desired):
            raise ValueError(f"path must have a row for each tick, got shape {desired.shape}")
        if (largest := np.abs(desired).max()) > LARGEST_DISPLACEMENT:
            raise ValueError(
                f"path must be at most {LARGEST_DISPLACEMENT:g} rad or m, got {largest:.3g}"
            )
        return desired

    def _goal(self, goal: Goal | None) -> Goal:
        """A goal, or that of the rig."""
        return self.goal if goal is None else check.instance("goal", goal, Goal)

    def feedforward_demands(self, path: Array) -> Array | None:
        """What the sound machine is to be demanded to do a path (N, m1), of the same shape.

        By the inverse of the linear model; None where :attr:`feedforward` is off. After a failure
        they are demanded on, and the compensators make up for the difference.
        """
        path = self._checked_path(path)
        if not self.feedforward:
            return None
        return inverse_feedforward(self.nominal, self.mapping(self.goal).major_gain(), path)

    def fly(
        self,
        controller: Any,
        path: ArrayLike,
        *,
        failures: Sequence[Failure] = (),
        seed: int = 0,
        begin_s: float = 0.0,
        lead_in_s: float = 0.0,
        events: object = None,
        on_tick: Callable[[int], None] | None = None,
    ) -> Run:
        """Simulate a path with a controller.

        Args:
            controller: As of :meth:`supervisor` or :meth:`controller`; any
                :class:`ftc.Controller`.
            path: Desired displacements of the major rows, tick by tick, shape (N, m1).
            failures: What happens, actuators by name or number.
            seed: Of the noise of all sensors.
            begin_s: Time of the first tick.
            lead_in_s: So long the loop is closed about zero before the path starts, which is not
                kept; what fails at the first tick has failed by then.
            events: What else happens: a sequence of :class:`fjh.rig.events.Event`, whose
                sizes are drawn from `seed`; or an object as of :class:`sim.Bench`; or both in it.
            on_tick: Told of the number of ticks so far.

        Raises:
            WrongInput: A failure of an actuator that the robot does not have, or an event that it
                cannot have.
            sim.SimulationDiverged: The physics left the finite numbers.
        """
        check.attributes("controller", controller, "start", "step")
        desired = self._checked_path(path)
        check.integer("seed", seed)
        check.number("begin_s", begin_s, 0.0, check.DAY_S)
        lead_in = self._ticks("lead_in_s", lead_in_s, 0.0)
        if on_tick is not None:
            check.function("on_tick", on_tick)
        around = {"begin_s": begin_s, "lead_in_s": lead_in_s, "seed": seed}
        hooks, caused = events_of(self, events, **around)
        struck = sorted((*self._numbered(failures), *caused), key=lambda one: one.time_s)
        time_s = begin_s + np.arange(len(desired)) * self.period_s
        run = simulate(
            self,
            controller,
            time_s,
            desired,
            struck,
            seed=seed,
            lead_in=lead_in,
            events=hooks,
            on_tick=on_tick,
        )
        return replace(run, events=self._named(events))

    def predict(
        self,
        path: ArrayLike,
        *,
        failures: Sequence[Failure] = (),
        told: Learns = True,
        noise: ArrayLike | None = None,
        dither: Dither | None = None,
        goal: Goal | None = None,
        start: ArrayLike | None = None,
        floor_m_per_s2: ArrayLike | None = None,
    ) -> Prediction:
        """RMS errors of a path that begins at time 0 by the linear model.

        Args:
            path: As of :meth:`fly`.
            failures: Likewise.
            told: Whether the controller is told of each failure at once, or never; or when it is
                told of each [s], one time a failure, None for never.
            noise: What the sensors of the major rows add at each tick, of the shape of the path,
                such as `run.measured - run.true`; None: white noise, in the mean of many runs.
            dither: That the controller adds; None is none.
            goal: Of the controller from the first tick on, with failures that it knows of then;
                None is that of the rig.
            start: Displacements (n,) that the actuators hold when the run begins; None is zero.
            floor_m_per_s2: Acceleration of the floor at each tick, shape (N, 3), where the linear
                model knows its effect, as of the hexapod; None is at rest.

        Raises:
            ValueError: Another number of times than of failures, or a time before its failure; or
                arrays of another shape.
        """
        desired, n = self._checked_path(path), len(self.actuators)
        if dither is not None:
            check.array("dither.direction", check.instance("dither", dither, Dither).direction, n)
        given = {"noise": (noise, desired.shape), "start": (start, (n,))}
        given["floor_m_per_s2"] = floor_m_per_s2, (len(desired), 3)
        arrays: dict[str, Any] = {
            name: None if value is None else check.array(name, value, *shape)
            for name, (value, shape) in given.items()
        }
        if floor_m_per_s2 is not None and self.nominal.floor is None:
            raise ValueError("floor_m_per_s2 must be None: this model knows no floor")
        struck, goal = self._numbered(failures), self._goal(goal)
        return predicted(self, desired, struck, told=told, dither=dither, goal=goal, **arrays)

    def _named(self, events: object) -> tuple[Event, ...]:
        """Those events that have a name, in the order of time, actuators by number."""
        named = (
            [each for each in events if isinstance(each, Event)]
            if isinstance(events, Sequence)
            else []
        )
        known = (
            each if each.actuator is None else replace(each, actuator=self.number(each.actuator))
            for each in named
        )
        return tuple(sorted(known, key=lambda one: one.time_s))

    def _numbered(self, failures: Sequence[Failure]) -> list[Failure]:
        check.instance("failures", failures, list, tuple)
        given = [check.instance("failures", each, Failure) for each in failures]
        return [replace(each, actuator=self.number(each.actuator)) for each in given]
