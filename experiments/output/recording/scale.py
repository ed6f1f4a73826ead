"""Round numbers for scales: 1, 2, 5, 10, 20, ..."""

import numpy as np

_STEPS = (1, 2, 5, 10)


def round_up(value: float) -> float:
    """The next round number from a positive value on; 1 from anything else."""
    if value <= 0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * min(step for step in _STEPS if step * decade >= value))


def round_down(value: float) -> float:
    """The last round number up to a positive value."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(decade * max(step for step in _STEPS if step * decade <= value))
