"""The plant's constants, as every result and recording of the hexapod carries them."""

from typing import Any

import mujoco
import numpy as np

from experiments.output.provenance import version_properties
from sim import element_id


def plant_constants(model: mujoco.MjModel) -> dict[str, float | list[float]]:
    """The plant's constants, read from the compiled model; struts are alike, the first speaks.

    Raises:
        sim.ModelError: The model lacks one of the named parts.
    """

    def part(kind: str, name: str) -> int:
        return element_id(model, kind, name)

    strut, payload, tip = part("joint", "strut1"), part("body", "payload"), part("body", "tip1")
    bend, twist = part("joint", "bottom_bend_x1"), part("joint", "top_twist1")
    stiffness, damping = model.jnt_stiffness, model.dof_damping[model.jnt_dofadr]
    lock, coil = part("equality", "lock1"), part("actuator", "coil1")
    preload_m = model.qpos_spring[model.jnt_qposadr[strut]]
    constants = {
        "physics_step_s": model.opt.timestep,
        "gravity_m_per_s2": 0.0 - model.opt.gravity[2],
        "payload_mass_kg": model.body_mass[payload],
        "payload_principal_inertia_kg_m2": model.body_inertia[payload],
        "housing_mass_kg": model.body_mass[part("body", "housing1")],
        "stem_mass_kg": model.body_mass[part("body", "stem1")],
        "tip_mass_kg": model.body_mass[tip],
        "tip_inertia_kg_m2": model.body_inertia[tip, 0],
        "suspension_stiffness_n_per_m": stiffness[strut],
        "suspension_damping_n_s_per_m": damping[strut],
        "suspension_preload_n": stiffness[strut] * preload_m,
        "suspension_stops_m": model.jnt_range[strut],
        "coil_gain_n_per_m": model.actuator_gainprm[coil, 0],
        "coil_force_limit_n": model.actuator_forcerange[coil, 1],
        "flexure_bending_stiffness_n_m_per_rad": stiffness[bend],
        "flexure_bending_damping_n_m_s_per_rad": damping[bend],
        "flexure_torsion_stiffness_n_m_per_rad": stiffness[twist],
        "flexure_torsion_damping_n_m_s_per_rad": damping[twist],
        "closure_time_constant_s": model.eq_solref[lock, 0],
        "closure_impedance": model.eq_solimp[lock, 0],
    }
    return {name: np.asarray(value).tolist() for name, value in constants.items()}


def recording_properties(summary: dict[str, Any]) -> dict[str, Any]:
    """What makes a recording self-describing, flat as Rerun's properties are."""
    plain = {key: summary[key] for key in ("seed", "model_sha256", "jacobian")}
    # What is None is absent: Rerun knows one type for each name in a process.
    bench = {name: value for name, value in summary["bench"].items() if value is not None}
    return plain | version_properties(summary) | bench
