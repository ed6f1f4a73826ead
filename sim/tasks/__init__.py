"""Task functions of a robot, each with an error and a Jacobian."""

from sim.kinematics.task import LocatedFunction as LocatedFunction
from sim.tasks.functions import LocatedRates as LocatedRates
