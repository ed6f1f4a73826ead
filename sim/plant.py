"""The plant: MuJoCo physics, struts that can lock or lose force, and the true payload motion."""

import copy
from math import isfinite

import mujoco
import numpy as np
from scipy.linalg.blas import dnrm2, idamax
from scipy.spatial.transform import Rotation

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError, SimulationDiverged
from sim.model import element_id
from sim.pose import Pose, computed
from sim.transmission import actuated_velocities

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

    Actuator k of the model drives strut k + 1; equality `lock{k + 1}` locks it.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Start at the nominal pose, without failures and without coil current.

        Raises:
            ModelError: The model lacks the site `base` or `payload`, or a lock of its own for
                every actuated joint; or an actuator has a gear, so that its control is no
                displacement of its joint.
            TypeError: `model` is of another type.
        """
        check.instance("model", model, mujoco.MjModel)
        # Locks and switched-off coils live in the model, so a shared one would share its failures.
        self.model = copy.copy(model)
        # A diverging run must keep its state to be looked at, whatever the file says.
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.data = mujoco.MjData(self.model)
        actuated_velocities(self.model)  # refuses what is not one actuator on one joint
        _refuse_gears(self.model)
        self._strut_qpos = self.model.jnt_qposadr[self.model.actuator_trnid[:, 0]]
        self._strut_qpos0 = self.model.qpos0[self._strut_qpos]
        self._locks = [_lock_of(self.model, k) for k in range(model.nu)]
        self._base = element_id(self.model, "site", "base")
        self._payload = element_id(self.model, "site", "payload")
        self._is_loop = np.isin(self.model.eq_type, _LOOPS).astype(float)
        self._warnings = [self.data.warning[kind] for kind in _NOT_FINITE]
        self._last = self.integration_state()
        mujoco.mj_forward(self.model, self.data)
        self._origin = self.data.site_xpos[self._payload].copy()
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
            ModelError: Its actuator shares a group with another.
        """
        actuator = check.index("actuator", actuator, self.model.nu)
        group = int(self.model.actuator_group[actuator])
        if np.count_nonzero(self.model.actuator_group == group) > 1:
            name = self.model.actuator(actuator).name
            raise ModelError(f'actuator "{name}" shares group {group} with another')
        self.model.opt.disableactuator |= 1 << group

    def weaken(self, actuator: int, effectiveness: float) -> None:
        """The coil of actuator 0..nu-1 gives this part, in 0..1, of the force that it gave.

        Raises:
            ValueError: No such actuator, or no such part.
        """
        actuator = check.index("actuator", actuator, self.model.nu)
        self.model.actuator_gainprm[actuator, 0] *= check.at_most_one(
            "effectiveness", effectiveness
        )

    def break_loose(self, actuator: int) -> None:
        """Release actuator 0..nu-1 and take its suspension spring, and with it its preload, away.

        Raises:
            ValueError, ModelError: As :meth:`release`.
        """
        self.release(actuator)
        self.model.jnt_stiffness[self.model.actuator_trnid[actuator, 0]] = 0.0

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
        body = self.model.site_bodyid[self._payload]
        to_world = self.data.site_xmat[self._base].reshape(3, 3)
        moment, force = to_world @ wrench[:3], to_world @ wrench[3:]
        # MuJoCo takes the wrench at the centre of mass, force first.
        arm = self.data.site_xpos[self._payload] - self.data.xipos[body]
        self.data.xfrc_applied[body] = [*force, *(moment + np.cross(arm, force))]

    def shake(self, acceleration: Array) -> None:
        """Accelerate the floor, from now on, without turning it.

        What is seen from the floor: every mass m feels the inertial force -m a beside its weight.

        Args:
            acceleration: Of the base, in base axes, shape (3,), [m]/[s^2].

        Raises:
            ValueError: It has another shape or is not finite.
        """
        acceleration = check.exactly("acceleration", acceleration, 3)
        to_world = self.data.site_xmat[self._base].reshape(3, 3)
        self.model.opt.gravity[:] = self._gravity - to_world @ acceleration

    def displacement(self) -> Array:
        """Payload displacement [rotation vector; translation] in base axes, shape (6,)."""
        pose = self.pose()
        return np.concatenate([Rotation.from_matrix(pose.rotation).as_rotvec(), pose.translation_m])

    def pose(self) -> Pose:
        """Payload in base axes, relative to the nominal pose."""
        to_base = self.data.site_xmat[self._base].reshape(3, 3).T
        rotation = to_base.dot(self.data.site_xmat[self._payload].reshape(3, 3))
        shift = self.data.site_xpos[self._payload] - self._origin
        return computed(Pose, rotation=rotation, translation_m=to_base.dot(shift))

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


def _refuse_gears(model: mujoco.MjModel) -> None:
    """Its spring turns a coil's force into the displacement commanded; a gear would scale it."""
    for k in np.flatnonzero(model.actuator_gear[:, 0] != 1.0):
        name, gear = model.actuator(k).name, model.actuator_gear[k, 0]
        raise ModelError(
            f'actuator "{name}" must have gear 1, its control being a displacement; got {gear:g}'
        )


def _lock_of(model: mujoco.MjModel, actuator: int) -> int:
    """Equality `lock{k + 1}`, which must hold the joint of actuator k and no other."""
    lock = element_id(model, "equality", f"lock{actuator + 1}")
    joint = int(model.actuator_trnid[actuator, 0])
    holds = (int(model.eq_type[lock]), int(model.eq_obj1id[lock]), int(model.eq_obj2id[lock]))
    if holds != (int(mujoco.mjtEq.mjEQ_JOINT), joint, -1):
        raise ModelError(
            f'equality "lock{actuator + 1}" must lock the joint "{model.joint(joint).name}" alone'
        )
    return lock
