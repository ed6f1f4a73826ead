"""The linear model of a rig in the loop: errors of a run, before and after failures; stability."""

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
"""Length of the response to a sample of noise, in periods of the crossover."""

MARGINAL = 1 + 1e-9
"""A largest pole up to here is an integrator that the mapping lets move nothing."""


@dataclass(frozen=True)
class Prediction:
    """RMS of desired minus true, before the first failure and from it on, (m1,) each.

    NaN where there is no such time, and where the linear model does not hold.

    Attributes:
        rms_before: (m1,).
        rms_after: (m1,).
        leaves: The actuator that leaves its range in the linear model, which then says nothing any
            more; None is none.
        error: Desired minus true tick by tick, (N, m1), without noise that is not known.
        rms: Of the whole run, (m1,).
    """

    rms_before: Array
    rms_after: Array
    leaves: str | None
    error: Array
    rms: Array


Learns = bool | Sequence[float | None]
"""When a controller learns of failures: at once, never, or at a time [s] each; None is never."""


def predicted(
    rig: "Rig",
    path: Array,
    failures: Sequence[Failure],
    *,
    told: Learns = True,
    noise: Array | None = None,
    dither: Dither | None = None,
    goal: Goal,
    start: Array | None = None,
    floor_m_per_s2: Array | None = None,
    bent: Array | float = 0.0,
) -> Prediction:
    """The prediction of a run; see :meth:`fjh.rig.Rig.predict`.

    `bent` is what the task deviates by from the linear model besides, of the shape of the path.

    The plant is linear about its start and changes with each fault; the mapping is that of the
    start, and is reconfigured at the tick at which the controller learns of a fault; the actuators
    go on from where they stand, and their secondary motion does not fade. Noise that is not known
    is white.
    """
    controller, model, n = rig.controller(goal), fault_model(rig.nominal), rig.nominal.actuators
    x = None if start is None else at_rest(model.A, model.B, rig.period_s) @ start
    stages = [Stage(model, gain=controller.mapping.major_gain())]
    dithered = _dithered(dither, len(path), n, rig.period_s)
    secondary = dithered @ controller.mapping.secondary_gain().T + _standing(controller)
    floor = np.zeros((len(path), 3)) if floor_m_per_s2 is None else floor_m_per_s2
    pushed = np.zeros((len(path), len(model.A))) if model.floor is None else floor @ model.floor.T
    faults, first = list[Fault](), len(path)
    for tick, changes in _changes(rig, failures, told):
        onset = [fault for fault, is_known in changes if not is_known]
        first, faults = min(first, tick), [*faults, *onset]
        after, goes_on, mapping = fault_model(rig.nominal, faults), None, None
        if known := [Diagnosis.told(fault) for fault, is_known in changes if is_known]:
            goal = goal_after(goal, known, rig.nominal, rig.unused)
            mapping, goes_on = rig.mapping(goal), np.ones(n)
            goes_on[[*goal.locked_at, *goal.free]] = 0.0
            secondary[tick:] = dithered[tick:] @ mapping.secondary_gain().T
        gain = stages[-1].gain if mapping is None else mapping.major_gain()
        stages.append(Stage(after, tick, gain, goes_on))
        if after.floor is not None:
            pushed[tick:] = floor[tick:] @ after.floor.T
    ticks = list(
        steps(
            stages,
            rig.nominal.plant.C,
            rig.loops,
            (path if noise is None else path - noise) - bent,
            secondary=secondary,
            disturbance=pushed if floor.any() else None,
            limit=controller.demand_limit,
            anti_windup=controller.anti_windup,
            feedforward=rig.feedforward_demands(path),
            start=x,
        )
    )
    error = path - bent - np.array([tick.output for tick in ticks])
    states = np.array([tick.x for tick in ticks])
    return _summarized(rig, error, states, first, (stages[0], stages[-1]), white=noise is None)


def _changes(
    rig: "Rig", failures: Sequence[Failure], told: Learns
) -> list[tuple[int, list[tuple[Fault, bool]]]]:
    """Faults that occur, and those that become known, by control tick."""
    check.instance("told", told, bool, list, tuple, np.ndarray)
    times: Sequence[float | None] = (
        [each.time_s if told else None for each in failures] if isinstance(told, bool) else told
    )
    if len(times) != len(failures):
        expected = f"a time for each of {len(failures)} failures"
        raise ValueError(f"told must be {expected}, got {check.short_repr(told)}")
    changes = dict[int, list[tuple[Fault, bool]]]()
    for failure, known_s in zip(failures, times, strict=True):
        for at_s, is_known in ((failure.time_s, False), (known_s, True)):
            if at_s is not None:
                if check.number("told", at_s) < failure.time_s:
                    given = check.short_repr(told)
                    raise ValueError(f"told must be no times before the failures, got {given}")
                tick = tick_of(at_s, rig.period_s)
                changes.setdefault(tick, []).append((Fault.of(failure), is_known))
    return sorted(changes.items())


def _dithered(dither: Dither | None, ticks: int, actuators: int, period_s: float) -> Array:
    """Displacements that the dither asks of the actuators at each tick, (N, n)."""
    if dither is None:
        return np.zeros((ticks, actuators))
    return np.array([dither.at(tick * period_s) for tick in range(ticks)])


