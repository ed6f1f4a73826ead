"""A simulated machine in a loop: plant, sensors, drives, failures at their times, and a log."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from inspect import Signature, signature
from typing import Any, NamedTuple, Protocol

import numpy as np

import argument_checks as check
from argument_checks.arrays import as_float64
from kernels import Struct, lib, pointer
from sim.array import Array
from sim.kinematics.mechanism import JointPosture, Mechanism
from sim.kinematics.pose import Pose, principal
from sim.plant.failure import Failure
from sim.plant.plant import Plant, physics_steps
from sim.plant.slip import MaxwellSlip


class Reading(NamedTuple):
    """What sensors read at one tick, as :class:`ftc.Measurement`.

    Attributes:
        output: The major task, shape (m1,).
        displacement: Displacements of the actuators, shape (n,).
    """

    output: Array
    displacement: Array


class Sensors(Protocol):
    """Protocol of the sensors of a machine."""

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """What they read at a pose of the task frame and displacements (n,) of the actuators."""
        ...


class TaskSensor:
    """A sensor of the task frame itself, such as a camera or a tracker, beside encoders."""

    def __init__(
        self, rows: Sequence[int], noise: float, encoder_noise: float, seed: int | Sequence[int]
    ) -> None:
        """Measure these rows of [rotation vector; translation].

        Args:
            rows: Of the displacement (6,) of the task frame.
            noise: Standard deviation of one sample of each row, [rad] or [m].
            encoder_noise: Of one sample of each actuator's displacement, [rad] or [m].
            seed: Of all noise.

        Raises:
            ValueError: Rows outside 0..5, or negative noise.
        """
        self._rows = check.indices("rows", rows, 6)
        self._noise = check.number("noise", noise)
        self._encoder_noise = check.number("encoder_noise", encoder_noise)
        self._rng = np.random.default_rng(check.seed("seed", seed))

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """The rows and the displacements, with noise."""
        displacements, m1 = _seen(pose, displacements), len(self._rows)
        noise = self._rng.standard_normal(m1 + len(displacements))
        output = pose.displacement().take(self._rows) + self._noise * noise[:m1]
        return Reading(output, displacements + self._encoder_noise * noise[m1:])


class JointSensors:
    """Encoders alone: the task follows from the forward kinematics of a model, loops closed."""

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
        self._noise = check.number("encoder_noise", encoder_noise)
        self._rng = np.random.default_rng(check.seed("seed", seed))
        self._posture: JointPosture = mechanism.nominal
        self._all = np.arange(len(mechanism.nominal.displacements))

    def read(self, pose: Pose, displacements: Array) -> Reading:
        """The task as the encoders have it, and what they read; the true pose stays unknown."""
        displacements = _seen(pose, displacements)
        seen = displacements + self._noise * self._rng.standard_normal(len(displacements))
        self._posture = self._mechanism.moved(self._posture, seen, self._all)
        return Reading(self._mechanism.task(self._posture)[self._rows], seen)


def hooks_of(events: object) -> list[Any]:
    """Functions `plant`, `measured` and `sent` of an object; None where it has none of a name.

    Raises:
        TypeError: It has none at all, or one that is no function of as many arguments.
    """
    hooks = [getattr(events, name, None) for name in _HOOKS]
    if all(hook is None for hook in hooks):
        raise TypeError("events must have plant, measured or sent, got " + check.shown(events))
    for (name, takes), hook in zip(_HOOKS.items(), hooks, strict=True):
        if hook is not None:
            function = check.function(f"events.{name}", hook)
            with suppress(ValueError):  # of compiled functions nothing is known
                _check_takes(f"events.{name}", signature(function), takes)
    return hooks


def _check_takes(name: str, of: Signature, takes: Sequence[str]) -> None:
    try:
        of.bind(*takes)
    except TypeError:
        raise TypeError(f"{name} must be a function of ({', '.join(takes)}), got {of}") from None


_HOOKS = {
    "plant": ("tick", "model", "data"),
    "measured": ("tick", "reading"),
    "sent": ("tick", "inputs"),
}


def measured_by(hook: Callable[[int, Any], Any], tick: int, reading: Any) -> tuple[Any, Any]:
    """What a hook makes of a reading, and the error of a pilot that needs one; None: it is one.

    A reading has as many numbers as before, in arrays; NaN for those that are missing.
    """
    changed = hook(tick, reading)
    if not isinstance(reading, Reading):
        return changed, None
    name, arrays = f"what events.measured returns at tick {tick}", list[Array]()
    try:
        check.attributes(name, changed, *Reading._fields)
        for part, before in zip(Reading._fields, reading, strict=True):
            arrays.append(as_float64(f"{part} of {name}", getattr(changed, part)))
            if arrays[-1].shape != before.shape:
                raise ValueError(
                    f"{part} of {name} must have shape {before.shape}, got {arrays[-1].shape}"
                )
    except (ValueError, TypeError) as error:
        return changed, error
    is_whole = np.isfinite(arrays[0]).all()
    missing = f"pilot must go on without numbers that are missing in {name}"
    return Reading(*arrays), None if is_whole else ValueError(missing)


def sent_by(hook: Callable[[int, Array], Array], tick: int, inputs: Array) -> Array:
    """What a hook makes of inputs: as many finite numbers.

    Raises:
        ValueError: It makes something else of them.
    """
    return check.exactly(
        f"what events.sent returns at tick {tick}", hook(tick, inputs), *inputs.shape
    )


def _seen(pose: Pose, displacements: Array) -> Array:
    check.instance("pose", pose, Pose)
    return check.series("displacements", displacements)


class Bench:
    """A plant with sensors and drives, as :class:`ftc.loop.Machine`.

    Attributes:
        plant: The machine itself.
        sensors: What is read of it.
        rotation: True rotation of the task frame at each tick, shape (N, 3, 3).
        translation_m: Its true translation, shape (N, 3).
        task: [rotation vector; translation] of both, shape (N, 6).
        displacement: True displacements of the actuators, shape (N, n).
        closure_residual_m: Largest gap of a closed loop, shape (N,).
        qpos: Joint positions, shape (N, nq); None where they are not kept.
        actuator_force: As MuJoCo has it, at the end of the period before, shape (N, outputs); kept
            with them.
        gap: The error of a pilot that needs what an event has taken from the last reading, or None.
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
        keep_qpos: bool = False,
        events: object = None,
    ) -> None:
        """Take a plant at rest.

        Args:
            plant: The machine.
            sensors: What is read of it.
            time_s: Of each tick, shape (N,): failures strike at their times.
            period_s: Between ticks, with at most as many physics steps as :meth:`Plant.step`.
            failures: What happens to the plant.
            drives: From the inputs of the drives to displacements (n,); None: they are the same.
            floor_m_per_s2: Acceleration of the floor at each tick, shape (N, 3); None is at rest.
            delay_ticks: Ticks by which commands reach the plant late; it holds its last one until
                the first comes.
            hysteresis: Of a spring along each actuator, beside the plant's own; none of it is
                stretched at the first tick. Its forces are updated once a tick and held.
            keep_qpos: Whether the log has the joint positions, and forces of the actuators.
            events: What else happens, tick by tick: an object with some of `plant(tick, model,
                data)`, before the physics of a tick (forces in `data.xfrc_applied`, gains,
                dampers); `measured(tick, reading)`, which returns what the controller reads
                instead; `sent(tick, inputs)`, what the drives get instead. None is nothing.

        Raises:
            ValueError: Times that are no vector, a period that is not positive or too long, another
                number of accelerations, a failure of an actuator that the plant does not have, a
                delay that is no whole number, or hysteresis of another number of springs.
            ModelError: The period is not a whole number of physics steps; or an actuator is to lock
                that has no lock.
            TypeError: An argument is of another type: `sensors` do not read, `drives` is no
                function, or `events` has none of these methods.
        """
        check.instance("plant", plant, Plant)
        check.methods("sensors", sensors, "read")
        if drives is not None:
            check.function("drives", drives)
        time_s = check.frozen(check.series("time_s", time_s))
        self._steps = physics_steps("period_s", period_s, plant.model.opt.timestep)
        if floor_m_per_s2 is not None:
            floor_m_per_s2 = check.exactly("floor_m_per_s2", floor_m_per_s2, len(time_s), 3)
            floor_m_per_s2 = check.frozen(floor_m_per_s2)
        failures = check.members("failures", failures, Failure)
        for failure in failures:  # an actuator may fail twice
            if isinstance(failure.actuator, str):
                number = plant.number(failure.actuator)
            else:
                number = check.index("failures", failure.actuator, len(plant.drives))
            if failure.kind == "locked":
                plant.check_lock(number)
        if hysteresis is not None:
            check.instance("hysteresis", hysteresis, MaxwellSlip)
            if len(hysteresis.slip) != len(plant.drives):
                raise ValueError(
                    f"hysteresis must have one row for each of {len(plant.drives)} actuators, "
                    f"got shape {hysteresis.slip.shape}"
                )
        self.plant, self.sensors, self._drives = plant, sensors, drives
        hooks = [None] * len(_HOOKS) if events is None else hooks_of(events)
        self._on_plant, self._on_measured, self._on_sent = hooks
        delay = min(check.index("delay_ticks", delay_ticks), len(time_s))  # then it never comes
        self._under_way = deque([plant.command] * delay)
        self._hysteresis, self.gap = hysteresis, None
        self._stretch = np.zeros((1, 1) if hysteresis is None else hysteresis.slip.shape)
        self._time_s, self._floor = time_s, floor_m_per_s2
        self._to_come = sorted(failures, key=lambda failure: failure.time_s)
        self._tick, ticks, n = 0, len(time_s), len(plant.drives)
        self.rotation = np.empty((ticks, 3, 3))
        self.translation_m = np.empty((ticks, 3))
        self.task = np.empty((ticks, 6))
        self.displacement = np.empty((ticks, n))
        self.closure_residual_m = np.empty(ticks)
        is_kept = check.flag("keep_qpos", keep_qpos)
        widths = (plant.model.nq, len(plant.data.actuator_force)) if is_kept else (0, 0)
        self._kept = [np.empty((ticks, width)) for width in widths]
        self.qpos, self.actuator_force = self._kept if is_kept else (None, None)
        self._log = self._logged()

    def __getstate__(self) -> dict[str, Any]:
        """Without the pointers into the plant's data, which a copy has of its own."""
        return {name: value for name, value in vars(self).items() if name != "_log"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._log = self._logged()

    def _logged(self) -> Struct:
        names = ("rotation", "translation_m", "task", "displacement", "closure_residual_m")
        all_qpos, all_forces = self._kept
        return Struct(
            "observation",
            **self.plant.observed(),
            **{name: getattr(self, name) for name in names},
            all_qpos=all_qpos,
            all_forces=all_forces,
            kept_qpos=all_qpos.shape[1],
            kept_forces=all_forces.shape[1],
        )

    def measure(self) -> Reading:
        """What the sensors read, after what happens now."""
        self._happen()
        tick, data = self._tick, self.plant.data
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
        changed, self.gap = measured_by(self._on_measured, tick, reading)
        return changed

    def _happen(self) -> None:
        """What is due at this tick, in which failures strike once."""
        now_s = self._time_s[self._tick]  # compiled code would write beyond the log
        while self._to_come and self._to_come[0].time_s <= now_s:
            self._to_come.pop(0).strike(self.plant)
        if self._floor is not None:
            self.plant.shake(self._floor[self._tick])

    def apply(self, inputs: Array) -> None:
        """Drive the actuators for a period.

        Raises:
            ValueError: Not finite; or the displacements, of the drives if there are any, are not
                one for each actuator.
        """
        command, name = check.finite("inputs", inputs), "inputs"
        if self._on_sent is not None:
            command = sent_by(self._on_sent, self._tick, command)
        if self._drives is not None:
            command, name = self._drives(command), "drives(inputs)"
        command = check.exactly(name, command, self.displacement.shape[1])
        if self._under_way:
            self._under_way.append(np.array(command))
            command = self._under_way.popleft()
        if self._hysteresis is not None:
            self._slip(self._hysteresis)
        if self._on_plant is not None:
            self._on_plant(self._tick, self.plant.model, self.plant.data)
        self.plant.hold(command, self._steps)
        self._tick += 1

    def _slip(self, hysteresis: MaxwellSlip) -> None:
        """Load the plant with the forces of hysteresis at the displacements measured."""
        here, before = self.displacement[self._tick], self.displacement[max(self._tick - 1, 0)]
        self._stretch = hysteresis.moved(self._stretch, here - before)
        self.plant.load(hysteresis.force(self._stretch))
