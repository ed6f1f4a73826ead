"""What a screen shows: axes with ticks, nothing that is constant."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fjh.recording.scene import scenes_of
from fjh.recording.signals import axis_of
from tests.made import made_view

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


def entities(scene):
    return [plot.entity for plot in scene.panels]


def test_what_is_constant_has_no_panel_unless_it_varies_in_a_run_beside():
    none = np.zeros((400, 6))
    alone, beside = made_view(secondary=none[:, :4], strut_input_percent=none), made_view()
    scene = scenes_of({"still": alone})["still"]
    assert entities(scene) == ["task/error", "closure/residual"]
    one, other = scenes_of({"still": alone, "moving": beside}).values()
    assert entities(one) == entities(other)
    assert {"actuators/input", "secondary/true"} <= set(entities(one))
    assert one.axes == other.axes
