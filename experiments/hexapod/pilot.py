"""Moved to :mod:`ftc.oracle`."""

from ftc.oracle import NEVER as NEVER  # lead: remove
from ftc.oracle import Informed as Informed  # lead: remove
from ftc.oracle import InformedState as InformedState  # lead: remove
from ftc.oracle import Pilot as Pilot  # lead: remove
from ftc.oracle import PilotState as PilotState  # lead: remove
from ftc.oracle import PointingState as PointingState  # lead: remove
from ftc.oracle import State as State  # lead: remove
