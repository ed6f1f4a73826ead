"""The ticks of a flight in compiled code, as far as it goes: bit for bit as step by step."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.rig.hexapod.columns import MAJOR
from experiments.rig.hexapod.controller import StrutMapping
from experiments.rig.hexapod.machine import HexapodSensors
from ftc.control.local_mapping import PreviousCommand
from ftc.controller import ControllerState, PrioritizedController
from ftc.loop import LoopRun
from kernels import Struct, lib, pointer
from sim import Amplifier, Array, Bench, Pose, Posture
from sim.kinematics.pose import computed, made

State = ControllerState[Pose]


class _Log(NamedTuple):
    """What the controller knows before the first tick and after each, N + 1 rows of everything."""

    compensator: Array
    rotation: Array
    translation_m: Array
    inverse_jacobian: Array
    displacement_m: Array
    demand: Array
    displacements: Array
    inputs: Array

    @classmethod
    def of(cls, ticks: int, state: State, posture: Posture) -> "_Log":
        """An empty one that begins with a state, and the struts at its pose."""
        first = (
            *(state.compensator, posture.rotation, posture.translation_m),
            *(posture.inverse_jacobian, posture.displacement_m),
            *(state.asked.demand, state.asked.displacements, state.inputs),
        )
        log = cls(*(np.empty((ticks + 1, *value.shape)) for value in first))
        for rows, value in zip(log, first, strict=True):
            rows[0] = value
        return log

    def state(self, done: int, *, constant: bool) -> State:
        """After so many ticks; struts do not belong to a pose whose Jacobian is constant."""
        compensator, R, t, A, struts_m, demand, displacements, inputs = (
            rows[done].copy() for rows in self
        )
        kind, there = Pose, {"rotation": R, "translation_m": t}
        if not constant:
            kind = Posture
            there |= {"displacement_m": struts_m, "inverse_jacobian": A}
        pose = computed(kind, **there)
        asked = PreviousCommand(demand, displacements, np.zeros_like(displacements))
        return ControllerState(compensator, inputs, pose, asked)

    def poses(self, done: int) -> list[Pose]:
        """After each of so many ticks."""
        moved = slice(1, done + 1)
        return [
            made(Pose, rotation=R, translation_m=t)
            for R, t in zip(self.rotation[moved], self.translation_m[moved], strict=True)
        ]


def begun(
    bench: Bench,
    pilot: Any,
    reference: Array,
    feedforward: Array | None,
    on_tick: Callable[[int], None] | None,
) -> LoopRun[State] | None:
    """A flight up to where the compiled code ends, if it can begin.

    It has a controller that does not diagnose, with sound or locked struts, and no limits; it ends
    where a pose is singular or a rank in doubt.
    """
    own, sensors = _of_pilot(pilot), bench.sensors
    if own is None or not isinstance(sensors, HexapodSensors):
        return None
    ticks, first = len(reference), pilot.start()
    if feedforward is None:
        feedforward = reference if pilot.reference_feedforward else np.zeros_like(reference)
    log = _Log.of(ticks, first, pilot.mapping.geometry.posture(first.pose))
    measured, inputs = np.empty(reference.shape), log.inputs
    task = Struct(
        "strut_task",
        observed=bench.observed,
        reference=np.ascontiguousarray(reference),
        feedforward=np.ascontiguousarray(feedforward),
        measured=measured,
        **sensors.detecting(ticks),
        **own,
        **log._asdict(),
    )
    call = lib.strut_tick

    def closed(tick: int, gaps: Array, owners: NDArray[np.int32], rows: int) -> Array | None:
        done = call(task.pointer, tick, pointer(gaps), pointer(owners), rows)
        return inputs[tick + 1] if done else None

    done = 0
    while done < ticks and bench.advance(closed):
        done += 1
        if on_tick is not None:
            on_tick(done)
    if not done:
        return None
    sensors.skip(done)
    state = log.state(done, constant=pilot.mapping.jacobian == "constant")
    return LoopRun(measured[:done], inputs[1 : done + 1], log.poses(done), state)


def _of_pilot(pilot: Any) -> dict[str, Any] | None:
    """What the compiled code takes of a controller; None where it does other things, too."""
    if type(pilot) is not PrioritizedController or type(pilot.mapping) is not StrutMapping:
        return None
    following, M = pilot.mapping.following(), pilot.linear
    if following is None or M is None or not isinstance(pilot.drives, Amplifier):
        return None
    if len(M) > lib.STRUT_ROOM:
        return None
    rest = {"M": np.ascontiguousarray(M), "order": len(M) - len(MAJOR)}
    return {**pilot.drives.conversions, **following, **rest}
