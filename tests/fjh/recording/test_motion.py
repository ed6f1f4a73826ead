"""Drawn motion against MuJoCo's."""

import numpy as np
from scipy.spatial.transform import Rotation

from fjh.recording.motion import hexapod_mover, magnified, motion_of
from sim import Plant, Pose


def test_hexapod_is_drawn_at_its_simulated_pose(model):
    """Bodies are drawn from the payload's pose after a step; flexures twist by some mrad."""
    plant = Plant(model)
    plant.step(1e-4 * np.array([4, -2, 3, -6, 2, -3]), 1.0)
    pose, data = plant.pose(), plant.data
    motion = hexapod_mover(model)(Pose(pose.rotation[None], pose.translation_m[None]))
    body = model.geom_bodyid
    placed = motion.position_m[0, body] + (
        motion.rotation[0, body] @ model.geom_pos[..., None]
    ).squeeze(-1)
    np.testing.assert_allclose(placed, data.geom_xpos, atol=1e-4)


def test_magnified_motion_has_scaled_translations_and_rotations(model):
    start, later = (model.qpos0 + 1e-3 * k * np.sin(np.arange(model.nq)) for k in (0, 1))
    nominal, motion = motion_of(model, start[None]), motion_of(model, later[None])
    larger = magnified(motion, nominal, 5.0)
    moved = motion.position_m - nominal.position_m
    np.testing.assert_allclose(larger.position_m - nominal.position_m, 5 * moved, atol=1e-12)
    vectors = [
        Rotation.from_matrix((each.rotation @ nominal.rotation.swapaxes(-1, -2))[0]).as_rotvec()
        for each in (motion, larger)
    ]
    np.testing.assert_allclose(vectors[1], 5 * vectors[0], atol=1e-9)
