"""Inverse kinematics of any MJCF: tasks in strict levels, under limits, with failures."""

from experiments.ik.ik import Ik as Ik
from experiments.ik.limits import Limits as Limits
from experiments.ik.solution import IkSolution as IkSolution
