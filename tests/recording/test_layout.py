"""What a screen shows: axes with ticks, nothing that is constant."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from experiments.recording.hexapod import of_hexapod
from experiments.recording.marks import Mark
from experiments.recording.scene import scenes_of
from experiments.recording.signals import axis_range
from experiments.rig.hexapod.columns import hexapod_arrays
from tests.made import made_run

NUMBERS = st.floats(-1e6, 1e6, allow_subnormal=False).map(lambda x: round(x, 6))


@given(NUMBERS, NUMBERS, st.floats(60, 600))
def test_an_axis_holds_its_values_and_has_three_ticks_or_more(one, other, height_px):
    """The viewer puts ticks at the multiples of powers of ten that are 24 pixels apart or more."""
    lower, upper = sorted((one, other))
    low, high = axis_range(lower, upper, height_px)
    assert low < lower <= upper < high
    steps = [10.0**k for k in range(-16, 9)]
    ticks = [
        np.floor(high / step + 1e-6) - np.ceil(low / step - 1e-6) + 1
        for step in steps
        if step / (high - low) * height_px >= 20
    ]
    assert max(ticks) >= 3


def entities(scene):
    return [plot.entity for plot in scene.panels]


def test_what_is_constant_has_no_panel_unless_it_varies_in_a_run_beside(model):
    run = hexapod_arrays(made_run())
    still = run | {"secondary": np.zeros((400, 4)), "strut_input_percent": np.zeros((400, 6))}
    alone, beside = of_hexapod(still, model), of_hexapod(run, model)
    (scene,) = scenes_of([alone])
    assert entities(scene) == ["task/error", "closure/residual"]
    both = scenes_of([alone, beside])
    assert entities(both[0]) == entities(both[1])
    assert {"actuators/input", "secondary/true"} <= set(entities(both[0]))
    assert both[0].ranges == both[1].ranges


def test_limits_are_levels_and_what_failed_is_thick_from_then_on(model):
    mark = Mark(2, 0.1, "strut 3 free", kind="free")
    shown = of_hexapod(hexapod_arrays(made_run()), model, [mark])
    (inputs,) = [plot for plot in shown.signals if plot.entity == "actuators/input"]
    assert list(inputs.levels) == [-100.0, 100.0]
    assert list(inputs.failed) == [(2, 0.1)]
    assert "at most" in inputs.note


def test_states_are_of_what_fails_alone(model):
    mark = Mark(2, 0.1, "strut 3 free", 0.2, "found", "free", "locked")
    lanes = of_hexapod(hexapod_arrays(made_run()), model, [mark]).lanes
    assert lanes == {
        "strut 3 is": [(0.0, "sound"), (0.1, "free")],
        "strut 3 taken for": [(0.0, "sound"), (0.2, "locked")],
    }
