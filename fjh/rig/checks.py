"""Checks that hold in every study of the hexapod."""

CLOSURE_LIMIT_M = 1e-8
"""Largest closure residual [m] without effect on the hexapod's angles: 10 nm is about 0.03 urad."""
