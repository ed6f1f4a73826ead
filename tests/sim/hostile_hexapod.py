"""Targets of hostile arguments: the hexapod, the parts of its bench, and any model."""

from typing import Any

import mujoco
import numpy as np

from fjh.rig.hexapod.amplifier import Amplifier, displacement_limits
from fjh.rig.hexapod.closed_form import Hexapod, Posture, hexapod
from fjh.rig.hexapod.coil import Coils
from fjh.rig.hexapod.detector import Detector, pointing_angles, secondary_motion
from fjh.rig.hexapod.forward import forward_kinematics
from fjh.rig.hexapod.strut_sensors import StrutSensors
from fjh.rig.hexapod.trajectory import spiral
from sim import HEXAPOD_MJCF, NOMINAL, Pose, jacobians, linearize, load_model
from sim.mjcf import element_id, joint_stiffness, mass_matrix, model_sha256, weightless
from sim.plant import MaxwellSlip
from tests.hostile import Target

MODEL = load_model()
DATA = mujoco.MjData(MODEL)
MACHINE = hexapod(MODEL)
POSTURE = MACHINE.posture(NOMINAL)
AMPLIFIER: dict[str, Any] = {"bits": 16, "full_input_a": 4.0, "limit_a": 3.0, "newton_per_a": 20.0}
AMPLIFIER |= {"newton_per_m": 1e5}
COILS: dict[str, Any] = {"resistance_ohm": 5.0, "heat_capacity_j_per_k": 4.0, "ambient_c": 20.0}
COILS |= {"thermal_resistance_k_per_w": np.full(2, 1.5)}
DETECTOR = {"focal_length_m": 1.0, "half_width_m": 5e-3, "noise_m": 3e-7}
POSE = {"rotation": np.eye(3), "translation_m": np.zeros(3)}
WARM = {"temperature_c": np.full(2, 30.0), "current_a": np.ones(2)}
ROTATIONS = np.stack([np.eye(3)] * 2)


def drives(**given: Any) -> Any:
    amplifier = Amplifier(**given)
    return amplifier.displacements(amplifier.inputs(np.array([1e-4, -1.0])))


def slipped(**given: Any) -> Any:
    slip = MaxwellSlip(**given)
    return slip.force(slip.moved(np.zeros(slip.slip.shape), np.full(len(slip.slip), 1e-5)))


def warmed(**given: Any) -> Any:
    coils = Coils(**given)
    cold = coils.cold()
    return coils.step(cold, np.ones(cold.shape), 1e-3)


def seen(**given: Any) -> Any:
    return Detector(**given).read(np.eye(3), np.random.default_rng(0))


def struts(geometry: Hexapod, pose: Pose = NOMINAL) -> Any:
    return geometry.nominal_length_m, geometry.posture(pose)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


SITES = {"site": "payload", "axes": "base"}
MACHINES = {"model": MODEL, "data": DATA}
TWIST = {"twist": np.full(6, 1e-3)}

TARGETS = {
    "Amplifier": Target(drives, AMPLIFIER),
    "Amplifier.inputs": Target(Amplifier(**AMPLIFIER).inputs, {"displacement_m": np.full(6, 1e-4)}),
    "Amplifier.current_a": Target(Amplifier(**AMPLIFIER).current_a, {"input_percent": np.ones(6)}),
    "Amplifier.displacements": Target(
        Amplifier(**AMPLIFIER).displacements, {"input_percent": np.ones(6)}
    ),
    "displacement_limits": Target(
        displacement_limits,
        {"model": MODEL, "amplifier": Amplifier(**AMPLIFIER), "current_limit_a": np.ones(6)},
    ),
    "Coils": Target(warmed, COILS),
    "Coils.net_power_w": Target(Coils(**COILS).net_power_w, WARM),
    "Coils.step": Target(Coils(**COILS).step, WARM | {"period_s": 1e-3}),
    "Coils.temperatures_c": Target(
        Coils(**COILS).temperatures_c, {"current_a": np.ones((3, 2)), "period_s": 1e-3}
    ),
    "Detector": Target(seen, DETECTOR),
    "Detector.read": Target(
        lambda **a: Detector(**DETECTOR).read(**a), {"rotation": np.eye(3), "rng": rng()}
    ),
    "MaxwellSlip": Target(
        slipped, {"stiffness": np.full((2, 3), 1e3), "slip": np.full((2, 3), 1e-6)}
    ),
    "StrutSensors": Target(
        lambda **a: StrutSensors(**a).read(np.zeros(6), rng()), {"noise_m": 1e-9}
    ),
    "StrutSensors.read": Target(
        StrutSensors(1e-9).read, {"displacement_m": np.full(6, 1e-5), "rng": rng()}
    ),
    "pointing_angles": Target(pointing_angles, {"rotation": ROTATIONS}),
    "secondary_motion": Target(
        secondary_motion, {"rotation": ROTATIONS, "translation_m": np.ones((2, 3))}
    ),
    "spiral": Target(
        spiral,
        {"time_s": np.arange(3.0), "radius_rad": 1e-4, "turns": 8.0, "duration_s": 16.0}
        | {"exponent": 0.5, "start_rad": 1.0},
    ),
    "Pose": Target(lambda **a: struts(MACHINE, Pose(**a)), POSE),
    "Pose.from_matrix": Target(Pose.from_matrix, {"T": np.eye(4)}),
    "Pose.moved": Target(NOMINAL.moved, TWIST),
    "Pose.moved of a batch": Target(NOMINAL.moved, {"twist": np.full((2, 6), 1e-3)}),
    "Posture": Target(
        lambda **a: Posture(**a).twist(np.ones(6)),
        POSE | {"displacement_m": np.zeros(6), "inverse_jacobian": POSTURE.inverse_jacobian},
    ),
    "Posture.twist": Target(POSTURE.twist, {"displacement_m": np.full(6, 1e-5)}),
    "Hexapod": Target(
        lambda **a: struts(Hexapod(**a)), {"bottom_m": MACHINE.bottom_m, "top_m": MACHINE.top_m}
    ),
    "Hexapod.displacements": Target(MACHINE.displacements, {"pose": NOMINAL}),
    "Hexapod.moved": Target(MACHINE.moved, {"pose": NOMINAL, "displacement_m": np.full(6, 1e-5)}),
    "Hexapod.lengths_and_jacobian": Target(
        MACHINE.lengths_and_jacobian, {"pose": NOMINAL, "singular": False}
    ),
    "Hexapod.inverse_jacobian": Target(MACHINE.inverse_jacobian, {"pose": NOMINAL}),
    "Hexapod.posture": Target(MACHINE.posture, {"pose": NOMINAL}),
    "hexapod": Target(hexapod, {"model": MODEL}),
    "forward_kinematics": Target(
        forward_kinematics,
        {"geometry": MACHINE, "displacements_m": np.full(6, 1e-5), "start": NOMINAL}
        | {"most_steps": 60},
    ),
    "mass_matrix": Target(mass_matrix, MACHINES),
    "joint_stiffness": Target(joint_stiffness, {"model": MODEL}),
    "jacobians": Target(jacobians, MACHINES | SITES),
    "linearize": Target(linearize, MACHINES | SITES),
    "element_id": Target(element_id, {"model": MODEL, "kind": "site", "name": "base"}),
    "load_model": Target(load_model, {"path": HEXAPOD_MJCF, "add_locks": False}),
    "model_sha256": Target(model_sha256, {"path": HEXAPOD_MJCF}),
    "weightless": Target(weightless, {"model": MODEL}),
}
