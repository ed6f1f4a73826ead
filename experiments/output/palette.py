"""The former place of the colours."""

from experiments.output.plotting import *  # noqa: F403
