"""Plant: MuJoCo physics, true payload motion, and actuator failures."""

import copy
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any, Literal, cast, get_args

import mujoco
import numpy as np

import argument_checks as check
from kernels import lib, pointer
from sim.array import Array
from sim.closing.equalities import active_closures, check_closures
from sim.errors import BAD_CONTROL, ModelError, SimulationDiverged, has_diverged
from sim.kinematics.jacobian import CLOSURE_TOLERANCE
from sim.kinematics.observation import Observed, Observer
from sim.kinematics.pose import Pose
from sim.mjcf.drive import drive_rows, names_of, number_of, required_drives
from sim.mjcf.frame import Body, located
from sim.mjcf.model import check_state
from sim.mjcf.part import Part
from sim.plant import actuators
from sim.plant.linear import LinearPlant, linear_plant

MOST_STEPS = 10_000_000
"""Largest number of physics steps in a period: minutes of computing, hours for large robots."""

_UNINTERRUPTED = 250
"""Number of physics steps after which Ctrl-C acts: many more than in a control tick."""

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)

FailureKind = Literal["locked", "free", "loose", "weak"]
"""Kinds of failure, in this order: stuck in place; no force; neither force nor spring; reduced
force."""


class Plant:
    """Simulated plant with private copies of model and data, and with actuator failures.

    Its n actuators are the active velocities of :func:`jacobians`, in that order; displacements
    (n,) are relative to the nominal pose, in [m] or [rad]. Twists, wrenches and displacements of
    the payload are [angular; linear] in the present axes of the base.

    Attributes:
        drives: Velocity and MuJoCo actuators of each actuator 0..n-1.
        model: The plant's copy of the model.
        data: State of the plant.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        base: str | Body | None = "base",
        payload: str | Body = "payload",
        start: mujoco.MjData | None = None,
        part: Part | None = None,
    ) -> None:
        """Start at rest in the nominal pose, without failures.

        Args:
            model: Each drive needs a position feedback or a spring: position servos of any gear, or
                motors with a suspension; see :func:`servoed` for others. To be locked, a joint or
                tendon needs an equality that fixes only it: `lock1`, `lock2`, ..., which
                :func:`load_model` adds on request, or one with another name.
            base: Site or body whose axes express twists and displacements; None is the world.
            payload: Site or body that is the task frame, in any orientation.
            start: State, for example from :func:`assemble`, that gives the nominal pose `qpos`, the
                active equalities and the mocap bodies. Controls then keep the machine at rest
                against gravity and springs, with actuator forces of least norm; contacts and limits
                are not included. None is `qpos0`, with controls of zero.
            part: Part of the model that is commanded; `start` is then a state in which the physics
                is at rest, loops and contacts loaded, with the controls that keep it there; other
                actuators keep these controls. None is the whole model.

        Raises:
            ModelError: A frame does not exist, or a joint has no lock; there is no actuator, or
                one whose control gives no displacement; or the machine is not in balance at
                `start`: the message names the joint that moves.
            ClosureError: A loop is open at `start`.
        """
        check.instance("model", model, mujoco.MjModel)
        if part is not None:
            check.instance("part", part, Part)
        # Locks and switched-off coils live in the model, so a shared one would share its failures.
        self.model = copy.copy(model)
        # The state of a diverging run must be kept for inspection, so MuJoCo must not reset it.
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        actuators.reserve_off_group(self.model)
        self._healthy = {name: getattr(self.model, name).copy() for name in actuators.STRENGTHS}
        self.data = mujoco.MjData(self.model)
        self.drives = required_drives(self.model, None if part is None else part.actuators)
        self._locks = [actuators.lock_of(self.model, drive) for drive in self.drives]
        joints = [drive.joint for drive in self.drives]
        self._velocities = None if None in joints else self.model.jnt_dofadr[joints].astype(np.intp)
        axes = None if base is None else located(self.model, "base", base)
        frame = located(self.model, "payload", payload)
        self._payload_frame = payload
        loops = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
        self._is_loop = np.isin(self.model.eq_type, loops).astype(float)
        if part is not None:
            self._is_loop[list(part.other_equalities)] = 0.0
        if start is not None:
            _place(self.model, self.data, start, at_rest=part is not None)
        actuators.enable_locks(self.model, self.data)
        self._last = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        self._command = np.zeros(len(self.drives))
        mujoco.mj_forward(self.model, self.data)
        forces = None if part is None else self.data.actuator_force.copy()
        if start is not None and part is None:
            forces, moving, reason = actuators.balance(self.model, self.data, self.drives)
            if moving is not None:
                raise ModelError(reason)
        self._commands = actuators.commands_of(self.model, self.data, self.drives, forces)
        if start is not None:
            if beyond := actuators.beyond_ranges(self.model, self.drives, self._commands):
                raise ModelError(beyond)
            self._commands = self._commands.with_other_controls(start.ctrl)
            self.data.ctrl[:] = self._commands.at_rest
            mujoco.mj_forward(self.model, self.data)
        self._observed = Observed(self.model, self.data, self.drives, frame, axes)
        self._observer = Observer(self._observed, self.data)
        self._limits = actuators.rest_limits(self.model, self.data, self.drives, self._commands)
        self._gravity = self.model.opt.gravity.copy()
        self._initially_active = self.data.eq_active.copy()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without views of :attr:`data`, which a copy must renew."""
        return {name: value for name, value in vars(self).items() if name != "_observer"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _observer=Observer(state["_observed"], state["data"]))

    def step(self, command_m: Array, period_s: float) -> None:
        """Simulate one period with constant commanded displacements (n,).

        Each control is that of the nominal pose plus the control that keeps the drive alone at its
        displacement, against its servo's feedback and the spring of its joint or tendon.

        Raises:
            ValueError: The period has more than 1e7 physics steps.
            ModelError: The period is not a whole number of physics steps.
            SimulationDiverged: The state is no longer finite.
        """
        steps = physics_steps("period_s", period_s, self.model.opt.timestep)
        self.step_physics(check.array("command_m", command_m, len(self.drives)), steps)

    def step_physics(self, command_m: Array, steps: int) -> None:
        """Simulate some physics steps with constant commands (n,), which are not checked."""
        model, data = self.model, self.data
        mujoco.mj_getState(model, data, self._last, _STATE)
        self._command[:] = controls = command_m
        if not (commands := self._commands).are_displacements:
            controls = commands.at_rest + commands.per_displacement.dot(command_m)
        data.ctrl[:] = controls
        for done in range(0, steps, _UNINTERRUPTED):
            mujoco.mj_step(model, data, min(steps - done, _UNINTERRUPTED))
            if has_diverged(data):
                huge = "was given controls beyond 1e+10, which MuJoCo replaces by zeros"
                why = (huge,) if data.warning[BAD_CONTROL].number else ()
                raise SimulationDiverged(data.time, self._last.copy(), *why)
        mujoco.mj_kinematics(model, data)
        self._observed.refresh(model, data)

    def settle(self, seconds: float, command_m: Array | None = None) -> None:
        """Simulate some seconds with constant displacements (n,), None is zero; reset the time."""
        steps = physics_steps("seconds", seconds, self.model.opt.timestep)
        n = len(self.drives)
        at_m = np.zeros(n) if command_m is None else check.array("command_m", command_m, n)
        self.step_physics(at_m, steps)
        self.data.time = 0.0

    def lock(self, actuator: int) -> None:
        """Lock actuator 0..n-1 in place (position failure); raise ModelError if it has no lock."""
        k = self.check_lock(actuator)
        actuators.activate_lock(self.model, self.data, self.drives[k], self._locks[k])

    def check_lock(self, actuator: int) -> int:
        """Return the index of an actuator 0..n-1; raise ModelError if it has no lock."""
        if self._locks[k := self._index(actuator)] < 0:
            raise actuators.no_lock(self.model, self.drives[k])
        return k

    @property
    def soft_locks(self) -> dict[int, str]:
        """Sentences on locks that would yield at the present pose, by number of the drive."""
        locks = enumerate(zip(self.drives, self._locks, self._commands.stiffness, strict=True))
        warnings = {k: actuators.lock_warning(self.model, self.data, *one) for k, one in locks}
        return {k: warning for k, warning in warnings.items() if warning is not None}

    def release(self, actuator: int) -> None:
        """Switch actuator 0..n-1 off (torque failure)."""
        actuators.switch_off(self.model, self.drives[self._index(actuator)])

    def weaken(self, actuator: int, effectiveness: float) -> None:
        """Reduce the force of actuator 0..n-1 to a fraction in 0..1."""
        ids = list(self.drives[self._index(actuator)].ids)
        part = check.number("effectiveness", effectiveness, 0.0, 1.0)
        # The force of a position servo depends on both.
        self.model.actuator_gainprm[ids, :3] *= part
        self.model.actuator_biasprm[ids, :3] *= part

    def break_loose(self, actuator: int) -> None:
        """Release actuator 0..n-1 and remove its suspension spring, preload included."""
        self.release(actuator)
        drive = self.drives[self._index(actuator)]
        if drive.joint is not None:
            self.model.jnt_stiffness[drive.joint] = 0.0
        elif drive.tendon is not None:
            self.model.tendon_stiffness[drive.tendon] = 0.0

    def repair(self, actuator: int) -> None:
        """Restore actuator 0..n-1 to its initial, healthy condition."""
        k = self._index(actuator)
        if (lock := self._locks[k]) >= 0:
            self.data.eq_active[lock] = self._initially_active[lock]
            self.model.eq_data[lock] = self._healthy["eq_data"][lock]
        actuators.restore(self.model, self.drives[k], self._healthy)

    def push(self, wrench: Array) -> None:
        """Apply a wrench (6,), [N m] and [N], to the payload at its site, from now on.

        Moment, force and lever arm stay constant in the world.
        """
        wrench = check.array("wrench", wrench, 6)
        self.data.xfrc_applied[:] = 0.0
        applied = self._observed.force_at_centre_of_mass(self.data, wrench)
        self.data.xfrc_applied[self._observed.frame.body] = applied

    def load(self, force: Array) -> None:
        """Apply forces (n,), [N] or [N m], along the actuators' velocities from now on."""
        force = check.array("force", force, len(self.drives))
        if self._velocities is None:
            self.data.qfrc_applied[:] = drive_rows(self.model, self.data, self.drives).T.dot(force)
        else:
            self.data.qfrc_applied[:] = 0.0
            self.data.qfrc_applied[self._velocities] = force

    def shake(self, acceleration: Array) -> None:
        """Accelerate the floor from now on by a (3,) in base axes, [m]/[s^2], without rotation.

        The model is relative to the floor: each mass m has the inertial force -m a.
        """
        acceleration = check.array("acceleration", acceleration, 3)
        self.model.opt.gravity[:] = self._gravity - self._observed.axes(self.data) @ acceleration

    def displacement(self) -> Array:
        """Return the payload displacement [rotation vector; translation] from nominal, (6,)."""
        return self.pose().displacement()

    def pose(self) -> Pose:
        """Return the payload's pose relative to nominal, in base axes: R = R_now R_nominal^T."""
        return self._observer.read()[0]

    @property
    def axes(self) -> Array:
        """Present axes of the base in the world as columns, shape (3, 3)."""
        return self._observed.axes(self.data).copy()

    @property
    def origin_m(self) -> Array:
        """Position of the task frame in the world in the nominal pose, shape (3,)."""
        return self._observed.origin_m.copy()

    def displacements(self) -> Array:
        """Return the displacements (n,) of joints, tendon or crank lengths, or servo lengths."""
        return self._observer.read()[1].copy()

    def limits(self) -> tuple[Array, Array]:
        """Return the lower and upper static displacements, (n,) each, of healthy actuators.

        They respect the ranges of joint or tendon, control and force against the spring, and are
        infinite where there are none. The change of gravity forces is neglected.
        """
        lower, upper = self._limits
        return lower.copy(), upper.copy()

    @property
    def stiffness(self) -> Array:
        """Force of each actuator per commanded displacement, the actuator blocked, shape (n,)."""
        return self._commands.stiffness.copy()

    @property
    def spring_share(self) -> Array:
        """Fraction of :attr:`stiffness` due to the spring of each drive, shape (n,)."""
        return 1.0 - self._commands.feedback[:, 0]

    @property
    def command(self) -> Array:
        """Last commanded displacements, shape (n,); zero before the first command."""
        return self._command.copy()

    def linear(self) -> LinearPlant:
        """Linearize about the present pose, treated as at rest, for the commands of :meth:`step`.

        Raises:
            ModelError: As for :func:`linearize`.
        """
        data = copy.copy(self.data)
        to_axes = self._observed.axes(data).T
        linear = linear_plant(self.model, data, self._payload_frame, to_axes, self.drives)
        commands, k = self._commands, len(linear.A) // 2
        springs = np.array([actuators.spring_of(self.model, data, drive) for drive in self.drives])
        return replace(
            linear,
            B=linear.B @ commands.per_displacement,
            feedback=np.hstack(
                [part[:, None] * linear.C_active[:, :k] for part in commands.feedback.T]
            ),
            holding=self.coil_force_n() / commands.stiffness,
            spring=self.spring_share[:, None] * linear.C_active,
            preload=-springs.prod(axis=1) / commands.stiffness,
        )

    @property
    def implicit_damping(self) -> bool:
        """True if the integrator computes all damper forces from the speeds at the end of a step.

        Euler's method does so for the damping of joints only.
        """
        if self.model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER:
            damped = not self.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
            return bool(damped and not self._commands.feedback[:, 1].any())
        return self.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4

    def coil_force_n(self) -> Array:
        """Return the force of each actuator along its velocity, shape (n,), [N] or [N m]."""
        force = self.data.actuator_force
        return np.array([force.take(d.outputs).dot(d.gear) for d in self.drives])

    def closure_residual_m(self) -> float:
        """Return the largest closure residual [m] of the last physics step; 1 rad counts as 1 m."""
        rows = self.data.efc_pos, self.data.efc_id, self._is_loop
        return lib.largest_gap(*map(pointer, rows), self.data.ne)  # equalities come first

    def observed(self) -> dict[str, Any]:
        """Return arrays of :attr:`data` that compiled code reads to log a tick, by field name."""
        own = {"counts": self._is_loop, "forces": self.data.actuator_force}
        return self._observed.fields(self.data) | own

    def number(self, actuator: int | str) -> int:
        """Return the number 0..n-1 of an actuator given by number or name.

        Raises:
            ValueError: No actuator has it; the message suggests the nearest name.
        """
        if not isinstance(actuator, str):
            return self._index(actuator)
        try:
            return number_of(actuator, names_of(self.drives))
        except ValueError as error:
            raise ValueError(f"actuator must be one of the plant's: {error}") from None

    def _index(self, actuator: int) -> int:
        return check.integer("actuator", actuator, len(self.drives))


