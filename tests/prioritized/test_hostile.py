"""Test that hostile arguments of `prioritized` give one error message or finite numbers."""

from functools import cache
from typing import Any

import numpy as np

import prioritized
from prioritized import (
    ConstrainedSystem,
    ForceMapping,
    Kinematics,
    Task,
    Tick,
    VelocityMapping,
    failure_atlas,
    force_mapping,
    velocity_mapping,
)
from prioritized._mechanism.failures import Failures
from prioritized._mechanism.names import Names
from prioritized._postures import Postures
from tests.hostile import Package, one_by_one, public, two_at_once


def one_level(levels: Any, lower: Any) -> Any:
    """Solve with the numbers of one level."""
    return prioritized.lexicographic_least_squares(
        [(levels, lower), (np.eye(3, 4), -1.0, 1.0)], lower=-1.0, upper=1.0
    )


def one_target(targets: Any) -> Any:
    """Solve with the numbers of one target of two."""
    return package().objects["Hierarchy"].solve([targets, None])


TRUSTED = {
    # Returned by the library; names are checked when they are used.
    *("Attainable", "Classes", "FailureAtlas", "ForceMapping", "ForceSolution"),
    *("Hierarchy", "HierarchySolution", "Kinematics", "Manipulability"),
    *("Postures", "Tick", "VelocityMapping", "VelocitySolution"),
    # Called inside the library with checked arguments.
    *("Hierarchy.undamped", "Tick.at", "Tick.limits", "Tick.of_plain", "Tick.at_jacobians"),
    *("HierarchySolution.describe", "Tick.of"),
}
CALLABLES = public(prioritized, Postures, one_level, one_target, trusted=TRUSTED)


def numbers(result: Any, **more: Any) -> dict[str, Any]:
    """Return all public numbers of a result, and its status."""
    names = "x rates torques residual residuals scale gains active gap steps certificate status"
    names += " secondary_force internal_force active_rows active_limits damping_errors J gain"
    names += " self_motion active_constraint passive_gain passive_self_motion major joint secondary"
    names += " achieved reaction vertices findings worst_gain"
    return {name: getattr(result, name) for name in names.split() if hasattr(result, name)} | more


def velocities(mapping: VelocityMapping) -> dict[str, Any]:
    """Return the numbers of a mapping; an exact one must achieve its major task."""
    v = np.ones(len(mapping._problem.S_m))
    rates = mapping(v)
    if mapping.status is prioritized.Status.EXACT and mapping._limiting is None:
        done = (mapping._problem.major_jacobian @ rates[..., None])[..., 0]
        assert np.allclose(done, v, rtol=0, atol=1e-4)
    far = None if mapping._limiting is None else numbers(mapping.solve(9 * v))
    return numbers(mapping, rates=rates, far=far, residual_v=mapping.residual(v))


def torques(mapping: ForceMapping) -> dict[str, Any]:
    f = np.ones(mapping.major.shape[-1])
    forces = (mapping(f), mapping.secondary_force(f), mapping.internal_force(f))
    far = None if mapping._limiting is None else numbers(mapping.solve(9 * f))
    return numbers(mapping, forces=forces, residual_f=mapping.residual(f), far=far)


def mechanism(kin: Kinematics) -> dict[str, Any]:
    f_C = kin.constraint_force(np.ones(len(kin.J)), np.ones(len(kin.active)))
    return numbers(kin, f_C=f_C, report=numbers(kin.manipulability([0])))


def extent(a: prioritized.Attainable) -> dict[str, Any]:
    """Return the numbers of a set, infinite where there is no limit."""
    return numbers(a, radius_gap=a.radius, support_gap=a.support(np.eye(len(a.gain))), text=str(a))