def _standing(controller: PrioritizedController) -> Array | float:
    """Displacements (n,) commanded at no demand, because a lock off centre is known."""
    mapping = controller.mapping
    if not any(mapping.goal.locked_at.values()):
        return 0.0
    return mapping.displacements(mapping.nothing().demand, mapping.nominal)


def _summarized(
    rig: "Rig",
    error: Array,
    states: Array,
    first: int,
    stages: tuple[Stage, Stage],
    *,
    white: bool,
) -> Prediction:
    """RMS of errors (N, m1) before a tick and from it on, until an actuator leaves its range.

    `stages` are the plants of the two parts; noise that is not known is white.
    """
    squares, leaves = [], None
    for part, stage in zip((slice(first), slice(first, None)), stages, strict=True):
        leaves = leaves or _leaving(rig, states[part])
        squares.append(np.full(error.shape[1], np.nan))
        if leaves is None and len(error[part]):
            squares[-1] = (error[part] ** 2).mean(axis=0)
            squares[-1] += _noise_variance(rig, stage) if white else 0.0
    shares = min(first, len(error)) / len(error), 1 - min(first, len(error)) / len(error)
    whole = np.sum([k * each for k, each in zip(shares, squares, strict=True) if k], axis=0)
    return Prediction(np.sqrt(squares[0]), np.sqrt(squares[1]), leaves, error, np.sqrt(whole))


def _leaving(rig: "Rig", states: Array) -> str | None:
    """The actuator that leaves its range furthest in these states (N, s); None where none does."""
    if not len(states):
        return None
    (lower, upper), moved = rig.travel, states @ rig.nominal.displacement.T
    beyond = np.maximum(lower - moved, moved - upper).max(axis=0)
    return rig.actuators[greatest(beyond)] if beyond.max() > 0.0 else None


def _noise_variance(rig: "Rig", stage: Stage) -> Array:
    """Variance (m1,) of the true task that the white noise of the sensors causes."""
    m1 = len(rig.loops)
    slowest_hz = min(each.crossover_hz for each in rig.margins)
    pulses = np.zeros((m1, round(_PULSE_S / slowest_hz / rig.period_s), m1))
    pulses[range(m1), 0, range(m1)] = 1.0  # a reference of the compensators alone is such a noise
    alone = replace(stage.model, drift=np.zeros(len(stage.model.A)), rubbing=None)
    first = Stage(alone, gain=stage.gain)
    outputs = np.array(
        [tick.output for tick in steps([first], rig.nominal.plant.C, rig.loops, pulses)]
    )
    return np.einsum("tsk,s->k", outputs**2, rig.nominal.noise**2)


def open_loop(rig: "Rig", goal: Goal, faults: Sequence[Fault] = ()) -> "control.StateSpace":
    """The open loop from errors of the major rows to the rows: compensators, mapping, plant.

    Args:
        rig: The robot, with all compensators.
        goal: Of the mapping, in the nominal posture; failures that it knows included.
        faults: Of the plant, on the coordinates that locks leave.
    """
    import control  # late, as in ftc.compensator

    model, k = fault_model(rig.nominal, faults), rig.nominal.plant.nstates // 2
    locked = [fault.actuator for fault in faults if fault.kind == "locked"]
    left = scipy.linalg.null_space(rig.nominal.displacement[locked, :k]) if locked else np.eye(k)
    Q = scipy.linalg.block_diag(left, left)
    B = model.B @ rig.mapping(goal).major_gain()
    plant = control.ss(Q.T @ model.A @ Q, Q.T @ B, rig.nominal.plant.C @ Q, 0, rig.period_s)
    return plant * control.append(*(loop.discrete for loop in rig.control.loops))


def pole_radius(L: "control.StateSpace") -> float:
    """Size of the largest pole of an open loop's closed loop: up to `MARGINAL` it is stable."""
    import control  # late, as above

    return float(np.abs(control.feedback(L, np.eye(L.noutputs)).poles()).max())


def loop_peak(rig: "Rig", goal: Goal, faults: Sequence[Fault] = ()) -> float:
    """Peak over frequency of the largest singular value of the sensitivity (I + L)^-1.

    Its inverse is how near the loops come to instability, all rows and their coupling taken
    together; a well-damped single loop has less than 2.
    """
    return sensitivity_peak(open_loop(rig, goal, faults))


def linear_run(
    rig: "Rig", path: Array, dither: Dither, faults: Sequence[Fault] = (), onset: int = 0
) -> tuple[Array, Array]:
    """States (N, s) and displacements commanded (N, n) of the linear loop on a path, without noise.

    The path is (N, m1). The faults strike all at once at the tick `onset`, unknown to the mapping,
    which is that of the rig's goal in the nominal posture.
    """
    mapping, sound = rig.mapping(rig.goal), fault_model(rig.nominal)
    failed = fault_model(rig.nominal, faults)
    stages = [Stage(sound, gain=mapping.major_gain()), Stage(failed, onset)]
    dithered = _dithered(dither, len(path), rig.nominal.actuators, rig.period_s)
    secondary = dithered @ mapping.secondary_gain().T
    ticks = list(steps(stages, rig.nominal.plant.C, rig.loops, path, secondary=secondary))
    return np.array([tick.x for tick in ticks]), np.array([tick.commanded for tick in ticks])
