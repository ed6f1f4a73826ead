"""The supervisor of the hexapod: diagnosis beside control, :mod:`ftc.supervisor` on it."""

from collections.abc import Sequence

import mujoco

from experiments.hexapod.choices import JacobianChoice
from experiments.hexapod.columns import MAJOR
from experiments.hexapod.diagnosis import nominal_model
from experiments.hexapod.dithers import STILL
from experiments.hexapod.simulation import controller_for
from experiments.hexapod.springs import elastic_system
from experiments.hexapod.testbed import Bench
from ftc.compensator import Compensator
from ftc.controller import Controller
from ftc.fdi.diagnosis import DEFAULT_CONFIG, Diagnosis, FdiConfig
from ftc.fdi.dither import Dither
from ftc.fdi.fault_model import Fault, NominalModel
from ftc.fdi.monitor import monitor
from ftc.goal import Goal
from ftc.supervisor import Supervisor, reconfigured_goal
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
        monitor=monitor(nominal, config=config),
        secondary=dither.at,
        reconfigured=controller,
        can_point=can_point,
    )
