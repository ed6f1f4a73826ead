"""Actuator forces that hold a machine still."""

import mujoco
import numpy as np

from sim.array import Array
from sim.closure import closure_rows
from sim.commands import Commands
from sim.drive import Drive
from sim.dynamics import mass_of
from sim.errors import ModelError
from sim.linear import allowed
from sim.model import name_of

_BALANCED = 1e-7
"""Part of the weights and springs that may stay without balance: joint axes are rounded."""
_WITHIN = 1e-6
_KIND = {
    int(mujoco.mjtJoint.mjJNT_FREE): "free joint",
    int(mujoco.mjtJoint.mjJNT_BALL): "ball joint",
}


def holding_forces(model: mujoco.MjModel, data: mujoco.MjData, drives: tuple[Drive, ...]) -> Array:
    """Forces (nout,) of the actuators of drives that hold the machine still in the pose of `data`.

    They balance gravity and springs through the closures, with the least norm. Contacts and limits
    do not count. `data` has been through `mj_forward` at rest.

    Raises:
        ModelError: Something falls, or is moved by a spring, whatever the actuators do.
    """
    moments = np.zeros((model.nout, model.nv))
    mujoco.mju_sparse2dense(
        moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    used = [out for drive in drives for out in drive.outputs]
    Z = allowed(closure_rows(model, data))
    springs = data.qfrc_passive + data.qfrc_gravcomp * model.jnt_actgravcomp[model.dof_jntid]
    load = data.qfrc_bias - springs
    arms = Z.T @ moments[used].T
    forces = np.zeros(model.nout)
    forces[used] = np.linalg.lstsq(arms, Z.T @ load, rcond=None)[0]
    unbalanced = Z @ (arms @ forces[used] - Z.T @ load)
    size = np.linalg.norm(data.qfrc_bias) + np.linalg.norm(springs)
    if np.linalg.norm(unbalanced) > _BALANCED * size:
        mass = Z.T @ mass_of(model, data) @ Z
        falls = Z @ np.linalg.solve(mass, Z.T @ unbalanced)
        # Force times acceleration has one unit for joints that turn and that slide.
        power = np.bincount(model.dof_jntid, unbalanced * falls)
        joint = int(power.argmax())
        cause = "gravity" if -falls @ data.qfrc_bias > falls @ springs else "a spring"
        kind = _KIND.get(int(model.jnt_type[joint]), "joint")
        raise ModelError(
            f'{cause} moves the {kind} "{name_of(model.joint(joint))}": no actuator holds it'
        )
    return forces


def refuse_beyond_ranges(
    model: mujoco.MjModel, drives: tuple[Drive, ...], commands: Commands
) -> None:
    """Refuse a pose that actuators could hold only beyond their ranges.

    Raises:
        ModelError: As described.
    """
    for drive in drives:
        for k, out in zip(drive.ids, drive.outputs, strict=True):
            control = model.actuator_ctrladr[k]
            force, value = commands.force_at_rest[out], commands.at_rest[control]
            if model.actuator_forcelimited[out]:
                _within("a force", force, model.actuator_forcerange[out], model, k)
            if model.actuator_ctrllimited[control]:
                _within("a control", value, model.actuator_ctrlrange[control], model, k)


def _within(what: str, value: float, span: Array, model: mujoco.MjModel, actuator: int) -> None:
    slack = _WITHIN * (span[1] - span[0])
    if not span[0] - slack <= value <= span[1] + slack:
        raise ModelError(
            f'actuator "{name_of(model.actuator(actuator))}" cannot hold the start: it takes '
            f"{what} of {value:.4g}, outside {span[0]:g}..{span[1]:g}"
        )
