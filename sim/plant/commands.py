"""Controls that displace the drives of a machine from a pose in which it is at rest."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf

import mujoco
import numpy as np

from sim.array import Array
from sim.errors import ModelError
from sim.mjcf.drive import Drive
from sim.mjcf.dynamics import has_linear_spring, is_slack
from sim.mjcf.law import Law, law_of
from sim.mjcf.ranges import ranges
from sim.mjcf.transmission import drive_rows

_STEP = 1e-6
_SAME_SLOPE = 1e-4


@dataclass(frozen=True, eq=False)
class Commands:
    """Controls and forces as functions of the displacements x (n,) at which drives rest.

    Attributes:
        at_rest: Controls at x = 0, shape (nu,).
        per_displacement: Slope of the controls, shape (nu, n).
        force_at_rest: Of each output at x = 0, shape (nout,).
        force_per_displacement: Its slope, shape (nout, n): what springs take.
        stiffness: Force of each drive per displacement commanded while it is held, shape (n,).
        feedback: What that force falls by per displacement and per speed, as parts of `stiffness`,
            shape (n, 2): [1, kv/kp] of a servo alone, zeros of a motor against a spring.
    """

    at_rest: Array
    per_displacement: Array
    force_at_rest: Array
    force_per_displacement: Array
    stiffness: Array
    feedback: Array

    @cached_property
    def _are_displacements(self) -> bool:
        """Whether each control is its drive's displacement."""
        rests, size = not self.at_rest.any(), len(self.at_rest)
        return rests and np.array_equal(self.per_displacement, np.eye(size))

    def beside(self, controls: Array) -> "Commands":
        """The same where all other controls keep these values (nu,)."""
        commanded = self.per_displacement.any(axis=1)
        return replace(self, at_rest=np.where(commanded, self.at_rest, controls))

    def controls(self, displacements: Array) -> Array:
        """Controls (nu,) for displacements (n,)."""
        if self._are_displacements:  # nothing to compute in the control tick of the hexapod
            return displacements
        return self.at_rest + self.per_displacement.dot(displacements)


def commands_of(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    drives: tuple[Drive, ...],
    forces: Array | None = None,
) -> Commands:
    """The controls that displace drives from the pose of `data`, which is up to date.

    Each actuator balances its own feedback; those of one drive share the force of its spring, each
    in proportion to its gear, which makes the sum of squares least.

    Args:
        model: The model.
        data: The pose.
        drives: What is commanded.
        forces: Of each output at that pose, shape (nout,); None is without control.

    Raises:
        ModelError: A drive that no control displaces.
    """
    at_rest, gains = np.zeros(model.nu), np.zeros((model.nu, len(drives)))
    force, slope = np.zeros(model.nout), np.zeros((model.nout, len(drives)))
    stiffness, feedback = np.zeros(len(drives)), np.zeros((len(drives), 2))
    for n, drive in enumerate(drives):
        laws = [law_of(model, k) for k in drive.ids]
        spring = _spring(model, data, drive)
        _refuse_without_stiffness(model, drive, laws, spring)
        if not drive.has_length:
            _refuse_other_length(model, data, drive)
        squares = sum(gear * gear for gear in drive.gear)
        for gear, law in zip(drive.gear, laws, strict=True):
            feedback[n] -= gear * gear * np.array([law.per_length, law.per_speed])
        stiffness[n] = spring + feedback[n, 0]
        for k, out, gear, law in zip(drive.ids, drive.outputs, drive.gear, laws, strict=True):
            control, share = model.actuator_ctrladr[k], gear * spring / squares
            passive = law.constant + law.per_length * data.actuator_length[out]
            gains[control, n] = (share - law.per_length * gear) / law.gain
            slope[out, n] = share
            force[out] = passive if forces is None else forces[out]
            at_rest[control] = (force[out] - passive) / law.gain
    feedback /= stiffness[:, None]
    return Commands(at_rest, gains, force, slope, stiffness, feedback)


def _spring(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive) -> float:
    """Stiffness of the spring of the joint or tendon itself."""
    if drive.joint is not None:
        if not has_linear_spring(model)[drive.joint]:
            raise ModelError(f'the spring of joint "{drive.name}" is not linear')
        return float(model.jnt_stiffness[drive.joint])
    if drive.tendon is None:
        return 0.0
    if model.tendon_stiffnesspoly[drive.tendon].any():
        raise ModelError(f'the spring of tendon "{drive.name}" is not linear')
    slack = is_slack(model, data, drive.tendon)
    return 0.0 if slack else float(model.tendon_stiffness[drive.tendon])


