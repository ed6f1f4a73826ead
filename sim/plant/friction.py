"""Dry friction of joints and tendons as the linear model of a plant needs it."""

from typing import NamedTuple

import mujoco
import numpy as np

from sim.array import Array
from sim.closing.equalities import constraint_rows
from sim.mjcf.model import name_of

_FRICTION = (
    int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF),
    int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON),
)


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


def dry_friction(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the joints, then of the tendons, that have some."""
    joints = dict.fromkeys(model.dof_jntid[np.flatnonzero(model.dof_frictionloss)].tolist())
    tendons = np.flatnonzero(model.tendon_frictionloss).tolist()
    return (
        *(name_of(model.joint(k)) for k in joints),
        *(name_of(model.tendon(k)) for k in tendons),
    )


def friction_of(
    model: mujoco.MjModel, data: mujoco.MjData, ways: Array, mass: Array
) -> Friction | None:
    """Of a state that is up to date; None where nothing rubs.

    Args:
        model: Of it.
        data: The state.
        ways: Velocities per free coordinate, shape (nv, k).
        mass: Mass matrix (nv, nv).
    """
    rubs = np.flatnonzero(np.isin(data.efc_type, _FRICTION) & (data.efc_frictionloss > 0.0))
    rows = constraint_rows(model, data)[rubs] @ ways
    moves = rows.any(axis=1)  # what the closed loops hold does not rub
    rubs, rows = rubs[moves], rows[moves]
    if not len(rubs):
        return None
    return Friction(
        push=np.linalg.solve(ways.T @ mass @ ways, rows.T),
        rows=rows,
        limit=data.efc_frictionloss[rubs].copy(),
        softness=data.efc_R[rubs].copy(),
        rate=data.efc_KBIP[rubs, 1].copy(),
    )
