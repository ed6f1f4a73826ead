"""Arms with the servos of their public models, as downloaded, on the default path."""

from functools import partial

import numpy as np
import pytest

from fjh.rig import Rig
from tests.arms import ARMS


@pytest.mark.long
@pytest.mark.parametrize("name", ARMS)
def test_an_arm_tracks_within_two_percent_with_its_own_servos(name, tmp_path):
    """Servos lag by 0.1 to 0.2 s: 19 to 33 % of the path where the path itself is demanded."""
    make = partial(Rig.of_mjcf, ARMS[name].write(tmp_path / f"{name}.xml"), site="tool")
    for noise in (None, 1e-12):
        rig = make(major=[3, 4, 5], noise=noise)
        path = rig.path("circle", duration_s=4.0)
        run = rig.fly(rig.controller(), path)
        error = np.sqrt(((run.desired - run.true) ** 2).sum(axis=1).mean())
        predicted = rig.predict(path, noise=run.measured - run.true)
        assert error < 0.005 * rig.size  # the goal is 0.02
        assert error == pytest.approx(np.linalg.norm(predicted.rms_before), rel=0.1)
