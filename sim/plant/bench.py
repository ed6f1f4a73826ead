"""Simulated machine in a control loop: plant, sensors, drives, failures, event hooks, log."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from inspect import signature
from typing import Any, NamedTuple, Protocol

import numpy as np

import argument_checks as check
from kernels import Struct, lib, pointer
from sim.array import Array
from sim.kinematics.mechanism import JointPosture, Mechanism
from sim.kinematics.pose import Pose, principal
from sim.plant.plant import Failure, Plant, physics_steps


class Reading(NamedTuple):
    """Sensor reading at one tick: major task (m1,) and actuator displacements (n,)."""

    output: Array
    displacement: Array


class Sensors(Protocol):
    """Protocol of the sensors of a machine."""

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """Return the reading at a pose of the task frame and actuator displacements (n,)."""
        ...


class TaskSensor:
    """Encoders, and a sensor of the task frame itself, such as a camera or a tracker."""

    def __init__(
        self, rows: Sequence[int], noise: float, encoder_noise: float, seed: int | Sequence[int]
    ) -> None:
        """Measure rows of [rotation vector; translation] of the task frame.

        Noise is a standard deviation of one sample of each row, and of each actuator's
        displacement, [rad] or [m].
        """
        self._rows = check.indices("rows", rows, 6)
        self._noise = check.number("noise", noise, 0.0)
        self._encoder_noise = check.number("encoder_noise", encoder_noise, 0.0)
        self._rng = _generator(seed)

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """Return task rows and actuator displacements, both with noise."""
        displacements, m1 = _seen(pose, displacements), len(self._rows)
        noise = self._rng.standard_normal(m1 + len(displacements))
        output = pose.displacement().take(self._rows) + self._noise * noise[:m1]
        return Reading(output, displacements + self._encoder_noise * noise[m1:])


class JointSensors:
    """Encoders as the only sensors: forward kinematics with closed loops gives the task."""

    def __init__(
        self,
        mechanism: Mechanism,
        rows: Sequence[int],
        encoder_noise: float,
        seed: int | Sequence[int],
    ) -> None:
        """Start at the nominal posture of the mechanism; arguments as :class:`TaskSensor`."""
        self._mechanism = check.instance("mechanism", mechanism, Mechanism)
        self._rows = check.indices("rows", rows, 6)
        self._noise = check.number("encoder_noise", encoder_noise, 0.0)
        self._rng = _generator(seed)
        self._posture: JointPosture = mechanism.nominal
        self._all = np.arange(len(mechanism.nominal.displacements))

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """Return the task computed from the encoders, and their readings; `pose` is not used."""
        displacements = _seen(pose, displacements)
        seen = displacements + self._noise * self._rng.standard_normal(len(displacements))
        self._posture = self._mechanism.moved(self._posture, seen, self._all)
        return Reading(self._mechanism.task(self._posture)[self._rows], seen)


def _seen(pose: Pose, displacements: Array) -> Array:
    check.instance("pose", pose, Pose)
    return check.array("displacements", displacements, None)


def _generator(seed: int | Sequence[int]) -> np.random.Generator:
    """Create a generator from one non-negative integer or a list of them."""
    listed = seed if isinstance(seed, list | tuple) and seed else [seed]
    return np.random.default_rng([check.integer("seed", item) for item in listed])


@dataclass(frozen=True)
class MaxwellSlip:
    """Hysteresis model: m parallel elastic elements with dry friction in series on n springs.

    An element of stiffness k is stretched with the displacement x until its force reaches its
    friction, k s; then it slips. Its stretch z follows dx within -s..s, and its force is -k z. In a
    cycle of amplitude a each element dissipates 4 k s (a - s) if a > s, else zero.

    Source: Iwan, J. Appl. Mech. 33 (1966) 893, his parallel-series model; for joints, Segalman,
    SAND2001-0811 (2001).

    Attributes:
        stiffness: Stiffness of each element, shape (n, m), [N]/[m] or [N m]/[rad].
        slip: Stretch of each element when it slips, shape (n, m), [m] or [rad].
    """

    stiffness: Array
    slip: Array

    def __post_init__(self) -> None:
        shape: tuple[int | None, ...] = (None, None)
        for name in ("stiffness", "slip"):
            value = check.array(name, getattr(self, name), *shape, least=0.0)
            object.__setattr__(self, name, check.frozen(value))
            shape = value.shape

    def moved(self, stretch: Array, by: Array) -> Array:
        """Return the stretches (n, m) of the elements after displacements (n,) of their springs.

        The result is exact for displacements in one direction, for any step size.
        """
        stretch = check.array("stretch", stretch, *self.slip.shape)
        by = check.array("by", by, len(self.slip))
        return (stretch + by[:, None]).clip(-self.slip, self.slip)

    def force(self, stretch: Array) -> Array:
        """Return the force on each spring's end, (n,), [N] or [N m], opposite to the stretch."""
        stretch = check.array("stretch", stretch, *self.slip.shape)
        return -(self.stiffness * stretch).sum(axis=1)


