"""Inverse kinematics of any MJCF: tasks in strict levels, under limits, with failures."""

from fjh.ik.ik import Ik as Ik
from fjh.ik.limits import Limits as Limits
from fjh.ik.solution import IkSolution as IkSolution
