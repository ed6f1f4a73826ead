"""The former place of runs side by side."""

from experiments.hexapod.recording.screens import write_side_by_side as write_side_by_side