class Bench:
    """Plant with sensors and drives, as :class:`ftc.loop.Machine`, and a log of its true state.

    Attributes:
        rotation: Rotation of the task frame at each tick, shape (N, 3, 3).
        translation_m: Translation of the task frame, shape (N, 3).
        task: [rotation vector; translation] of the task frame, shape (N, 6).
        displacement: Displacements of the actuators, [m] or [rad], shape (N, n).
        closure_residual_m: Largest gap of a closed loop, 1 rad counted as 1 m, shape (N,).
        qpos: Joint positions, shape (N, nq); None if they are not logged.
        actuator_force: MuJoCo's forces at the end of the previous period, [N] or [N m], shape (N,
            outputs); None if they are not logged.
        reading_error: Error to raise if the controller cannot use the last reading, which an event
            has changed; None if the reading is complete.
    """

    def __init__(
        self,
        plant: Plant,
        sensors: Sensors,
        *,
        time_s: Array,
        period_s: float,
        failures: Sequence[Failure] = (),
        drives: Callable[[Array], Array] | None = None,
        floor_m_per_s2: Array | None = None,
        delay_ticks: int = 0,
        hysteresis: MaxwellSlip | None = None,
        log_qpos: bool = False,
        events: object = None,
    ) -> None:
        """Take a plant at rest.

        Args:
            plant: The plant.
            sensors: Its sensors.
            time_s: Time of each tick [s], shape (N,); failures occur by these times.
            period_s: Time between ticks [s]; its physics steps are limited as in
                :meth:`Plant.step`.
            failures: Failures of the plant's actuators.
            drives: Function from inputs of the drives to displacements (n,); None is the identity.
            floor_m_per_s2: Acceleration of the floor at each tick, shape (N, 3); None is zero.
            delay_ticks: Delay of the commands, in ticks; the plant keeps its present command until
                the first one arrives.
            hysteresis: Additional springs along the actuators, unstretched at the first tick. Their
                forces are updated once a tick.
            log_qpos: Whether to log joint positions and actuator forces.
            events: Object with some of these hooks: `plant(tick, model, data)`, called before the
                physics of a tick (forces in `data.xfrc_applied`, gains, dampers); `measured(tick,
                reading)`, whose result replaces the reading; `sent(tick, inputs)`, whose result
                replaces the inputs of the drives.

        Raises:
            ModelError: The period is not a whole number of physics steps; or an actuator without a
                lock is to be locked.
        """
        check.instance("plant", plant, Plant)
        check.attributes("sensors", sensors, "read")
        if drives is not None:
            check.function("drives", drives)
        time_s = check.frozen(check.array("time_s", time_s, None))
        self._steps = physics_steps("period_s", period_s, plant.model.opt.timestep)
        if (floor := floor_m_per_s2) is not None:
            floor = check.frozen(check.array("floor_m_per_s2", floor, len(time_s), 3))
        failures = check.members("failures", failures, Failure)
        for failure in failures:
            number = plant.number(failure.actuator)
            if failure.kind == "locked":
                plant.check_lock(number)
        n, ticks = len(plant.drives), len(time_s)
        if hysteresis is not None:
            check.instance("hysteresis", hysteresis, MaxwellSlip)
            if len(hysteresis.slip) != n:
                raise ValueError(
                    f"hysteresis must have one row for each of {n} actuators, "
                    f"got shape {hysteresis.slip.shape}"
                )
        self.plant, self.sensors, self._drives = plant, sensors, drives
        hooks = (None, None, None) if events is None else hooks_of(events)
        self._on_plant, self._on_measured, self._on_sent = hooks
        delay = min(check.integer("delay_ticks", delay_ticks), ticks)  # a longer one: the same
        self._pending = deque([plant.command] * delay)
        self._hysteresis, self.reading_error = hysteresis, None
        self._stretch = np.zeros((1, 1) if hysteresis is None else hysteresis.slip.shape)
        self._time_s, self._floor = time_s, floor
        self._pending_failures = sorted(failures, key=lambda failure: failure.time_s)
        self._tick = 0
        self.rotation = np.empty((ticks, 3, 3))
        self.translation_m = np.empty((ticks, 3))
        self.task = np.empty((ticks, 6))
        self.displacement = np.empty((ticks, n))
        self.closure_residual_m = np.empty(ticks)
        logs_qpos = check.flag("log_qpos", log_qpos)
        widths = (plant.model.nq, len(plant.data.actuator_force)) if logs_qpos else (0, 0)
        self._state_log = [np.empty((ticks, width)) for width in widths]
        self.qpos, self.actuator_force = self._state_log if logs_qpos else (None, None)
        self._log = self._logged()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without pointers into the plant's data, which a copy must renew."""
        return {name: value for name, value in vars(self).items() if name != "_log"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._log = self._logged()

    def _logged(self) -> Struct:
        names = ("rotation", "translation_m", "task", "displacement", "closure_residual_m")
        all_qpos, all_forces = self._state_log
        return Struct(
            "observation",
            **self.plant.observed(),
            **{name: getattr(self, name) for name in names},
            all_qpos=all_qpos,
            all_forces=all_forces,
            logged_qpos=all_qpos.shape[1],
            logged_forces=all_forces.shape[1],
        )

    def measure(self) -> Reading:
        """Inject the failures that are due, log the true state and read the sensors."""
        tick, data = self._tick, self.plant.data
        now_s = self._time_s[tick]  # raises after the last tick, where compiled code would not
        while self._pending_failures and self._pending_failures[0].time_s <= now_s:
            self._pending_failures.pop(0).inject(self.plant)
        if self._floor is not None:
            self.plant.shake(self._floor[tick])
        rows = pointer(data.efc_pos), pointer(data.efc_id), data.ne
        principal(lib.observe(self._log.pointer, tick, *rows), self.task[tick])
        pose = check.computed(
            Pose,
            rotation=self.rotation[tick],
            translation_m=self.translation_m[tick],
            _displacement=self.task[tick],
        )
        reading = self.sensors.read(pose, self.displacement[tick])
        if self._on_measured is None:
            return reading
        changed, self.reading_error = measured_by(self._on_measured, tick, reading)
        return changed

    def apply(self, inputs: Array) -> None:
        """Simulate one period with inputs that the drives convert to displacements (n,)."""
        command, name = check.array("inputs", inputs), "inputs"
        if self._on_sent is not None:
            command = sent_by(self._on_sent, self._tick, command)
        if self._drives is not None:
            command, name = self._drives(command), "drives(inputs)"
        command = check.array(name, command, self.displacement.shape[1])
        if self._pending:
            self._pending.append(np.array(command))
            command = self._pending.popleft()
        if self._hysteresis is not None:  # its forces at the displacements measured
            here, before = self.displacement[[self._tick, max(self._tick - 1, 0)]]
            self._stretch = self._hysteresis.moved(self._stretch, here - before)
            self.plant.load(self._hysteresis.force(self._stretch))
        if self._on_plant is not None:
            self._on_plant(self._tick, self.plant.model, self.plant.data)
        self.plant.step_physics(command, self._steps)
        self._tick += 1


def hooks_of(events: object) -> list[Any]:
    """Return the hooks `plant`, `measured` and `sent` of an object; None for a missing one."""
    takes = {"plant": "tick, model, data", "measured": "tick, reading", "sent": "tick, inputs"}
    hooks = {name: getattr(events, name, None) for name in takes}
    present = {name: hook for name, hook in hooks.items() if hook is not None}
    if not present:
        raise TypeError("events must have plant, measured or sent, got " + check.short_repr(events))
    for name, hook in present.items():
        with suppress(ValueError):  # compiled functions may have no signature
            of = signature(check.function(f"events.{name}", hook))
            try:
                of.bind(*takes[name].split(", "))
            except TypeError:
                message = f"events.{name} must be a function of ({takes[name]}), got {of}"
                raise TypeError(message) from None
    return [*hooks.values()]


def measured_by(hook: Callable[[int, Any], Any], tick: int, reading: Any) -> tuple[Any, Any]:
    """Return the reading changed by a hook, and the error to raise if it is incomplete.

    The error is None if all numbers are present and finite.
    """
    changed = hook(tick, reading)
    if not isinstance(reading, Reading):
        return changed, None
    name, arrays = f"what events.measured returns at tick {tick}", list[Array]()
    try:
        check.attributes(name, changed, *Reading._fields)
        for part, before in zip(Reading._fields, reading, strict=True):
            value = getattr(changed, part)
            arrays.append(check.array(f"{part} of {name}", value, *before.shape, finite=False))
    except (ValueError, TypeError) as error:
        return changed, error
    missing = ValueError(
        f"{name} must have finite numbers, unless the controller runs without them"
    )
    return Reading(*arrays), None if np.isfinite(arrays[0]).all() else missing


def sent_by(hook: Callable[[int, Array], Array], tick: int, inputs: Array) -> Array:
    """Return the inputs (n,) changed by a hook, which must be finite."""
    name = f"what events.sent returns at tick {tick}"
    return check.array(name, hook(tick, inputs.copy()), *inputs.shape)
