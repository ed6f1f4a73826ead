"""Test of one robot, from its file to a run: `python -m tools.public_robots.trial FILE OUT.json`.

Results are written after each stage, so that a stopped process leaves them.
"""

import json
import re
import resource
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from argument_checks.ties import ascending
from fjh.rig import Rig
from fjh.rig.dither import dither_of
from fjh.rig.reach import diagnosed_at_s, uncompared
from fjh.rig.run import rms
from fjh.study.errors import WrongInput
from fjh.study.provenance import code_sha256, commit
from ftc import is_possible
from prioritized import ConstrainedSystem
from sim import (
    Array,
    Body,
    Failure,
    Jacobians,
    ModelError,
    SimulationDiverged,
    assemble,
    jacobians,
    load_model,
)
from sim.mjcf import drive_rows, drives
from tools.public_robots.task_frame import NoTask, task_frame

STAGES = ("load", "assemble", "jacobians", "power", "classified", "rig", "healthy", "lock")
REJECTIONS = (ModelError, WrongInput, SimulationDiverged, NoTask)
"""Errors that the command reports in a sentence; others give a traceback."""

SERVO_HZ, OF_STEP_RATE = 10.0, 0.03
"""Natural frequency [Hz] of servos for torque motors; its largest fraction of the step rate."""
RUN_S, FAILS_S = 2.0, 1.0
ROWS = ((3, 4, 5), (3, 4), (3, 5), (4, 5), (3,), (4,), (5,), (0,), (1,), (2,))
"""Candidates of major rows, of which the first feasible one is used."""
LIMIT_S = 60
"""Limit of processor time [s], which does not depend on the load of the machine."""
_STEP = 1e-6
_ADVICE = re.compile(r"pinned (\S+)$")
"""End of an error message that lists frames to be pinned."""


def main(file: Path, out: Path) -> None:
    """Run all stages and write their results."""
    record: dict[str, Any] = {"code_sha256": code_sha256(), "commit": commit()}

    def save(**more: Any) -> None:
        record.update(more)
        out.write_text(json.dumps(record, indent=1))

    save(stage=STAGES[0])
    start = time.monotonic()
    try:
        for stage, numbers in stages(file):
            following = (*STAGES, None)[STAGES.index(stage) + 1]
            save(**{stage: numbers}, stage=following)
    except REJECTIONS as error:
        save(refused=" ".join(str(error).replace(f"{file}: ", "").split()))
    except Exception as error:
        message = " ".join(traceback.format_exception_only(error)[-1].split())
        save(traceback=message, whole=traceback.format_exc())
    finished = datetime.now(UTC).isoformat(timespec="seconds")
    save(duration_s=round(time.monotonic() - start, 1), finished=finished)


