"""Measures of a run (errors, margins) and their tolerances; constants of the plant."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import mujoco
import numpy as np

from fjh.rig.hexapod.controller import Loop
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.study.provenance import version_properties
from sim import Array
from sim.mjcf import element_id


def finite_or_none(value: float) -> float | None:
    """Return the value, or None if it is infinite, which JSON cannot represent."""
    return value if np.isfinite(value) else None


def loop_measures(loop: Loop) -> dict[str, Any]:
    """Return compensator and margins of one pointing loop, ready for JSON."""
    return {
        "numerator": loop.numerator.tolist(),
        "denominator": loop.denominator.tolist(),
        "crossover_hz": loop.crossover_hz,
        "gain_margin_db": finite_or_none(loop.gain_margin_db),
        "phase_margin_deg": loop.phase_margin_deg,
        "phase_crossover_hz": finite_or_none(loop.phase_crossover_hz),
        "sentence": str(loop),
    }


def percent(difference: Array, whole: Array) -> float:
    """Return the size of a difference of twists or wrenches (..., 6), in percent of the whole.

    The result is the larger of the two ratios for rotation and translation, or moment and force.
    """
    parts = (slice(0, 3), slice(3, 6))
    ratios = [np.linalg.norm(difference[..., p]) / np.linalg.norm(whole[..., p]) for p in parts]
    return float(100 * max(ratios))


PREDICTION_TOLERANCE = 0.004
"""Largest relative difference of a complete run's RMS from that expected by the linear model.

The largest measured difference is 0.13 %, over all columns of Table I and eight seeds.
"""


def prediction_tolerance(duration_s: float) -> float:
    """Return the largest relative difference from the linear model's RMS over part of the spiral.

    Over a shorter part the error is smaller and the detector noise is averaged less, so that the
    RMS scatters more: up to 1.13 % over 4 s.
    """
    return PREDICTION_TOLERANCE * (TestbedConfig().duration_s / duration_s) ** 1.5


def is_cut(summary: Mapping[str, Any]) -> bool:
    """Return True if only part of the spiral was run: then it is not comparable with the paper."""
    return summary["duration_s"] < summary["bench"]["duration_s"]


def plant_constants(model: mujoco.MjModel) -> dict[str, float | list[float]]:
    """Return the constants of the compiled model; those of the first strut stand for all struts.

    Raises:
        sim.ModelError: The model lacks one of the named parts.
    """
    part = partial(element_id, model)
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
    """Return the constants and versions of a recording, as flat properties for Rerun."""
    plain = {key: summary[key] for key in ("seed", "model_sha256", "jacobian")}
    # None is omitted: Rerun accepts one type for each name in a process.
    bench = {name: value for name, value in summary["bench"].items() if value is not None}
    return plain | version_properties(summary) | bench
