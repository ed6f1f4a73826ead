"""One machine with its pilot in flight, tick by tick, for a time that is not known beforehand."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from fjh.rig import Rig, Run
from fjh.rig.events import Event
from fjh.rig.events.effects import Effect
from fjh.rig.events.hooks import Hooks, effect_of
from fjh.rig.run import SOUND, run_of
from ftc import LoopRun, SupervisorState, one_tick
from ftc.fdi import LEARNING_S
from sim import Array, Failure, Pose

Kind = Literal["sound", "locked", "free", "weak"]


class LiveRun:
    """A machine, its pilot, and what happened to it.

    Attributes:
        rig: The robot.
        pilot: As of :meth:`.Rig.supervisor` or :meth:`.Rig.controller`.
        state: Of the pilot.
        tick: So many are done.
        desired: Of all ticks, shape (N, m1).
        changes: When actuators, by number, became of which kind.
        events: What else happened.
    """

    def __init__(self, rig: Rig, pilot: Any, ticks: int, seed: int) -> None:
        """Begin at rest a flight of at most so many ticks.

        All noise, and what is drawn of events, is of the seed.
        """
        self.rig, self.pilot, self.state = rig, pilot, pilot.start()
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
        """Time of the next tick."""
        return self.tick * self.rig.period_s

    @property
    def left(self) -> int:
        """Ticks that it has left."""
        return len(self._time_s) - self.tick

    def step(self, reference: Array, demand: Array | None) -> None:
        """One tick.

        Raises:
            sim.SimulationDiverged: The physics left the finite numbers.
        """
        k, known = self.tick, {} if demand is None else {"feedforward": demand}
        self.desired[k] = reference
        self.state, self._measured[k] = one_tick(
            self._bench, self.pilot.step, self.state, reference, **known
        )
        self._inputs[k] = self.state.inputs
        self.tick = k + 1

    def make(self, actuator: int, kind: Kind) -> None:
        """Let an actuator that works fail, from the next tick on, or work again.

        Raises:
            sim.ModelError: It is to lock and has no lock.
        """
        if kind == SOUND:
            self._bench.plant.repair(actuator)
        else:
            Failure(actuator, kind, self.now_s).strike(self._bench.plant)
        self.changes.append((self.now_s, actuator, kind))

    def begin(self, name: str) -> None:
        """An event that is of no actuator, from the next tick on."""
        self.end(name)
        event = Event(name, self.now_s)
        before = sum(each.name == name for each in self.events)
        self._effects[name], _ = effect_of(self.rig, event, self._seed, before)
        self._hooks.begin(self.tick, self._effects[name])
        self.events.append(event)

    def end(self, name: str) -> None:
        """The event is over."""
        if (effect := self._effects.pop(name, None)) is not None:
            self._hooks.end(effect)

    def switch_controller(self, pilot: Any, state: Any = None) -> None:
        """Go on with another pilot in a state; None is what it makes of the present one."""
        self.pilot, self.state = pilot, pilot.transfer(self.state) if state is None else state
        self._since = self.tick - getattr(self.state, "ticks", 0)

    @property
    def belief(self) -> str:
        """What the pilot believes now, and why, in a sentence."""
        state = self.state
        if not isinstance(state, SupervisorState):
            return "Does not diagnose: it goes on with what it knows."
        if state.is_learning and not state.watch.relearns:
            return f"It takes the first {LEARNING_S:g} s for the sound machine."
        said = state.status
        if state.sensors.failed:
            said = f"{said[:-1]}; {state.sensors.sentence(self.rig.period_s)}."
        return said

    def error(self, ticks: slice) -> Array:
        """Desired minus true at some ticks that are done, (T, m1)."""
        return self.desired[ticks] - self.seen(ticks)[2]

    @property
    def frame(self) -> tuple[Array, Array]:
        """Of the task, in the world: its origin (3,) at rest, and the axes (3, 3) of its rows."""
        return self._bench.plant.origin_m, self._bench.plant.axes

    def seen(self, ticks: slice) -> tuple[Array, Array, Array]:
        """At some ticks that are done: displacements (T, 6), qpos (T, nq), true rows (T, m1)."""
        bench = self._bench
        assert bench.qpos is not None  # a rig keeps them
        pose = Pose(bench.rotation[ticks], bench.translation_m[ticks])
        return pose.displacement(), bench.qpos[ticks], self.rig.reached(pose)

    def run(self, first: int) -> Run:
        """What happened from a tick on; of what happened before it, what still is.

        Without the poses that the pilot estimated, some kilobytes each: they are not kept.
        """
        looped = LoopRun(self._measured, self._inputs, self.state)
        begin_s, ticks = first * self.rig.period_s, slice(first, self.tick)
        last = {actuator: at_s for at_s, actuator, _ in self.changes if at_s < begin_s}
        failures = [
            Failure(actuator, kind, at_s)
            for at_s, actuator, kind in self.changes
            if kind != SOUND and (at_s >= begin_s or last[actuator] == at_s)
        ]
        around = looped, self._time_s, self.desired, failures, ticks, self._since
        run = run_of(self.rig, self._bench, *around)
        return replace(run, events=tuple(e for e in self.events if e.time_s >= begin_s))
