"""Contacts and pins: which bodies stand, and what of them moves no more."""

import mujoco
import numpy as np
import pytest
import scipy.linalg

from sim import Body, ModelError, Pin, jacobians
from tests.models import model


def leg(height: float = 0.0) -> mujoco.MjData:
    """The foot on the floor, or so far above it."""
    data = mujoco.MjData(model("leg"))
    mujoco.mj_kinematics(data.model, data)
    data.qpos[2] += 0.02 * (1 - 1e-6) + height - data.geom_xpos[-1, 2]
    return data


def test_contacts_are_warned_about_by_the_names_of_the_bodies():
    words = '"foot" touches "world" and is taken to move freely: pinned= takes it to stand'
    for height, margin, gap, warnings in (
        (0.0, 0.0, 0.0, (words,)),
        (1e-3, 0.0, 0.0, ()),
        (1e-3, 2e-3, 0.0, (words,)),  # the floor pushes within the margin,
        (1e-3, 0.0, 2e-3, ()),  # and is only noticed within the gap
    ):
        data = leg(height)
        data.model.geom_margin[-1], data.model.geom_gap[-1] = margin, gap
        assert jacobians(data.model, data, "sole").warnings == warnings
    with pytest.raises(ModelError, match=r"no actuator moves 'trunk'.* stands on in pinned="):
        jacobians(data.model, data, "trunk")  # a leg in the air


@pytest.mark.parametrize("frame", ["sole", Body("foot"), "toe", Body("toe")])
@pytest.mark.parametrize("weld", [False, True])
def test_what_is_pinned_does_not_move_and_is_warned_about_no_more(frame, weld):
    """Pinned like a connect its origin stays, like a weld it does not turn either."""
    data, standing = leg(), [Pin(frame, weld=True) if weld else frame]
    jac = jacobians(data.model, data, "trunk", pinned=standing)
    assert jac.warnings == () and len(jac.J_C) == (6 if weld else 3)
    allowed = scipy.linalg.null_space(jac.J_C)
    assert allowed.shape[1] == data.model.nv - (6 if weld else 3)
    kind, name = (
        (mujoco.mjtObj.mjOBJ_XBODY, frame.name)
        if isinstance(frame, Body)
        else (mujoco.mjtObj.mjOBJ_SITE, frame)
    )
    twists = []
    for data.qvel[:] in allowed.T:
        mujoco.mj_forward(data.model, data)
        twists.append(np.empty(6))
        number = mujoco.mj_name2id(data.model, int(kind), name)
        mujoco.mj_objectVelocity(data.model, data, int(kind), number, twists[-1], 0)
    angular, linear = np.abs(twists)[:, :3].max(), np.abs(twists)[:, 3:].max()
    assert linear < 1e-14 and (angular < 1e-14 if weld else angular > 0.1)
