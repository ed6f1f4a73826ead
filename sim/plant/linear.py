"""Linear model of a mechanism about its present equilibrium."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
import scipy.linalg

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import check_closures, closure_rows
from sim.errors import ModelError
from sim.kinematics.task import Task, task_jacobian, task_list, to_axes_of
from sim.mjcf.drive import Drive
from sim.mjcf.dynamics import mass_of
from sim.mjcf.model import check_state, joint_name, name_of
from sim.mjcf.transmission import drive_rows, drives
from sim.plant.friction import Friction, friction_of

_POSITION_STEP = 1e-6
_VELOCITY_STEP = 1e-4
_FLOOR_STEP = 1e-2
_NO_CLAMP = int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
_ANY = (-np.inf, np.inf)
_IDLE, _NOTHING, _MOSTLY = 1e-6, 1e-12, 0.3
"""Part of the stiffness and of the outputs below which a motion has none, a size that is none, and
part of the largest speed of a joint from which on it is named."""
_REDUNDANT = 1e-9
"""Part of the constraints below which they repeat one another: loops are closed to 1e-10."""


@dataclass(frozen=True)
class LinearPlant:
    """x_dot = A x + B u + B_floor a; twist = C_twist x, displacement of actuators = C_active x.

    x = [y; y_dot] with y the k free coordinates on the closed loops; u as `data.ctrl`, or, of a
    :meth:`Plant.linear`, its commands; a the acceleration of the floor, which all of x is measured
    from.

    Attributes:
        A: Shape (2k, 2k).
        B: Shape (2k, nu), or (2k, n) for commands.
        B_floor: Shape (2k, 3), for a in the axes of the twist.
        C_twist: Displacement [rotation; translation] of the site, shape (6, 2k).
        C_active: Displacement of each drive, shape (n, 2k).
        feedback: Of a :meth:`Plant.linear`, what the force of each drive feeds back, shape (n, 2k),
            in units of its commands: the force is proportional to u + holding - feedback x. Zero of
            a motor against a spring. Without drive k, A + B[:, k] feedback[k] takes the place of A.
        holding: Of the same, the force of each drive at x = 0 and u = 0, shape (n,). Without drive
            k, the machine accelerates by -B[:, k] holding[k] besides. How the direction of that
            force turns with the pose is left out: of the order of this acceleration per radian.
        spring: Of the same, what the own spring of each drive takes, shape (n, 2k), in units of its
            commands: without it A + B[:, k] spring[k] takes the place of A.
        preload: Of the same, the force of that spring at x = 0, shape (n,).
        friction: Dry friction, which A leaves out; None where nothing rubs.
        motion: Velocities of the joints per y_dot, shape (nv, k).
        joints: Of each of these velocities the joint, by name, or by its body where it has none.
    """

    A: Array
    B: Array
    B_floor: Array
    C_twist: Array
    C_active: Array
    feedback: Array | None = None
    holding: Array | None = None
    spring: Array | None = None
    preload: Array | None = None
    friction: Friction | None = None
    motion: Array | None = None
    joints: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        check.lock(self)

    def named(self, y: Array) -> tuple[str, ...]:
        """The joints that mostly move in some motions y (k, ...), real or complex, in their order.

        Raises:
            ValueError: Motions of another shape, or not finite.
        """
        if self.motion is None:
            return ()
        if isinstance(y, np.ndarray) and np.iscomplexobj(y):  # modes are
            y = check.real("y", np.real(y)) + 1j * check.real("y", np.imag(y))
        else:
            y = check.real("y", y)
        if y.shape[:1] != self.motion.shape[1:]:
            raise ValueError(
                f"y must have shape (k, ...) with k = {self.motion.shape[1]}, got {y.shape}"
            )
        moved = np.abs(self.motion @ y).reshape(len(self.joints), -1)
        most = moved >= _MOSTLY * moved.max(axis=0, initial=0.0)
        moving = (most & (moved > 0.0)).any(axis=1)
        return tuple(dict.fromkeys(n for n, m in zip(self.joints, moving, strict=True) if m))

    @property
    def idle(self) -> tuple[str, ...]:
        """Joints that nothing holds and that move neither the task nor an actuator.

        So spins a rod between two ball joints.
        """
        k = len(self.A) // 2
        held = self.A[k:, :k] / max(np.abs(self.A[k:, :k]).max(initial=0.0), 1.0)
        outputs = np.vstack([self.C_twist[:, :k], self.C_active[:, :k]])
        rows = np.vstack([held, outputs / max(np.abs(outputs).max(initial=0.0), _NOTHING)])
        return self.named(scipy.linalg.null_space(rows, rcond=_IDLE))


def linearize(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    site: Task = "payload",
    axes: str | None = "base",
) -> LinearPlant:
    """Linearize at `data`, which must be at rest; locks, switched-off coils and pushes count.

    Equalities are all that constrains: contacts and limits, a strut on its stop, are left out; so
    are ranges of controls. Dry friction is not linear, and stands beside A.

    The velocities are reduced to a null-space basis of the active equalities, and MuJoCo's own
    unconstrained accelerations, projected on what the loops allow, differentiated along it. (Its
    constrained ones let 1e-4 of the stiffest spring through, the constraints' softness: as much as
    the flexures of a strut without its spring.) Central differences: stepping off a curved
    constraint by h leaves a gap of order h^2, which is the same on both sides and cancels.

    Args:
        model: Any model; the drives of C_active include those that are switched off.
        data: Its state, closed; derived quantities are brought up to date.
        site: A task of six rows, as for :func:`jacobians`.
        axes: Site whose axes express twists; None is the world.

    Raises:
        ModelError: As :func:`jacobians`; or an actuator with a state of its own, or a delay.
        ValueError, TypeError: As :func:`jacobians`.
    """
    check_state(model, data)
    (task,) = task_list(model, [site])
    of_model = drives(model, disabled=True)
    return linear_plant(model, data, task, to_axes_of(model, data, axes), of_model)


def linear_plant(
    model: mujoco.MjModel, data: mujoco.MjData, task: Task, to_axes: Array, some: tuple[Drive, ...]
) -> LinearPlant:
    """The same of drives that are known, for a rotation (3, 3) from world axes to others."""
    for k in np.flatnonzero(model.actuator_actnum):
        called = name_of(model.actuator(k))
        raise ModelError(
            f'an actuator has a state of its own, "{called}": only those without one are linear'
        )
    for k in np.flatnonzero(model.actuator_delay):
        raise ModelError(f"actuator number {k} delays its control, which a linear model does not")
    check_closures(model, data)
    mujoco.mj_fwdPosition(model, data)
    Z = allowed(closure_rows(model, data))
    k = Z.shape[1]
    gravity, model = model.opt.gravity.copy(), copy.copy(model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER  # "discrete" adds to the mass matrix
    control = _clamped(model, data)
    probe = mujoco.MjData(model)
    probe.eq_active[:] = data.eq_active
    probe.mocap_pos[:], probe.mocap_quat[:] = data.mocap_pos, data.mocap_quat
    probe.xfrc_applied[:], probe.qfrc_applied[:] = data.xfrc_applied, data.qfrc_applied

    def acceleration(y: Array, y_dot: Array, u: Array, floor: Array) -> Array:
        # Seen from a floor that accelerates, every mass weighs by so much less.
        model.opt.gravity[:] = gravity - to_axes.T @ floor
        probe.qpos[:] = data.qpos
        mujoco.mj_integratePos(model, probe.qpos, Z @ y, 1.0)
        probe.qvel[:] = Z @ y_dot
        probe.ctrl[:] = u
        mujoco.mj_forward(model, probe)
        ways, mass = allowed(closure_rows(model, probe)), mass_of(model, probe)
        force = ways.T @ (mass @ probe.qacc_smooth)
        return Z.T @ ways @ np.linalg.solve(ways.T @ mass @ ways, force)

    def gradient(argument: int, size: int, step: float) -> Array:
        columns = []
        for e in np.eye(size) * step:
            ahead = [np.zeros(k), np.zeros(k), control.copy(), np.zeros(3)]
            behind = [part.copy() for part in ahead]
            ahead[argument] += e
            behind[argument] -= e
            columns.append((acceleration(*ahead) - acceleration(*behind)) / (2 * step))
        return np.array(columns).T.reshape(k, size)

    zero = np.zeros((k, k))
    stiffness = gradient(0, k, _POSITION_STEP)
    damping = gradient(1, k, _VELOCITY_STEP)
    drive = gradient(2, model.nu, _POSITION_STEP)
    floor = gradient(3, 3, _FLOOR_STEP)
    acceleration(np.zeros(k), np.zeros(k), control, np.zeros(3))
    return LinearPlant(
        A=np.block([[zero, np.eye(k)], [stiffness, damping]]),
        B=np.vstack([np.zeros((k, model.nu)), drive]),
        B_floor=np.vstack([np.zeros((k, 3)), floor]),
        C_twist=np.hstack(
            [np.kron(np.eye(2), to_axes) @ task_jacobian(model, data, task) @ Z, np.zeros((6, k))]
        ),
        C_active=np.hstack([drive_rows(model, data, some) @ Z, np.zeros((len(some), k))]),
        motion=Z,
        joints=tuple(joint_name(model, int(j)) for j in model.dof_jntid),
        friction=friction_of(model, probe, Z, mass_of(model, probe)),
    )


def _clamped(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """The controls (nu,) within their ranges, which the model, a copy, then no longer has.

    At the end of a range a central difference would take half of the slope.
    """
    low, high = np.where(model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, _ANY).T
    if model.opt.disableflags & _NO_CLAMP:
        return data.ctrl.copy()
    model.opt.disableflags |= _NO_CLAMP
    return data.ctrl.clip(low, high)


def allowed(J_C: Array) -> Array:
    """Orthonormal basis of the velocities that the constraints allow."""
    return scipy.linalg.null_space(J_C, rcond=_REDUNDANT) if len(J_C) else np.eye(J_C.shape[1])
