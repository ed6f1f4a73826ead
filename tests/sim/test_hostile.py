"""Hostile arguments of `sim` give an error of one sentence or finite numbers."""

import copy
from functools import cache
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

import sim
from sim import HEXAPOD_MJCF, MODELS, NOMINAL, Bench, Failure, Mechanism, Plant, Pose, load_model
from sim.mjcf import element_id, joint_stiffness, mass_matrix, model_sha256, weightless
from sim.plant import JointSensors, MaxwellSlip, TaskSensor, failed_plant
from tests.hostile import POSITIVE, Package, one_by_one, public, two_at_once

PERIOD_S = 2.5e-4
DOUBLED = SimpleNamespace(sent=lambda tick, inputs: 2.0 * inputs)


def pose_error_of_a_quaternion(quaternion: Any) -> Any:
    """Return the error of a pose given by a quaternion."""
    good = package().good
    return sim.pose_error(good["model"], good["data"], "payload", (np.ones(3), quaternion))


TRUSTED = {
    # Created only by the package, from checked numbers.
    *("Jacobians", "LinearPlant"),
    # Attacked by its subclasses.
    *("TaskFunction", "TaskFunction.checked", "TaskFunction.on"),
    # Called at every tick with checked numbers.
    *("Plant.step_physics", "Plant.check_lock"),
    *("Distances.farthest", "Distances.largest_fraction", "Distances.fits"),
}
CALLABLES = public(
    *(sim, JointSensors, TaskSensor, MaxwellSlip, failed_plant, pose_error_of_a_quaternion),
    *(element_id, joint_stiffness, mass_matrix, model_sha256, weightless),
    trusted=TRUSTED,
)


def state(plant: Plant) -> Any:
    """Return all measured quantities of a plant."""
    loads = (plant.data.qfrc_constraint, plant.coil_force_n(), plant.closure_residual_m())
    return plant.pose(), plant.displacement(), plant.displacements(), loads


def stepped(plant: Plant) -> Any:
    """Return all measured quantities of a plant after two more physics steps."""
    plant.step(np.zeros(plant.model.nu), 2e-3)
    return state(plant)


def run(bench: Bench) -> Any:
    """Return the log of a copied bench after its ticks."""
    bench = copy.deepcopy(bench)
    for _ in bench.rotation:
        bench.measure()
        bench.apply(np.zeros(7))
    logged = "rotation translation_m displacement closure_residual_m qpos actuator_force"
    return {name: getattr(bench, name) for name in logged.split()}


def slipped(slip: MaxwellSlip) -> Any:
    return slip.force(slip.moved(np.zeros(slip.slip.shape), np.full(len(slip.slip), 1e-5)))


def numbers(jac: Any) -> Any:
    return jac.J_T, jac.J_C, jac.closure_residual


