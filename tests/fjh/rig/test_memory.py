"""With Python's garbage collector off the memory of a control loop does not grow."""

import gc

import pytest

from fjh.rig import Rig
from sim import MODELS


@pytest.mark.long
@pytest.mark.parametrize("kind", ["controller", "supervisor"])
def test_a_tick_leaves_no_reference_cycles(kind):
    """Runs of different lengths leave as much to collect: what is left is of a run, not a tick."""
    rig = Rig.of_mjcf(MODELS / "arm.xml", site="payload", major=["x", "y", "z"])
    controller = getattr(rig, kind)()

    def left_by(duration_s: float) -> int:
        gc.collect()
        rig.fly(controller, rig.path("circle", duration_s=duration_s))
        return gc.collect()

    gc.disable()
    try:
        left_by(0.05)
        short, long = (min(left_by(each) for _ in range(3)) for each in (0.05, 0.2))
        assert long == short
    finally:
        gc.enable()
