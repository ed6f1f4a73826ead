"""What a screen shows: axes with ticks, nothing that is constant."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fjh.recording.signals import axis_of

NUMBERS = st.floats(-1e6, 1e6, allow_subnormal=False).map(lambda x: round(x, 6))


@given(NUMBERS, NUMBERS, st.floats(3, 30))
def test_an_axis_holds_its_values_and_has_three_ticks_or_more(one, other, room):
    """The viewer puts ticks at the multiples of powers of ten for which there is room."""
    lower, upper = sorted((one, other))
    low, high = axis_of(lower, upper, room)
    assert low < lower <= upper < high
    steps = [10.0**k for k in range(-16, 9)]
    ticks = [
        np.floor(high / step + 1e-6) - np.ceil(low / step - 1e-6) + 1
        for step in steps
        if (high - low) / step <= 1.09 * max(room, 3)
    ]
    assert max(ticks) >= 3
