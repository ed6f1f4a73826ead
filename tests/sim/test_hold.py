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
    mujoco.mj_forward(data.model, data)
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
    body = isinstance(frame, Body)
    place = data.body(frame.name) if body else data.site(frame)
    linear, angular = np.zeros((2, 3, data.model.nv))
    jacobian = mujoco.mj_jacBody if body else mujoco.mj_jacSite
    jacobian(data.model, data, linear, angular, place.id)
    assert np.abs(linear @ allowed).max() < 1e-14
    turns = np.abs(angular @ allowed).max()
    assert turns < 1e-14 if weld else turns > 0.1
