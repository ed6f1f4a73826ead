"""Linear model of a mechanism at rest, dry friction beside it, and what both leave out."""

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
"""Part of the stiffness and of the outputs below which a motion has none, a size that is none, and
part of the largest speed of a joint from which on it is named."""
_REDUNDANT = 1e-9
"""Part of the constraints below which they repeat one another: loops are closed to 1e-10."""

_FRICTION = (
    int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF),
    int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON),
)
_STIFFNESS = 1 / (0.95 * 0.02) ** 2
"""Of MuJoCo's default `solref`, 20 ms critically damped, [1/s^2]."""
_SOFT = 0.1
"""Part of it below which an equality counts as soft."""
_AT = 1e-6
"""Part of a force range within which a force stands at its end."""


class Friction(NamedTuple):
    """Dry friction at r places, each a force f with |f| <= limit along a velocity s = rows y_dot.

    The forces minimize f'(K + diag(softness)) f / 2 + f'(a + rate s) within their limits, K =
    rows push and a the accelerations of the places without friction: MuJoCo's convex model of
    Coulomb's law (Todorov, ICRA 2014, "Convex and analytically-invertible dynamics with contacts
    and constraints"). Where a place sticks it creeps, with a damping of rate / softness.

    Attributes:
        push: Accelerations of the k free coordinates per force, shape (k, r).
        rows: Shape (r, k).
        limit: `frictionloss`, shape (r,), [N] or [N m].
        softness: Acceleration per force, shape (r,).
        rate: Shape (r,), [1/s].
    """

    push: Array
    rows: Array
    limit: Array
    softness: Array
    rate: Array


@dataclass(frozen=True)
class LinearPlant:
    """x_dot = A x + B u + B_floor a; twist = C_twist x, displacement of actuators = C_active x.

    x = [y; y_dot] with y the k free coordinates on the closed loops, measured from the floor, whose
    acceleration is a; u as `data.ctrl`. Of a :meth:`Plant.linear` u are its commands, and in their
    units the force of each drive is u + holding - feedback x, that of its own spring preload -
    spring x. Without drive k, A + B[:, k] feedback[k] takes the place of A, and the machine
    accelerates by -B[:, k] holding[k] besides; so with a spring. How the direction of that force
    turns with the pose is left out: of the order of this acceleration per radian.

    Attributes:
        A: Shape (2k, 2k).
        B: Shape (2k, nu), or (2k, n) for commands.
        B_floor: Shape (2k, 3), for a in the axes of the twist.
        C_twist: Displacement [rotation; translation] of the site, shape (6, 2k).
        C_active: Shape (n, 2k).
        feedback: Shape (n, 2k); zero of a motor against a spring.
        holding: Shape (n,).
        spring: Shape (n, 2k).
        preload: Shape (n,).
        friction: Dry friction, which A leaves out; None where there is none.
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
        check.lock(self)

    @property
    def unobservable_joints(self) -> tuple[str, ...]:
        """Joints that nothing holds and that move neither the task nor an actuator.

        So spins a rod between two ball joints.
        """
        k = len(self.A) // 2
        stiffness = self.A[k:, :k] / max(np.abs(self.A[k:, :k]).max(initial=0.0), 1.0)
        outputs = np.vstack([self.C_twist[:, :k], self.C_active[:, :k]])
        rows = np.vstack([stiffness, outputs / max(np.abs(outputs).max(initial=0.0), _NEGLIGIBLE)])
        return self.moving_joints(scipy.linalg.null_space(rows, rcond=_UNOBSERVABLE))

    def moving_joints(self, y: Array) -> tuple[str, ...]:
        """Joints that mostly move in motions y (k, ...), real or complex modes, in their order."""
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
    model: mujoco.MjModel,
    data: mujoco.MjData,
    site: Task = "payload",
    axes: str | None = "base",
) -> LinearPlant:
    """Linearize at `data`, which must be at rest; locks, switched-off coils and pushes count.

    Equalities are all that constrains: contacts and limits, a strut on its stop, are left out; so
    are ranges of controls. Dry friction is not linear, and stands beside A.

    MuJoCo's unconstrained accelerations, projected on what the loops allow, are differentiated
    along a null-space basis of the active equalities. (Its constrained ones let 1e-4 of the
    stiffest spring through.) Central differences: stepping off a curved constraint by h leaves a
    gap of order h^2, which is the same on both sides and cancels.

    Args:
        model: Any model; the drives of C_active include those that are switched off.
        data: Its state, closed; derived quantities are brought up to date.
        site: A task of six rows, as for :func:`jacobians`.
        axes: Site whose axes express twists; None is the world.

    Raises:
        ModelError: As :func:`jacobians`; or an actuator with a state of its own, or a delay.
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
        called = f'an actuator has a state of its own, "{name_of(model.actuator(k))}"'
        raise ModelError(f"{called}: only those without one are linear")
    for k in np.flatnonzero(model.actuator_delay):
        raise ModelError(f"actuator number {k} delays its control, which a linear model does not")
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
        # Seen from a floor that accelerates, every mass weighs by so much less.
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
    """Orthonormal basis of the velocities that the constraints allow."""
    return scipy.linalg.null_space(J_C, rcond=_REDUNDANT) if len(J_C) else np.eye(J_C.shape[1])


