"""What a result depends on: package versions and the plant's constants."""

import platform
from importlib.metadata import version

import mujoco

from sim import element_id

PACKAGES = ("mujoco", "numpy", "scipy", "control", "rerun-sdk", "matplotlib")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that the numbers depend on."""
    return {"python": platform.python_version()} | {name: version(name) for name in PACKAGES}


def plant_constants(model: mujoco.MjModel) -> dict[str, float]:
    """The plant's chosen constants, read from the compiled model."""
    strut = model.joint("strut1")
    payload = element_id(model, "body", "payload")
    bend = model.joint("bottom_bend_x1")
    twist = model.joint("top_twist1")
    return {
        "physics_step_s": model.opt.timestep,
        "gravity_m_per_s2": float(-model.opt.gravity[2]),
        "payload_mass_kg": float(model.body_mass[payload]),
        "payload_inertia_max_kg_m2": float(model.body_inertia[payload].max()),
        "housing_mass_kg": float(model.body("housing1").mass[0]),
        "stem_mass_kg": float(model.body("stem1").mass[0]),
        "tip_mass_kg": float(model.body("tip1").mass[0]),
        "suspension_stiffness_n_per_m": float(strut.stiffness[0]),
        "suspension_damping_n_s_per_m": float(strut.damping[0]),
        "suspension_preload_n": float(strut.stiffness[0] * model.qpos_spring[strut.qposadr[0]]),
        "flexure_bending_stiffness_n_m_per_rad": float(bend.stiffness[0]),
        "flexure_bending_damping_n_m_s_per_rad": float(bend.damping[0]),
        "flexure_torsion_stiffness_n_m_per_rad": float(twist.stiffness[0]),
        "flexure_torsion_damping_n_m_s_per_rad": float(twist.damping[0]),
    }
