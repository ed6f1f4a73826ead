"""Where the payload comes to rest when strut 1 has lost its coil, and perhaps its spring."""

import mujoco
import numpy as np

from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.fault_tolerance import elastic_system, strut_and_payload_stiffness
from experiments.rig.hexapod.metrics import percent
from sim import Array, Plant, hexapod, linearize

STRUT = 0
"""The strut that fails, strut 1 as in the paper."""

_ASKED_RAD = np.array([100e-6, 0.0])
_AT_REST_S = 8.0  # more than ten time constants of the softest motion: 110 N s/m on 197 N/m


def released_statics(model: mujoco.MjModel, ratio: float) -> dict[str, float]:
    """Where the payload comes to rest, 100 urad of alpha asked for, strut 1 without its coil.

    Args:
        model: The hexapod in orbit.
        ratio: Suspension of strut 1 over what its own two flexures put up against its swing.
    """
    swing_n_per_m = _swing_stiffness(model)
    soft = {STRUT: ratio * swing_n_per_m}
    failed = elastic_system(model, soft).with_failures(free=[STRUT]).kinematics()
    sound = elastic_system(model).kinematics()
    fault_unaware = sound.velocity_mapping(MAJOR, joint_weight=np.ones(6))(_ASKED_RAD)
    told = failed.expand(failed.velocity_mapping(MAJOR, joint_weight=np.ones(6))(_ASKED_RAD))
    expected = failed.J @ fault_unaware[failed.actuators]
    locked = np.delete(sound.J, STRUT, axis=1) @ fault_unaware[failed.actuators]

    plant = _released(model, soft[STRUT])
    at_rest = linearize(plant.model, plant.data)
    # Here the coils are forces against springs, and the struts that still have one yield a little.
    linear = -at_rest.C_twist @ np.linalg.solve(at_rest.A, at_rest.B @ fault_unaware)
    twist, extension_m = _at_rest(plant, fault_unaware)
    models = {"elastic": expected, "linear_model": linear, "as_if_locked": locked}
    corrected, _ = _at_rest(_released(model, soft[STRUT]), told)
    passive = list(failed.passive).index(sound.active[STRUT])
    follows = failed.passive_rates(fault_unaware[failed.actuators])[passive]
    return {
        "suspension_over_swing": ratio,
        "suspension_n_per_m": soft[STRUT],
        "swing_n_per_m": swing_n_per_m,
        "all_flexures_n_per_m": _resistance(model, sound.J[:, STRUT]),
        "alpha_simulated_urad": 1e6 * twist[0],
        **{f"alpha_{model}_urad": 1e6 * each[0] for model, each in models.items()},
        "strut_1_simulated_um": 1e6 * extension_m,
        "strut_1_elastic_um": 1e6 * follows,
        **{
            f"mismatch_{model}_percent": percent(twist - each, twist)
            for model, each in models.items()
        },
        "alpha_corrected_urad": 1e6 * corrected[0],
        "beta_corrected_urad": 1e6 * corrected[1],
        "worst_gain_rad_per_m": float(failed.manipulability(MAJOR).worst_gain),
    }


def fall(model: mujoco.MjModel) -> dict[str, float]:
    """Where strut 1 goes on the ground when it loses its spring, and with it its preload."""
    plant = Plant(model)
    plant.break_loose(STRUT)
    twist, extension_m = _at_rest(plant, np.zeros(6))
    stop_m = model.jnt_range[model.joint(f"strut{STRUT + 1}").id, 0]
    return {
        "strut_1_um": 1e6 * extension_m,
        "stop_um": 1e6 * float(stop_m),
        "alpha_urad": 1e6 * twist[0],
        "beta_urad": 1e6 * twist[1],
    }


def _released(model: mujoco.MjModel, suspension: float) -> Plant:
    plant = Plant(model)
    plant.release(STRUT)
    plant.model.jnt_stiffness[plant.model.actuator_trnid[STRUT, 0]] = suspension
    return plant


def _at_rest(plant: Plant, command_m: Array) -> tuple[Array, float]:
    """Payload twist and extension of the released strut once everything has come to rest."""
    plant.step(command_m, _AT_REST_S)
    return plant.displacement(), float(plant.displacements()[STRUT])


def _swing_stiffness(model: mujoco.MjModel) -> float:
    """What both flexures of a strut put up against its swing, at its top, [N]/[m]."""
    bend = sum(
        model.jnt_stiffness[model.joint(f"{end}_bend_x{STRUT + 1}").id] for end in ("bottom", "top")
    )
    geometry = hexapod(model)
    return float(bend / np.sum((geometry.top_m - geometry.bottom_m)[STRUT] ** 2))


def _resistance(model: mujoco.MjModel, column: Array) -> float:
    """What all flexures together put up against one strut's length, the others held, [N]/[m]."""
    return float(column @ strut_and_payload_stiffness(model)[6:, 6:] @ column)
