"""The former place of the marks."""

from experiments.hexapod.recording.hexapod import Mark as Mark
