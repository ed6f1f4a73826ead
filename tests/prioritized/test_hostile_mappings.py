"""No hostile argument of `prioritized` ends in anything but one sentence or finite numbers."""

from typing import Any

import numpy as np
import pytest

import prioritized
from prioritized import (
    Attainable,
    ConstrainedSystem,
    FailureAtlas,
    ForceMapping,
    Kinematics,
    Status,
    Task,
    Tick,
    VelocityMapping,
    canonical_basis,
    failure_atlas,
    force_mapping,
    lexicographic_least_squares,
    velocity_mapping,
    viable_rates,
)
from prioritized._mechanism.failures import Failures
from prioritized._mechanism.names import Names
from prioritized._postures import Postures
from tests.hostile import Target, complaints, unattacked

RNG = np.random.default_rng(7)
J = RNG.normal(size=(3, 4))
BATCH = RNG.normal(size=(2, 3, 4))
J_T = RNG.normal(size=(3, 5))
J_C = RNG.normal(size=(1, 5))
SPRUNG = ConstrainedSystem(J_T, J_C, [0, 1, 2], stiffness=np.ones(5))
SYSTEM = ConstrainedSystem(J_T, J_C, [0, 1, 2])
KIN = SYSTEM.kinematics()
MANY_J_T, MANY_J_C = RNG.normal(size=(2, 3, 5)), RNG.normal(size=(2, 1, 5))
POSTURES = SYSTEM.postures(MANY_J_T, MANY_J_C)
LOOSE = SYSTEM.with_failures(free=[1]).kinematics()


def rates(mapping: VelocityMapping) -> dict[str, Any]:
    """All numbers of a velocity mapping; an exact one must meet its major task."""
    S_m = mapping._problem.S_m
    v = np.ones(len(S_m))
    answer = mapping(v)
    if mapping.status is Status.EXACT:
        done = (mapping._problem.major_jacobian @ answer[..., None])[..., 0]
        assert np.allclose(done, v, rtol=0, atol=1e-4)
    gains = (mapping.major, mapping.joint, mapping.secondary, mapping.achieved)
    return {"rates": answer, "gains": gains, "gap": mapping.gap, "rest": mapping.residual(v)}


def torques(mapping: ForceMapping) -> dict[str, Any]:
    """All numbers of a force mapping."""
    f = np.ones(mapping.major.shape[-1])
    forces = (mapping(f), mapping.secondary_force(f), mapping.internal_force(f))
    return {"mapping": mapping, "forces": forces, "rest": mapping.residual(f)}


def mechanism(kin: Kinematics) -> dict[str, Any]:
    """All numbers of a mechanism."""
    names = "J self_motion internal_force active_constraint passive_gain passive_self_motion"
    names += " gap"
    report = kin.manipulability([0])
    arrays: dict[str, Any] = {name: getattr(kin, name) for name in names.split()}
    arrays["f_C"] = kin.constraint_force(np.ones(len(kin.J)), np.ones(len(kin.active)))
    return arrays | {"findings": report.findings, "worst_gain": report.worst_gain}


def reached(postures: Postures) -> dict[str, Any]:
    """All numbers of a batch of postures."""
    names = ("J", "active_constraint", "self_motion", "passive_gain")
    return {name: getattr(postures, name) for name in names}


def reach(a: Attainable) -> dict[str, Any]:
    """All numbers of an attainable set; infinite where a limit is, or none."""
    unlimited = {"radius_gap": a.radius, "support_gap": a.support(np.eye(len(a.gain)))}
    return unlimited | {"gain": a.gain, "vertices": a.vertices, "sentence": str(a)}


def worst(atlas: FailureAtlas) -> dict[str, Any]:
    """The numbers of an atlas that limits change; infinite where a limit is, or none."""
    return {"speed_gap": atlas.worst_speed, "force_gap": atlas.worst_force, "gap": atlas.gap}


def limited(mapping: VelocityMapping | ForceMapping, wanted: str) -> dict[str, Any]:
    """All numbers of a solution under limits that hold the task back."""
    found = mapping.solve(9 * np.ones(len(mapping._problem.S_m)))
    return {"x": getattr(found, wanted), "active": found.active_limits} | answer(found)


