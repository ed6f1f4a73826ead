"""Simulation of one machine with its controller, tick by tick, for an unknown duration."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from fjh.rig import Rig, Run
from fjh.rig.events import Event
from fjh.rig.events.effects import Effect
from fjh.rig.events.hooks import Hooks, effect_of
from fjh.rig.run import HEALTHY, run_of
from ftc import LoopRun, SupervisorState, one_tick
from ftc.fdi import LEARNING_S
from sim import Array, Failure, Pose

Kind = Literal["healthy", "locked", "free", "weak"]


class LiveRun:
    """Running simulation of a machine and its controller, with its failures and events.

    Attributes:
        rig: The robot.
        controller: Controller, from :meth:`.Rig.supervisor` or :meth:`.Rig.controller`.
        state: State of the controller.
        tick: Number of simulated ticks.
        desired: Desired displacements of the major rows at all ticks, (N, m1), [rad] or [m].
        changes: Time [s], actuator number and new kind of each change.
        events: Other events.
    """

    def __init__(self, rig: Rig, controller: Any, ticks: int, seed: int) -> None:
        """Prepare a run of at most `ticks` ticks that starts at rest.

        The seed determines all noise and the random parameters of events.
        """
        self.rig, self.controller, self.state = rig, controller, controller.start()
        self._hooks, self._seed, self._since = Hooks(), seed, 0
        self._time_s = np.arange(ticks) * rig.period_s
        self._bench = rig.bench(self._time_s, (), seed, self._hooks)
        self.tick, m1 = 0, len(rig.major)
        self.desired, self._measured = np.empty((ticks, m1)), np.empty((ticks, m1))
        self._inputs = np.empty((ticks, len(rig.actuators)))
        self._effects = dict[str, Effect]()
        self.changes, self.events = list[tuple[float, int, Kind]](), list[Event]()

    @property
    def now_s(self) -> float:
        """Time of the next tick [s]."""
        return self.tick * self.rig.period_s

    @property
    def ticks_left(self) -> int:
        """Number of ticks that can still be simulated."""
        return len(self._time_s) - self.tick

    def step(self, reference: Array, demand: Array | None) -> None:
        """Simulate one tick with desired displacements (m1,) and feedforward demands (m1,) or None.

        Raises:
            sim.SimulationDiverged: The state of the physics is not finite.
        """
        k, known = self.tick, {} if demand is None else {"feedforward": demand}
        self.desired[k] = reference
        self.state, self._measured[k] = one_tick(
            self._bench, self.controller.step, self.state, reference, **known
        )
        self._inputs[k] = self.state.inputs
        self.tick = k + 1

    def make(self, actuator: int, kind: Kind) -> None:
        """Let a healthy actuator fail, or repair it, from the next tick on.

        Raises:
            sim.ModelError: The actuator is to lock, but the model has no lock for it.
        """
        if kind == HEALTHY:
            self._bench.plant.repair(actuator)
        else:
            Failure(actuator, kind, self.now_s).inject(self._bench.plant)
        self.changes.append((self.now_s, actuator, kind))

    def start_event(self, name: str) -> None:
        """Start an event without an actuator at the next tick."""
        self.end_event(name)
        event = Event(name, self.now_s)
        count = sum(former.name == name for former in self.events)
        self._effects[name], _ = effect_of(self.rig, event, self._seed, count)
        self._hooks.start(self.tick, self._effects[name])
        self.events.append(event)

    def end_event(self, name: str) -> None:
        """End an event, if it is active."""
        if (effect := self._effects.pop(name, None)) is not None:
            self._hooks.end(effect)

    def switch_controller(self, controller: Any, state: Any = None) -> None:
        """Continue with another controller in a state; None: the present state, transferred."""
        self.state = controller.transfer(self.state) if state is None else state
        self.controller = controller
        self._since = self.tick - getattr(self.state, "ticks", 0)

    @property
    def diagnosis_text(self) -> str:
        """Sentence on the present diagnosis and its reason."""
        state = self.state
        if not isinstance(state, SupervisorState):
            return "No diagnosis: the controller continues with the failures known so far."
        if state.is_learning and not state.monitor_state.relearns:
            return f"The diagnosis is calibrated in the first {LEARNING_S:g} s, without failures."
        text = state.status
        if state.sensors.failed:
            text = f"{text[:-1]}; {state.sensors.sentence(self.rig.period_s)}."
        return text

    def error(self, ticks: slice) -> Array:
        """Return desired minus true displacements (T, m1) in a slice of ticks, [rad] or [m]."""
        return self.desired[ticks] - self.motion(ticks)[2]

    @property
    def frame(self) -> tuple[Array, Array]:
        """Task frame in the world at the start: origin (3,) [m], axes (3, 3) of the task rows."""
        return self._bench.plant.origin_m, self._bench.plant.axes

    def motion(self, ticks: slice) -> tuple[Array, Array, Array]:
        """Return task displacements (T, 6), qpos (T, nq), true rows (T, m1) in a slice of ticks."""
        bench = self._bench
        assert bench.qpos is not None  # a rig logs them
        pose = Pose(bench.rotation[ticks], bench.translation_m[ticks])
        return pose.displacement(), bench.qpos[ticks], self.rig.reached(pose)

    def logged_run(self, first: int) -> Run:
        """Return the run from a tick on; earlier failures that still exist start at that tick.

        Estimated poses are not logged, which would take kilobytes each.
        """
        looped = LoopRun(self._measured, self._inputs, self.state)
        start_s, ticks = first * self.rig.period_s, slice(first, self.tick)
        last = {actuator: at_s for at_s, actuator, _ in self.changes if at_s < start_s}
        failures = [
            Failure(actuator, kind, at_s)
            for at_s, actuator, kind in self.changes
            if kind != HEALTHY and (at_s >= start_s or last[actuator] == at_s)
        ]
        context = looped, self._time_s, self.desired, failures, ticks, self._since
        run = run_of(self.rig, self._bench, *context)
        return replace(run, events=tuple(e for e in self.events if e.time_s >= start_s))
