"""Simulation in MuJoCo: models, plants, sensors, actuators, failures; Jacobians of any MJCF."""

from importlib.util import find_spec as _find_spec

from argument_checks import __version__ as __version__

if _find_spec("mujoco") is None:
    raise ModuleNotFoundError(
        'sim needs mujoco, which is not installed: pip install "fault-tolerant-hexapod[sim]"',
        name="mujoco",
    )

from sim.amplifier import Amplifier as Amplifier
from sim.array import Array as Array
from sim.assembly import advance as advance
from sim.assembly import assemble as assemble
from sim.bench import Bench as Bench
from sim.bench import JointSensors as JointSensors
from sim.bench import Reading as Reading
from sim.bench import Sensors as Sensors
from sim.bench import TaskSensor as TaskSensor
from sim.coil import COPPER_PER_K as COPPER_PER_K
from sim.coil import Coils as Coils
from sim.detector import Detector as Detector
from sim.detector import pointing_angles as pointing_angles
from sim.detector import secondary_motion as secondary_motion
from sim.displacement_limits import displacement_limits as displacement_limits
from sim.drive import Drive as Drive
from sim.dynamics import joint_stiffness as joint_stiffness
from sim.dynamics import mass_matrix as mass_matrix
from sim.entry_accuracy import EntryAccuracy as EntryAccuracy
from sim.errors import ClosureError as ClosureError
from sim.errors import ModelError as ModelError
from sim.errors import SimulationDiverged as SimulationDiverged
from sim.failure import Failure as Failure
from sim.failure import FailureKind as FailureKind
from sim.failure import failed_plant as failed_plant
from sim.forward import UnreachableLengths as UnreachableLengths
from sim.forward import forward_kinematics as forward_kinematics
from sim.frame import Body as Body
from sim.hexapod import Hexapod as Hexapod
from sim.hexapod import Posture as Posture
from sim.hexapod import hexapod as hexapod
from sim.hexapod import regular_jacobian as regular_jacobian
from sim.jacobian import Jacobians as Jacobians
from sim.linear import LinearPlant as LinearPlant
from sim.linear import linearize as linearize
from sim.machine import Machine as Machine
from sim.machine import Names as Names
from sim.mechanism import JointPosture as JointPosture
from sim.mechanism import Mechanism as Mechanism
from sim.model import HEXAPOD_MJCF as HEXAPOD_MJCF
from sim.model import element_id as element_id
from sim.model import load_model as load_model
from sim.model import model_sha256 as model_sha256
from sim.model import weightless as weightless
from sim.pin import Pin as Pin
from sim.plant import Plant as Plant
from sim.pose import NOMINAL as NOMINAL
from sim.pose import Pose as Pose
from sim.ranges import Ranges as Ranges
from sim.ranges import ranges as ranges
from sim.reader import CLOSURE_TOLERANCE as CLOSURE_TOLERANCE
from sim.reader import JacobianReader as JacobianReader
from sim.reader import jacobians as jacobians
from sim.servo import servoed as servoed
from sim.slip import MaxwellSlip as MaxwellSlip
from sim.strut_sensors import StrutSensors as StrutSensors
from sim.task import CenterOfMass as CenterOfMass
from sim.task import Relative as Relative
from sim.task import pose_error as pose_error
from sim.task import pose_of as pose_of
from sim.trajectory import spiral as spiral
from sim.warning import log_warnings

log_warnings()  # in every process that uses MuJoCo through us, workers too