def physics_steps(name: str, period_s: float, timestep_s: float) -> int:
    """Return the number of physics steps in a period, a whole number of at most 1e7, or raise."""
    steps = round(check.number(name, period_s, check.SMALLEST) / timestep_s)
    if steps > MOST_STEPS:
        raise ValueError(
            f"{name} must be at most {MOST_STEPS:g} physics steps, here "
            f"{MOST_STEPS * timestep_s:g} s, got {period_s:g} s"
        )
    if steps < 1 or abs(steps * timestep_s - period_s) > 1e-12:
        raise ModelError(
            f"the model's physics step of {timestep_s} s does not divide the period of {period_s} s"
        )
    return steps


def _place(
    model: mujoco.MjModel, data: mujoco.MjData, start: mujoco.MjData, *, at_rest: bool
) -> None:
    """Copy the pose of `start`, which must be closed; with `at_rest` its controls as well."""
    check_state(model, check.instance("start", start, mujoco.MjData))
    data.qpos[:], data.eq_active[:] = start.qpos, start.eq_active
    data.mocap_pos[:], data.mocap_quat[:] = start.mocap_pos, start.mocap_quat
    if at_rest:
        data.act[:], data.ctrl[:] = start.act, start.ctrl
        return
    check_closures(model, data)
    mujoco.mj_fwdPosition(model, data)
    active_closures(model, data).check_closed(model, data, CLOSURE_TOLERANCE)