def friction_of(
    model: mujoco.MjModel, data: mujoco.MjData, basis: Array, mass: Array
) -> Friction | None:
    """Dry friction of a state that is up to date; None where nothing rubs.

    `ways` (nv, k) are velocities per free coordinate, `mass` (nv, nv) is the mass matrix.
    """
    indices = np.flatnonzero(np.isin(data.efc_type, _FRICTION) & (data.efc_frictionloss > 0.0))
    rows = constraint_rows(model, data)[indices] @ basis
    moves = rows.any(axis=1)  # what the closed loops hold does not rub
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
    """Names of the joints, then of the tendons, that have some."""
    return _names(model, model.dof_frictionloss != 0.0, model.tendon_frictionloss)


def beyond_linear(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[str, ...]:
    """Say in a sentence each what a file states that is not linear, besides contacts and limits.

    `data` says which of its equalities are active.
    """
    sentences = []
    if names := dry_friction(model):
        sentences.append(
            f"dry friction of {', '.join(names)}: the prediction includes it, the diagnosis takes "
            "its size as uncertain; the design of the loops leaves it out"
        )
    polynomials = model.dof_dampingpoly, model.tendon_dampingpoly, model.actuator_dampingpoly
    damped = _names(model, *(A.any(axis=1) for A in polynomials))
    of_joints = model.jnt_stiffnesspoly.any(axis=1)[model.dof_jntid]
    sprung = _names(model, of_joints, model.tendon_stiffnesspoly.any(axis=1))
    for what, names in (("damping", damped), ("stiffness", sprung)):
        if names:
            sentences.append(
                f"{what} of {', '.join(names)} is not linear: the model has its slope at the start"
            )
    for k in np.flatnonzero(data.eq_active).tolist():
        if stiffness_of(model, k) * model.eq_solimp[k, 0] < _SOFT * _STIFFNESS:  # at its centre
            sentences.append(
                f"{equality_name(model, k)} is soft and gives like backlash: the model has it rigid"
            )
    if model.opt.density > 0:
        sentences.append(
            f"drag of a medium of density {model.opt.density:g} grows with the square of the speed:"
            " the model leaves it out"
        )
    return tuple(sentences)


def _names(
    model: mujoco.MjModel, velocities: Array, tendons: Array, actuators: Array | tuple[()] = ()
) -> tuple[str, ...]:
    """Names of the joints of some velocities, of some tendons and actuators, all given as masks."""
    joints = dict.fromkeys(model.dof_jntid[velocities].tolist())
    return (
        *(name_of(model.joint(k)) for k in joints),
        *(name_of(model.tendon(int(k))) for k in np.flatnonzero(tendons)),
        *(name_of(model.actuator(int(k))) for k in np.flatnonzero(actuators)),
    )


class NonlinearityMonitor:
    """Events of a :class:`sim.Bench` that note what a run meets and a linear model leaves out.

    Attributes:
        sentences: So far, each once.
    """

    def __init__(self, model: mujoco.MjModel, part: Part | None = None) -> None:
        """Take a model of the plant, and what of it counts; None is everything."""
        self.sentences, self._part = dict[str, None](), part
        drives_of_part = drives(model, among=None if part is None else part.actuators)
        self._forces = [
            (k, out, drive.name)
            for drive in drives_of_part
            for k, out in zip(drive.ids, drive.outputs, strict=True)
        ]

    def plant(self, tick: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Look at the end of the tick before."""
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
