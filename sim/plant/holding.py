"""Actuator forces that hold a machine still."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from argument_checks.ties import greatest
from sim.array import Array
from sim.closing.equalities import closure_rows
from sim.mjcf.drive import Drive, moments_of
from sim.mjcf.joints import mass_of, ranges
from sim.mjcf.model import name_of
from sim.plant.actuators import Commands
from sim.plant.linear import allowed

_BALANCED = 1e-7
"""Part of the weights and springs that may stay without balance: joint axes are rounded."""
_WITHIN = 1e-6
"""Part of a range by which a value may miss it, and of a power by which equal ones may differ."""
_PREFERENCE = 1e-6
"""Weight of small forces against a load that is borne."""
_KINDS = {mujoco.mjtJoint.mjJNT_FREE: "free joint", mujoco.mjtJoint.mjJNT_BALL: "ball joint"}


class Balance(NamedTuple):
    """Forces (nout,) of outputs that hold a machine still, and the joint that moves most if any.

    `moves` says in words what moves it.
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
    """Find forces of the actuators of drives that hold the machine still in the pose of `data`.

    They balance gravity and springs through the closures, with the least norm, within the ranges of
    the forces where these allow it. Contacts, limits and dry friction, which creeps, hold nothing;
    something else holds the velocities `still` (k,). `data` has been through `mj_forward` at rest.
    """
    moments = moments_of(model, data)
    used = [out for drive in drives for out in drive.outputs]
    held = np.eye(model.nv)[[] if still is None else still]
    Z = allowed(np.vstack([closure_rows(model, data), held]))
    springs = data.qfrc_passive + data.qfrc_gravcomp * model.jnt_actgravcomp[model.dof_jntid]
    loads = np.stack([-data.qfrc_bias, springs], axis=1)  # apart, to name the one that moves
    arms = Z.T @ moments[used].T
    each = np.linalg.lstsq(arms, -Z.T @ loads, rcond=None)[0]
    low, high = ranges(model).force[used].T
    least, negligible = each.sum(axis=1), _BALANCED * np.linalg.norm(loads)
    if ((least < low) | (least > high)).any():
        # Along what bears no load others may take over.
        within = _within_ranges(arms, arms @ least, low, high)
        if np.linalg.norm(arms @ (within - least)) <= negligible:
            each[:, 0] += within - least
    unbalanced = Z @ (Z.T @ loads + arms @ each)
    forces = np.zeros(model.nout)
    forces[used] = each.sum(axis=1)
    if np.linalg.norm(unbalanced.sum(axis=1)) <= negligible:
        return Balance(forces)
    return Balance(forces, *_what_moves(model, Z, mass_of(model, data), unbalanced))


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
    kind = _KINDS.get(mujoco.mjtJoint(model.jnt_type[joint]), "joint")
    name = model.joint(joint).name
    called = f'"{name}"' if name else f'of body "{model.body(model.jnt_bodyid[joint]).name}"'
    return joint, f"{cause} moves the {kind} {called}: no actuator holds it"


def beyond_ranges(model: mujoco.MjModel, drives: tuple[Drive, ...], commands: Commands) -> str:
    """Sentence on an actuator that could hold the pose only beyond its range; empty if none."""
    limits = ranges(model)
    for k, out in (each for d in drives for each in zip(d.ids, d.outputs, strict=True)):
        control = model.actuator_ctrladr[k]
        for what, value, (low, high) in (
            ("a force", commands.force[out], limits.force[out]),
            ("a control", commands.at_rest[control], limits.control[control]),
        ):
            slack = _WITHIN * (high - low)
            if not low - slack <= value <= high + slack:
                return (
                    f'actuator "{name_of(model.actuator(k))}" cannot hold the start: it takes '
                    f"{what} of {value:.4g}, outside {low:g}..{high:g}"
                )
    return ""
