"""What must hold in every study of the hexapod."""

CLOSURE_LIMIT_M = 1e-8
"""A larger closure residual affects the hexapod's angles: 10 nm is about 0.03 urad."""
