"""The supervisor of the hexapod: diagnosis beside control, :mod:`ftc.supervisor` on it."""

from collections.abc import Sequence

import mujoco

from experiments.hexapod.choices import JacobianChoice
<<<<<<< HEAD
=======
from experiments.hexapod.compensator import Loop
from experiments.hexapod.diagnosis import nominal_model
from experiments.hexapod.dithers import STILL
>>>>>>> fdi
from experiments.hexapod.goal import MAJOR, Goal
from experiments.hexapod.simulation import controller_for
from experiments.hexapod.springs import elastic_system
from experiments.hexapod.testbed import Bench
<<<<<<< HEAD
from ftc.compensator import Compensator
from ftc.controller import Controller
from ftc.fdi.config import RULES, Rules
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.dither import STILL, Dither
from ftc.fdi.fault_model import Fault, SoundMachine, sound_machine
from ftc.fdi.monitor import monitor
from ftc.fdi.sensing import sensing
from ftc.supervisor import WEAKEST as WEAKEST  # lead: remove
from ftc.supervisor import Supervisor, reconfigured_goal
from ftc.supervisor import SupervisorState as SupervisorState  # lead: remove
from ftc.supervisor import falling as falling  # lead: remove
from prioritized import failure_atlas
from sim import Pose
=======
from ftc.controller import Controller, Sensed
from ftc.fdi.diagnosis import DEFAULT_CONFIG, Diagnosis, FdiConfig, MonitorState
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, NominalModel
from ftc.fdi.monitor import Monitor, monitor
from prioritized import failure_atlas
from sim import Amplifier, Array


@dataclass(frozen=True)
class SupervisorState(PointingState):
    """What the supervisor remembers.

    Attributes:
        flies: The controller that flies; `controller` is its state.
        watch: State of the monitor.
        monitor: That monitor.
        confirmed: The diagnoses that are believed.
        diagnoses: All that were made, revised and withdrawn ones included, in order.
        task_lost: Whether the struts that are left can no longer point; the commands then stand
            still.
        ticks: Flown.
    """

    flies: Controller
    watch: MonitorState
    monitor: Monitor
    confirmed: tuple[Diagnosis, ...] = ()
    diagnoses: tuple[Diagnosis, ...] = ()
    task_lost: bool = False
    ticks: int = 0

    @property
    def standing(self) -> list[Diagnosis]:
        """What is held to be true: the last confirmed on each strut, and the one in question."""
        latest = self.confirmed
        if self.watch.diagnosis is not None:
            latest = (*latest, self.watch.diagnosis)
        return list({each.fault.actuator: each for each in latest}.values())


@dataclass(frozen=True)
class Supervisor:
    """Diagnosis beside control.

    Attributes:
        first: Controller of the sound machine.
        monitor: Of the sound machine.
        dither: Desired secondary motion.
        reconfigured: Controller that knows of these failures.
        can_point: Whether the struts that are left can still point.
    """

    first: Controller
    monitor: Monitor
    dither: Dither
    reconfigured: Callable[[Sequence[Diagnosis]], Controller]
    can_point: Callable[[Sequence[Fault]], bool]

    @property
    def amplifier(self) -> Amplifier:
        """The same for all controllers."""
        return self.first.amplifier

    def start(self) -> SupervisorState:
        """At rest at the nominal pose, believing in a sound machine."""
        return SupervisorState(self.first.start(), self.first, self.monitor.start(), self.monitor)

    def step(self, state: SupervisorState, desired_rad: Array, sensed: Sensed) -> SupervisorState:
        """One control tick: first what has happened, then what to do."""
        if state.task_lost and state.watch.diagnosis is None:
            return replace(state, ticks=state.ticks + 1)
        sent_m = self.amplifier.displacement_m(state.input_percent)
        known = state.watch.diagnosis
        measured = np.concatenate([sensed.pointing_rad, sensed.strut_m])
        outputs = len(state.monitor.nominal.noise)  # without the gauges unless they are used
        watch = state.monitor.step(state.watch, measured[:outputs], sent_m)
        state = replace(state, watch=watch)
        if watch.diagnosis is not known:
            state = self._reconfigured(state, sent_m)
        if not state.task_lost:
            rest_m = self.dither.at(state.ticks * self.monitor.nominal.period_s)
            controller = state.flies.step(state.controller, desired_rad, sensed, rest_m)
            state = replace(state, controller=controller)
        return replace(state, ticks=state.ticks + 1)

    def _reconfigured(self, state: SupervisorState, sent_m: Array) -> SupervisorState:
        """The mapping goes over to what is held to be true now; the compensators stay."""
        found, believed = state.watch.diagnosis, state.standing
        falling_m = np.zeros(len(sent_m))
        if found is not None:
            state = replace(state, diagnoses=(*state.diagnoses, found))
            falling_m = falling(found, sent_m)
        lost = not self.can_point([each.fault for each in believed])
        state = replace(state, task_lost=lost)
        if not lost:
            flies = self.reconfigured(believed)
            controller = flies.take_over(state.controller, falling_m)
            state = replace(state, flies=flies, controller=controller)
        if found is None or not found.confirmed:
            return state
        state = replace(state, confirmed=(*state.confirmed, found))
        if lost:  # nothing is left to be done about another failure
            return replace(state, watch=replace(state.watch, diagnosis=None, evidence=None))
        monitor, watch = state.monitor.believing(state.watch)
        return replace(state, monitor=monitor, watch=watch)


