"""The supervisor of the hexapod: diagnosis beside control, :mod:`ftc.supervisor` on it."""

from collections.abc import Sequence

import mujoco

from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.goal import MAJOR, Goal
from experiments.hexapod.simulation import controller_for
from experiments.hexapod.springs import elastic_system
from experiments.hexapod.testbed import Bench
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


def supervisor(
    model: mujoco.MjModel,
    bench: Bench,
    loops: tuple[Compensator, Compensator],
    goal: Goal,
    *,
    jacobian: JacobianChoice = "constant",
    strut_sensors: bool = False,
    dither: Dither = STILL,
    rules: Rules = RULES,
    sound: SoundMachine | None = None,
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
        rules: Rates and confidences.
        sound: What the diagnosis takes the machine for; None is the model's.
    """
    sound = sound_machine(model, bench) if sound is None else sound
    atlas = failure_atlas(elastic_system(model), MAJOR)

    def controller(diagnoses: Sequence[Diagnosis]) -> Controller[Pose]:
        known = reconfigured_goal(goal, diagnoses)
        return controller_for(model, bench, loops, known, jacobian=jacobian)

    def can_point(faults: Sequence[Fault]) -> bool:
        assert atlas.elastic is not None  # the hexapod has springs
        by_kind = {
            kind: [fault.strut for fault in faults if fault.kind == kind]
            for kind in ("locked", "free")
        }
        return bool(atlas.elastic.possible[atlas.row(**by_kind)])

    return Supervisor(
        first=controller([]),
        monitor=monitor((), sound, sensing(sound, bench, strut_sensors), rules),
        secondary=dither.at,
        reconfigured=controller,
        can_point=can_point,
    )
