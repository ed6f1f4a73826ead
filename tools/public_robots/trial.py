"""One robot from its file to a flight; `python -m tools.public_robots.trial FILE OUT.json`.

The stages come in order, and the first that is refused ends the trial. What is known so far is
written after each stage, so that a process that is stopped leaves it.
"""

import json
import re
import resource
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from argument_checks.ties import ascending
from fjh.rig import Rig, Run
from fjh.rig.dither import dither_of
from fjh.rig.reach import learnt_s, uncompared
from fjh.rig.run import rms
from fjh.study.errors import WrongInput
from fjh.study.provenance import commit
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
from tools.public_robots.task_frame import NoTask, TaskFrame, task_frame

STAGES = ("load", "assemble", "jacobians", "power", "classified", "rig", "sound", "lock")
REFUSALS = (ModelError, WrongInput, SimulationDiverged, NoTask)
"""What the command answers in a sentence; anything else would be a traceback."""

SERVO_HZ, OF_STEP_RATE = 10.0, 0.03
"""Natural frequency of the servos that torque motors get, at most that part of the step rate."""
FLIGHT_S, FAILS_S = 2.0, 1.0
ROWS = ((3, 4, 5), (3, 4), (3, 5), (4, 5), (3,), (4,), (5,), (0,), (1,), (2,))
"""Major rows, the first that the actuators reach: translations, as many as they can."""
LIMIT_S = 60
"""Processor time after which the trial is ended: the same on a busy machine."""
_STEP = 1e-6
_ADVISED = re.compile(r"pinned (\S+)$")
"""What a refusal names to be pinned."""


def main(file: Path, out: Path) -> None:
    """Write what came of each stage."""
    record: dict[str, Any] = {"date": date.today().isoformat(), "commit": commit()}

    def keep(**more: Any) -> None:
        record.update(more)
        out.write_text(json.dumps(record, indent=1))

    keep(stage=STAGES[0])
    start = time.monotonic()
    try:
        for stage, numbers in Trial(file).stages():
            following = STAGES[(STAGES.index(stage) + 1) :]
            keep(**{stage: numbers}, stage=following[0] if following else None)
    except REFUSALS as error:
        keep(refused=" ".join(str(error).replace(f"{file}: ", "").split()))
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(last.filename).name}:{last.lineno} in {last.name}"
        says = f"{type(error).__name__}: {' '.join(str(error).split())} ({where})"
        keep(traceback=says, whole=traceback.format_exc())
    keep(duration_s=round(time.monotonic() - start, 1))


