"""Compensators of single channels and the mapping from the major task to the actuators."""

from ftc.control.anti_windup import circle_margin as circle_margin
from ftc.control.compensator import Channel as Channel
from ftc.control.compensator import Compensator as Compensator
from ftc.control.compensator import NoResponse as NoResponse
from ftc.control.compensator import UnstableLoop as UnstableLoop
from ftc.control.frequency_response import Margins as Margins
from ftc.control.frequency_response import sensitivity_peak as sensitivity_peak
from ftc.control.mapping import DisplacementForm as DisplacementForm
from ftc.control.mapping import PreviousCommand as PreviousCommand
