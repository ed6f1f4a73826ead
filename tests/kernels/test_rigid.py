"""Test rigid-body functions against numpy and MuJoCo."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kernels import Struct, lib, pointer
from sim import MODELS, JacobianReader, Mechanism, Pose, load_model


@pytest.mark.parametrize("largest", [0.0, 1e-9, 0.1, 3.0])
def test_displacements_are_rotation_vectors_and_translations(largest):
    rng = np.random.default_rng(3)
    turn = rng.normal(size=(40, 3))
    turn *= largest * rng.random((40, 1)) / np.linalg.norm(turn, axis=1, keepdims=True)
    R, t = np.ascontiguousarray(Rotation.from_rotvec(turn).as_matrix()), rng.normal(size=(40, 3))
    result = np.empty((40, 6))
    angle = lib.displacements(40, pointer(R), pointer(t), pointer(result))
    np.testing.assert_allclose(result, np.hstack([turn, t]), atol=2e-15)
    assert angle == pytest.approx(np.linalg.norm(turn, axis=1).max(), abs=1e-15)
    np.testing.assert_array_equal(Pose(R, t).displacement(), result)


def test_a_motion_closes_the_loops_then_moves_the_drives():
    """Check J_C x = -gaps first, then fixed drives; undetermined motion is zero."""
    rng = np.random.default_rng(4)
    J_C, gaps = rng.normal(size=(3, 7)), 1e-3 * rng.normal(size=2)
    active, fixed = np.array([4, 5, 6]), np.array([2, 0])
    here, wanted = np.zeros(3), 1e-3 * rng.normal(size=3)
    of = Struct("drives_model", N=7, n=3, active=active)
    motion, workspace = np.empty(7), np.empty(lib.nearest_room(3, 2, 0, 7))

    def nearest(fixed, gaps, wanted):
        return lib.nearest_motion(
            *(of.pointer, 3, pointer(J_C), len(gaps), pointer(gaps), len(fixed), pointer(fixed)),
            *(pointer(wanted), pointer(here), pointer(workspace), pointer(motion)),
        )

    assert nearest(fixed, gaps, wanted) == lib.MOTION_SOLVED
    np.testing.assert_allclose(J_C @ motion, [*-gaps, 0.0], atol=1e-12)
    np.testing.assert_allclose(motion[active[fixed]], wanted[fixed], atol=1e-12)
    rows = np.vstack([J_C, np.eye(7)[active[fixed]]])
    np.testing.assert_allclose(np.linalg.svd(rows)[2][5:] @ motion, 0.0, atol=1e-12)
    assert nearest(fixed, np.zeros(2), here) == lib.MOTION_NONE
    assert nearest(np.array([3]), gaps, wanted) == lib.MOTION_INVALID
    assert nearest(np.array([-1]), gaps, wanted) == lib.MOTION_INVALID
    assert nearest(np.array([1, 1]), gaps, wanted) == lib.MOTION_INVALID


@pytest.mark.parametrize("name", ["arm", "hand", "arms", "platform"])
def test_a_posture_equals_mujoco_at_its_joint_positions(name):
    model = load_model(MODELS / f"{name}.xml")
    mechanism = Mechanism(model, site="payload")
    rng, n = np.random.default_rng(5), len(mechanism.nominal.displacements)
    moved = mechanism.moved(mechanism.nominal, 1e-3 * rng.normal(size=n), np.arange(n))
    data = mujoco.MjData(model)
    data.qpos[:] = moved.qpos
    mujoco.mj_fwdPosition(model, data)
    np.testing.assert_allclose(moved.gaps, data.efc_pos[: data.ne], atol=1e-15)
    whole = JacobianReader(model, "payload", closure_tolerance=np.inf).at(data)
    np.testing.assert_array_equal(moved.J_T, whole.J_T)
    np.testing.assert_array_equal(moved.J_C, whole.J_C)
    assert moved.error_bound == whole.error_bound == moved.accuracy.error_bound
    assert moved.names == whole.names and moved.closure_residual == whole.closure_residual
    pose = moved.pose
    computed_anew = Pose(pose.rotation, pose.translation_m).displacement()
    np.testing.assert_array_equal(mechanism.task(moved), computed_anew)
    pose.displacement()[:] = np.nan
    np.testing.assert_array_equal(pose.displacement(), computed_anew)
    arrays = moved.qpos, pose.rotation, pose.translation_m, moved.J_T, moved.J_C, moved.gaps
    assert not any(array.flags.writeable for array in (*arrays, moved.displacements))
