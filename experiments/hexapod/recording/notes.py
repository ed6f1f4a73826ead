"""The former place of the notes."""

from experiments.hexapod.recording.shown import constants as constants
from experiments.hexapod.recording.shown import run_notes as run_notes
