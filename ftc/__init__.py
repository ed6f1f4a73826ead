"""Fault-tolerant control of any mechanism."""

from argument_checks import __version__ as __version__
from ftc.control.compensator import LoopShape as LoopShape
from ftc.control.compensator import compensator as compensator
from ftc.control.compensator import margins as margins
from ftc.control.geometry import LocalGeometry as LocalGeometry
from ftc.control.mapping import PrioritizedMapping as PrioritizedMapping
from ftc.control.mechanism import MechanismGeometry as MechanismGeometry
from ftc.control_task import ControlTask as ControlTask
from ftc.controller import DirectDrive as DirectDrive
from ftc.controller import Measurement as Measurement
from ftc.controller import PrioritizedController as PrioritizedController
from ftc.fdi.fault_model import Fault as Fault
from ftc.fdi.fault_model import NominalModel as NominalModel
from ftc.fdi.fault_model import fault_model as fault_model
from ftc.fdi.monitor import monitor as monitor
from ftc.feedforward import inverse_feedforward as inverse_feedforward
from ftc.goal import Goal as Goal
from ftc.guarded_controller import GuardedController as GuardedController
from ftc.loop import LoopRun as LoopRun
from ftc.loop import run_loop as run_loop
from ftc.oracle import OracleController as OracleController
from ftc.reconfiguration import goal_after as goal_after
from ftc.supervisor import Supervisor as Supervisor
from ftc.tracking import TaskLost as TaskLost
from ftc.tracking import Tracking as Tracking
from ftc.tracking import tracking as tracking
