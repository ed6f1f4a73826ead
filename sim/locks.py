"""Locks: joint equalities that hold one joint alone, inactive until it fails."""

from pathlib import Path

import mujoco

from sim.errors import ModelError

_ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_ONE_AXIS = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
_STEPS = 2
"""Time constant of a lock, in physics steps: the stiffest that MuJoCo integrates."""
_IMPEDANCE = [0.9999, 0.9999, 0.001, 0.5, 2]


def lock_name(actuator: int) -> str:
    """Name of the lock of actuator 0..nu-1, unless the user gives another."""
    return f"lock{actuator + 1}"


def joint_locked_by(model: mujoco.MjModel, equality: int) -> int:
    """Id of the joint that the equality holds alone; -1 if it does anything else."""
    is_joint = int(model.eq_type[equality]) == int(mujoco.mjtEq.mjEQ_JOINT)
    alone = int(model.eq_obj2id[equality]) == -1
    return int(model.eq_obj1id[equality]) if is_joint and alone else -1


def with_locks(file: Path, model: mujoco.MjModel) -> mujoco.MjModel:
    """The model of this file with an inactive lock for each actuated joint that has none.

    Raises:
        ModelError: The name of a lock to be added is that of another equality.
    """
    missing = _missing(model)
    if not missing:
        return model
    spec = mujoco.MjSpec.from_file(str(file))
    for actuator, joint in missing.items():
        lock = spec.add_equality(name=lock_name(actuator), type=mujoco.mjtEq.mjEQ_JOINT)
        lock.name1 = model.joint(joint).name
        lock.active = False
        lock.solref = [_STEPS * model.opt.timestep, 1.0]
        lock.solimp = _IMPEDANCE
    return spec.compile()


def _missing(model: mujoco.MjModel) -> dict[int, int]:
    """Joint without a lock of each actuator on a slide or hinge joint, the first on that joint."""
    taken = {model.equality(k).name for k in range(model.neq)}
    locked = {joint_locked_by(model, k) for k in range(model.neq)}
    missing: dict[int, int] = {}
    for k in range(model.nactuator):
        joint = int(model.actuator_trnid[k, 0])
        on_joint = int(model.actuator_trntype[k]) in _ON_JOINT
        if not on_joint or int(model.jnt_type[joint]) not in _ONE_AXIS or joint in locked:
            continue
        if lock_name(k) in taken:
            raise ModelError(
                f'the lock of joint "{model.joint(joint).name}" cannot be added: '
                f'another equality is named "{lock_name(k)}"'
            )
        missing[k] = joint
        locked.add(joint)
    return missing
