"""Locks: equalities that hold one joint or tendon alone, inactive until it fails."""

from typing import NamedTuple

import mujoco

from sim.errors import ModelError

_ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_ONE_AXIS = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
STEPS = 2
"""Time constant of a lock, in physics steps: the stiffest that MuJoCo integrates."""
_IMPEDANCE = [0.9999, 0.9999, 0.001, 0.5, 2]


def lock_name(actuator: int) -> str:
    """Name of the lock of actuator 0..nu-1, unless the user gives another."""
    return f"lock{actuator + 1}"


class Lockable(NamedTuple):
    """A joint or tendon, by its number, and what the model calls it."""

    kind: str
    id: int
    name: str


def locked_by(model: mujoco.MjModel, equality: int) -> Lockable | None:
    """The joint or tendon that the equality holds alone; None if it does anything else."""
    end, kind = int(model.eq_obj1id[equality]), int(model.eq_type[equality])
    if int(model.eq_obj2id[equality]) != -1:
        return None
    if kind == int(mujoco.mjtEq.mjEQ_JOINT):
        return Lockable("joint", end, model.joint(end).name)
    if kind == int(mujoco.mjtEq.mjEQ_TENDON):
        return Lockable("tendon", end, model.tendon(end).name)
    return None


def lockable_by(model: mujoco.MjModel, actuator: int) -> Lockable | None:
    """The slide, hinge or tendon that an actuator moves; None for any other transmission."""
    end, kind = int(model.actuator_trnid[actuator, 0]), int(model.actuator_trntype[actuator])
    if kind in _ON_JOINT and int(model.jnt_type[end]) in _ONE_AXIS:
        return Lockable("joint", end, model.joint(end).name)
    return Lockable("tendon", end, model.tendon(end).name) if kind == _TENDON else None


def add_locks(spec: mujoco.MjSpec, model: mujoco.MjModel) -> bool:
    """Add an inactive lock for each actuated joint or tendon without one; whether there was one.

    Args:
        spec: Which is changed, and compiled anew by the caller.
        model: As it was compiled.

    Raises:
        ModelError: The name of a lock to be added is that of another equality.
    """
    missing = _missing(model)
    for actuator, part in missing.items():
        kind = mujoco.mjtEq.mjEQ_JOINT if part.kind == "joint" else mujoco.mjtEq.mjEQ_TENDON
        lock = spec.add_equality(name=lock_name(actuator), type=kind)
        lock.name1 = part.name
        lock.active = False
        stiffen(lock, model.opt.timestep)
    return bool(missing)


def weakens_locks(model: mujoco.MjModel) -> bool:
    """Whether the integrator takes dampers after constraints, and so out of the forces of locks.

    Damped joints that move then drag a locked one along, the more the longer a step is.
    """
    integrator, flags = model.opt.integrator, model.opt.disableflags
    if integrator == mujoco.mjtIntegrator.mjINT_EULER:
        explicit = mujoco.mjtDisableBit.mjDSBL_EULERDAMP | mujoco.mjtDisableBit.mjDSBL_DAMPER
        return bool(model.dof_damping.any() and not flags & explicit)
    kinds = (mujoco.mjtIntegrator.mjINT_IMPLICIT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    return integrator in kinds


def stiffness_of(model: mujoco.MjModel, equality: int) -> float:
    """Acceleration per displacement with which an equality pulls back, about, [1/s^2]."""
    (time_s, damping), most = model.eq_solref[equality], model.eq_solimp[equality, 1]
    return float(-time_s / most**2 if time_s < 0 else 1 / (most * time_s * damping) ** 2)


def stiffen(equality: mujoco.MjsEquality, timestep_s: float) -> None:
    """Make an equality as stiff as the time step allows."""
    equality.solref = [STEPS * timestep_s, 1.0]
    equality.solimp = _IMPEDANCE


def _missing(model: mujoco.MjModel) -> dict[int, Lockable]:
    """Joint or tendon without a lock of each actuator on one, the first there."""
    taken = {model.equality(k).name for k in range(model.neq)}
    locked = {locked_by(model, k) for k in range(model.neq)}
    missing: dict[int, Lockable] = {}
    for k in range(model.nactuator):
        part = lockable_by(model, k)
        if part is None or part in locked:
            continue
        if lock_name(k) in taken:
            raise ModelError(
                f'the lock of {part.kind} "{part.name}" cannot be added: '
                f'another equality is named "{lock_name(k)}"'
            )
        missing[k] = part
        locked.add(part)
    return missing
