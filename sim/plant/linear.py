"""Linear model of a mechanism at rest, its dry friction, and the effects that both omit."""

import copy
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
import scipy.linalg

import argument_checks as check
from sim.array import Array
from sim.closing.equalities import check_closures, closure_rows, constraint_rows, equality_name
from sim.errors import ModelError
from sim.kinematics.task import Task, located_axes, located_task, located_tasks
from sim.mjcf.drive import Drive, drive_rows, drives, force_limits, stiffness_of
from sim.mjcf.joints import mass_of, ranges
from sim.mjcf.limits import at_limits, touching
from sim.mjcf.model import check_state, joint_name, name_of
from sim.mjcf.part import Part

_NO_CLAMP = int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
_UNOBSERVABLE, _NEGLIGIBLE, _MOSTLY = 1e-6, 1e-12, 0.3
"""Relative stiffness and output that count as none; size that counts as zero; fraction of a
motion's largest joint speed at which a joint is listed as moving."""
_REDUNDANT = 1e-9
"""Relative singular value below which constraints are redundant: loops close to 1e-10."""

_CONSTRAINT = mujoco.mjtConstraint
_FRICTION = int(_CONSTRAINT.mjCNSTR_FRICTION_DOF), int(_CONSTRAINT.mjCNSTR_FRICTION_TENDON)
_STIFFNESS = 1 / (0.95 * 0.02) ** 2
"""Stiffness of MuJoCo's default `solref`, 20 ms critically damped, [1/s^2]."""
_SOFT = 0.1
"""Fraction of the default stiffness below which an equality counts as soft."""
_AT = 1e-6
"""Fraction of a force range within which a force counts as being at its limit."""


class Friction(NamedTuple):
    """Dry friction forces f at r places, |f| <= limit, along the velocities s = rows y_dot.

    The forces minimize f'(K + diag(softness)) f / 2 + f'(a + rate s) within their limits, K =
    rows push and a the accelerations along them without friction: MuJoCo's convex model of
    Coulomb's law (Todorov, ICRA 2014, "Convex and analytically-invertible dynamics with contacts
    and constraints"). A sticking place creeps, with a damping of rate / softness.

    Attributes:
        push: Accelerations of the k free coordinates per force, shape (k, r).
        rows: Velocities of the places per y_dot, shape (r, k).
        limit: Largest forces (`frictionloss`), shape (r,), [N] or [N m].
        softness: Regularization, acceleration per force, shape (r,).
        rate: Decay rate of the velocity while sticking, shape (r,), [1/s].
    """

    push: Array
    rows: Array
    limit: Array
    softness: Array
    rate: Array


