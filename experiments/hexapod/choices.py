"""Choices that the command line offers; apart, so that its help need not wait for other imports."""

from typing import Literal

JacobianChoice = Literal["analytic", "constant"]
"""Of the estimated pose at every control tick, or of the nominal pose as eq. (39)."""

ConfigurationName = Literal["calibrated", "demand-limit"]
"""Of Table I, see :mod:`experiments.table1.configuration`."""
