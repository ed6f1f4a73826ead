"""Scenes of geoms on joints: pairs of floating shapes, and arms among obstacles."""

import itertools

import mujoco
import numpy as np

SHAPES = {
    "sphere": 'type="sphere" size="0.1"',
    "capsule": 'type="capsule" size="0.05 0.1"',
    "ellipsoid": 'type="ellipsoid" size="0.1 0.07 0.15"',
    "cylinder": 'type="cylinder" size="0.08 0.1"',
    "box": 'type="box" size="0.1 0.07 0.12"',
    "mesh": 'type="mesh" mesh="stone"',
    "plane": 'type="plane" size="1 1 0.1"',
}
PAIRS = [pair for pair in itertools.combinations_with_replacement(SHAPES, 2) if pair[0] != "plane"]
STONE = '<mesh name="stone" vertex="0 0 0  0.2 0 0  0 0.2 0  0 0 0.2  0.15 0.15 0.15"/>'


def two(first: str, second: str) -> mujoco.MjModel:
    """Create two geoms: one on a slide, hinge and ball in series, one floating or the ground."""
    other = f'<geom name="second" {SHAPES[second]} mass="1"/>'
    inner = f'<geom name="first" {SHAPES[first]} mass="1"/>'
    for joint in ("ball", "hinge", "slide"):
        body = f'<body pos="0.02 0 0.01"><joint type="{joint}" axis="1 2 3"/>'
        inner = f'{body}<geom size="0.001" mass="1" contype="0" conaffinity="0"/>{inner}</body>'
    floating = other if second == "plane" else f"<body><freejoint/>{other}</body>"
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{STONE}</asset><worldbody>{inner}{floating}</worldbody></mujoco>"
    )


def arm_among(obstacles: int, rng: np.random.Generator) -> mujoco.MjModel:
    """Create a random arm of six hinges above a floor, among boxes, spheres and capsules."""
    arm = ""
    for k in range(6):
        shape = ("capsule", "box", "sphere")[rng.integers(3)]
        size, axis = rng.uniform(0.02, 0.08, size=3), rng.normal(size=3)
        place = [0.0, 0.0, 0.2] if k else [0.0, 0.0, 0.4]
        arm += f'<body pos="{_row(place)}"><joint axis="{_row(axis)}"/>'
        arm += f'<geom type="{shape}" size="{_row(size)}" pos="0 0 0.1"/>'
    around = ""
    for k in range(obstacles):
        shape = ("box", "sphere", "capsule")[k % 3]
        place, turn = rng.normal([0, 0, 0.5], 0.4), rng.normal(size=4)
        size = _row(rng.uniform(0.02, 0.15, size=3))
        around += f'<geom type="{shape}" size="{size}" pos="{_row(place)}" quat="{_row(turn)}"/>'
    floor = '<geom type="plane" size="1 1 1" pos="0 0 -0.5"/>'
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{floor}{around}{arm}{'</body>' * 6}</worldbody></mujoco>"
    )


def distances_of(
    model: mujoco.MjModel, qpos: np.ndarray, pairs: np.ndarray, most_m: float
) -> np.ndarray:
    """Compute the distance of every pair at a pose, in a separate state."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return np.array([mujoco.mj_geomDistance(model, data, *pair, most_m, None) for pair in pairs])


def moved(model: mujoco.MjModel, qpos: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the pose after a step on the manifold."""
    there = qpos.copy()
    mujoco.mj_integratePos(model, there, step, 1.0)
    return there


def _row(numbers: "np.ndarray | list[float]") -> str:
    return " ".join(f"{number:.6f}" for number in numbers)