def stages(file: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Run the stages of a robot, and yield the name and numbers of each."""
    model = load_model(file)
    yield "load", {"actuators": len(drives(model)), "velocities": int(model.nv)}
    start = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, start, 0)
    start = assemble(model, start)
    frame, feet = task_frame(model, start)
    yield "assemble", {"frame": frame, "pinned": feet}
    sites = {model.site(k).name for k in range(model.nsite)}
    pinned = [name if name in sites else Body(name) for name in feet]
    jac, body = jacobians(model, start, Body(frame), pinned=pinned), model.body(frame).id
    yield "jacobians", {"error": difference_error(model, start, jac, body)}
    yield "power", {"error": power_error(model, start, jac, body)}
    kin = ConstrainedSystem.of(jac).kinematics()
    reached = (rows for rows in ROWS if is_possible(kin.manipulability(major=list(rows))))
    major = next(reached, ROWS[0])
    sentence = str(kin.manipulability(major=list(major))).splitlines()[0]
    yield "classified", {"major": major, "says": sentence}
    rig, pins = _rig_and_pins(
        partial(Rig.of_mjcf, file, site=frame, servo_hz=servo_hz(model)),
        [f"{name}:point" for name in feet],
        major,
    )
    numbers = {"warnings": rig.warnings, "left_out": rig.left_out, "pinned": pins}
    yield "rig", numbers | {"rows": rig.major, "crossover_hz": rig.margins[0].crossover_hz}
    yield "healthy", _simulated(rig, ())
    failed = _expendable(rig)
    lock = (Failure(failed, "locked", FAILS_S),)
    yield "lock", {"actuator": rig.actuators[failed]} | _simulated(rig, lock)


def _rig_and_pins(
    rig: Callable[..., Rig], pins: list[str], major: tuple[int, ...]
) -> tuple[Rig, list[str]]:
    """Create the rig; if it is rejected, use the advised pins and the first feasible rows."""
    try:
        return rig(pinned=pins, major=major), pins
    except ModelError as error:
        if (advice := _ADVICE.search(str(error))) is None:
            raise
    pins = advice[1].split(",")
    for rows in (major, *ROWS[:-1]):
        with suppress(WrongInput):
            return rig(pinned=pins, major=rows), pins
    return rig(pinned=pins, major=ROWS[-1]), pins


def _expendable(rig: Rig) -> int:
    """Return the strongest actuator without which the task is possible, else the strongest."""
    system, major = rig.control.system, list(rig.major)
    moves = np.linalg.norm(system.kinematics().J[major], axis=0)
    order = ascending(-moves).tolist()

    def is_expendable(k: int) -> bool:
        remaining = system.with_failures(locked=[k]).kinematics()
        return is_possible(remaining.manipulability(major=major))

    return next((k for k in order if moves[k] > 0 and is_expendable(k)), order[0])


def _simulated(rig: Rig, failures: tuple[Failure, ...]) -> dict[str, Any]:
    """Simulate a run with diagnosis, and predict one that is informed at the diagnosed time."""
    path = rig.path("circle", duration_s=RUN_S, turn_s=RUN_S)
    dither = dither_of(rig, "default", "default")
    run = rig.fly(rig.supervisor(dither), path, failures=failures)
    known_s, noise = diagnosed_at_s(rig, run, failures), run.measured - run.true
    predicted = rig.predict(path, failures=failures, told=known_s, noise=noise, dither=dither)
    of_model = predicted.rms_after if failures else predicted.rms_before
    measured = rms(run.error[run.time_s >= (FAILS_S if failures else 0.0) - 1e-9])
    failed = [rig.actuators[failure.number] for failure in failures]
    correct = [d for d in run.diagnoses if d.actuator in failed and d.time_s >= FAILS_S]
    return {
        "measured": measured.tolist(),
        "predicted": of_model.tolist() if np.isfinite(of_model).all() else None,
        "of_path": float(np.linalg.norm(measured)) / rig.size,
        "uncompared": uncompared(rig, run, predicted),
        "leaves": predicted.leaves,
        "status": run.status,
        "named_after_ms": round(1e3 * (correct[0].time_s - FAILS_S)) if correct else None,
        "wrong": [str(diagnosis) for diagnosis in run.diagnoses if diagnosis not in correct],
    }


def servo_hz(model: mujoco.MjModel) -> float | None:
    """Return the natural frequency [Hz] for converted servos; None if none is converted."""
    fixed = model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED
    without = (model.actuator_biasprm[:, 1] == 0) & fixed
    return min(SERVO_HZ, OF_STEP_RATE / model.opt.timestep) if without.any() else None


def difference_error(
    model: mujoco.MjModel, data: mujoco.MjData, jac: Jacobians, body: int
) -> float:
    """Return the largest error of J_T against central differences along each joint velocity."""
    differences, turned = np.zeros((6, model.nv)), np.zeros(3)
    ahead, behind = mujoco.MjData(model), mujoco.MjData(model)
    for k, velocity in enumerate(np.eye(model.nv)):
        for moved, step in ((ahead, _STEP), (behind, -_STEP)):
            moved.qpos[:] = data.qpos
            mujoco.mj_integratePos(model, moved.qpos, velocity, step)
            mujoco.mj_kinematics(model, moved)
        mujoco.mju_subQuat(turned, ahead.xquat[body], behind.xquat[body])  # in the body's axes
        differences[:3, k] = data.xmat[body].reshape(3, 3) @ turned
        differences[3:, k] = ahead.xpos[body] - behind.xpos[body]
    wrong = jac.J_T[:, : model.nv] - differences / (2 * _STEP)
    return float(np.abs(wrong).max() / max(1.0, np.abs(jac.J_T).max()))


def power_error(model: mujoco.MjModel, data: mujoco.MjData, jac: Jacobians, body: int) -> float:
    """Return the relative error of the power of random forces at random admissible rates."""
    kin, rng = ConstrainedSystem.of(jac).kinematics(), np.random.default_rng(0)
    rates = rng.standard_normal(len(kin.active))
    rates -= np.linalg.pinv(kin.active_constraint) @ (kin.active_constraint @ rates)
    joints = kin.velocities(rates)[: model.nv]
    rows = drive_rows(model, data, drives(model))
    twist = np.zeros((6, model.nv))
    mujoco.mj_jacBody(model, data, twist[3:], twist[:3], body)

    def off(rates: Array, jacobian: Array) -> float:
        forces = rng.standard_normal(len(rates))
        joint_power = (jacobian.T @ forces) @ joints
        return float(abs(forces @ rates - joint_power) / (np.abs(forces * rates).sum() or 1.0))

    return max(off(rates, rows), off(kin.J @ rates, twist))


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_S, LIMIT_S + 5))
    main(Path(sys.argv[1]), Path(sys.argv[2]))