@dataclass(frozen=True)
class Trial:
    """A robot of a file."""

    file: Path

    def stages(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Each stage, and its numbers."""
        yield "load", {"actuators": len(drives(self.model)), "velocities": int(self.model.nv)}
        frame = self.task
        yield "assemble", {"frame": frame.frame, "pinned": frame.pinned}
        yield "jacobians", {"error": difference_error(self.model, self.start, self.jac, self.body)}
        yield "power", {"error": power_error(self.model, self.start, self.jac, self.body)}
        yield "classified", {"major": self.major, "says": str(self.report).splitlines()[0]}
        rig = self.rig
        yield (
            "rig",
            {
                "warnings": rig.warnings,
                "left_out": rig.left_out,
                "pinned": self._rig_and_pins[1],
                "rows": rig.major,
                "crossover_hz": rig.margins[0].crossover_hz,
            },
        )
        yield "sound", self._flown(())
        failed = self.expendable
        yield (
            "lock",
            {"actuator": rig.actuators[failed]}
            | self._flown((Failure(failed, "locked", FAILS_S),)),
        )

    @cached_property
    def model(self) -> mujoco.MjModel:
        """As the user loads it."""
        return load_model(self.file)

    @cached_property
    def start(self) -> mujoco.MjData:
        """Closed, from the first keyframe or zero."""
        data = mujoco.MjData(self.model)
        if self.model.nkey:
            mujoco.mj_resetDataKeyframe(self.model, data, 0)
        return assemble(self.model, data)

    @cached_property
    def task(self) -> TaskFrame:
        """By the rule of :mod:`tools.public_robots.task_frame`."""
        return task_frame(self.model, self.start)

    @property
    def body(self) -> int:
        """Of the task frame."""
        return self.model.body(self.task.frame).id

    @cached_property
    def jac(self) -> Jacobians:
        """With the feet pinned."""
        sites = {self.model.site(k).name for k in range(self.model.nsite)}
        pinned = [name if name in sites else Body(name) for name in self.task.pinned]
        return jacobians(self.model, self.start, Body(self.task.frame), pinned=pinned)

    @cached_property
    def system(self) -> ConstrainedSystem:
        """Of the Jacobians."""
        return ConstrainedSystem.of(self.jac)

    @cached_property
    def major(self) -> tuple[int, ...]:
        """The first of :data:`ROWS` that the actuators reach, or all translations."""
        kin = self.system.kinematics()
        reached = (rows for rows in ROWS if is_possible(kin.manipulability(major=list(rows))))
        return next(reached, ROWS[0])

    @cached_property
    def report(self) -> Any:
        """The classification of the sound robot."""
        return self.system.kinematics().manipulability(major=list(self.major))

    @cached_property
    def expendable(self) -> int:
        """Of the actuators without which the task remains possible, the one that moves it most.

        Of all, where it never remains so.
        """
        system, major = self.rig.control.system, list(self.rig.major)
        moves = np.linalg.norm(system.kinematics().J[major], axis=0)
        order = ascending(-moves).tolist()

        def spared(k: int) -> bool:
            left = system.with_failures(locked=[k]).kinematics()
            return is_possible(left.manipulability(major=major))

        return next((k for k in order if moves[k] > 0 and spared(k)), order[0])

    @property
    def rig(self) -> Rig:
        """The robot with its loops; torque motors and velocity servos become position servos."""
        return self._rig_and_pins[0]

    @cached_property
    def _rig_and_pins(self) -> tuple[Rig, list[str]]:
        """The rig; where it is refused for what it stands on, with the pins that the refusal names.

        The major rows are then the first that remain.
        """
        pins = [f"{name}:point" for name in self.task.pinned]
        try:
            return self._rig(pins, self.major), pins
        except ModelError as error:
            if (advised := _ADVISED.search(str(error))) is None:
                raise
        pins = advised[1].split(",")
        for rows in (self.major, *ROWS[:-1]):
            with suppress(WrongInput):
                return self._rig(pins, rows), pins
        return self._rig(pins, ROWS[-1]), pins

    def _rig(self, pins: list[str], rows: tuple[int, ...]) -> Rig:
        given = {"site": self.task.frame, "major": rows, "pinned": pins}
        return Rig.of_mjcf(self.file, **given, servo_hz=servo_hz(self.model))

    def _flown(self, failures: tuple[Failure, ...]) -> dict[str, Any]:
        """A flight with a diagnosing controller, beside what was predicted.

        The prediction is of a controller that learns of the failure when this one did.
        """
        rig = self.rig
        path = rig.path("circle", duration_s=FLIGHT_S, turn_s=FLIGHT_S)
        dither = dither_of(rig, "default", "default")
        run = rig.fly(rig.supervisor(dither), path, failures=failures)
        told, noise = learnt_s(rig, run, failures), run.measured - run.true
        predicted = rig.predict(path, failures=failures, told=told, noise=noise, dither=dither)
        of_model = predicted.rms_after if failures else predicted.rms_before
        measured = rms(run.error[run.time_s >= (FAILS_S if failures else 0.0) - 1e-9])
        return {
            "measured": measured.tolist(),
            "predicted": of_model.tolist() if np.isfinite(of_model).all() else None,
            "of_path": float(np.linalg.norm(measured)) / rig.size,
            "uncompared": uncompared(rig, run, predicted),
            "leaves": predicted.leaves,
            "status": run.status,
        } | _named(run, [rig.actuators[each.number] for each in failures])


def _named(run: Run, failed: list[str]) -> dict[str, Any]:
    right = [each for each in run.diagnoses if each.actuator in failed and each.time_s >= FAILS_S]
    wrong = [str(each) for each in run.diagnoses if each not in right]
    delay_ms = round(1e3 * (right[0].time_s - FAILS_S)) if right else None
    return {"named_after_ms": delay_ms, "wrong": wrong}


def servo_hz(model: mujoco.MjModel) -> float | None:
    """Natural frequency of position servos; None where the file has no others."""
    fixed = model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED
    without = (model.actuator_biasprm[:, 1] == 0) & fixed
    return min(SERVO_HZ, OF_STEP_RATE / model.opt.timestep) if without.any() else None


def difference_error(
    model: mujoco.MjModel, data: mujoco.MjData, jac: Jacobians, body: int
) -> float:
    """Largest error of J_T against central differences along each velocity of the joints."""
    ends = []
    for sign in (1.0, -1.0):
        poses = []
        for k in range(model.nv):
            moved, velocity = mujoco.MjData(model), np.zeros(model.nv)
            moved.qpos[:] = data.qpos
            velocity[k] = sign
            mujoco.mj_integratePos(model, moved.qpos, velocity, _STEP)
            mujoco.mj_kinematics(model, moved)
            poses.append((moved.xquat[body].copy(), moved.xpos[body].copy()))
        ends.append(poses)
    differences = np.zeros((6, model.nv))
    for k, ((quat, there), (other, back)) in enumerate(zip(*ends, strict=True)):
        turned = np.zeros(3)  # in the axes of the body
        mujoco.mju_subQuat(turned, quat, other)
        differences[:3, k] = data.xmat[body].reshape(3, 3) @ turned
        differences[3:, k] = there - back
    wrong = jac.J_T[:, : model.nv] - differences / (2 * _STEP)
    return float(np.abs(wrong).max() / max(1.0, np.abs(jac.J_T).max()))


def power_error(model: mujoco.MjModel, data: mujoco.MjData, jac: Jacobians, body: int) -> float:
    """Relative difference of the power of random forces, at actuators and task, and at the joints.

    The velocities are those of random rates that the closures admit.
    """
    kin, draw = ConstrainedSystem.of(jac).kinematics(), np.random.default_rng(0)
    rates = draw.standard_normal(len(kin.active))
    rates -= np.linalg.pinv(kin.active_constraint) @ (kin.active_constraint @ rates)
    joints = kin.velocities(rates)[: model.nv]
    rows = drive_rows(model, data, drives(model))
    twist = np.zeros((6, model.nv))
    mujoco.mj_jacBody(model, data, twist[3:], twist[:3], body)

    def off(ours: Array, theirs: Array) -> float:
        forces = draw.standard_normal(len(ours))
        joint_power = (theirs.T @ forces) @ joints
        return float(abs(forces @ ours - joint_power) / (np.abs(forces * ours).sum() or 1.0))

    return max(off(rates, rows), off(kin.J @ rates, twist))


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_S, LIMIT_S + 5))
    main(Path(sys.argv[1]), Path(sys.argv[2]))
