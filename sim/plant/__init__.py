"""Plants: physics, actuator failures, sensors in a control loop, linear models, event hooks."""

from sim.plant.actuators import lock_of as lock_of
from sim.plant.actuators import switch_off as switch_off
from sim.plant.bench import JointSensors as JointSensors
from sim.plant.bench import MaxwellSlip as MaxwellSlip
from sim.plant.bench import Reading as Reading
from sim.plant.bench import Sensors as Sensors
from sim.plant.bench import TaskSensor as TaskSensor
from sim.plant.bench import hooks_of as hooks_of
from sim.plant.bench import measured_by as measured_by
from sim.plant.bench import sent_by as sent_by
from sim.plant.linear import NonlinearityMonitor as NonlinearityMonitor
from sim.plant.linear import beyond_linear as beyond_linear
from sim.plant.linear import dry_friction as dry_friction
from sim.plant.plant import FailureKind as FailureKind
from sim.plant.plant import failed_plant as failed_plant