BODY_ABOVE_FLOOR = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
  <body name="box" pos="0 0 0.2"><joint axis="1 0 0"/><geom type="box" size="0.1 0.1 0.19"/>
  </body></worldbody></mujoco>"""


@cache
def package() -> Package:
    """Create arguments: arm for kinematics, hexapod for its plant, platform for closed loops."""
    arm, hexapod, platform = (
        load_model(path) for path in (MODELS / "arm.xml", HEXAPOD_MJCF, MODELS / "platform.xml")
    )
    scene = mujoco.MjModel.from_xml_string(BODY_ABOVE_FLOOR)
    at_rest, of_hexapod, on_platform, above = map(mujoco.MjData, (arm, hexapod, platform, scene))
    mujoco.mj_forward(arm, at_rest)
    here, mechanism = {"model": hexapod, "data": of_hexapod}, Mechanism(arm, at_rest)
    closed = {"model": platform, "data": on_platform}
    task = {"rows": [0, 1], "noise": 1e-5, "encoder_noise": 1e-5, "seed": 3}
    joints = {"mechanism": mechanism, "rows": [0, 1], "encoder_noise": 1e-5, "seed": [3, 4]}
    slip = MaxwellSlip(np.full((2, 3), 1e3), np.full((2, 3), 1e-6))
    sensed = {"pose": NOMINAL, "displacements": np.zeros(7)}
    at = Pose(np.eye(3), np.array([0.1, 0.2, 0.3]))
    separation = {"model": scene, "pairs": [(["floor"], [1, sim.Body("box")])], "detection_m": 1.0}

    def measured() -> Bench:
        times = {"time_s": PERIOD_S * np.arange(2), "period_s": PERIOD_S}
        bench = Bench(Plant(arm), TaskSensor([0, 1], 1e-5, 1e-5, 0), **times)
        bench.measure()
        return bench

    def placed(frame: Any) -> Any:
        return sim.pose_of(arm, at_rest, frame)

    def done(given: Any) -> Any:
        located = given.on(arm)
        errors = located.error(arm, at_rest), located.jacobian(arm, at_rest)
        return given.gain, given.damping, errors

    good = {
        **{"model": arm, "data": at_rest, "site": "payload", "axes": "base", "springs": True},
        **{"velocity": np.zeros(platform.nv), "held": [0]},
        **{"into": mujoco.MjData(platform), "geometry_accuracy": 1e-9},
        **{"frame": "payload", "weld": True, "gain": 0.5, "within_m": 0.1},
        **{"qvel": np.ones(scene.nv), "dt": 0.01, "posture": mechanism.nominal},
        **{"displacements": np.full(7, 1e-3), "body": None, "rotation": np.eye(3)},
        **{"translation_m": np.zeros(3), "T": np.eye(4), "root": "base", "twist": np.full(6, 1e-3)},
        **{"name": 3, "path": HEXAPOD_MJCF, "target": np.ones(3)},
        **{"weight": 2.0, "damping": 0.1, "rows": [3, 1], "axis": np.ones(3), "joints": ["joint2"]},
        **{"coefficients": {"joint1": 1.0, "joint2": -2.0}, "kind": "weak", "plant": Plant(arm)},
        **{"sensors": TaskSensor(**task), "time_s": PERIOD_S * np.arange(2), "period_s": PERIOD_S},
        **{"failures": [Failure(2, "weak")], "drives": np.negative},
        **{"floor_m_per_s2": np.full((2, 3), 1e-3), "delay_ticks": 1, "events": DOUBLED},
        **{"hysteresis": MaxwellSlip(np.ones((7, 2)), np.ones((7, 2))), "log_qpos": True},
        **{"inputs": np.full(7, 1e-5), "actuator": 0, "effectiveness": 0.5},
        **{"part": None, "command_m": np.full(6, 1e-5), "seconds": 2e-3},
        **{"wrench": np.full(6, 1e-3), "force": np.full(6, 1e-3), "acceleration": np.full(3, 1e-3)},
        **{"natural_frequency_hz": 5.0, "among": [0, 1], "start": at_rest},
        **{"text": "strut1:locked@1.3", "y": np.eye(len(sim.linearize(**here).A) // 2)[0]},
        **{"stiffness": np.full((2, 3), 1e3), "slip": np.full((2, 3), 1e-6), "pose": NOMINAL},
        **{"stretch": np.zeros((2, 3)), "by": np.full(2, 1e-6)},
        "quaternion": np.array([0.6, 0.0, 0.8, 0.0]),
    }
    special: dict[str, dict[str, Any]] = {
        **dict.fromkeys(("advance", "assemble"), closed),
        **dict.fromkeys(("linearize", "mass_matrix", "joint_stiffness", "weightless"), here),
        "Pin": {"frame": "base"},
        "Distances": separation,
        "Distances.at": {"data": above},
        "Distances.safe_fraction": {"data": above},
        "Mechanism.moved": {"held": np.arange(7)},
        "jacobians of the hexapod": here | {"axes": "base"},
        "pose_error": {"site": ["payload"], "target": [Pose(np.eye(3), np.ones(3))]},
        "pose_error of a position": {"target": np.ones(3)},
        "pose_error of a matrix": {"target": np.eye(4)},
        "Pose.moved of a batch": {"twist": np.full((2, 6), 1e-3)},
        "FrameTask": {"target": at},
        "FrameTask at a position": {"target": np.ones(3)},
        "FrameTask.checked": {"target": at},
        "RelativeFrameTask": {"target": at},
        "RelativeFrameTask.checked": {"target": at},
        "CenterOfMassTask": {"body": "link4", "rows": [1]},
        "LookAtTask": {"target": 2 * np.ones(3)},
        "PostureTask": {"target": np.ones(arm.nq)},
        "PostureTask.checked": {"target": np.ones(arm.nq)},
        "DampingTask": {"target": None},
        "DampingTask.checked": {"target": None},
        "JointCouplingTask": {"target": 0.5},
        "JointCouplingTask.checked": {"target": 0.5},
        "Failure": {"time_s": 0.0},
        "Failure.inject": {"plant": Plant(hexapod)},
        "failed_plant": here | {"failures": [Failure(0, "locked")]},
        "Plant": here | {"start": ..., "part": ...},
        "Plant at a start": {"start": at_rest, "part": None},
        "Plant.step": {"period_s": 2e-3},
        "Plant.number": {"actuator": "coil3"},
        "TaskSensor": task,
        "TaskSensor.read": sensed,
        "JointSensors": joints,
        "JointSensors.read": sensed,
        "element_id": here | {"kind": "site", "name": "base"},
        "MaxwellSlip.force": {"stretch": np.full((2, 3), 1e-7)},
    }

    def task_of(kind: Any) -> Any:
        names = kind.__dataclass_fields__.keys() & {"frame", "root", "axis", "coefficients"}
        return kind(**{name: good[name] for name in names})

    tasks = [task for name, task in vars(sim).items() if name.endswith("Task")]
    objects: dict[str, Any] = {
        **{kind.__name__: task_of(kind) for kind in tasks},
        **{"Distances": sim.Distances(**separation)},
        **{"JacobianReader": sim.JacobianReader(arm, "payload"), "Mechanism": mechanism},
        **{"Pose": NOMINAL, "Failure": Failure(0, "weak")},
        **{"LinearPlant": sim.linearize(**here, site="payload"), "Bench": measured},
        **{"Plant": lambda: Plant(hexapod), "MaxwellSlip": slip},
        **{"TaskSensor": lambda: TaskSensor(**task)},
        **{"JointSensors": lambda: JointSensors(**joints)},
    }
    uses = {
        **dict.fromkeys(("Body", "CenterOfMass", "Relative"), placed),
        "MjData": lambda data: data.qpos,
        "Pin": lambda pin: sim.assemble(arm, pinned=[pin]).qpos,
        **{"Distances": lambda made: made.at(above), "MaxwellSlip": slipped, "Jacobians": numbers},
        "Mechanism": lambda made: (made.task(made.nominal), made.displacements(made.nominal)),
        "JointPosture": lambda at: (at.qpos, at.displacements, at.pose, at.gaps),
        "JacobianReader": lambda made: numbers(made.at(at_rest)),
        "Failure": lambda failure: state(failed_plant(hexapod, [failure])),
        **{"Plant": stepped, "Bench": run, "Bench.apply": lambda made: state(made.plant)},
        **dict.fromkeys(("TaskSensor", "JointSensors"), lambda made: made.read(**sensed)),
        **{"TaskFunction": done, "Ranges": lambda result: {"force_gap": result.force}},
    }
    return Package(
        callables=CALLABLES,
        good=good,
        special=special,
        objects=objects,
        uses=uses,
        errors=(ValueError, TypeError, sim.ModelError),
        unsolvable=(sim.ModelError, sim.SimulationDiverged),
        slow=[f"Plant.{name}" for name in ("step", "settle", "weaken", "push", "load", "shake")],
        ranges={"effectiveness": (0, 1), "period_s": POSITIVE, "seconds": POSITIVE},
    )


@pytest.fixture(autouse=True, scope="module")
def _in_temporary_folder(tmp_path_factory):
    """Change the folder, since MuJoCo writes a log of diverging states."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("log"))
        yield


test_a_hostile_argument_is_reported_or_harmless = one_by_one(package, CALLABLES)
test_two_hostile_arguments_are_reported_or_harmless = two_at_once(package)
