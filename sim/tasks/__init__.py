"""Task functions: what a robot is to do, each as an error and a Jacobian."""

from sim.kinematics.task import LocatedFunction as LocatedFunction
from sim.tasks.functions import LocatedRates as LocatedRates