@dataclass(frozen=True)
class Failure:
    """Failure of one actuator at one time.

    Its text form is NAME:KIND@SECONDS, for example "strut1:locked@1.3"; see :meth:`parse`.

    Attributes:
        actuator: Number 0..n-1, in the order of `plant.drives`, which is that of
            :func:`jacobians`; or the name of the joint, tendon or actuator.
        kind: Kind of failure; see :data:`FailureKind`.
        time_s: Time of the fault onset [s], not negative.
        effectiveness: Remaining fraction of the force of a weak actuator, in 0..1.
    """

    actuator: int | str
    kind: FailureKind
    time_s: float = 0.0
    effectiveness: float = 0.5

    def __post_init__(self) -> None:
        check.choice("kind", self.kind, get_args(FailureKind))
        if not isinstance(self.actuator, str):
            check.integer("actuator", self.actuator)
        check.number("time_s", self.time_s, 0.0)
        check.number("effectiveness", self.effectiveness, 0.0, 1.0)

    def __str__(self) -> str:
        return f"{self.actuator}:{self.kind}@{str(float(self.time_s)).removesuffix('.0')}"

    @classmethod
    def parse(cls, text: str) -> "Failure":
        """Parse NAME:KIND@SECONDS, the text form of a failure; `effectiveness` is the default.

        NAME is the name of a joint, tendon or actuator, or the actuator's number in digits.
        """
        name, _, event = check.instance("text", text, str).rpartition(":")
        kind, _, time_s = event.partition("@")
        is_number = name.isascii() and name.isdecimal() and len(name) < 10  # of 32 bits
        actuator = int(name) if is_number else name
        with suppress(ValueError):  # the message below quotes the whole text
            if name:
                return cls(actuator, cast(FailureKind, kind), float(time_s))
        kinds = get_args(FailureKind)
        near = [] if kind in kinds else get_close_matches(kind, kinds, 1)
        hint = f'; did you mean "{near[0]}"?' if near else ""
        raise ValueError(
            f"text must be NAME:KIND@SECONDS, with KIND one of {', '.join(kinds)} and SECONDS from "
            f"0 on, got {check.short_repr(text)}{hint}"
        )

    @property
    def number(self) -> int:
        """Number of the actuator, 0..n-1; raises TypeError if only its name is given."""
        if isinstance(self.actuator, str):
            raise TypeError(
                f"actuator must be a number here, got {check.short_repr(self.actuator)}"
            )
        return int(self.actuator)

    def inject(self, plant: Plant) -> None:
        """Apply the failure to a plant now; raise ModelError if a lock is missing."""
        actuator = check.instance("plant", plant, Plant).number(self.actuator)
        if self.kind == "weak":
            plant.weaken(actuator, self.effectiveness)
        else:
            events = {"locked": plant.lock, "free": plant.release, "loose": plant.break_loose}
            events[self.kind](actuator)


def failed_plant(model: mujoco.MjModel, failures: Iterable[Failure]) -> Plant:
    """Create a plant at rest at the nominal pose, with failures already applied.

    The model's sites have the default names of :class:`Plant`.
    """
    plant = Plant(model)
    for failure in check.members("failures", failures, Failure):
        failure.inject(plant)
    return plant
