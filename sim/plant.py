"""The plant: MuJoCo physics, struts that can lock or lose force, and the true payload motion."""

import copy
from collections.abc import Sequence
from math import isfinite

import mujoco
import numpy as np
from scipy.linalg.blas import dnrm2, idamax
from scipy.spatial.transform import Rotation

import argument_checks as check
from sim.actuators import actuated_joints, locks_of, reserve_off_group, switch_off
from sim.array import Array
from sim.errors import ModelError, SimulationDiverged
from sim.frame import Body, located
from sim.payload import Payload
from sim.pose import Pose

_LOOPS = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))

_NOT_FINITE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)

_MOST_STEPS = 2**31 - 1
"""MuJoCo counts physics steps in 32 bits."""

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Plant:
    """Simulated plant with private copies of model and data, failures included.

    The nominal pose is `qpos0` of the model. Twists, wrenches and displacements of the payload are
    expressed in the present axes of the base.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        base: str | Body | None = "base",
        payload: str | Body = "payload",
        locks: Sequence[str] | None = None,
    ) -> None:
        """Start at the nominal pose, without failures and without coil current.

        Args:
            model: A model whose actuators are position servos of gear 1, each on a slide or hinge
                joint of its own.
            base: Site, or :class:`Body`, whose axes express twists and displacements; None is the
                world.
            payload: Site, or :class:`Body`, that is the task frame, in any orientation.
            locks: Equality that locks the joint of each actuator, in actuator order; None is
                `lock1`, `lock2`, ..., which :func:`load_model` adds on request.

        Raises:
            ModelError: There is no frame or equality of these names, or one does not lock its joint
                alone; there is no actuator; or an actuator has a gear or no joint of its own.
            ValueError: `locks` has another number of names than the model of actuators.
            TypeError: An argument is of another type.
        """
        check.instance("model", model, mujoco.MjModel)
        # Locks and switched-off coils live in the model, so a shared one would share its failures.
        self.model = copy.copy(model)
        # A diverging run must keep its state to be looked at, whatever the file says.
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        reserve_off_group(self.model)
        self.data = mujoco.MjData(self.model)
        self._joints = actuated_joints(self.model)
        self._strut_qpos = self.model.jnt_qposadr[self._joints]
        self._strut_qpos0 = self.model.qpos0[self._strut_qpos]
        self._locks = locks_of(self.model, self._joints, locks)
        axes = None if base is None else located(self.model, "base", base)
        frame = located(self.model, "payload", payload)
        self._is_loop = np.isin(self.model.eq_type, _LOOPS).astype(float)
        self._warnings = [self.data.warning[kind] for kind in _NOT_FINITE]
        self._last = self.integration_state()
        mujoco.mj_forward(self.model, self.data)
        self._payload = Payload.at_rest(self.data, frame, axes)
        self._gravity = self.model.opt.gravity.copy()

    def step(self, command_m: Array, period_s: float) -> None:
        """Hold the commanded strut displacements (nu,) for one period of physics steps.

        Raises:
            ValueError: The command has a wrong shape or is not finite; or the period is not
                positive, or has more physics steps than MuJoCo counts.
            ModelError: The period is not a whole number of physics steps.
            SimulationDiverged: The state is no longer finite.
        """
        timestep_s = self.model.opt.timestep
        steps = round(check.positive("period_s", period_s) / timestep_s)
        if steps > _MOST_STEPS:
            raise ValueError(f"period_s must be at most {_MOST_STEPS} steps, got {period_s:g} s")
        if steps < 1 or abs(steps * timestep_s - period_s) > 1e-12:
            raise ModelError(
                f"the model's physics step of {timestep_s} s does not divide "
                f"the period of {period_s} s"
            )
        command_m = check.exactly("command_m", command_m, *self._strut_qpos0.shape)
        mujoco.mj_getState(self.model, self.data, self._last, _STATE)
        self.data.ctrl[:] = command_m
        mujoco.mj_step(self.model, self.data, steps)
        if not self._is_finite():
            raise SimulationDiverged(self.data.time, self._last.copy())
        mujoco.mj_kinematics(self.model, self.data)

    def settle(self, seconds: float, command_m: Array | None = None) -> None:
        """Let the machine come to rest at strut displacements (nu,); time starts again at zero.

        None is without current.

        Raises:
            ValueError, ModelError, SimulationDiverged: As :meth:`step`.
        """
        check.positive("seconds", seconds)
        self.step(np.zeros(self.model.nu) if command_m is None else command_m, seconds)
        self.data.time = 0.0

    def lock(self, actuator: int) -> None:
        """Position failure: actuator 0..nu-1 stays where it is, from now on.

        Raises:
            ValueError: No such actuator.
        """
        actuator = check.index("actuator", actuator, self.model.nu)
        lock, qpos = self._locks[actuator], self._strut_qpos[actuator]
        self.model.eq_data[lock, 0] = self.data.qpos[qpos] - self._strut_qpos0[actuator]
        self.data.eq_active[lock] = True

    def release(self, actuator: int) -> None:
        """Torque failure: the coil of actuator 0..nu-1 is switched off, from now on.

        Raises:
            ValueError: No such actuator.
        """
        switch_off(self.model, check.index("actuator", actuator, self.model.nu))

    def weaken(self, actuator: int, effectiveness: float) -> None:
        """The coil of actuator 0..nu-1 gives this part, in 0..1, of the force that it gave.

        Raises:
            ValueError: No such actuator, or no such part.
        """
        actuator = check.index("actuator", actuator, self.model.nu)
        part = check.at_most_one("effectiveness", effectiveness)
        # A position servo takes the force of its error from both.
        self.model.actuator_gainprm[actuator, :3] *= part
        self.model.actuator_biasprm[actuator, :3] *= part

    def break_loose(self, actuator: int) -> None:
        """Release actuator 0..nu-1 and take its suspension spring, and with it its preload, away.

        Raises:
            ValueError: No such actuator.
        """
        self.release(actuator)
        self.model.jnt_stiffness[self._joints[actuator]] = 0.0

    def push(self, wrench: Array) -> None:
        """Push the payload, from now on, with [moment; force] at its site in base axes.

        Moment, force and lever arm stay as they are now, in the world.

        Args:
            wrench: Shape (6,), [N m] and [N].

        Raises:
            ValueError: It has another shape or is not finite.
        """
        wrench = check.exactly("wrench", wrench, 6)
        self.data.xfrc_applied[:] = 0.0
        applied = self._payload.force_at_centre_of_mass(self.data, wrench)
        self.data.xfrc_applied[self._payload.frame.body] = applied

    def shake(self, acceleration: Array) -> None:
        """Accelerate the floor, from now on, without turning it.

        What is seen from the floor: every mass m feels the inertial force -m a beside its weight.

        Args:
            acceleration: Of the base, in base axes, shape (3,), [m]/[s^2].

        Raises:
            ValueError: It has another shape or is not finite.
        """
        acceleration = check.exactly("acceleration", acceleration, 3)
        self.model.opt.gravity[:] = self._gravity - self._payload.axes(self.data) @ acceleration

    def displacement(self) -> Array:
        """Payload displacement [rotation vector; translation] in base axes, shape (6,).

        From the nominal pose, [rad] and [m]; zero there, however base and payload are turned.
        """
        pose = self.pose()
        return np.concatenate([Rotation.from_matrix(pose.rotation).as_rotvec(), pose.translation_m])

    def pose(self) -> Pose:
        """Payload relative to its nominal pose, in base axes: rotation R_now R_nominal^T."""
        return self._payload.pose(self.data)

    def strut_displacement_m(self) -> Array:
        """Extension of each strut from its nominal length, shape (nu,)."""
        return self.data.qpos.take(self._strut_qpos) - self._strut_qpos0

    def constraint_force(self) -> Array:
        """Forces of closures, locks and stops on each velocity, shape (nv,), [N] and [N m]."""
        return self.data.qfrc_constraint.copy()

    def coil_force_n(self) -> Array:
        """Force of each coil, shape (nu,); proportional to its current."""
        return self.data.actuator_force.copy()

    def closure_residual_m(self) -> float:
        """Largest closure residual at the last physics step; a weld's angles count as m/rad."""
        rows = self.data.ne  # equalities come first
        gaps = self.data.efc_pos[:rows] * self._is_loop.take(self.data.efc_id[:rows])
        return abs(float(gaps[idamax(gaps)])) if rows else 0.0

    def integration_state(self) -> Array:
        """The complete state of the integration (mjSTATE_INTEGRATION)."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return state

    def _is_finite(self) -> bool:
        a, b, c = self._warnings
        return not (a.number or b.number or c.number) and isfinite(dnrm2(self.data.qpos))