WEAKEST = 0.5
"""A coil with less of its force left is left alone. Commanded seven times as much by mistake, a
sound strut would make the loop unstable: docs/recover.md."""


def reckoned_strength(diagnosis: Diagnosis) -> float:
    """Part of the coil's force that the mapping reckons with; 0 is a strut that is left alone."""
    fault = diagnosis.fault
    return fault.effectiveness if fault.kind == "weak" and fault.effectiveness >= WEAKEST else 0.0


def falling(diagnosis: Diagnosis, sent_m: Array) -> Array:
    """What the diagnosed strut is about to lose of its displacement, shape (6,).

    `sent_m`, shape (6,), is what the struts are commanded to. A strut that has stuck loses nothing,
    nor one that had been found out before.
    """
    fault, falling_m = diagnosis.fault, np.zeros(len(sent_m))
    if fault.kind != "locked" and not diagnosis.confirmed:
        held_m = reckoned_strength(diagnosis) * sent_m[fault.actuator]
        falling_m[fault.actuator] = diagnosis.displacement - held_m
    return falling_m


def reconfigured_goal(goal: Goal, diagnoses: Sequence[Diagnosis]) -> Goal:
    """The goal with what is known of the struts.

    A strut without its coil counts as stuck at its centre: its suspension spring holds it there to
    6e-4, and in a loop of 8 Hz that is the better model even without the spring (docs/theory.md).
    """
    locked_m = dict(goal.locked_m)
    strength = dict(goal.strength)
    for diagnosis in diagnoses:
        fault, left = diagnosis.fault, reckoned_strength(diagnosis)
        if left > 0:
            strength[fault.actuator] = left
        else:
            locked_m[fault.actuator] = diagnosis.displacement if fault.kind == "locked" else 0.0
    return replace(goal, locked_m=locked_m, strength=strength)
>>>>>>> fdi


def supervisor(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Compensator, Compensator],
    goal: Goal,
    *,
    jacobian: JacobianChoice = "constant",
    strut_sensors: bool = False,
    dither: Dither = STILL,
    config: FdiConfig = DEFAULT_CONFIG,
    nominal: NominalModel | None = None,
) -> Supervisor:
    """Diagnosis and control for this machine.

    Args:
        model: The machine, sound; the plant of a run is another.
        bench: Constants around it.
        loops: Compensators.
        goal: While all struts are sound.
        jacobian: Of the mapping.
        strut_sensors: Whether the diagnosis may use them.
        dither: What finds failures sooner.
        config: Rates and confidences.
        nominal: What the diagnosis takes the machine for; None is the model's.
    """
    if nominal is None:
        nominal = nominal_model(model, bench, strut_sensors=strut_sensors)
    atlas = failure_atlas(elastic_system(model), MAJOR)

    def controller(diagnoses: Sequence[Diagnosis]) -> Controller[Pose]:
        known = reconfigured_goal(goal, diagnoses)
        return controller_for(model, bench, loops, known, jacobian=jacobian)

    def can_point(faults: Sequence[Fault]) -> bool:
        assert atlas.elastic is not None  # the hexapod has springs
        by_kind = {
            kind: [fault.actuator for fault in faults if fault.kind == kind]
            for kind in ("locked", "free")
        }
        return bool(atlas.elastic.possible[atlas.row(**by_kind)])

    return Supervisor(
        first=controller([]),
<<<<<<< HEAD
        monitor=monitor((), sound, sensing(sound, bench, strut_sensors), rules),
        secondary=dither.at,
=======
        monitor=monitor(nominal, config=config),
        dither=dither,
>>>>>>> fdi
        reconfigured=controller,
        can_point=can_point,
    )
