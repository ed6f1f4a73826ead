import pytest

from fjh.rig.dither import rig_dither
from tests.fjh.rigs import rig


@pytest.mark.long
@pytest.mark.parametrize("name", ["arm", "platform", "hexapod"])
def test_the_default_dither_moves_the_task_by_less_than_half_the_noise(name):
    design = rig_dither(rig(name), "default")
    assert design is not None and design.separations.isolable()
    assert design.dither.frequency_hz in (10.0, 20.0)
    assert design.task_motion.max() <= 0.5 * rig(name).noise * (1 + 1e-9)
