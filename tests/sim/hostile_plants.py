"""Targets of hostile arguments: plants, their failures, benches and their sensors."""

from typing import Any

import numpy as np

from sim import NOMINAL, Bench, Failure, Mechanism, Plant, linearize, servoed
from sim.plant import JointSensors, MaxwellSlip, TaskSensor, failed_plant
from tests.hostile import Target
from tests.sim.hostile_hexapod import DATA, MODEL
from tests.sim.hostile_mechanisms import ARM, AT_REST

TICKS, PERIOD_S = 2, 2.5e-4


def state(plant: Plant) -> Any:
    """All that a plant tells of itself."""
    loads = (plant.data.qfrc_constraint, plant.coil_force_n(), plant.closure_residual_m())
    return plant.pose(), plant.displacement(), plant.displacements(), loads


def after(method: str) -> Any:
    """What a plant tells after one of its methods and two physics steps."""

    def act(**given: Any) -> Any:
        plant = Plant(MODEL)
        getattr(plant, method)(**given)
        plant.step(np.zeros(6), 2e-3)
        return state(plant)

    return act


def struck(**given: Any) -> Any:
    return state(failed_plant(MODEL, [Failure(**given)]))


def run(bench: Bench) -> Any:
    """All that a bench has logged after its ticks."""
    for _ in bench.rotation:
        bench.measure()
        bench.apply(np.zeros(7))
    return {name: getattr(bench, name) for name in LOGGED}


def on_bench(**given: Any) -> Any:
    plant = given.pop("plant", None)
    bench = Bench(plant, **{**USUAL, **given})
    if isinstance(plant, Plant):  # what runs has its own; most are refused before, in less time
        bench = Bench(Plant(ARM), **{**USUAL, **given})
    return run(bench)


def applied(**given: Any) -> Any:
    bench = Bench(Plant(ARM), **USUAL)
    bench.measure()
    bench.apply(**given)
    return state(bench.plant)


class Doubled:
    """What else happens on a bench."""

    def sent(self, tick: int, inputs: np.ndarray) -> np.ndarray:
        """What the drives get."""
        return 2.0 * inputs


LOGGED = ("rotation", "translation_m", "displacement", "closure_residual_m", "qpos")
LOGGED += ("actuator_force",)
USUAL: dict[str, Any] = {"sensors": TaskSensor([0, 1], 1e-5, 1e-5, 0), "period_s": PERIOD_S}
USUAL |= {"time_s": PERIOD_S * np.arange(TICKS)}
BENCH = {"plant": Plant(ARM), "failures": [Failure(2, "weak")], "drives": np.negative}
BENCH |= {"floor_m_per_s2": np.full((TICKS, 3), 1e-3), "delay_ticks": 1, "events": Doubled()}
BENCH |= {"hysteresis": MaxwellSlip(np.ones((7, 2)), np.ones((7, 2))), "keep_qpos": True}
SENSED = {"pose": NOMINAL, "displacements": np.zeros(7)}
TASK: dict[str, Any] = {"rows": [0, 1], "noise": 1e-5, "encoder_noise": 1e-5, "seed": 3}
JOINTS = {"mechanism": Mechanism(ARM), "rows": [0, 1], "encoder_noise": 1e-5, "seed": [3, 4]}
SLIP = MaxwellSlip(np.full((2, 3), 1e3), np.full((2, 3), 1e-6))
FAILED = {"actuator": 0, "kind": "weak", "time_s": 0.0, "effectiveness": 0.5}

TARGETS = {
    "Failure": Target(struck, FAILED),
    "Failure.parse": Target(lambda **a: str(Failure.parse(**a)), {"text": "strut1:locked@1.3"}),
    "Failure.strike": Target(Failure(0, "weak").strike, {"plant": Plant(MODEL)}),
    "failed_plant": Target(
        lambda **a: state(failed_plant(**a)), {"model": MODEL, "failures": [Failure(0, "locked")]}
    ),
    "Plant": Target(
        lambda **a: state(Plant(**a)),
        {"model": MODEL, "base": "base", "payload": "payload"},
    ),
    "Plant.step": Target(after("step"), {"command_m": np.full(6, 1e-5), "period_s": 2e-3}),
    "Plant.settle": Target(after("settle"), {"seconds": 2e-3, "command_m": np.full(6, 1e-5)}),
    "Plant.lock": Target(after("lock"), {"actuator": 0}),
    "Plant.release": Target(after("release"), {"actuator": 0}),
    "Plant.break_loose": Target(after("break_loose"), {"actuator": 0}),
    "Plant.repair": Target(after("repair"), {"actuator": 0}),
    "Plant.weaken": Target(after("weaken"), {"actuator": 0, "effectiveness": 0.5}),
    "Plant.push": Target(after("push"), {"wrench": np.full(6, 1e-3)}),
    "Plant.shake": Target(after("shake"), {"acceleration": np.full(3, 1e-3)}),
    "Plant.load": Target(lambda force: Plant(MODEL).load(force), {"force": np.full(6, 1e-3)}),
    "Plant at a start": Target(
        lambda **a: state(Plant(ARM, **a)), {"start": AT_REST, "part": None}
    ),
    "Plant.number": Target(Plant(MODEL).number, {"actuator": "coil3"}),
    "Bench": Target(on_bench, USUAL | BENCH),
    "Bench.apply": Target(applied, {"inputs": np.full(7, 1e-5)}),
    "TaskSensor": Target(lambda **a: TaskSensor(**a).read(**SENSED), TASK),
    "TaskSensor.read": Target(lambda **a: TaskSensor(**TASK).read(**a), SENSED),
    "JointSensors": Target(lambda **a: JointSensors(**a).read(**SENSED), JOINTS),
    "JointSensors.read": Target(lambda **a: JointSensors(**JOINTS).read(**a), SENSED),
    "LinearPlant.named": Target(
        linearize(MODEL, DATA, "payload").named,
        {"y": np.eye(len(linearize(MODEL, DATA).A) // 2)[0]},
    ),
    "MaxwellSlip.moved": Target(SLIP.moved, {"stretch": np.zeros((2, 3)), "by": np.full(2, 1e-6)}),
    "MaxwellSlip.force": Target(SLIP.force, {"stretch": np.full((2, 3), 1e-7)}),
    "servoed": Target(
        servoed,
        {"model": ARM, "natural_frequency_hz": 5.0, "damping_ratio": 1.0, "data": AT_REST}
        | {"among": [0, 1]},
    ),
}
