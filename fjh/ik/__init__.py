"""Inverse kinematics of any MJCF robot: tasks in strict priority levels, limits, known failures."""

from fjh.ik.ik import Ik as Ik
from fjh.ik.limits import Limits as Limits
from fjh.ik.solution import IkSolution as IkSolution