@cache
def package() -> Package:
    """Return arguments for four joints, and for three motors and two passive joints."""
    rng = np.random.default_rng(7)
    J, J_T, J_C = rng.normal(size=(3, 4)), rng.normal(size=(3, 5)), rng.normal(size=(1, 5))
    batch, many_J_T, many_J_C = (rng.normal(size=(2, *shape)) for shape in ((3, 4), (3, 5), (1, 5)))
    system = ConstrainedSystem(J_T, J_C, [0, 1, 2])
    sprung = ConstrainedSystem(J_T, J_C, [0, 1, 2], stiffness=np.ones(5))
    kin, loose = system.kinematics(), system.with_failures(free=[1]).kinematics()
    closed = ConstrainedSystem(J_T, rng.normal(size=(2, 5)), [0, 1, 2]).kinematics()
    steady = closed.hierarchy([Task([0]), Task.joints()])
    levels = [Task([0]), Task([1, 2], interval=True)]
    hierarchy = kin.hierarchy(levels, rate_limits=(-1.0, 1.0))
    ticked = {"J_T": J_T, "J_C": closed.system.J_C, "targets": np.ones(4)}
    ticked |= {"velocity_limits": (-np.ones(5), np.ones(5)), "error_bound": 0.0}
    weighed: dict[str, Any] = {"joint_weight": np.ones(4), "secondary_weight": np.ones(1)}
    forced: dict[str, Any] = {"torque_weight": np.ones(4), "secondary_weight": np.ones(1)}
    one = velocity_mapping(J, [0, 1], **weighed)
    within = velocity_mapping(J, [0, 1], rate_limits=(-np.ones(4), 0.2))
    force = force_mapping(J, [0, 1], **forced)
    fixed = force_mapping(J, [0, 1], torque_limits=(-np.ones(4), 0.2))

    def limits(n: int) -> np.ndarray:
        return rng.random((2, n)) - [[1], [0]]

    def solve_tick(tick: Tick) -> dict[str, Any]:
        result = tick(**ticked)
        return {} if result is None else {"velocities": result}

    no_limits: dict[str, Any] = {"rate_limits": ..., "rate_rows": ..., "when_limited": ...}
    no_forces: dict[str, Any] = {"torque_limits": ..., "torque_rows": ..., "force_rows": ...}
    no_forces |= {"when_limited": ...}
    rows, rows_3 = (J[:1], -1.0, 1.0), (np.ones((1, 3)), -1.0, 1.0)
    three = {"joint_weight": np.ones(3), "torque_weight": np.ones(3), "secondary": [1, 2]}
    three |= {"major": [0], "secondary_weight": np.ones(2), "major_metric": np.ones(1)}
    three |= {"tie_metric": np.ones(3)}

    def box(**more: Any) -> dict[str, Any]:
        """Return arguments of a velocity mapping with a secondary task within limits."""
        return {"secondary": [2], "secondary_weight": np.ones(1)} | more

    good = {
        **{"J": J, "major": [0, 1], "secondary": [2], "damping": 0.1, "scale": 3.0},
        **{"joint_weight": np.ones(4), "torque_weight": np.ones(4), "tie_metric": np.ones(4)},
        **{"secondary_weight": np.ones(1), "major_metric": np.ones(2), "rank_tolerance": 1e-10},
        **{"active_constraint": rng.normal(size=(1, 4)), "self_motion": rng.normal(size=(3, 1))},
        **{"v_major": np.ones(2), "joint_velocity": np.ones(4), "secondary_velocity": np.ones(1)},
        **{"f_major": np.ones(2), "torque": np.ones(4), "secondary_force": np.ones(1), "J_T": J_T},
        **{"J_C": J_C, "active": [0, 1, 2], "stiffness": np.ones(5), "failures": Failures()},
        **{"names": Names(tuple("abcde"), (("m",),) * 3), "accuracy": None},
        **{"geometry_accuracy": 1e-9, "mechanism": sprung, "springs": True, "system": system},
        **{"locked": [0], "free": [1], "locked_passive": [4], "passive_metric": np.eye(5)},
        **{"rates": np.ones(2), "f": np.ones(3), "torques": np.ones(2), "direction": np.ones(2)},
        **{"codes": np.zeros((2, 3)), "row": 1, "kinematics": kin, "basis": np.eye(3)[:, :2]},
        **{"position": np.zeros(3), "rate": np.ones(3), "period_s": 0.1, "most_steps": 100},
        **{"position_limits": (-np.ones(3), 1.0), "acceleration_limits": (-3.0, 4.0)},
        **{"levels": levels, "lower": -np.ones(4), "upper": np.ones(4)},
        **{"rows": rng.normal(size=(2, 4)), "rows_lower": -np.ones(2), "rows_upper": np.ones(2)},
        **{"start": None, "weight": np.ones(2)},
        **{"targets": [np.ones(1), np.ones((2, 2))], "rate_limits": limits(3)},
        **{"torque_limits": limits(3), "rate_rows": rows_3, "torque_rows": rows_3},
        **{"force_rows": (J_T[:1, :3], -1.0, 1.0), "when_limited": "scaled"},
    }
    special: dict[str, dict[str, Any]] = {
        "velocity_mapping": no_limits,
        "velocity_mapping undamped": box(joint_weight=np.ones(4)),
        "velocity_mapping of directions": {"major": J[:1, :3], "secondary": J[1:, :3]}
        | {"joint_weight": np.eye(4)},
        "velocity_mapping of joints alone": {"major": [0], "joint_weight": np.ones(4)},
        "velocity_mapping of a batch": {"J": batch, "joint_weight": np.stack([np.eye(4)] * 2)}
        | {"scale": 3.0},
        "velocity_mapping within limits": box(joint_weight=np.ones(4), rate_limits=limits(4))
        | {"rate_rows": rows, "when_limited": "scaled"},
        "velocity_mapping within a box": box(rate_limits=(-0.1 * np.ones(4), 0.1 * np.ones(4))),
        "VelocityMapping.__call__ of a batch": {"joint_velocity": np.ones(4)}
        | {"self": velocity_mapping(batch, [0, 1], **weighed), "secondary_velocity": np.ones(1)},
        "VelocityMapping.at": {"self": kin.velocity_mapping([0])},
        "VelocityMapping.solve": {"self": within, "start": within.solve(np.ones(2))},
        "VelocityMapping.with_limits": {"self": within, "rate_limits": (-np.ones(4), 0.2)},
        "force_mapping": no_forces,
        "force_mapping of a batch": {"J": batch, "torque_weight": np.stack([np.eye(4)] * 2)}
        | {"scale": 3.0},
        "force_mapping within limits": box(torque_weight=np.ones(4), torque_limits=limits(4))
        | {"torque_rows": rows, "force_rows": (J[:1, :3], -1.0, 1.0), "when_limited": "scaled"},
        "ForceMapping.solve": {"self": fixed, "start": fixed.solve(np.ones(2))},
        "ConstrainedSystem": {"geometry_accuracy": ..., "accuracy": ...},
        "ConstrainedSystem of a model": {"geometry_accuracy": 1e-9, "names": good["names"]},
        "ConstrainedSystem with its accuracy": {"accuracy": None},
        "ConstrainedSystem.with_failures": {"self": sprung},
        "ConstrainedSystem.postures": {"J_T": many_J_T, "J_C": many_J_C},
        "ConstrainedSystem.kinematics": {"self": system.with_failures(free=[0, 1, 2])},
        "Postures.passive_rates": {"rates": np.ones((2, 3))},
        "Postures.velocities": {"rates": np.ones((2, 3))},
        "Postures.velocity_mapping": {"joint_weight": np.ones(3), "damping": ...},
        "Kinematics.expand": {"self": kin, "rates": np.ones(3)},
        "Kinematics.manipulability": {"self": kin, "major": J[:1, :3]},
        "Kinematics.velocity_mapping": three | no_limits | {"damping": 0.0},
        "Kinematics.velocity_mapping within limits": {"major": [0], "rate_limits": limits(3)}
        | {"rate_rows": rows_3, "when_limited": "scaled"},
        "Kinematics.force_mapping": three | no_forces,
        "Kinematics.force_mapping within limits": {"major": [0], "torque_limits": limits(3)}
        | {"torque_rows": rows_3, "force_rows": good["force_rows"], "when_limited": "scaled"},
        "Kinematics.attainable": {"major": [0]},
        "Kinematics.attainable of directions": {"self": kin, "major": J[:2, :3]}
        | {"rate_limits": (-1.0, 2.0)},
        "Kinematics.attainable_force": {"major": [0]},
        "Kinematics.hierarchy": {"tie_metric": np.ones(3)},
        "Hierarchy.tick": {"self": steady, "kinematics": closed},
        "Tick.__call__": ticked,
        "Task": {"rows": J[:2, :3], "weight": np.ones(2)},
        "Task.joints": {"weight": np.ones(3)},
        "failure_atlas": {"major": [0], "secondary": [1, 2]}
        | {"rate_limits": ..., "torque_limits": ...},
        "failure_atlas with limits": {"system": sprung, "major": [0], "codes": np.zeros((2, 3))}
        | {"rate_limits": limits(3), "torque_limits": limits(3)},
        "failure_atlas of springs": {"system": sprung, "major": [0], "secondary": [1, 2]},
        "viable_rates": {"rate_limits": (-2.0, 2 * np.ones(3))},
        "viable_rates of arrays": {name: limits(3) for name in good if name.endswith("n_limits")}
        | {"rate_limits": limits(3)},
        "lexicographic_least_squares": {"levels": [(J, np.ones(3))]},
        "one_level": {"levels": J, "lower": np.ones(3)},
        "one_target": {"targets": np.ones(1)},
    }
    objects = {"VelocityMapping": one, "ForceMapping": force, "Kinematics": loose}
    objects |= {"Tick": steady.tick(closed), "FailureAtlas": failure_atlas(system, [0])}
    objects |= {"Postures": system.postures(many_J_T, many_J_C), "ConstrainedSystem": system}
    objects |= {"Attainable": kin.attainable([0, 1], (-1.0, 1.0)), "Hierarchy": hierarchy}
    uses = {
        **{"VelocityMapping": velocities, "ForceMapping": torques, "Attainable": extent},
        **{"Postures": numbers, "Tick": solve_tick, "HierarchySolution": numbers},
        **{"ConstrainedSystem": lambda made: mechanism(made.kinematics()), "Kinematics": mechanism},
        **{"Task": lambda task: numbers(kin.hierarchy([task]).solve([None]))},
        **dict.fromkeys(("Solution", "VelocitySolution", "ForceSolution"), numbers),
        "Hierarchy": lambda made: numbers(made.solve(good["targets"])),
    }
    ranges = {"scale": (0, np.inf), "damping": (0, np.inf), "rank_tolerance": (0, 0.5)}
    return Package(
        callables=CALLABLES,
        good=good,
        special=special,
        objects=objects,
        uses=uses,
        ranges=ranges,
        unbounded=("gap", "worst_gain", "worst_speed", "worst_force"),
    )


test_a_hostile_argument_is_reported_or_harmless = one_by_one(package, CALLABLES)
test_two_hostile_arguments_are_reported_or_harmless = two_at_once(package)
