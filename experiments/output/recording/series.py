"""The former place of plots."""

from experiments.output.recording.views import *  # noqa: F403