def spring_forces(model: mujoco.MjModel, data: mujoco.MjData, drives: tuple[Drive, ...]) -> Array:
    """Force of the own spring of each drive at this pose, along its velocity, shape (n,)."""
    forces = np.zeros(len(drives))
    for n, drive in enumerate(drives):
        if drive.joint is not None:
            at = model.jnt_qposadr[drive.joint]
            stretched = data.qpos[at] - model.qpos_spring[at]
        elif drive.tendon is not None:
            length = data.ten_length[drive.tendon]
            stretched = length - np.clip(length, *model.tendon_lengthspring[drive.tendon])
        else:
            continue
        forces[n] = -_spring(model, data, drive) * stretched
    return forces


def _refuse_without_stiffness(
    model: mujoco.MjModel, drive: Drive, laws: list[Law], spring: float
) -> None:
    """Without a feedback of position and without a spring a control has no displacement."""
    terms = zip(laws, drive.gear, strict=True)
    if spring - sum(law.per_length * gear * gear for law, gear in terms) > 0.0:
        return
    called = f'actuator "{drive.actuators[0]}"'
    if any(law.per_length > 0.0 for law in laws):
        raise ModelError(f"{called} pushes away from its target: its feedback must be negative")
    if any(law.per_speed for law in laws):
        raise ModelError(
            f"{called} is a velocity servo, whose control is a speed: a plant is commanded by "
            "displacements: sim.servoed(model, natural_frequency_hz=...), --servo HZ or servo_hz= "
            "makes it a position servo"
        )
    if not drive.has_length:
        raise ModelError(
            f"{called} is a torque motor at a site, or on a ball or free joint, where no "
            "displacement follows from its force: a flight needs a controller of the base. Its "
            "force mapping, attainable forces and limits are those of any actuator"
        )
    raise ModelError(
        f"{called} is a torque motor, and no displacement follows from a torque: "
        "sim.servoed(model, natural_frequency_hz=...), --servo HZ or servo_hz= makes it a position "
        "servo"
    )


def _refuse_other_length(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive) -> None:
    """A servo must feel its own displacement.

    Without a reference site it feels none; of a ball joint away from zero or a turning reference
    site, another one.
    """
    row, probe = drive_rows(model, data, [drive])[0], mujoco.MjData(model)
    probe.mocap_pos[:], probe.mocap_quat[:] = data.mocap_pos, data.mocap_quat
    slope = np.zeros(model.nv)
    for k, velocity in enumerate(np.eye(model.nv)):
        for step in (_STEP, -_STEP):
            probe.qpos[:] = data.qpos
            mujoco.mj_integratePos(model, probe.qpos, velocity, step)
            mujoco.mj_fwdPosition(model, probe)
            slope[k] += probe.actuator_length[drive.outputs[0]] / (2 * step)
    if np.abs(slope / drive.gear[0] - row).max() > _SAME_SLOPE * np.abs(row).max():
        raise ModelError(
            f'actuator "{drive.actuators[0]}" feels a length that does not grow with what it '
            "moves: give its site a refsite that does not turn, its ball joint a pose near zero"
        )


def displacement_range(
    commands: Commands, model: mujoco.MjModel, drives: tuple[Drive, ...]
) -> tuple[Array, Array]:
    """Displacements (n,) each, lower and upper, within the ranges of controls and forces."""
    lower, upper = np.full(len(drives), -inf), np.full(len(drives), inf)
    for n, drive in enumerate(drives):
        for k, out in zip(drive.ids, drive.outputs, strict=True):
            control = model.actuator_ctrladr[k]
            spans = []
            if model.actuator_ctrllimited[control]:
                at, slope = commands.at_rest[control], commands.per_displacement[control, n]
                spans.append((model.actuator_ctrlrange[control] - at, slope))
            if model.actuator_forcelimited[out]:
                at, slope = commands.force_at_rest[out], commands.force_per_displacement[out, n]
                spans.append((model.actuator_forcerange[out] - at, slope))
            for room, slope in spans:
                if slope:
                    least, most = np.sort(room / slope)
                    lower[n], upper[n] = max(lower[n], least), min(upper[n], most)
    return lower, upper


def rest_limits(
    model: mujoco.MjModel, data: mujoco.MjData, drives: tuple[Drive, ...], commands: Commands
) -> tuple[Array, Array]:
    """Displacements at which drives can rest, within the ranges of MJCF: (n,) each, [m] or [rad].

    From the pose of `data`; infinite where no range is stated.
    """
    limits, stroke = ranges(model), np.tile([-np.inf, np.inf], (len(drives), 1))
    for row, drive in zip(stroke, drives, strict=True):
        if drive.joint is not None:
            here = data.qpos[model.jnt_qposadr[drive.joint]]
            row[:] = limits.joint[model.jnt_dofadr[drive.joint]] - here
        elif drive.tendon is not None:
            row[:] = limits.tendon[drive.tendon] - data.ten_length[drive.tendon]
    least, most = displacement_range(commands, model, drives)
    return np.maximum(stroke[:, 0], least), np.minimum(stroke[:, 1], most)
