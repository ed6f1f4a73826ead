"""A humanoid of the size of a Unitree G1: 29 joints and a floating base, made here with MjSpec.

Links and masses are rounded to centimetres and tenths of a kilogram; nothing is taken from a file.
x points ahead, y to the left, z up. It stands with bent knees and elbows where all joints are zero.
"""

from math import cos, sin

import mujoco

_ROLL, _PITCH, _YAW = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_KNEE, _ELBOW = 0.6, -1.4
"""Bends [rad] about y."""

_Link = tuple[str, tuple[float, ...], tuple[float, float, float], float, float]
"""Joint, its axis, its place on the link before [m], bend [rad], mass [kg] of what follows."""
_LEG: tuple[_Link, ...] = (
    ("hip_pitch", _PITCH, (0.0, 0.06, -0.10), -_KNEE / 2, 1.4),
    ("hip_roll", _ROLL, (0.0, 0.05, -0.03), 0.0, 1.5),
    ("hip_yaw", _YAW, (0.0, 0.0, -0.12), 0.0, 1.7),
    ("knee", _PITCH, (0.0, 0.0, -0.18), _KNEE, 1.9),
    ("ankle_pitch", _PITCH, (0.0, 0.0, -0.30), -_KNEE / 2, 0.1),
    ("ankle_roll", _ROLL, (0.0, 0.0, -0.02), 0.0, 0.6),
)
_WAIST: tuple[_Link, ...] = (
    ("waist_yaw", _YAW, (0.0, 0.0, 0.0), 0.0, 0.2),
    ("waist_roll", _ROLL, (0.0, 0.0, 0.04), 0.0, 0.1),
    ("waist_pitch", _PITCH, (0.0, 0.0, 0.02), 0.0, 8.0),
)
_ARM: tuple[_Link, ...] = (
    ("shoulder_pitch", _PITCH, (0.0, 0.10, 0.24), 0.0, 0.7),
    ("shoulder_roll", _ROLL, (0.0, 0.04, -0.01), 0.0, 0.6),
    ("shoulder_yaw", _YAW, (0.0, 0.01, -0.10), 0.0, 0.7),
    ("elbow", _PITCH, (0.0, 0.0, -0.08), _ELBOW, 0.6),
    ("wrist_roll", _YAW, (0.0, 0.0, -0.10), 0.0, 0.1),
    ("wrist_pitch", _PITCH, (0.0, 0.0, -0.04), 0.0, 0.5),
    ("wrist_yaw", _ROLL, (0.0, 0.0, -0.05), 0.0, 0.3),
)
_FOOT, _HAND = (0.0, 0.0, -0.03), (0.0, 0.0, -0.10)
"""Of sole and palm, on the last link [m]."""


def humanoid() -> mujoco.MjModel:
    """The model: sites left_foot, right_foot, left_hand, right_hand; an actuator on each joint."""
    spec = mujoco.MjSpec()
    pelvis = spec.worldbody.add_body(name="pelvis", pos=[0.0, 0.0, 0.79])
    pelvis.add_freejoint(name="root")
    _weigh(pelvis, 3.8)
    torso = _chain(spec, pelvis, _WAIST, "", 1.0)
    for name, side in (("left_", 1.0), ("right_", -1.0)):
        foot = _chain(spec, pelvis, _LEG, name, side)
        foot.add_site(name=f"{name}foot", pos=list(_FOOT))
        hand = _chain(spec, torso, _ARM, name, side)
        hand.add_site(name=f"{name}hand", pos=list(_HAND))
    return spec.compile()


def _chain(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, links: tuple[_Link, ...], name: str, side: float
) -> mujoco.MjsBody:
    """The last of these links, on the left (side 1) or mirrored to the right (-1)."""
    for joint, axis, (x, y, z), bend, mass in links:
        half = bend / 2
        body = body.add_body(
            name=name + joint, pos=[x, side * y, z], quat=[cos(half), 0.0, sin(half), 0.0]
        )
        body.add_joint(name=name + joint, type=mujoco.mjtJoint.mjJNT_HINGE, axis=list(axis))
        _weigh(body, mass)
        motor = spec.add_actuator(name=name + joint, target=name + joint)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    return body


def _weigh(body: mujoco.MjsBody, mass: float) -> None:
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.04, 0.0, 0.0], mass=mass)
