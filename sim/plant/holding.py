"""Actuator forces that hold a machine still."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from argument_checks.ties import greatest
from sim.array import Array
from sim.closing.equalities import closure_rows
from sim.errors import ModelError
from sim.mjcf.drive import Drive
from sim.mjcf.dynamics import mass_of
from sim.mjcf.model import name_of
from sim.plant.commands import Commands
from sim.plant.linear import allowed

_BALANCED = 1e-7
"""Part of the weights and springs that may stay without balance: joint axes are rounded."""
_WITHIN = 1e-6
"""Part of a range by which a value may miss it, and of a power by which equal ones may differ."""
_PREFERENCE = 1e-6
"""Weight of small forces against a load that is borne."""
_KIND = {
    int(mujoco.mjtJoint.mjJNT_FREE): "free joint",
    int(mujoco.mjtJoint.mjJNT_BALL): "ball joint",
}


class Balance(NamedTuple):
    """Forces of actuators that hold a machine still, as far as they can.

    Attributes:
        forces: Of each output, shape (nout,).
        joint: Number of the one that moves most; None where all is still.
        moves: That, and what moves it, in words.
    """

    forces: Array
    joint: int | None = None
    moves: str = ""


def balance(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    drives: tuple[Drive, ...],
    still: NDArray[np.intp] | None = None,
) -> Balance:
    """Forces of the actuators of drives that hold the machine still in the pose of `data`.

    They balance gravity and springs through the closures, with the least norm, within the ranges of
    the forces where these allow it. Contacts, limits and dry friction, which creeps, hold nothing.
    `data` has been through `mj_forward` at rest.

    Args:
        model: The model.
        data: Its state.
        drives: Whose actuators hold it.
        still: Velocities (k,) that something else holds; None is none.
    """
    moments = np.zeros((model.nout, model.nv))
    mujoco.mju_sparse2dense(
        moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    used = [out for drive in drives for out in drive.outputs]
    held = closure_rows(model, data)
    if still is not None and len(still):
        held = np.vstack([held, np.eye(model.nv)[still]])
    Z = allowed(held)
    springs = data.qfrc_passive + data.qfrc_gravcomp * model.jnt_actgravcomp[model.dof_jntid]
    loads = np.stack([-data.qfrc_bias, springs], axis=1)  # apart, to name the one that moves
    arms = Z.T @ moments[used].T
    each = np.linalg.lstsq(arms, -Z.T @ loads, rcond=None)[0]
    low, high = np.where(
        model.actuator_forcelimited[used, None], model.actuator_forcerange[used], (-np.inf, np.inf)
    ).T
    least = each.sum(axis=1)
    if ((least < low) | (least > high)).any():
        # Along what bears no load others may take over.
        within = _within_ranges(arms, arms @ least, low, high)
        if np.linalg.norm(arms @ (within - least)) <= _BALANCED * np.linalg.norm(loads):
            each = each + (within - least)[:, None] * np.array([1.0, 0.0])
    unbalanced = Z @ (Z.T @ loads + arms @ each)
    forces = np.zeros(model.nout)
    forces[used] = each.sum(axis=1)
    if np.linalg.norm(unbalanced.sum(axis=1)) > _BALANCED * np.linalg.norm(loads):
        return Balance(forces, *_what_moves(model, Z, mass_of(model, data), unbalanced))
    return Balance(forces)


def _within_ranges(arms: Array, load: Array, low: Array, high: Array) -> Array:
    """Forces (k,) within ranges that bear a load, nearly the least; as far as there are any."""
    scale = np.linalg.norm(arms, 2) or 1.0
    rows = np.vstack([arms / scale, _PREFERENCE * np.eye(len(low))])
    wanted = np.concatenate([load / scale, np.zeros(len(low))])
    return lsq_linear(rows, wanted, (low, high), method="bvls").x


def _what_moves(model: mujoco.MjModel, Z: Array, mass: Array, unbalanced: Array) -> tuple[int, str]:
    """The joint that takes most of the power, and whether from gravity or springs, (nv, 2)."""
    falls = Z @ np.linalg.solve(Z.T @ mass @ Z, Z.T @ unbalanced.sum(axis=1))
    # Force times acceleration has one unit for joints that turn and that slide.
    power = unbalanced * falls[:, None]
    joint = greatest(np.bincount(model.dof_jntid, power.sum(axis=1)), _WITHIN)
    of_gravity, of_springs = power[model.dof_jntid == joint].sum(axis=0)
    cause = "gravity" if of_gravity > of_springs else "a spring"
    kind = _KIND.get(int(model.jnt_type[joint]), "joint")
    name = model.joint(joint).name
    called = f'"{name}"' if name else f'of body "{model.body(model.jnt_bodyid[joint]).name}"'
    return joint, f"{cause} moves the {kind} {called}: no actuator holds it"


def holding_forces(model: mujoco.MjModel, data: mujoco.MjData, drives: tuple[Drive, ...]) -> Array:
    """The forces (nout,) of :func:`balance`.

    Raises:
        ModelError: Something falls, or is moved by a spring, whatever the actuators do.
    """
    found = balance(model, data, drives)
    if found.joint is not None:
        raise ModelError(found.moves)
    return found.forces


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
            force = float(commands.force_at_rest[out])
            value = float(commands.at_rest[control])
            if model.actuator_forcelimited[out]:
                _within("a force", float(force), model.actuator_forcerange[out], model, k)
            if model.actuator_ctrllimited[control]:
                _within("a control", float(value), model.actuator_ctrlrange[control], model, k)


def _within(what: str, value: float, span: Array, model: mujoco.MjModel, actuator: int) -> None:
    slack = _WITHIN * (span[1] - span[0])
    if not span[0] - slack <= value <= span[1] + slack:
        raise ModelError(
            f'actuator "{name_of(model.actuator(actuator))}" cannot hold the start: it takes '
            f"{what} of {value:.4g}, outside {span[0]:g}..{span[1]:g}"
        )
