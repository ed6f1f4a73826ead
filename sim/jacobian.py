"""Task and constraint Jacobians of any MJCF model."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

import argument_checks as check
from sim.array import Array
from sim.errors import ModelError
from sim.model import check_state, element_id

_WITHOUT_CLOSURES = int(mujoco.mjtDisableBit.mjDSBL_EQUALITY) | int(
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
)
_CLOSURES = [
    int(getattr(mujoco.mjtEq, f"mjEQ_{kind}")) for kind in ("CONNECT", "WELD", "JOINT", "TENDON")
]
_ONE_AXIS = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
# "In parent" matters to ball and free joints only, which are refused anyway.
_ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


@dataclass(frozen=True)
class Jacobians:
    """Velocities of a MuJoCo model as v = J_T qvel, 0 = J_C qvel.

    Attributes:
        J_T: Twist [angular; linear] of the site, shape (6, nv), [rad]/[s] and [m]/[s].
        J_C: Active equality constraints, shape (c, nv); redundant rows are normal.
        active: Velocity index of each actuator, in actuator order, shape (n,).
        gear: Gear ratio of each actuator, never zero, shape (n,).

    Raises:
        ValueError: Shapes that do not fit, an index out of range, or numbers that are not finite.
    """

    J_T: Array
    J_C: Array
    active: NDArray[np.intp]
    gear: Array

    def __post_init__(self) -> None:
        """Check the arguments."""
        nv = check.batch("J_T", self.J_T).shape[-1]
        check.batch("J_C", self.J_C, columns=nv)
        active = check.indices("active", self.active, nv)
        if not check.exactly("gear", self.gear, len(active)).all():
            raise ValueError(f"gear must not be zero, got {check.shown(self.gear)}")


def jacobians(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    site: str,
    axes: str | None = None,
) -> Jacobians:
    """Jacobians at the present `data.qpos`; derived quantities in `data` are brought up to date.

    Slide, hinge, ball and free joints; connect, weld, joint and tendon equalities. Contacts, limits
    and dry friction are left out: they are not equalities. The rows are derivatives of the closures
    where these are closed; that is for the caller to see to.

    Args:
        model: Any model whose actuators each drive a slide or hinge joint of their own.
        data: Its state; `eq_active` decides which equalities count.
        site: The task point.
        axes: Site whose axes the twist is expressed in; None is the world.

    Raises:
        ModelError: A missing site; an actuator or an active equality that the theory has no word
            for; closures that the model's flags switch off, or that sleep.
        ValueError: `data.qpos` is not finite, or `data` of another model.
        TypeError: An argument is of another kind.
    """
    check_state(model, data)
    task = element_id(model, "site", check.instance("site", site, str))
    frame = None
    if axes is not None:
        frame = element_id(model, "site", check.instance("axes", axes, str))
    active = actuated_velocities(model)
    _check_closures(model, data)
    mujoco.mj_fwdPosition(model, data)

    linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacSite(model, data, linear, angular, task)
    to_axes = np.eye(3) if frame is None else data.site_xmat[frame].reshape(3, 3).T
    J_C = constraint_jacobian(model, data)
    if not np.isfinite(J_C).all():
        raise ModelError("an equality of the model is not finite")
    return Jacobians(
        J_T=np.vstack([to_axes @ angular, to_axes @ linear]),
        J_C=J_C,
        active=active,
        gear=model.actuator_gear[:, 0].copy(),
    )


def constraint_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Rows of the active equality constraints, shape (c, nv), as MuJoCo last computed them.

    Raises:
        ModelError: A part of the mechanism sleeps; MuJoCo leaves its rows out.
    """
    if data.ntree_awake < model.ntree:
        raise ModelError("a part of the mechanism is asleep, with its closures: switch sleep off")
    if mujoco.mj_isSparse(model):
        rows = np.zeros((data.nefc, model.nv))
        mujoco.mju_sparse2dense(
            rows, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
        )
    else:
        rows = data.efc_J.reshape(-1, model.nv)
    return rows[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)].copy()


def actuated_velocities(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Velocity index of each actuator.

    Raises:
        ModelError: An actuator not on a slide or hinge joint, one of gear 0, or two on one joint.
    """
    owner: dict[int, str] = {}
    for k in range(model.nactuator):
        name = model.actuator(k).name or f"number {k}"
        joint = int(model.actuator_trnid[k, 0])
        on_joint = int(model.actuator_trntype[k]) in _ON_JOINT
        if not on_joint or int(model.jnt_type[joint]) not in _ONE_AXIS:
            raise ModelError(f'actuator "{name}" does not drive a slide or hinge joint')
        if model.actuator_gear[model.actuator_outadr[k], 0] == 0.0:
            raise ModelError(f'actuator "{name}" has gear 0 and moves nothing')
        if joint in owner:
            raise ModelError(
                f'actuators "{owner[joint]}" and "{name}" drive the same joint '
                f'"{model.joint(joint).name}"'
            )
        owner[joint] = name
    return model.jnt_dofadr[list(owner)].astype(np.intp)


def _check_closures(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    if data.eq_active.any() and model.opt.disableflags & _WITHOUT_CLOSURES:
        raise ModelError("equalities are active, and the model's flags disable them")
    strange = data.eq_active.astype(bool) & ~np.isin(model.eq_type, _CLOSURES)
    for k in np.flatnonzero(strange):
        name = model.equality(k).name or f"number {k}"
        raise ModelError(f'equality "{name}" holds a flex: only connect, weld, joint and tendon do')
