"""Tests of the study `systems`: mobility of the models, and classification in simulation."""

from functools import cache

import mujoco
import numpy as np
import pytest
import scipy.linalg

from experiments import systems
from sim import Jacobians, jacobians, load_model

BY_NAME = {mechanism.name: mechanism for mechanism in systems.MECHANISMS}
FREEDOMS = {"arm": 7, "hand": 3, "arms": 6, "platform": 3}


@cache
def model_of(name: str) -> mujoco.MjModel:
    return load_model(BY_NAME[name].path)


@cache
def nominal(name: str) -> tuple[Jacobians, np.ndarray]:
    """Return Jacobians at the nominal pose, and an orthonormal basis of its closed motions."""
    model = model_of(name)
    jac = jacobians(model, mujoco.MjData(model), "payload", "base")
    return jac, scipy.linalg.null_space(jac.J_C) if len(jac.J_C) else np.eye(model.nv)


@pytest.mark.parametrize("name", FREEDOMS)
def test_a_mechanism_is_closed_at_its_nominal_pose_and_has_its_freedoms(name):
    """Freedoms are velocities minus the rank of the closures; the motors control all of them."""
    model, data, task = model_of(name), mujoco.MjData(model_of(name)), BY_NAME[name].task
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max(initial=0.0) < 1e-12
    np.testing.assert_array_equal(model.qpos0[model.jnt_qposadr[model.actuator_trnid[:, 0]]], 0.0)
    # The wrist angles of the arm are written with thirteen decimals of a degree.
    np.testing.assert_allclose(data.site("payload").xmat, data.site("base").xmat, atol=1e-14)
    jac, motions = nominal(name)
    assert {len(condition) for condition in BY_NAME[name].conditions} == {len(jac.active)}
    assert motions.shape[1] == np.linalg.matrix_rank(motions[jac.active]) == FREEDOMS[name]
    task_motions = jac.J_T @ motions
    assert np.linalg.matrix_rank(task_motions) == len(task)
    np.testing.assert_allclose(np.delete(task_motions, task, axis=0), 0.0, atol=1e-15)


@pytest.fixture(scope="module")
def entries(study):
    return study.tables["systems"].set_index(["mechanism", "condition"])


def test_the_simulated_motions_are_those_of_the_classification(entries):
    """Limits are ten to a hundred times tighter than in the study's checks."""
    assert len(entries) == sum(len(mechanism.conditions) for mechanism in systems.MECHANISMS)
    # Closure forces include internal forces, by eq. (11).
    assert entries[["drift_error", "torque_error", "closure_error"]].max(axis=None) < 1e-4
    assert entries.yielded_steps.max() < 1e-4
    assert entries.smallest_gap.min() > 1e4


@pytest.mark.parametrize(
    ("where", "unstable", "major", "constrained"),
    [
        (("arm", "4 free"), True, True, 0),  # a free elbow moves the camera
        (("arm", "7 free"), True, False, 0),  # a free wrist rotates it about its axis
        (("hand", "healthy"), False, False, 1),  # four motors for three freedoms
        (("hand", "1 free"), False, False, 0),  # three motors still hold the object
        (("hand", "1 and 2 free"), True, True, 0),  # with a free finger it swings about the other
        (("arms", "healthy"), False, False, 6),  # twelve motors for six freedoms
        # One arm carries the load and the other arm.
        (("arms", "1, 2, 3, 4, 5 and 6 free"), False, False, 0),
        (("platform", "1 free"), False, False, 0),  # over-actuated: no self-motion
        (("platform", "1 and 2 free"), True, True, 0),
    ],
)
def test_each_mechanism_has_the_expected_classification(
    entries, where, unstable, major, constrained
):
    entry = entries.loc[where]
    assert (entry["unstable"], entry["unstable_major"]) == (unstable, major)
    assert entry["constrained_active"] == entry["simulated_constrained_active"] == constrained


def test_in_a_hand_dropping_the_column_of_a_locked_finger_joint_is_wrong():
    """The other joints are constrained, too, as section 2.3.2 warns."""
    mechanism = BY_NAME["hand"]
    _, healthy = systems.classified(model_of("hand"), mechanism, "SSSS")
    _, locked = systems.classified(model_of("hand"), mechanism, "LSSS")
    probed = systems.Probed(model_of("hand"), mechanism, "LSSS")
    active, moved = systems.respond(probed, locked.actuators)
    right = moved - locked.J @ active
    dropped = moved - np.delete(healthy.J, 0, axis=1) @ np.eye(3)
    assert np.linalg.norm(right) < 1e-3 * np.linalg.norm(moved)
    assert np.linalg.norm(dropped) > 0.1 * np.linalg.norm(moved)
