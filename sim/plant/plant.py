"""The plant: MuJoCo physics, the true payload motion, and failures of its actuators."""

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
"""Physics steps of one period: some minutes of computing, hours for a large robot."""

_UNINTERRUPTED = 250
"""Physics steps between which Ctrl-C acts: much more than those of a control tick."""

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)

FailureKind = Literal["locked", "free", "loose", "weak"]
"""Stuck where it is; without force; without force and spring; with a part of its force."""


class Plant:
    """Simulated plant with private copies of model and data, failures included.

    Its n actuators are the active velocities of :func:`jacobians`, in that order, and displacements
    (n,) are in [m] or [rad] from the nominal pose. Twists, wrenches and displacements of the
    payload are [angular; linear] in the present axes of the base.

    Attributes:
        drives: What each actuator 0..n-1 moves, and its actuators in the model.
        model: Its own copy.
        data: Its state.
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
                motors with a suspension; see :func:`servoed` for others. To lock, a joint or tendon
                needs an equality that holds it alone: `lock1`, `lock2`, ..., which
                :func:`load_model` adds on request, or any.
            base: Site or body whose axes express twists and displacements; None is the world.
            payload: Site or body that is the task frame, in any orientation.
            start: A state, such as of :func:`assemble`, whose `qpos` is the nominal pose, with the
                equalities that are active and the mocap bodies. Controls then hold the machine
                still against gravity and springs, with actuator forces of least norm; contacts and
                limits do not count. None is `qpos0`, with controls of zero.
            part: What of the model is commanded; `start` is then a state in which the physics has
                come to rest, loops and contacts loaded, with the controls that keep it there, and
                all else goes on with these. None is everything.

        Raises:
            ModelError: There is no frame of these names, or a joint has no lock; there is no
                actuator, or one that no displacement follows from; or nothing holds the machine
                still at `start`, which the message names.
            ClosureError: `start` is not closed.
        """
        check.instance("model", model, mujoco.MjModel)
        if part is not None:
            check.instance("part", part, Part)
        # Locks and switched-off coils live in the model, so a shared one would share its failures.
        self.model = copy.copy(model)
        # A diverging run must keep its state to be looked at, whatever the file says.
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        actuators.reserve_off_group(self.model)
        self._sound = {name: getattr(self.model, name).copy() for name in actuators.STRENGTHS}
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
            self._is_loop[list(part.apart)] = 0.0
        if start is not None:
            _place(self.model, self.data, start, at_rest=part is not None)
        actuators.enable_locks(self.model, self.data)
        self._last = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        self._command = np.zeros(len(self.drives))
        mujoco.mj_forward(self.model, self.data)
        held = None if part is None else self.data.actuator_force.copy()
        if start is not None and part is None:
            held, falls, why = actuators.balance(self.model, self.data, self.drives)
            if falls is not None:
                raise ModelError(why)
        self._commands = actuators.commands_of(self.model, self.data, self.drives, held)
        if start is not None:
            if beyond := actuators.beyond_ranges(self.model, self.drives, self._commands):
                raise ModelError(beyond)
            self._commands = self._commands.beside(start.ctrl)
            self.data.ctrl[:] = self._commands.at_rest
            mujoco.mj_forward(self.model, self.data)
        self._observed = Observed(self.model, self.data, self.drives, frame, axes)
        self._observer = Observer(self._observed, self.data)
        self._limits = actuators.rest_limits(self.model, self.data, self.drives, self._commands)
        self._gravity, self._held = self.model.opt.gravity.copy(), self.data.eq_active.copy()

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the views of :attr:`data`, which a copy has of its own."""
        return {name: value for name, value in vars(self).items() if name != "_observer"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _observer=Observer(state["_observed"], state["data"]))

    def step(self, command_m: Array, period_s: float) -> None:
        """Hold the commanded displacements (n,) for one period of physics steps.

        Each control is that of the nominal pose plus what would hold the drive alone at its
        displacement, against its servo's feedback and the spring of its joint or tendon.

        Raises:
            ValueError: The period has more than 1e7 physics steps.
            ModelError: The period is not a whole number of physics steps.
            SimulationDiverged: The state is no longer finite.
        """
        steps = physics_steps("period_s", period_s, self.model.opt.timestep)
        self.hold(check.array("command_m", command_m, len(self.drives)), steps)

    def hold(self, command_m: Array, steps: int) -> None:
        """Hold checked displacements for a number of physics steps; Ctrl-C ends it soon."""
        model, data = self.model, self.data
        mujoco.mj_getState(model, data, self._last, _STATE)
        self._command[:] = controls = command_m
        if not (commands := self._commands).are_displacements:
            controls = commands.at_rest + commands.per_displacement.dot(command_m)
        data.ctrl[:] = controls
        for done in range(0, steps, _UNINTERRUPTED):
            mujoco.mj_step(model, data, min(steps - done, _UNINTERRUPTED))
            if has_diverged(data):
                huge = "was given controls beyond 1e+10, which MuJoCo takes for zeros"
                why = (huge,) if data.warning[BAD_CONTROL].number else ()
                raise SimulationDiverged(data.time, self._last.copy(), *why)
        mujoco.mj_kinematics(model, data)
        self._observed.refresh(model, data)

    def settle(self, seconds: float, command_m: Array | None = None) -> None:
        """Let the machine come to rest at displacements (n,), None is zero; time starts anew."""
        steps = physics_steps("seconds", seconds, self.model.opt.timestep)
        n = len(self.drives)
        at_m = np.zeros(n) if command_m is None else check.array("command_m", command_m, n)
        self.hold(at_m, steps)
        self.data.time = 0.0

    def lock(self, actuator: int) -> None:
        """Lock actuator 0..n-1 where it is: a position failure; a ModelError if it has no lock."""
        k = self.check_lock(actuator)
        actuators.activate_lock(self.model, self.data, self.drives[k], self._locks[k])

    def check_lock(self, actuator: int) -> int:
        """The actuator 0..n-1 itself; a ModelError if it cannot lock."""
        if self._locks[k := self._index(actuator)] < 0:
            raise actuators.no_lock(self.model, self.drives[k])
        return k

    @property
    def soft_locks(self) -> dict[int, str]:
        """How far, and why, locks would give way at the present pose, by number of the drive."""
        each = enumerate(zip(self.drives, self._locks, self._commands.stiffness, strict=True))
        found = {k: actuators.yields(self.model, self.data, *one) for k, one in each}
        return {k: said for k, said in found.items() if said is not None}

    def release(self, actuator: int) -> None:
        """Switch actuator 0..n-1 off: a torque failure."""
        actuators.switch_off(self.model, self.drives[self._index(actuator)])

    def weaken(self, actuator: int, effectiveness: float) -> None:
        """Leave actuator 0..n-1 this part, in 0..1, of its force."""
        ids = list(self.drives[self._index(actuator)].ids)
        part = check.number("effectiveness", effectiveness, 0.0, 1.0)
        # A position servo takes the force of its error from both.
        self.model.actuator_gainprm[ids, :3] *= part
        self.model.actuator_biasprm[ids, :3] *= part

    def break_loose(self, actuator: int) -> None:
        """Release actuator 0..n-1 and take its suspension spring, and with it its preload, away."""
        self.release(actuator)
        drive = self.drives[self._index(actuator)]
        if drive.joint is not None:
            self.model.jnt_stiffness[drive.joint] = 0.0
        elif drive.tendon is not None:
            self.model.tendon_stiffness[drive.tendon] = 0.0

    def repair(self, actuator: int) -> None:
        """Let actuator 0..n-1 work from now on as it did when the plant was made."""
        k = self._index(actuator)
        if (lock := self._locks[k]) >= 0:
            self.data.eq_active[lock] = self._held[lock]
            self.model.eq_data[lock] = self._sound["eq_data"][lock]
        actuators.restore(self.model, self.drives[k], self._sound)

    def push(self, wrench: Array) -> None:
        """Push the payload, from now on, with a wrench (6,), [N m] and [N], at its site.

        Moment, force and lever arm stay as they are now, in the world.
        """
        wrench = check.array("wrench", wrench, 6)
        self.data.xfrc_applied[:] = 0.0
        applied = self._observed.force_at_centre_of_mass(self.data, wrench)
        self.data.xfrc_applied[self._observed.frame.body] = applied

    def load(self, force: Array) -> None:
        """Push along each actuator's velocity, from now on, by (n,), [N] or [N m], as friction."""
        force = check.array("force", force, len(self.drives))
        if self._velocities is None:
            rows = drive_rows(self.model, self.data, self.drives)
            self.data.qfrc_applied[:] = rows.T.dot(force)
        else:
            self.data.qfrc_applied[:] = 0.0
            self.data.qfrc_applied[self._velocities] = force

    def shake(self, acceleration: Array) -> None:
        """Accelerate the floor, from now on, by (3,) in base axes, [m]/[s^2], without turning it.

        What is seen from the floor: every mass m feels the inertial force -m a beside its weight.
        """
        acceleration = check.array("acceleration", acceleration, 3)
        self.model.opt.gravity[:] = self._gravity - self._observed.axes(self.data) @ acceleration

    def displacement(self) -> Array:
        """Payload displacement [rotation vector; translation] from the nominal pose, shape (6,)."""
        return self.pose().displacement()

    def pose(self) -> Pose:
        """Payload relative to its nominal pose, in base axes: rotation R_now R_nominal^T."""
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
        """Displacement (n,) of each joint, length of tendon or crank, or what a servo feels."""
        return self._observer.read()[1].copy()

    def limits(self) -> tuple[Array, Array]:
        """Lower and upper displacements, (n,) each, at which healthy actuators can rest.

        Within the ranges of joint or tendon, control, and the force that the spring takes; infinite
        where there are none. The change of the weight's pull is neglected.
        """
        lower, upper = self._limits
        return lower.copy(), upper.copy()

    @property
    def stiffness(self) -> Array:
        """Force of each actuator per displacement commanded while it is held, shape (n,)."""
        return self._commands.stiffness.copy()

    @property
    def spring_share(self) -> Array:
        """Part of :attr:`stiffness` that the own spring of each drive gives, shape (n,)."""
        return 1.0 - self._commands.feedback[:, 0]

    @property
    def command(self) -> Array:
        """Displacements (n,) last commanded; zero before the first."""
        return self._command.copy()

    def linear(self) -> LinearPlant:
        """Linearize about the present pose, taken as a rest, for the commands of :meth:`step`.

        Raises:
            ModelError: As :func:`linearize`.
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
        """Whether the integrator takes the forces of all dampers with the speeds at a step's end.

        Euler's method does so with the damping of joints alone.
        """
        if self.model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER:
            damped = not self.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
            return bool(damped and not self._commands.feedback[:, 1].any())
        return self.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4

    def coil_force_n(self) -> Array:
        """Force of each actuator along its velocity, shape (n,), [N] or [N m]."""
        force = self.data.actuator_force
        return np.array([force.take(d.outputs).dot(d.gear) for d in self.drives])

    def closure_residual_m(self) -> float:
        """Largest closure residual at the last physics step; a weld's angles count as m/rad."""
        rows = self.data.efc_pos, self.data.efc_id, self._is_loop
        return lib.largest_gap(*map(pointer, rows), self.data.ne)  # equalities come first

    def observed(self) -> dict[str, Any]:
        """Arrays of :attr:`data` that the compiled code reads to log a tick, by its names."""
        own = {"counts": self._is_loop, "forces": self.data.actuator_force}
        return self._observed.fields(self.data) | own

    def number(self, actuator: int | str) -> int:
        """The number 0..n-1 of a drive, given by it or by a name.

        Raises:
            ValueError: There is none; the message has the nearest name.
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
    """Count the physics steps in a period, an argument of this name.

    Raises:
        ValueError: It has too many.
        ModelError: It is not a whole number of them.
    """
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
    """Put a new state into the pose of another one, which must be closed, or at rest."""
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
    """One actuator fails at one time.

    As text it is NAME:KIND@SECONDS, such as "strut1:locked@1.3", which :meth:`parse` reads.

    Attributes:
        actuator: 0..n-1, in the order of `plant.drives`, which is that of :func:`jacobians`; or the
            name of its joint, tendon or actuator.
        kind: See :data:`FailureKind`.
        time_s: When, not before 0.
        effectiveness: Part of the force that a weak one has left, in 0..1.
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
        """Parse NAME:KIND@SECONDS, as `str` writes a failure; a weak one has the default part.

        NAME is that of a joint, tendon or actuator, or the number of the actuator in digits.
        """
        name, _, rest = check.instance("text", text, str).rpartition(":")
        kind, _, time_s = rest.partition("@")
        is_number = name.isascii() and name.isdecimal() and len(name) < 10  # of 32 bits
        actuator = int(name) if is_number else name
        with suppress(ValueError):  # what is said below is of the whole text
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
        """The actuator, 0..n-1."""
        if isinstance(self.actuator, str):
            raise TypeError(
                f"actuator must be a number here, got {check.short_repr(self.actuator)}"
            )
        return int(self.actuator)

    def strike(self, plant: Plant) -> None:
        """Apply the failure now; a ModelError if the actuator is to lock and has no lock."""
        actuator = check.instance("plant", plant, Plant).number(self.actuator)
        if self.kind == "weak":
            plant.weaken(actuator, self.effectiveness)
        else:
            events = {"locked": plant.lock, "free": plant.release, "loose": plant.break_loose}
            events[self.kind](actuator)


def failed_plant(model: mujoco.MjModel, failures: Iterable[Failure]) -> Plant:
    """Make a plant at rest at the nominal pose, with failures already applied.

    Sites have the names that :class:`Plant` expects by default.
    """
    plant = Plant(model)
    for failure in check.members("failures", failures, Failure):
        failure.strike(plant)
    return plant
