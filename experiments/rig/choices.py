"""Choices that the command line offers; apart, so that its help need not wait for other imports."""

from typing import Literal

Sensing = Literal["task", "joints", "both"]
"""A sensor of the task frame; encoders of the actuators and forward kinematics; or both sensors."""

Failing = Literal["locked", "free", "loose", "weak"]
"""What can happen to an actuator: :data:`sim.FailureKind`."""

Limited = Literal["stated", "none"]
"""Limits of the displacements: those that the file states, or none."""

Diagnosing = Literal["on", "off"]
"""Whether failures are looked for."""

Feedforward = Literal["default", "on", "off"]
"""Whether the path is demanded through the inverse of the linear model; by default on, but for the
hexapod, as in the paper."""

SOUND = "sound"
"""What an actuator is, or is taken for, that works."""
