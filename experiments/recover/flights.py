"""One failure flown: by a controller that knows nothing, one that knows all, one that finds out."""

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.hexapod.compensator import Loop
from experiments.hexapod.metrics import closure_residual_max_m
from experiments.hexapod.pilot import NEVER, Informed, Pilot, State
from experiments.hexapod.simulation import Trajectory, controller_for, fly
from experiments.hexapod.supervisor import reconfigured_goal, supervisor
from experiments.hexapod.testbed import Bench
from experiments.recover.cases import AFTER_S, BEFORE_S, GOAL, RECOVERED_S, Case
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, SoundMachine
from sim import Array

CATCHING_UP_S = 0.5
"""At the start of a flight; not counted."""


@dataclass(frozen=True)
class Found:
    """What the supervisor made of one case.

    Attributes:
        case: What happened.
        diagnoses: All of them, in order; ticks count from the start of the flight.
        standing: Those held to be true in the end.
        false_alarm: Whether there was an alarm before the failure.
        unexplained: Whether it gave an alarm up.
        task_lost: Whether it declared the task lost.
        closure_residual_max_m: Of the flight.
    """

    case: Case
    diagnoses: tuple[Diagnosis, ...]
    standing: tuple[Diagnosis, ...]
    false_alarm: bool
    unexplained: bool
    task_lost: bool
    closure_residual_max_m: float

    @property
    def first(self) -> Diagnosis | None:
        """The first that came after the failure."""
        return next((each for each in self.diagnoses if each.tick >= STRUCK), None)

    @property
    def last(self) -> Diagnosis | None:
        """What it held to be true at the end."""
        return self.standing[-1] if self.standing else None

    @property
    def strut_right(self) -> bool:
        """Whether the strut was, as first named, and nothing had been suspected before."""
        named = self.first is not None and self.first.fault.strut == self.case.strut
        return named and not self.false_alarm

    @property
    def right(self) -> bool:
        """Whether strut and kind were, as held in the end, and nothing else was held."""
        held = [(each.fault.strut, each.fault.kind) for each in self.standing]
        return held == [(self.case.strut, self.case.kind)] and not self.false_alarm


STRUCK = round(BEFORE_S / Bench().control_period_s)
"""Tick of the failure in each flight."""


def find(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    case: Case,
    dither: Dither,
    strut_sensors: bool,
    flown: mujoco.MjModel | None = None,
    sound: SoundMachine | None = None,
) -> tuple[Trajectory, Found]:
    """Fly a case with a supervisor, W_a, constant Jacobian.

    `flown` is the machine, if it is not quite the model; `sound` what the diagnosis takes it for.
    """
    pilot = supervisor(
        model,
        bench,
        loops,
        GOAL,
        dither=case.dither(dither),
        strut_sensors=strut_sensors,
        sound=sound,
    )
    run, state = _flown(model if flown is None else flown, bench, pilot, case)
    return run, Found(
        case=case,
        diagnoses=state.diagnoses,
        standing=tuple(state.standing),
        false_alarm=any(tick < STRUCK for tick in state.watch.alarm_ticks),
        unexplained=state.watch.unexplained,
        task_lost=state.task_lost,
        closure_residual_max_m=closure_residual_max_m(run),
    )


def uncorrected(
    model: mujoco.MjModel, bench: Bench, loops: tuple[Loop, Loop], case: Case, dither: Dither
) -> Trajectory:
    """The same flight by a controller that goes on as if nothing had happened."""
    pilot = controller_for(model, bench, loops, GOAL, jacobian="constant")
    deaf = Informed(pilot, pilot, NEVER, secondary=case.dither(dither).at)
    return _flown(model, bench, deaf, case)[0]


def informed(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Loop, Loop],
    case: Case,
    dither: Dither,
    displacement_m: float,
    *,
    told: Fault | None = None,
    late_s: float = 0.0,
) -> Trajectory:
    """The same flight by a controller that is told what has happened: at once, or wrongly, or late.

    Args:
        model: As in :func:`find`, and so are the next four.
        bench: As there.
        loops: As there.
        case: As there.
        dither: As there.
        displacement_m: Where the strut has stuck, which is the same in all flights of a case.
        told: The fault it is told of; None is the truth.
        late_s: So long after the failure.
    """
    tick = STRUCK + round(late_s / bench.control_period_s)
    fault = case.fault if told is None else told
    news = Diagnosis(fault, 1.0, 1.0, displacement_m, STRUCK, STRUCK, tick, settled=True)
    before = controller_for(model, bench, loops, GOAL, jacobian="constant")
    goal = reconfigured_goal(GOAL, [news])
    after = controller_for(model, bench, loops, goal, jacobian="constant")
    falling_m = np.zeros(6)
    if fault.kind != "locked" and late_s == 0:
        falling_m[fault.strut] = (1 - fault.strength) * displacement_m
    pilot = Informed(before, after, tick, falling_m, case.dither(dither).at)
    return _flown(model, bench, pilot, case)[0]


def _flown(
    model: mujoco.MjModel, bench: Bench, pilot: Pilot[State], case: Case
) -> tuple[Trajectory, State]:
    return fly(
        model,
        bench,
        pilot,
        failures=[case.failure],
        seed=case.seed,
        begin_s=case.begin_s,
        duration_s=BEFORE_S + AFTER_S,
    )


@dataclass(frozen=True)
class Errors:
    """Pointing error |desired - true|, both angles together, [urad].

    Attributes:
        rms_urad: Before the failure, during, and after recovery.
        peak_urad: Alike.
    """

    rms_urad: tuple[float, ...]
    peak_urad: tuple[float, ...]


def errors(run: Trajectory) -> Errors:
    """Before, during and after: see RECOVERED_S."""
    size = pointing_error_urad(run)
    period_s = run.time_s[1] - run.time_s[0]
    edges = [round(s / period_s) for s in (CATCHING_UP_S, BEFORE_S, BEFORE_S + RECOVERED_S)]
    _, *parts = np.split(size, edges)
    return Errors(
        rms_urad=tuple(float(np.sqrt((part**2).mean())) for part in parts),
        peak_urad=tuple(float(part.max()) for part in parts),
    )


def pointing_error_urad(run: Trajectory) -> Array:
    """Size of desired minus true (alpha, beta), shape (N,)."""
    return 1e6 * np.linalg.norm(run.desired_rad - run.true_rad, axis=1)
