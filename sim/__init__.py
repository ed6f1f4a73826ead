"""Simulation in MuJoCo: models, plants, sensors, actuators, failures; Jacobians of any MJCF."""

from importlib.util import find_spec as _find_spec

from argument_checks import __version__ as __version__

if _find_spec("mujoco") is None:
    raise ModuleNotFoundError(
        'sim needs mujoco, which is not installed: in a checkout, pip install ".[sim]"',
        name="mujoco",
    )

from sim.array import Array as Array
from sim.closing.assembly import advance as advance
from sim.closing.assembly import assemble as assemble
from sim.closing.fixed import Pin as Pin
from sim.closing.newton import FRACTIONS as FRACTIONS
from sim.errors import ClosureError as ClosureError
from sim.errors import ModelError as ModelError
from sim.errors import SimulationDiverged as SimulationDiverged
from sim.errors import log_warnings
from sim.kinematics.distances import Distances as Distances
from sim.kinematics.jacobian import CLOSURE_TOLERANCE as CLOSURE_TOLERANCE
from sim.kinematics.jacobian import JacobianReader as JacobianReader
from sim.kinematics.jacobian import Jacobians as Jacobians
from sim.kinematics.jacobian import jacobians as jacobians
from sim.kinematics.mechanism import Mechanism as Mechanism
from sim.kinematics.pose import NOMINAL as NOMINAL
from sim.kinematics.pose import Pose as Pose
from sim.kinematics.task import CenterOfMass as CenterOfMass
from sim.kinematics.task import Relative as Relative
from sim.kinematics.task import TaskFunction as TaskFunction
from sim.kinematics.task import pose_error as pose_error
from sim.kinematics.task import pose_of as pose_of
from sim.mjcf.frame import Body as Body
from sim.mjcf.joints import ranges as ranges
from sim.mjcf.load import HEXAPOD_MJCF as HEXAPOD_MJCF
from sim.mjcf.load import MODELS as MODELS
from sim.mjcf.load import load_model as load_model
from sim.plant.bench import Bench as Bench
from sim.plant.linear import LinearPlant as LinearPlant
from sim.plant.linear import linearize as linearize
from sim.plant.plant import Failure as Failure
from sim.plant.plant import Plant as Plant
from sim.plant.servo import servoed as servoed
from sim.tasks.functions import CenterOfMassTask as CenterOfMassTask
from sim.tasks.functions import DampingTask as DampingTask
from sim.tasks.functions import FrameTask as FrameTask
from sim.tasks.functions import JointCouplingTask as JointCouplingTask
from sim.tasks.functions import LookAtTask as LookAtTask
from sim.tasks.functions import PostureTask as PostureTask
from sim.tasks.functions import RelativeFrameTask as RelativeFrameTask

log_warnings()  # in every process that imports sim, workers included
