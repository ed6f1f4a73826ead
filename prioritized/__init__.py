"""Prioritized manipulation of any constrained multibody system, healthy or with failed actuators.

An invalid argument raises a ValueError or a TypeError that names it, the expected value and the
given one.

Chen, McInroy, Yi, "Optimal, Fault-Tolerant Mappings to Achieve Secondary Goals without Compromising
Primary Performance" (2003)::

    paper                code                            shape
    J_T, J_C             J_T, J_C                        (m, N), (c, N)
    theta_a              active                          (n,) velocity indices, actuator order
    J, eq. (14)          kinematics.J                    (m, n)
    J_Tp J~_Cp           kinematics.self_motion          (m, k)
    J~_Cp^T              kinematics.internal_force       (r, c)
    J~_Cp^T J_Ca (17)    kinematics.active_constraint    (r', n)
    v_m, v_s             major, secondary                (m1,), (m2,)
    W1, W2               joint_weight, secondary_weight  (., n), (., m2)

Spatial vectors are [angular; linear].
"""

from argument_checks import __version__ as __version__
from prioritized._analysis.attainable import Attainable as Attainable
from prioritized._analysis.manipulability import Manipulability as Manipulability
from prioritized._analysis.viable import viable_rates as viable_rates
from prioritized._atlas import Classes as Classes
from prioritized._atlas import FailureAtlas as FailureAtlas
from prioritized._atlas import failure_atlas as failure_atlas
from prioritized._kinematics import Kinematics as Kinematics
from prioritized._mapping.force import ForceMapping as ForceMapping
from prioritized._mapping.force import force_mapping as force_mapping
from prioritized._mapping.hierarchy import Hierarchy as Hierarchy
from prioritized._mapping.hierarchy import HierarchySolution as HierarchySolution
from prioritized._mapping.lexicographic import (
    lexicographic_least_squares as lexicographic_least_squares,
)
from prioritized._mapping.limited import WhenLimited as WhenLimited
from prioritized._mapping.solution import ForceSolution as ForceSolution
from prioritized._mapping.solution import VelocitySolution as VelocitySolution
from prioritized._mapping.task import Status as Status
from prioritized._mapping.tasks import Task as Task
from prioritized._mapping.tick import Tick as Tick
from prioritized._mapping.velocity import VelocityMapping as VelocityMapping
from prioritized._mapping.velocity_arguments import velocity_mapping as velocity_mapping
from prioritized._solver.canonical import canonical_basis as canonical_basis
from prioritized._system import ConstrainedSystem as ConstrainedSystem
