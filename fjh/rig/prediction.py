"""Linear model of a rig in closed loop: predicted errors before and after failures, stability."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

import argument_checks as check
from argument_checks.ties import greatest
from fjh.rig.run import tick_of
from ftc import Goal, PrioritizedController, Stage, goal_after, steps
from ftc.control import sensitivity_peak
from ftc.fdi import Diagnosis, Dither, Fault, at_rest, fault_model
from sim import Array, Failure

if TYPE_CHECKING:
    import control

    from fjh.rig.rig import Rig

_PULSE_S = 3.0
"""Length of the noise impulse response, in periods of the crossover."""

MARGINAL = 1 + 1e-9
"""Largest pole radius that counts as stable: integrators without excitation have 1."""


@dataclass(frozen=True)
class Prediction:
    """Predicted RMS of desired minus true displacements, before and after the first failure.

    An RMS is NaN for a part of the run without ticks, and if an actuator has left its range.

    Attributes:
        rms_before: RMS error of each major row before the first failure, (m1,), [rad] or [m].
        rms_after: RMS error from the first failure on, (m1,).
        leaves: Name of the actuator that leaves its range; None if all stay in range.
        error: Desired minus true displacements at each tick, (N, m1), without averaged noise.
        rms: RMS error over the complete run, (m1,).
    """

    rms_before: Array
    rms_after: Array
    leaves: str | None
    error: Array
    rms: Array


InformedAt = bool | Sequence[float | None]
"""Times [s] at which a controller is informed of each failure, None: never; True: at onset."""


def predicted(
    rig: "Rig",
    path: Array,
    failures: Sequence[Failure],
    *,
    informed: InformedAt = True,
    noise: Array | None = None,
    dither: Dither | None = None,
    goal: Goal,
    start: Array | None = None,
    floor_m_per_s2: Array | None = None,
    deviation: Array | float = 0.0,
) -> Prediction:
    """Return the predicted errors of a run; see :meth:`fjh.rig.Rig.predict`.

    The plant is linear about its start and changes with each fault. The mapping, that of the start
    posture, is reconfigured at the tick at which the controller is informed of a fault; then the
    actuators start from their present positions, and their secondary motion does not fade. If
    `noise` is None it is white. `deviation` is added to the task of the linear model, shape (N,
    m1).
    """
    controller, model, n = rig.controller(goal), fault_model(rig.nominal), rig.nominal.actuators
    x = None if start is None else at_rest(model.A, model.B, rig.period_s) @ start
    stages = [Stage(model, gain=controller.mapping.major_gain())]
    dithered = _dithered(dither, len(path), n, rig.period_s)
    secondary = dithered @ controller.mapping.secondary_gain().T + _static_offset(controller)
    floor = np.zeros((len(path), 3)) if floor_m_per_s2 is None else floor_m_per_s2
    pushed = np.zeros((len(path), len(model.A))) if model.floor is None else floor @ model.floor.T
    faults, first = list[Fault](), len(path)
    for tick, changes in _changes(rig, failures, informed):
        onset = [fault for fault, is_known in changes if not is_known]
        first, faults = min(first, tick), [*faults, *onset]
        after, in_service, mapping = fault_model(rig.nominal, faults), None, None
        if known := [Diagnosis.known(fault) for fault, is_known in changes if is_known]:
            goal = goal_after(goal, known, rig.nominal, rig.unused)
            mapping, in_service = rig.mapping(goal), np.ones(n)
            in_service[[*goal.locked_at, *goal.free]] = 0.0
            secondary[tick:] = dithered[tick:] @ mapping.secondary_gain().T
        gain = stages[-1].gain if mapping is None else mapping.major_gain()
        stages.append(Stage(after, tick, gain, in_service))
        if after.floor is not None:
            pushed[tick:] = floor[tick:] @ after.floor.T
    simulated = steps(
        stages,
        rig.nominal.plant.C,
        rig.loops,
        (path if noise is None else path - noise) - deviation,
        secondary=secondary,
        disturbance=pushed if floor.any() else None,
        limit=controller.demand_limit,
        anti_windup=controller.anti_windup,
        feedforward=rig.feedforward_demands(path),
        start=x,
    )
    ticks = list(simulated)
    error = path - deviation - np.array([tick.output for tick in ticks])
    states = np.array([tick.x for tick in ticks])
    return _summarized(rig, error, states, first, (stages[0], stages[-1]), white=noise is None)


def _changes(
    rig: "Rig", failures: Sequence[Failure], informed: InformedAt
) -> list[tuple[int, list[tuple[Fault, bool]]]]:
    check.instance("told", informed, bool, list, tuple, np.ndarray)
    times: Sequence[float | None] = (
        [failure.time_s if informed else None for failure in failures]
        if isinstance(informed, bool)
        else informed
    )
    if len(times) != len(failures):
        expected = f"True, False or a time for each of {len(failures)} failures"
        raise ValueError(f"told must be {expected}, got {check.short_repr(informed)}")
    changes = dict[int, list[tuple[Fault, bool]]]()
    for failure, known_s in zip(failures, times, strict=True):
        for at_s, is_known in ((failure.time_s, False), (known_s, True)):
            if at_s is not None:
                if check.number("told", at_s) < failure.time_s:
                    given = check.short_repr(informed)
                    raise ValueError(f"told must have no time before its failure, got {given}")
                tick = tick_of(at_s, rig.period_s)
                changes.setdefault(tick, []).append((Fault.of(failure), is_known))
    return sorted(changes.items())


def _dithered(dither: Dither | None, ticks: int, actuators: int, period_s: float) -> Array:
    if dither is None:
        return np.zeros((ticks, actuators))
    return np.array([dither.at(tick * period_s) for tick in range(ticks)])


def _static_offset(controller: PrioritizedController) -> Array | float:
    """Return the displacements (n,) at zero demand, nonzero for known locks off centre."""
    mapping = controller.mapping
    if not any(mapping.goal.locked_at.values()):
        return 0.0
    return mapping.displacements(mapping.initial_command().demand, mapping.nominal)


def _summarized(
    rig: "Rig", error: Array, states: Array, first: int, stages: tuple[Stage, Stage], *, white: bool
) -> Prediction:
    """Return the RMS of errors (N, m1) before and after the tick `first`, NaN beyond ranges.

    `stages` are the plants of the two parts; `white` adds the variance of white sensor noise.
    """
    squares, leaves = [], None
    for part, stage in zip((slice(first), slice(first, None)), stages, strict=True):
        leaves = leaves or _leaving(rig, states[part])
        squares.append(np.full(error.shape[1], np.nan))
        if leaves is None and len(error[part]):
            squares[-1] = (error[part] ** 2).mean(axis=0)
            squares[-1] += _noise_variance(rig, stage) if white else 0.0
    shares = min(first, len(error)) / len(error), 1 - min(first, len(error)) / len(error)
    total = np.sum([k * square for k, square in zip(shares, squares, strict=True) if k], axis=0)
    return Prediction(np.sqrt(squares[0]), np.sqrt(squares[1]), leaves, error, np.sqrt(total))


def _leaving(rig: "Rig", states: Array) -> str | None:
    """Return the actuator that leaves its range furthest in states (N, s), or None."""
    if not len(states):
        return None
    (lower, upper), moved = rig.travel, states @ rig.nominal.displacement.T
    beyond = np.maximum(lower - moved, moved - upper).max(axis=0)
    return rig.actuators[greatest(beyond)] if beyond.max() > 0.0 else None


def _noise_variance(rig: "Rig", stage: Stage) -> Array:
    """Return the variance (m1,) of the true task caused by white sensor noise."""
    m1 = len(rig.loops)
    slowest_hz = min(loop.crossover_hz for loop in rig.margins)
    pulses = np.zeros((m1, round(_PULSE_S / slowest_hz / rig.period_s), m1))
    pulses[range(m1), 0, range(m1)] = 1.0  # noise acts like a reference of the compensators alone
    alone = replace(stage.model, drift=np.zeros(len(stage.model.A)), dry_friction=None)
    first = Stage(alone, gain=stage.gain)
    ticks = steps([first], rig.nominal.plant.C, rig.loops, pulses)
    outputs = np.array([tick.output for tick in ticks])
    return np.einsum("tsk,s->k", outputs**2, rig.nominal.noise**2)


def open_loop(rig: "Rig", goal: Goal, faults: Sequence[Fault] = ()) -> "control.StateSpace":
    """Return the open loop of the major rows, errors to outputs: compensators, mapping, plant.

    Args:
        rig: The robot, its compensators included.
        goal: Goal of the mapping in the nominal posture, including known failures.
        faults: Faults of the plant.
    """
    import control  # late, as in ftc.compensator

    model, k = fault_model(rig.nominal, faults), rig.nominal.plant.nstates // 2
    locked = [fault.actuator for fault in faults if fault.kind == "locked"]
    basis = scipy.linalg.null_space(rig.nominal.displacement[locked, :k]) if locked else np.eye(k)
    Q = scipy.linalg.block_diag(basis, basis)
    B = model.B @ rig.mapping(goal).major_gain()
    plant = control.ss(Q.T @ model.A @ Q, Q.T @ B, rig.nominal.plant.C @ Q, 0, rig.period_s)
    return plant * control.append(*(loop.discrete for loop in rig.control.loops))


def pole_radius(L: "control.StateSpace") -> float:
    """Return the largest pole radius of the closed loop, which is stable up to `MARGINAL`."""
    import control  # late, as above

    return float(np.abs(control.feedback(L, np.eye(L.noutputs)).poles()).max())


def loop_peak(rig: "Rig", goal: Goal, faults: Sequence[Fault] = ()) -> float:
    """Return the peak over frequency of the largest singular value of the sensitivity (I + L)^-1.

    The inverse of the peak is the stability margin of all loops together, including coupling; a
    well-damped single loop has a peak below 2.
    """
    return sensitivity_peak(open_loop(rig, goal, faults))


def linear_run(
    rig: "Rig", path: Array, dither: Dither, faults: Sequence[Fault] = (), onset: int = 0
) -> tuple[Array, Array]:
    """Return states (N, s) and commanded displacements (N, n) of the linear loop without noise.

    The path is (N, m1). All faults occur at the tick `onset`, unknown to the mapping, which is that
    of the rig's goal in the nominal posture.
    """
    mapping, healthy = rig.mapping(rig.goal), fault_model(rig.nominal)
    failed = fault_model(rig.nominal, faults)
    stages = [Stage(healthy, gain=mapping.major_gain()), Stage(failed, onset)]
    dithered = _dithered(dither, len(path), rig.nominal.actuators, rig.period_s)
    secondary = dithered @ mapping.secondary_gain().T
    ticks = list(steps(stages, rig.nominal.plant.C, rig.loops, path, secondary=secondary))
    return np.array([tick.x for tick in ticks]), np.array([tick.commanded for tick in ticks])
