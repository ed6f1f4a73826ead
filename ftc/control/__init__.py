"""Compensators of single channels, and the mapping from a major task to the actuators."""

from ftc.control.anti_windup import circle_margin as circle_margin
from ftc.control.compensator import Channel as Channel
from ftc.control.compensator import Compensator as Compensator
from ftc.control.compensator import Margins as Margins
from ftc.control.compensator import NoResponse as NoResponse
from ftc.control.compensator import UnstableLoop as UnstableLoop
from ftc.control.compensator import sensitivity_peak as sensitivity_peak
from ftc.control.local_mapping import PreviousCommand as PreviousCommand
from ftc.control.mapping import DisplacementForm as DisplacementForm