def answer(found: Any) -> dict[str, Any]:
    """All public numbers of a solution, and its status."""
    names = "x rates torques residual residuals scale gains active gap steps certificate status"
    names += " secondary_force internal_force active_rows damping_errors"
    return {name: getattr(found, name) for name in names.split() if hasattr(found, name)}


CLOSED = ConstrainedSystem(J_T, RNG.normal(size=(2, 5)), [0, 1, 2]).kinematics()
STEADY = CLOSED.hierarchy([Task([0]), Task.joints()])


def met(tick: Tick | None, **changes: Any) -> dict[str, Any]:
    """What a tick answers; nothing where others decide."""
    assert tick is not None
    given = {"J_T": J_T, "J_C": CLOSED.system.J_C, "targets": np.ones(4)}
    given |= {"velocity_limits": (-np.ones(5), np.ones(5))}
    found = tick(**given | changes)
    return {} if found is None else {"velocities": found}


PROBLEM = {"J": J, "major": [0, 1], "secondary": [2], "secondary_weight": np.ones(1)}
FULL = {
    "active_constraint": RNG.normal(size=(1, 4)),
    "self_motion": RNG.normal(size=(3, 1)),
    "major_metric": np.ones(2),
    "tie_metric": np.ones(4),
    "scale": 3.0,
    "rank_tolerance": 1e-10,
}
RATES = {"v_major": np.ones(2), "joint_velocity": np.ones(4), "secondary_velocity": np.ones(1)}
FORCES = {"f_major": np.ones(2), "torque": np.ones(4), "secondary_force": np.ones(1)}
ONE = velocity_mapping(J, [0, 1], joint_weight=np.ones(4), secondary_weight=[1.0])
MANY = velocity_mapping(BATCH, [0, 1], joint_weight=np.ones(4), secondary_weight=[1.0])
FORCE = force_mapping(J, [0, 1], torque_weight=np.ones(4), secondary_weight=[1.0])
LIMITS = np.array([[-1.0, -2.0, -1.0], [1.0, 1.0, 3.0]])
WITHIN = velocity_mapping(J, [0, 1], rate_limits=(-np.ones(4), 0.2))
HELD = force_mapping(J, [0, 1], torque_limits=(-np.ones(4), 0.2))
LEVELS = KIN.hierarchy([Task([0]), Task([1, 2], interval=True)], rate_limits=(-1.0, 1.0))
ATLAS = failure_atlas(SYSTEM, [0])
CODES = {"codes": np.zeros((2, 3)), "system": SYSTEM, "major": [0], "secondary": [1, 2]}