@dataclass(frozen=True)
class LinearPlant:
    """Linear state-space model x_dot = A x + B u + B_floor a, with x = [y; y_dot].

    y are the k free coordinates on the closed loops, relative to the floor, whose acceleration is
    a; u is `data.ctrl`. Outputs are twist = C_twist x and displacement of actuators = C_active x.
    For :meth:`Plant.linear`, u are the plant's commands; in their units the force of each drive is
    u + holding - feedback x, and that of its spring preload - spring x. Without drive k, A is
    replaced by A + B[:, k] feedback[k], and the machine has the additional acceleration
    -B[:, k] holding[k]; the same holds for a spring. The rotation of that force with the pose is
    neglected: it is of the order of this acceleration per radian.

    Attributes:
        A: State matrix, shape (2k, 2k).
        B: Input matrix, shape (2k, nu), or (2k, n) for commands.
        B_floor: Input matrix of the floor, shape (2k, 3), for a in the axes of the twist.
        C_twist: Displacement [rotation; translation] of the site, shape (6, 2k).
        C_active: Displacements of the actuators, shape (n, 2k).
        feedback: Force per state of each drive, shape (n, 2k); zero for a motor with a spring.
        holding: Force of each drive at x = 0, shape (n,).
        spring: Spring force per state of each drive, shape (n, 2k).
        preload: Spring force of each drive at x = 0, shape (n,).
        friction: Dry friction, which A omits; None if there is none.
        motion: Velocities of the joints per y_dot, shape (nv, k).
        joints: Joint of each of these velocities, by its name or that of its body.
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
        check.lock(self)

    @property
    def unobservable_joints(self) -> tuple[str, ...]:
        """Joints of motions without stiffness that move neither the task nor an actuator.

        An example is the spin of a rod between two ball joints.
        """
        k = len(self.A) // 2
        stiffness = self.A[k:, :k] / max(np.abs(self.A[k:, :k]).max(initial=0.0), 1.0)
        outputs = np.vstack([self.C_twist[:, :k], self.C_active[:, :k]])
        rows = np.vstack([stiffness, outputs / max(np.abs(outputs).max(initial=0.0), _NEGLIGIBLE)])
        return self.moving_joints(scipy.linalg.null_space(rows, rcond=_UNOBSERVABLE))

    def moving_joints(self, y: Array) -> tuple[str, ...]:
        """List the joints that move most in motions y (k, ...), real or complex modes."""
        if self.motion is None:
            return ()
        k, is_mode = len(self.A) // 2, isinstance(y, np.ndarray) and np.iscomplexobj(y)
        parts = [check.array("y", part) for part in ((np.real(y), np.imag(y)) if is_mode else (y,))]
        if parts[0].shape[:1] != (k,):
            raise ValueError(f"y must have shape ({k}, ...), got {parts[0].shape}")
        moved = np.abs(self.motion @ (parts[0] + 1j * parts[-1] if is_mode else parts[0]))
        moved = moved.reshape(len(self.motion), -1)
        most = moved >= _MOSTLY * moved.max(axis=0, initial=0.0)
        moving = np.flatnonzero((most & (moved > 0.0)).any(axis=1))
        return tuple(dict.fromkeys(self.joints[velocity] for velocity in moving))


def linearize(
    model: mujoco.MjModel, data: mujoco.MjData, site: Task = "payload", axes: str | None = "base"
) -> LinearPlant:
    """Return the linear model at rest in `data`, with its locks, disabled actuators and loads.

    Equalities are the only constraints: contacts, joint limits and ranges of controls are left
    out. Dry friction is not linear, and is returned separately from A.

    MuJoCo's unconstrained accelerations, projected on what the loops allow, are differentiated
    along a null-space basis of the active equalities. (Its constrained ones contain 1e-4 of
    the stiffest spring.) Central differences: stepping off a curved constraint by h leaves a
    gap of order h^2, which is the same on both sides and cancels.

    Args:
        model: Any model; the drives of C_active include those that are switched off.
        data: State with closed loops; derived quantities are brought up to date.
        site: Task of six rows, as for :func:`jacobians`.
        axes: Site whose axes express twists; None is the world.

    Raises:
        ModelError: As for :func:`jacobians`; or an actuator has an internal state or a delay.
    """
    check_state(model, data)
    (task,), of_axes = located_tasks(model, [site]), located_axes(model, axes)
    to_axes = np.eye(3) if of_axes is None else of_axes.rotation(data).T
    return linear_plant(model, data, task, to_axes, drives(model, disabled=True))


def linear_plant(
    model: mujoco.MjModel, data: mujoco.MjData, task: Task, to_axes: Array, some: tuple[Drive, ...]
) -> LinearPlant:
    """Linearize for given drives and a rotation (3, 3) from world axes to those of the twist."""
    for k in np.flatnonzero(model.actuator_actnum):
        name = name_of(model.actuator(k))
        raise ModelError(f'actuator "{name}" has an internal state: the linear model has none')
    for k in np.flatnonzero(model.actuator_delay):
        name = name_of(model.actuator(k))
        raise ModelError(f'actuator "{name}" delays its control: the linear model has no delay')
    check_closures(model, data)
    mujoco.mj_fwdPosition(model, data)
    Z = allowed(closure_rows(model, data))
    k = Z.shape[1]
    gravity, model = model.opt.gravity.copy(), copy.copy(model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER  # "discrete" adds to the mass matrix
    probe, controls = mujoco.MjData(model), data.ctrl
    if not model.opt.disableflags & _NO_CLAMP:
        # At the end of a range a central difference would take half of the slope.
        controls = controls.clip(*ranges(model).control.T)
        model.opt.disableflags |= _NO_CLAMP
    mujoco.mj_copyState(model, data, probe, mujoco.mjtState.mjSTATE_USER)
    start = np.concatenate([np.zeros(2 * k), controls, np.zeros(3)])  # y, y_dot, u, a
    steps = np.repeat([1e-6, 1e-4, 1e-6, 1e-2], [k, k, model.nu, 3])

    def acceleration(at: Array) -> Array:
        y, y_dot, u, floor = np.split(at, [k, 2 * k, -3])
        # Relative to an accelerating floor, gravity is reduced by the acceleration.
        model.opt.gravity[:] = gravity - to_axes.T @ floor
        probe.qpos[:] = data.qpos
        mujoco.mj_integratePos(model, probe.qpos, Z @ y, 1.0)
        probe.qvel[:] = Z @ y_dot
        probe.ctrl[:] = u
        mujoco.mj_forward(model, probe)
        basis, mass = allowed(closure_rows(model, probe)), mass_of(model, probe)
        force = basis.T @ (mass @ probe.qacc_smooth)
        return Z.T @ basis @ np.linalg.solve(basis.T @ mass @ basis, force)

    slopes = [
        (acceleration(start + step) - acceleration(start - step)) / (2 * step.sum())
        for step in np.diag(steps)
    ]
    rates = np.vstack([np.eye(k, len(start), k), np.transpose(slopes).reshape(k, len(start))])
    A, B, B_floor = (part.copy() for part in np.split(rates, [2 * k, -3], axis=1))
    acceleration(start)
    jacobian = np.kron(np.eye(2), to_axes) @ located_task(model, task).jacobian(model, data)
    return LinearPlant(
        A=A,
        B=B,
        B_floor=B_floor,
        C_twist=np.hstack([jacobian @ Z, np.zeros((6, k))]),
        C_active=np.hstack([drive_rows(model, data, some) @ Z, np.zeros((len(some), k))]),
        motion=Z,
        joints=tuple(joint_name(model, int(j)) for j in model.dof_jntid),
        friction=friction_of(model, probe, Z, mass_of(model, probe)),
    )


def allowed(J_C: Array) -> Array:
    """Return an orthonormal basis of the velocities that the constraints J_C allow."""
    return scipy.linalg.null_space(J_C, rcond=_REDUNDANT) if len(J_C) else np.eye(J_C.shape[1])


def friction_of(
    model: mujoco.MjModel, data: mujoco.MjData, basis: Array, mass: Array
) -> Friction | None:
    """Return the dry friction in a state that is up to date; None if there is none.

    `basis` (nv, k) has the velocities per free coordinate, `mass` (nv, nv) is the mass matrix.
    """
    indices = np.flatnonzero(np.isin(data.efc_type, _FRICTION) & (data.efc_frictionloss > 0.0))
    rows = constraint_rows(model, data)[indices] @ basis
    moves = rows.any(axis=1)  # places that the closed loops fix have no friction
    indices, rows = indices[moves], rows[moves]
    if not len(indices):
        return None
    return Friction(
        push=np.linalg.solve(basis.T @ mass @ basis, rows.T),
        rows=rows,
        limit=data.efc_frictionloss[indices].copy(),
        softness=data.efc_R[indices].copy(),
        rate=data.efc_KBIP[indices, 1].copy(),
    )


def dry_friction(model: mujoco.MjModel) -> tuple[str, ...]:
    """List the names of joints, then of tendons, that have dry friction."""
    return _names(model, model.dof_frictionloss != 0.0, model.tendon_frictionloss)


def beyond_linear(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[str, ...]:
    """List the nonlinear effects in a model, except contacts and limits, one sentence each.

    Only equalities that are active in `data` are included.
    """
    sentences = []
    if names := dry_friction(model):
        sentences.append(
            f"dry friction of {', '.join(names)}: the prediction includes it, the diagnosis treats "
            "its size as uncertain; the loop design omits it"
        )
    polynomials = model.dof_dampingpoly, model.tendon_dampingpoly, model.actuator_dampingpoly
    damped = _names(model, *(A.any(axis=1) for A in polynomials))
    of_joints = model.jnt_stiffnesspoly.any(axis=1)[model.dof_jntid]
    sprung = _names(model, of_joints, model.tendon_stiffnesspoly.any(axis=1))
    for what, names in (("damping", damped), ("stiffness", sprung)):
        if names:
            sentences.append(
                f"{what} of {', '.join(names)} is not linear: the model uses its slope at the start"
            )
    for k in np.flatnonzero(data.eq_active).tolist():
        if stiffness_of(model, k) * model.eq_solimp[k, 0] < _SOFT * _STIFFNESS:  # at its centre
            sentences.append(
                f"{equality_name(model, k)} is soft and yields like backlash: the model treats it "
                "as rigid"
            )
    if model.opt.density > 0:
        sentences.append(
            f"drag of a medium of density {model.opt.density:g} grows with the square of the speed:"
            " the model omits it"
        )
    return tuple(sentences)


def _names(
    model: mujoco.MjModel, velocities: Array, tendons: Array, actuators: Array | tuple[()] = ()
) -> tuple[str, ...]:
    """Return the names of the joints of velocities, tendons and actuators given by masks."""
    joints = dict.fromkeys(model.dof_jntid[velocities].tolist())
    return (
        *(name_of(model.joint(k)) for k in joints),
        *(name_of(model.tendon(int(k))) for k in np.flatnonzero(tendons)),
        *(name_of(model.actuator(int(k))) for k in np.flatnonzero(actuators)),
    )


class NonlinearityMonitor:
    """Event hook of a :class:`sim.Bench` that records effects which the linear model omits.

    Attributes:
        sentences: Sentences on contacts, joint limits and force limits so far, without repeats.
    """

    def __init__(self, model: mujoco.MjModel, part: Part | None = None) -> None:
        """Take the plant's model and the part of it to monitor; None is the whole model."""
        self.sentences, self._part = dict[str, None](), part
        self._forces = [
            (k, out, drive.name)
            for drive in drives(model, among=None if part is None else part.actuators)
            for k, out in zip(drive.ids, drive.outputs, strict=True)
        ]

    def plant(self, tick: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Record contacts and limits at the end of the previous tick."""
        for a, b in touching(model, data):
            if self._part is None or set(model.body_weldid[[a, b]]) & self._part.bodies:
                one, other = (name_of(model.body(k)) for k in (b, a))
                self._record(f'"{one}" touched "{other}"')
        if data.nl:
            for limit in at_limits(model, data):
                if self._part is None or limit.name not in self._part.left_out:
                    self._record(f'{limit.kind} "{limit.name}" reached its limit')
        for actuator, output, name in self._forces:
            if model.actuator_forcelimited[actuator]:
                low, high = force_limits(model, actuator)
                slack = _AT * (high - low)
                if not low + slack < data.actuator_force[output] < high - slack:
                    self._record(f'the force of "{name}" reached its limit')

    def _record(self, sentence: str) -> None:
        self.sentences.setdefault(sentence)
