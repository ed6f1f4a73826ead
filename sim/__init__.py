"""The bench: MuJoCo model, plant, sensors, actuators, failures and trajectories."""

from sim.amplifier import Amplifier as Amplifier
from sim.array import Array as Array
from sim.detector import Detector as Detector
from sim.detector import pointing_angles as pointing_angles
from sim.detector import secondary_motion as secondary_motion
from sim.dynamics import joint_stiffness as joint_stiffness
from sim.dynamics import mass_matrix as mass_matrix
from sim.errors import ModelError as ModelError
from sim.errors import SimulationDiverged as SimulationDiverged
from sim.failure import Failure as Failure
from sim.failure import FailureKind as FailureKind
from sim.hexapod import NOMINAL as NOMINAL
from sim.hexapod import Hexapod as Hexapod
from sim.hexapod import Pose as Pose
from sim.hexapod import hexapod as hexapod
from sim.jacobian import Jacobians as Jacobians
from sim.jacobian import jacobians as jacobians
from sim.linear import LinearPlant as LinearPlant
from sim.linear import linearize as linearize
from sim.model import HEXAPOD_MJCF as HEXAPOD_MJCF
from sim.model import element_id as element_id
from sim.model import load_model as load_model
from sim.model import model_sha256 as model_sha256
from sim.model import weightless as weightless
from sim.plant import Plant as Plant
from sim.trajectory import spiral as spiral
