"""Robot with its control loops: simulates runs with failures and predicts their errors."""

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
from fjh.rig.options import BOUNDS, RobotOptions, Sensing, check_bounds, pinned_of, rows_of
from fjh.rig.paths import path_of
from fjh.rig.prediction import InformedAt, Prediction, predicted
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
"""Number of rotational rows, the first ones of a twist."""

_LOOPS = ("crossover", "period", "size", "joint_weight", "secondary_weight", "limits")
"""Further options of :meth:`Rig.of_mjcf`, passed to :class:`fjh.rig.options.RobotOptions`."""

LARGEST_DISPLACEMENT = 1e4
"""Largest displacement of a path, [rad] or [m]: MuJoCo replaces controls beyond 1e10 by zeros."""

MOST_TICKS = 100_000_000
"""Largest number of ticks of a path: more would exceed the memory."""


@dataclass(frozen=True)
class Rig:
    """Robot with its plant, control loops and diagnosis, for simulated runs with failures.

    Attributes:
        title: Name of the robot in text.
        model: Model of the complete file; the controller has a model of the task's part.
        actuators: Names of the actuators: those of the file; for several on one joint or tendon, or
            one without a name, the name of the joint or tendon.
        aliases: Other names of each actuator, such as the name of its joint.
        bodies: Body that each actuator moves, for display; None if it drives no joint.
        units: Unit of each actuator's displacement, "rad" or "m".
        major: Rows of the twist that form the major task.
        size: Radius of the default path, [rad] or [m].
        noise: Standard deviation of the sensors of the major rows, [rad] or [m].
        encoder_noise: Standard deviation of the sensors of the actuators, [rad] or [m].
        travel: Lower and upper displacements (n,) at which the plant's actuators can rest.
        task: Description of the task for controllers of other packages.
        warnings: Sentences on parts left out, changed start positions, dry friction.
        payload_body: Number of the body that carries the task frame.
        control: Loops and nominal model of the diagnosis: a :class:`ftc.tracking.Tracking`, or the
            hexapod's `HexapodControl` of `fjh.rig.hexapod.rig`, with the same members.
        machine: Plant with sensors and drives: its `bench` creates one for a run, its
            `with_mismatch` changes the plant. `RobotMachine` of `fjh.rig.robot_machine`, or for the
            hexapod `HexapodMachine` of `fjh.rig.hexapod.machine`.
        coordinates: Function from poses of the task frame to task coordinates (N, 6): rotation
            vector and translation, or the hexapod's angles and translation.
        dither: Dither that "default" stands for in :meth:`supervisor`.
        part: Part of the model that the task involves; None is the complete model.
        file: MJCF file as given by the user; None is the hexapod's own.
        soft_locks: Numbers of the actuators whose lock is compliant, as a warning states.
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
        """Return the testbed's hexapod: detector, amplifiers, closed-form kinematics, goal W_a.

        Args:
            size: Radius of the default path, [rad]; None is that of the testbed's spiral.
            feedforward: Whether the controller adds :meth:`feedforward_demands`; in the paper it
                does not.
            mismatch: Differences between plant and model: "exact", "all", or sizes.
            seed: Seed of the sampled plant.
        """
        from fjh.rig.hexapod.rig import hexapod_rig  # late: that module imports this one

        check.flag("feedforward", feedforward)
        check.integer("seed", seed)
        if size is not None:
            check_bounds("size", size)
        return hexapod_rig(size=size, feedforward=feedforward).with_mismatch(mismatch, seed)

    def __repr__(self) -> str:
        """Return one line: the default representation would print pages of arrays."""
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
        """Return the rig of any MJCF robot.

        Args:
            file: MJCF file.
            major: Rows of the twist to control exactly: names among rx, ry, rz (rotations about the
                axes), x, y, z (translations), or numbers 0 to 5.
            site: Task frame: a site or a body, by name, or by number if it has no name.
            axes: Site whose axes are those of the twist; None is the world.
            start: Keyframe by name or number, or joint positions (nq,); None is the first keyframe,
                or qpos0. Positions outside a joint's range are clamped; `warnings` reports this,
                and collisions.
            sense: Sensors of the diagnosis: a sensor of the task, encoders, or both.
            noise: Standard deviation of one sample of each sensor, [rad] or [m]; None is a
                hundredth of the sensor's amplitude on a path of the default size: 0.01 mrad for a
                row, or 1e-5 of the model's extent.
            servo_hz: Natural frequency of position servos that are added to torque motors, [Hz].
            feedforward: Whether the controller adds :meth:`feedforward_demands` to the loops'
                feedback.
            pinned: Sites or bodies fixed to the world, such as feet: "NAME" is welded, "NAME:point"
                may rotate.
            mismatch: Differences between plant and model: "exact", "all", or sizes.
            seed: Seed of the sampled plant.
            loops: Further options of :class:`fjh.rig.options.RobotOptions`: `crossover` [Hz],
                `period` [s], `size`, `joint_weight`, `secondary_weight`, `limits`.

        Raises:
            WrongInput: The robot lacks a named part, or cannot perform the task.
            sim.ModelError: The file cannot be read, or its model is unsuitable.
        """
        from fjh.rig.mjcf import robot_rig  # late: that module imports this one

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
        return robot_rig(Path(file), options, at).with_mismatch(mismatch, seed)

    @property
    def row_units(self) -> tuple[str, ...]:
        """Units of the major rows, "rad" or "m"."""
        return tuple("rad" if row < _TURNS else "m" for row in self.major)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the model's joints or bodies that the task does not involve."""
        return () if self.part is None else self.part.left_out

    @property
    def period_s(self) -> float:
        """Control period [s]."""
        return self.nominal.period_s

    @cached_property
    def model_sha256(self) -> str:
        """SHA-256 of the MJCF file, which identifies the robot of a result."""
        return model_sha256(self.file)

    def number(self, actuator: int | str) -> int:
        """Return the number of an actuator, given by its number, its name, or its joint's name.

        Raises:
            WrongInput: There is no such actuator; the message suggests the nearest name.
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
        """Goal of the controllers, without failures."""
        return self.control.goal

    @property
    def nominal(self) -> NominalModel:
        """Linear model from commanded displacements (n,) to the major rows (m1,)."""
        return self.control.nominal

    @property
    def diagnosis_model(self) -> NominalModel:
        """Linear model from commanded displacements (n,) to the measurements of the diagnosis."""
        return self.control.diagnosis_model

    @property
    def loops(self) -> Sequence[Channel]:
        """Compensators, one for each major row."""
        return self.control.loops

    @property
    def margins(self) -> Sequence[Margins]:
        """Stability margins of the loops, one for each major row."""
        return self.control.margins

    @property
    def limits(self) -> tuple[Array, Array] | None:
        """Lower and upper displacements (n,) that the mapping respects; None without limits."""
        return self.control.limits

    @property
    def feedforward(self) -> bool:
        """True if controllers add :meth:`feedforward_demands`."""
        return self.control.feedforward

    @property
    def unused(self) -> Unused:
        """Behavior of an actuator without force: "locked" by its own spring, or "free"."""
        return self.control.unused

    def with_mismatch(self, mismatch: Known | Mismatch, seed: int) -> "Rig":
        """Return the same rig on a sampled plant that differs from the controller's model.

        Raises:
            WrongInput: The name is unknown, or a size does not apply to the robot.
        """
        machine = self.machine
        sizes = sizes_of(mismatch, machine.everything, machine.unknown)
        return replace(self, machine=machine.with_mismatch(sizes, check.integer("seed", seed)))

    def mapping(self, goal: Goal) -> PrioritizedMapping[Any]:
        """Return the mapping for a goal, including the failures that the goal states."""
        return self.control.mapping(check.instance("goal", goal, Goal))

    def controller(self, goal: Goal | None = None) -> PrioritizedController[Any]:
        """Return a controller without diagnosis for a goal; None is the goal of the rig."""
        return self.control.controller(self._goal(goal))

    def reconfigured(self, before: Goal, after: Goal, time_s: float) -> OracleController:
        """Return a controller without diagnosis that switches between two goals at a time [s].

        Used for comparison: it is informed of the failures of the goal `after` at `time_s`.
        """
        check.instance("before", before, Goal)
        check.instance("after", after, Goal)
        check.number("time_s", time_s, 0.0, 1e9)
        first, then = self.controller(before), self.controller(after)
        return OracleController(first, then, tick_of(time_s, self.period_s))

    def supervisor(
        self, dither: str | Dither | None = "default", goal: Goal | None = None
    ) -> Supervisor:
        """Return a controller that diagnoses failures and reconfigures itself.

        Args:
            dither: "default" is 20 Hz of heave on the hexapod, as in `fjh paper recover`, and the
                dither of `fjh track` on other robots; other values as for
                :func:`fjh.rig.dither.rig_dither`; None is no dither.
            goal: Goal without failures; None is that of the rig.
        """
        design = dither_of(self, dither, self.dither)
        control = self.control if goal is None else replace(self.control, goal=self._goal(goal))
        return control.supervisor(dither=design)

    def bench(
        self, time_s: Array, failures: Sequence[Failure], seed: int, events: object = None
    ) -> Bench:
        """Return the simulated machine for times (N,), with sensor noise of this seed."""
        time_s, seed = check.array("time_s", time_s, None), check.integer("seed", seed)
        return self.machine.bench(time_s, failures, seed, events)

    def classified(self, faults: Sequence[Fault]) -> Manipulability:
        """Return the manipulability of the major task after these faults."""
        return self.control.classified(faults)

    def reached(self, pose: Pose) -> Array:
        """Return the major rows, [rad] or [m], shape (N, m1), of N poses of the task frame."""
        return self.coordinates(check.instance("pose", pose, Pose))[:, list(self.major)]

    def path(self, name: str, *, duration_s: float, turn_s: float = 4.0) -> Array:
        """Return desired displacements of the major rows at each tick, (N, m1), [rad] or [m].

        Args:
            name: "spiral", "circle", "steps", or FILE.npz with `time_s` (K,), `desired` (K, m1).
            duration_s: Duration of the path [s].
            turn_s: Time of one turn [s].
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
        """Check a path (N, m1): at least one tick, displacements within `LARGEST_DISPLACEMENT`."""
        desired = check.array("path", path, None, len(self.major))
        if not len(desired):
            raise ValueError(f"path must have a row for each tick, got shape {desired.shape}")
        if (largest := np.abs(desired).max()) > LARGEST_DISPLACEMENT:
            raise ValueError(
                f"path must be at most {LARGEST_DISPLACEMENT:g} rad or m, got {largest:.3g}"
            )
        return desired

    def _goal(self, goal: Goal | None) -> Goal:
        return self.goal if goal is None else check.instance("goal", goal, Goal)

    def feedforward_demands(self, path: Array) -> Array | None:
        """Return the demands (N, m1) with which the healthy machine follows a path (N, m1).

        The demands result from the inverse of the linear model; None if :attr:`feedforward` is
        False. A failure does not change them: the compensators correct the difference.
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
        """Simulate a run along a path with a controller.

        Args:
            controller: Controller of :meth:`supervisor` or :meth:`controller`, or any
                :class:`ftc.Controller`.
            path: Desired displacements of the major rows, tick by tick, shape (N, m1).
            failures: Failures that occur, actuators by name or number.
            seed: Seed of the noise of all sensors.
            begin_s: Time of the first tick [s].
            lead_in_s: Duration [s] of control about zero before the path starts, which is not
                logged; failures at the first tick occur at the start of this lead-in.
            events: List of :class:`fjh.rig.events.Event`, with random parameters by `seed`, and of
                objects with hooks as for :class:`sim.Bench`; or one such object.
            on_tick: Called with the number of completed ticks.

        Raises:
            WrongInput: A failure's actuator does not exist, or an event does not apply.
            sim.SimulationDiverged: The simulated state became non-finite.
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
        all_failures = sorted((*self._numbered(failures), *caused), key=lambda one: one.time_s)
        time_s = begin_s + np.arange(len(desired)) * self.period_s
        run = simulate(
            self,
            controller,
            time_s,
            desired,
            all_failures,
            seed=seed,
            lead_in=lead_in,
            events=hooks,
            on_tick=on_tick,
        )
        return replace(run, events=self._events_by_time(events))

    def predict(
        self,
        path: ArrayLike,
        *,
        failures: Sequence[Failure] = (),
        told: InformedAt = True,
        noise: ArrayLike | None = None,
        dither: Dither | None = None,
        goal: Goal | None = None,
        start: ArrayLike | None = None,
        floor_m_per_s2: ArrayLike | None = None,
    ) -> Prediction:
        """Predict with the linear model the RMS errors of a run that starts at time 0 s.

        Args:
            path: Desired displacements as for :meth:`fly`.
            failures: Failures as for :meth:`fly`.
            told: True if the controller is informed of each failure at onset, False if never; or
                one time [s] for each failure at which it is informed, None for never.
            noise: Noise of the sensors of the major rows at each tick, of the shape of the path,
                such as `run.measured - run.true`; None is white noise, averaged over many runs.
            dither: Dither that the controller adds; None is no dither.
            goal: Goal of the controller from the first tick on, including failures that are known
                by then; None is that of the rig.
            start: Displacements (n,) of the actuators when the run starts; None is zero.
            floor_m_per_s2: Acceleration of the floor at each tick, shape (N, 3), if the linear
                model includes the floor, as for the hexapod; None is at rest.

        Raises:
            ValueError: The numbers of times and failures differ, a time is before its failure, or
                an array has a wrong shape.
        """
        desired, n = self._checked_path(path), len(self.actuators)
        if dither is not None:
            check.array("dither.direction", check.instance("dither", dither, Dither).direction, n)
        arguments = {"noise": (noise, desired.shape), "start": (start, (n,))}
        arguments["floor_m_per_s2"] = floor_m_per_s2, (len(desired), 3)
        arrays: dict[str, Any] = {
            name: None if value is None else check.array(name, value, *shape)
            for name, (value, shape) in arguments.items()
        }
        if floor_m_per_s2 is not None and self.nominal.floor is None:
            raise ValueError("floor_m_per_s2 must be None: this robot's model has no floor input")
        numbered, goal = self._numbered(failures), self._goal(goal)
        return predicted(self, desired, numbered, informed=told, dither=dither, goal=goal, **arrays)

    def _events_by_time(self, events: object) -> tuple[Event, ...]:
        """Return the named events in order of time, actuators by number."""
        given = events if isinstance(events, Sequence) else ()
        numbered = (
            item if item.actuator is None else replace(item, actuator=self.number(item.actuator))
            for item in given
            if isinstance(item, Event)
        )
        return tuple(sorted(numbered, key=lambda event: event.time_s))

    def _numbered(self, failures: Sequence[Failure]) -> list[Failure]:
        check.instance("failures", failures, list, tuple)
        checked = [check.instance("failures", failure, Failure) for failure in failures]
        return [replace(failure, actuator=self.number(failure.actuator)) for failure in checked]
