"""Fault detection and isolation of any mechanism: n actuators, any outputs, linear models.

It depends neither on a simulator nor on files or a particular machine.
"""

from ftc.fdi.bank import Cause as Cause
from ftc.fdi.diagnosis import DEFAULT_CONFIG as DEFAULT_CONFIG
from ftc.fdi.diagnosis import Diagnosis as Diagnosis
from ftc.fdi.dither import Cost as Cost
from ftc.fdi.dither import Dither as Dither
from ftc.fdi.dither import DitherDesign as DitherDesign
from ftc.fdi.dither import designed_dither as designed_dither
from ftc.fdi.dither import ranked_sensors as ranked_sensors
from ftc.fdi.dither import separations as separations
from ftc.fdi.fault_model import KINDS as KINDS
from ftc.fdi.fault_model import Fault as Fault
from ftc.fdi.fault_model import FaultKind as FaultKind
from ftc.fdi.fault_model import NominalModel as NominalModel
from ftc.fdi.fault_model import at_rest as at_rest
from ftc.fdi.fault_model import by_kind as by_kind
from ftc.fdi.fault_model import fault_model as fault_model
from ftc.fdi.fault_model import of_actuators as of_actuators
from ftc.fdi.fault_model import static_share as static_share
from ftc.fdi.monitor import monitor as monitor
from ftc.fdi.observer import LEARNING_S as LEARNING_S
from ftc.fdi.separation import ACCURACY as ACCURACY
from ftc.fdi.separation import Separations as Separations
from ftc.fdi.separation import fault_responses as fault_responses
from ftc.fdi.separation import isolability as isolability
from ftc.fdi.separation import separations_at as separations_at
from ftc.fdi.uncertainty import CERTAIN as CERTAIN
from ftc.fdi.uncertainty import Uncertainty as Uncertainty