TARGETS = {
    "velocity_mapping": Target(
        lambda **a: rates(velocity_mapping(**a)), PROBLEM | {"joint_weight": np.ones(4)}
    ),
    "velocity_mapping of directions": Target(
        lambda **a: rates(velocity_mapping(**a)),
        {"J": J, "major": J[:1, :3], "secondary": J[1:, :3], "joint_weight": np.eye(4)},
    ),
    "velocity_mapping of joints alone": Target(
        lambda **a: rates(velocity_mapping(**a)),
        {"J": J, "major": [0], "joint_weight": np.ones(4)},
    ),
    "velocity_mapping with all": Target(
        lambda **a: rates(velocity_mapping(**a)),
        PROBLEM | FULL | {"joint_weight": np.ones(4), "damping": 0.1},
    ),
    "velocity_mapping of a batch": Target(
        lambda **a: rates(velocity_mapping(**a)),
        {"J": BATCH, "major": [0, 1], "joint_weight": np.stack([np.eye(4)] * 2), "scale": 3.0},
    ),
    "VelocityMapping": Target(lambda **a: ONE(**a), RATES),
    "VelocityMapping of a batch": Target(lambda **a: MANY(**a), RATES),
    "VelocityMapping.residual": Target(ONE.residual, {"v_major": np.ones(2)}),
    "VelocityMapping.at": Target(
        lambda **a: KIN.velocity_mapping([0]).at(**a)(1.0), {"kinematics": KIN}
    ),
    "force_mapping": Target(
        lambda **a: torques(force_mapping(**a)), PROBLEM | {"torque_weight": np.ones(4)}
    ),
    "force_mapping with all": Target(
        lambda **a: torques(force_mapping(**a)), PROBLEM | FULL | {"torque_weight": np.ones(4)}
    ),
    "force_mapping of a batch": Target(
        lambda **a: torques(force_mapping(**a)),
        {"J": BATCH, "major": [0, 1], "torque_weight": np.stack([np.eye(4)] * 2), "scale": 3.0},
    ),
    "ForceMapping": Target(lambda **a: FORCE(**a), FORCES),
    "ForceMapping.secondary_force": Target(FORCE.secondary_force, FORCES),
    "ForceMapping.internal_force": Target(FORCE.internal_force, FORCES),
    "ForceMapping.residual": Target(FORCE.residual, {"f_major": np.ones(2)}),
    "ConstrainedSystem": Target(
        lambda **a: mechanism(ConstrainedSystem(**a).kinematics()),
        {"J_T": J_T, "J_C": J_C, "active": [0, 1, 2], "rank_tolerance": 1e-10}
        | {"stiffness": np.ones(5), "failures": Failures()},
    ),
    "ConstrainedSystem of a model": Target(
        lambda **a: mechanism(ConstrainedSystem(J_T, J_C, [0, 1, 2], **a).kinematics()),
        {"geometry_accuracy": 1e-9, "names": Names(("a", "b", "c", "d", "e"), (("m",),) * 3)},
    ),
    "ConstrainedSystem.of": Target(
        lambda **a: mechanism(ConstrainedSystem.of(**a).kinematics()),
        {"mechanism": SPRUNG, "springs": True, "geometry_accuracy": 1e-9},
    ),
    "ConstrainedSystem.with_failures": Target(
        lambda **a: mechanism(SPRUNG.with_failures(**a).kinematics()),
        {"locked": [0], "free": [1], "locked_passive": [4]},
    ),
    "ConstrainedSystem.postures": Target(
        lambda **a: reached(SYSTEM.postures(**a)), {"J_T": MANY_J_T, "J_C": MANY_J_C}
    ),
    "Postures.passive_rates": Target(POSTURES.passive_rates, {"rates": np.ones((2, 3))}),
    "Postures.velocities": Target(POSTURES.velocities, {"rates": np.ones((2, 3))}),
    "Postures.velocity_mapping": Target(
        lambda **a: rates(POSTURES.velocity_mapping(**a)),
        {"major": [0, 1], "secondary": [2], "joint_weight": np.ones(3), "secondary_weight": [1.0]},
    ),
    "ConstrainedSystem.at": Target(
        lambda **a: mechanism(SYSTEM.at(**a).kinematics()), {"J_T": J_T, "J_C": J_C}
    ),
    "ConstrainedSystem.kinematics": Target(
        lambda **a: mechanism(SYSTEM.with_failures(free=[0, 1, 2]).kinematics(**a)),
        {"passive_metric": np.eye(5)},
    ),
    "Kinematics.expand": Target(KIN.expand, {"rates": np.ones(3)}),
    "Kinematics.passive_rates": Target(LOOSE.passive_rates, {"rates": np.ones(2)}),
    "Kinematics.velocities": Target(LOOSE.velocities, {"rates": np.ones(2)}),
    "Kinematics.constraint_force": Target(
        LOOSE.constraint_force, {"f": np.ones(3), "torques": np.ones(2)}
    ),
    "Kinematics.manipulability": Target(KIN.manipulability, {"major": J[:1, :3]}),
    "Kinematics.velocity_mapping": Target(
        lambda **a: rates(LOOSE.velocity_mapping(**a)),
        {"major": [0], "secondary": [1, 2], "joint_weight": np.ones(3), "damping": 0.0}
        | {"secondary_weight": np.ones(2), "major_metric": np.ones(1), "tie_metric": np.ones(3)},
    ),
    "Kinematics.force_mapping": Target(
        lambda **a: torques(LOOSE.force_mapping(**a)),
        {"major": [0], "secondary": [1, 2], "torque_weight": np.ones(3)}
        | {"secondary_weight": np.ones(2), "major_metric": np.ones(1), "tie_metric": np.ones(3)},
    ),
    "Kinematics.attainable": Target(
        lambda **a: reach(LOOSE.attainable(**a)),
        {"major": [0], "rate_limits": LIMITS},
    ),
    "Kinematics.attainable of directions": Target(
        lambda **a: reach(KIN.attainable(**a)), {"major": J[:2, :3], "rate_limits": (-1.0, 2.0)}
    ),
    "Kinematics.attainable_force": Target(
        lambda **a: reach(LOOSE.attainable_force(**a)),
        {"major": [0], "torque_limits": LIMITS},
    ),
    "Attainable.support": Target(
        KIN.attainable([0, 1], (-1.0, 1.0)).support, {"direction": np.ones(2)}
    ),
    "failure_atlas": Target(failure_atlas, CODES),
    "failure_atlas with limits": Target(
        lambda **a: worst(failure_atlas(SPRUNG, [0], codes=CODES["codes"], **a)),
        {"rate_limits": LIMITS, "torque_limits": LIMITS},
    ),
    "failure_atlas of springs": Target(failure_atlas, CODES | {"system": SPRUNG}, ("codes",)),
    "viable_rates": Target(
        viable_rates,
        {"position": np.zeros(3), "rate": np.ones(3), "position_limits": (-np.ones(3), 1.0)}
        | {"rate_limits": (-2.0, 2 * np.ones(3)), "acceleration_limits": (-3.0, 4.0)}
        | {"period_s": 0.1},
    ),
    "viable_rates of arrays of limits": Target(
        viable_rates,
        {
            "position": np.zeros(3),
            "rate": np.ones(3),
            "position_limits": RNG.random((2, 3)) - [[1], [0]],
        }
        | {"rate_limits": RNG.random((2, 3)) - [[1], [0]], "period_s": 0.1}
        | {"acceleration_limits": RNG.random((2, 3)) - [[1], [0]]},
    ),
    "lexicographic_least_squares": Target(
        lambda **a: answer(lexicographic_least_squares(**a)),
        {"levels": [(J, np.ones(3))], "lower": -np.ones(4), "upper": np.ones(4)}
        | {"rows": RNG.normal(size=(2, 4)), "rows_lower": -np.ones(2), "rows_upper": np.ones(2)}
        | {"tie_metric": np.ones(4), "start": None, "most_steps": 100, "rank_tolerance": 1e-10},
    ),
    "lexicographic_least_squares of any level": Target(
        lambda levels, lower: answer(
            lexicographic_least_squares([(levels, lower), (J, -1.0, 1.0)], -1.0, 1.0)
        ),
        {"levels": J, "lower": np.ones(3)},
    ),
    "velocity_mapping within limits": Target(
        lambda **a: limited(velocity_mapping(**a), "rates"),
        PROBLEM
        | {"joint_weight": np.ones(4), "rate_limits": RNG.random((2, 4)) - [[1], [0]]}
        | {"rate_rows": (J[:1], -1.0, 1.0), "when_limited": "scaled"},
    ),
    "velocity_mapping within a box": Target(
        lambda **a: limited(velocity_mapping(**a), "rates"),
        PROBLEM | {"rate_limits": (-0.1 * np.ones(4), 0.1 * np.ones(4))},
    ),
    "force_mapping within limits": Target(
        lambda **a: limited(force_mapping(**a), "torques"),
        PROBLEM
        | {"torque_weight": np.ones(4), "torque_limits": RNG.random((2, 4)) - [[1], [0]]}
        | {"torque_rows": (J[:1], -1.0, 1.0), "force_rows": (J[:1, :3], -1.0, 1.0)}
        | {"when_limited": "scaled"},
    ),
    "VelocityMapping.solve": Target(
        lambda **a: answer(WITHIN.solve(**a)), RATES | {"start": WITHIN.solve(np.ones(2))}
    ),
    "ForceMapping.solve": Target(
        lambda **a: answer(HELD.solve(**a)), FORCES | {"start": HELD.solve(np.ones(2))}
    ),
    "Task": Target(
        lambda **a: answer(KIN.hierarchy([Task(**a)]).solve([None])),
        {"rows": J[:2, :3], "weight": np.ones(2), "interval": False, "damping": 0.1},
    ),
    "Task.joints": Target(
        lambda **a: answer(KIN.hierarchy([Task.joints(**a)]).solve([np.ones(3)])),
        {"weight": np.ones(3), "damping": 0.1},
    ),
    "Kinematics.hierarchy": Target(
        lambda **a: answer(LOOSE.hierarchy(**a).solve([np.ones(1)])),
        {"levels": [Task([0])], "rate_limits": RNG.random((2, 3)) - [[1], [0]]}
        | {"rate_rows": (np.ones((1, 3)), -1.0, 1.0), "tie_metric": np.ones(3)},
    ),
    "Hierarchy.solve": Target(
        lambda **a: answer(LEVELS.solve(**a)),
        {"targets": [np.ones(1), np.ones((2, 2))], "start": None},
    ),
    "Hierarchy.at": Target(
        lambda **a: answer(LEVELS.at(**a).solve([np.ones(1), np.ones((2, 2))])),
        {"kinematics": KIN, "rate_limits": RNG.random((2, 3)) - [[1], [0]]}
        | {"rate_rows": (np.ones((1, 3)), -1.0, 1.0)},
    ),
    "Hierarchy.tick": Target(lambda **a: met(STEADY.tick(**a)), {"kinematics": CLOSED}),
    "Tick.__call__": Target(
        lambda **a: met(STEADY.tick(CLOSED), **a),
        {"J_T": CLOSED.system.geometry.J_T, "J_C": CLOSED.system.J_C, "targets": np.ones(4)}
        | {"velocity_limits": (-np.ones(5), np.ones(5)), "error_bound": 0.0},
    ),
    "Hierarchy.solve of any target": Target(
        lambda targets: answer(LEVELS.solve([targets, None])), {"targets": np.ones(1)}
    ),
    "FailureAtlas.row": Target(ATLAS.row, {"locked": [0], "free": [1]}),
    "FailureAtlas.describe": Target(ATLAS.describe, {"row": 1}),
    "Kinematics.velocity_mapping within limits": Target(
        lambda **a: limited(LOOSE.velocity_mapping([0], **a), "rates"),
        {"rate_limits": LIMITS, "rate_rows": (np.ones((1, 3)), -1.0, 1.0)}
        | {"when_limited": "scaled"},
    ),
    "Kinematics.force_mapping within limits": Target(
        lambda **a: limited(LOOSE.force_mapping([0], **a), "torques"),
        {"torque_limits": LIMITS, "torque_rows": (np.ones((1, 3)), -1.0, 1.0)}
        | {"force_rows": (J_T[:1, :3], -1.0, 1.0), "when_limited": "scaled"},
    ),
    "VelocityMapping.at with limits": Target(
        lambda **a: KIN.velocity_mapping([0]).at(KIN, **a)([1.0]), {"rate_limits": LIMITS}
    ),
    "VelocityMapping.within": Target(
        lambda **a: WITHIN.within(**a)(np.ones(2)), {"rate_limits": (-np.ones(4), 0.2)}
    ),
    "ConstrainedSystem.at_pose": Target(
        lambda **a: mechanism(SYSTEM.at_pose(**a).kinematics()), {"mechanism": SPRUNG}
    ),
    "ConstrainedSystem with its accuracy": Target(
        lambda **a: mechanism(ConstrainedSystem(J_T, J_C, [0, 1, 2], **a).kinematics()),
        {"accuracy": None},
    ),
    "canonical_basis": Target(canonical_basis, {"basis": np.eye(3)[:, :2]}),
}
TRUSTED = {
    # what the library returns, and what Names hold is checked where they are used
    *("Attainable", "Classes", "FailureAtlas", "Failures", "ForceMapping", "ForceSolution"),
    *("Hierarchy", "HierarchySolution", "Kinematics", "Manipulability", "Names"),
    *("Postures", "RateBox"),
    *("Solution", "Tick", "VelocityMapping", "VelocitySolution"),
    # what its parts ask of each other, of what was checked
    *("Hierarchy.undamped", "Tick.at", "Tick.limits", "Tick.of_plain", "Tick.at_jacobians"),
    *("Failures.and_also", "Failures.in_words", "HierarchySolution.in_words"),
}


def test_every_argument_of_the_package_is_attacked():
    assert not unattacked(prioritized, TARGETS, TRUSTED)


@pytest.mark.parametrize("target", TARGETS)
def test_a_hostile_argument_ends_in_one_sentence_or_in_finite_numbers(target):
    calls, wrong = complaints(TARGETS[target])
    assert calls > 30
    assert not wrong, "\n".join(wrong)
