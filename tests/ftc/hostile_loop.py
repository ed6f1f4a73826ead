"""What is attacked of the loop: controllers, and what runs them."""

from typing import Any

import numpy as np

from ftc import (
    Goal,
    GuardedController,
    Measurement,
    OracleController,
    PrioritizedController,
    PrioritizedMapping,
    SensorCheck,
    Supervisor,
    run_loop,
)
from ftc.fdi import DEFAULT_CONFIG, Diagnosis, Dither, Fault, monitor
from tests.ftc.hostile_machine import (
    DESIRED,
    DRIVES,
    GEOMETRY,
    GOAL,
    LIMITS,
    LOOP,
    M1,
    NOMINAL,
    PERIOD_S,
    PILOT,
    READ,
    STILL,
    SUPERVISED,
    SUPERVISOR,
    TASK,
    N,
    Still,
    flown,
    mapping,
    motionless,
    pilot,
    told,
)
from tests.hostile import Target

FAULTY = [Fault(0, "weak", 0.5)]
ORACLE: dict[str, Any] = {"before": PILOT, "after": pilot(Goal((1.0,) * N, free=(0,))), "tick": 1}
ORACLE |= {"lost_displacements": STILL, "secondary": motionless, "acting": STILL}
GUARDED = GuardedController("own", lambda task: PILOT, TASK)
AT_REST: dict[str, Any] = {"reference": DESIRED, "measurement": READ}
SECONDARY = {"secondary_reference": STILL, "feedforward": DESIRED, "unused_reference": STILL}
SWING = Dither(1e-3, 20.0, (1.0, -1.0, 1.0))
SWINGING = Supervisor(**SUPERVISOR, dither=SWING)
TOLD = [Diagnosis.told(Fault(0, "locked"), 1e-3)]
LIMITED = mapping(GOAL, limits=LIMITS)


def transferred(**given: Any) -> Any:
    return PILOT.step(PILOT.transfer(**given), **AT_REST).inputs


def stepped(controller: Any, **given: Any) -> Any:
    """What is sent, of all that a step returns."""
    return controller.step(**({"state": controller.start()} | AT_REST | given)).inputs


def calibrated(state: Any) -> Any:
    return flown(SUPERVISED.calibrated(state))


def taken_over(state: Any) -> Any:
    return SUPERVISED.step(SUPERVISED.transfer(state), **AT_REST).inputs


def read(output: Any, displacement: Any) -> Any:
    return stepped(SUPERVISED, measurement=Measurement(output, displacement))


def looped(**given: Any) -> Any:
    run = run_loop(**given)
    return run.measured, run.inputs


def equal_weights(kinematics):
    """Another allocation, of the mechanism of these tests."""
    return kinematics.velocity_mapping([0, 1], [2])


TARGETS = {
    "PrioritizedMapping": Target(
        lambda **a: PrioritizedMapping(**a).displacements(
            np.full(len(a["major"]), 0.1), STILL, STILL
        ),
        {"geometry": GEOMETRY, "goal": GOAL, "major": [0, 1], "secondary": [2]}
        | {"form": "gauss_newton", "task": lambda pose: pose}
        | {"limits": LIMITS, "when_limited": "scaled", "allocate": equal_weights},
    ),
    "PrioritizedController": Target(
        told(PrioritizedController),
        {"loops": [LOOP] * M1, "mapping": LIMITED, "drives": DRIVES, "handover_s": 0.1}
        | {"demand_limit": 1.0, "anti_windup": True, "tracking_slowness": 1.0}
        | {"reference_feedforward": True},
    ),
    "PrioritizedController.step": Target(
        lambda **a: stepped(PILOT, **a),
        {"state": PILOT.start()} | AT_REST | SECONDARY,
    ),
    "PrioritizedController.transfer": Target(
        transferred,
        {"state": PILOT.start(), "lost_displacements": STILL, "acting": STILL}
        | {"keeps": STILL, "unused_reference": STILL},
    ),
    "Measurement": Target(read, dict(vars(READ)), gaps=("output", "displacement")),
    "GuardedController": Target(
        told(GuardedController),
        {"name": "own", "factory": lambda task: PILOT, "task": TASK, "step_limit_s": 1.0},
    ),
    "GuardedController.step": Target(
        lambda **a: stepped(GUARDED, **a),
        {"state": GUARDED.start()} | AT_REST,
        gaps=("measurement",),
    ),
    "OracleController": Target(told(OracleController), ORACLE),
    "OracleController.step": Target(
        lambda **a: stepped(OracleController(**ORACLE), **a),
        {"state": OracleController(**ORACLE).start(), "feedforward": DESIRED} | AT_REST,
    ),
    "Supervisor": Target(
        told(Supervisor),
        SUPERVISOR
        | {"task": NOMINAL, "watched": lambda read, *_: read.output, "estimate": lambda *_: DESIRED}
        | {"sensor_check": SensorCheck(PERIOD_S), "unused": "locked"}
        | {"dither": SWING},
    ),
    "Supervisor.reconfigured": Target(
        lambda diagnoses: flown(SUPERVISED.reconfigured(diagnoses)), {"diagnoses": TOLD}
    ),
    "Supervisor.secondary": Target(SWINGING.secondary, {"time_s": 0.1}),
    "Supervisor.step": Target(
        lambda **a: stepped(SUPERVISED, **a),
        {"state": SUPERVISED.start(), "feedforward": DESIRED} | AT_REST,
        gaps=("measurement",),
    ),
    "Supervisor.calibrated": Target(calibrated, {"state": SUPERVISED.start()}),
    "Supervisor.transfer": Target(taken_over, {"state": PILOT.start()}),
    "Supervisor.transfer of a supervisor's": Target(taken_over, {"state": SUPERVISED.start()}),
    "monitor": Target(
        lambda **a: monitor(**a).start().last_commanded,
        {"nominal": NOMINAL, "faults": FAULTY, "config": DEFAULT_CONFIG},
    ),
    "run_loop": Target(
        looped,
        {"machine": Still(), "controller": PILOT}
        | {"reference": np.ones((3, M1)), "feedforward": np.ones((3, M1))}
        | {"keeps": lambda state: state.inputs},
    ),
}
