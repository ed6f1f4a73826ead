"""A robot with dry friction: predicted as it moves, and not suspected for it."""

import numpy as np
import pytest

from fjh.rig import Rig
from sim import Failure
from tests.sim.machines import rubbing_arm

LOCK = [Failure("elbow", "locked", 0.5)]


@pytest.fixture(scope="module")
def rig(tmp_path_factory) -> Rig:
    file = rubbing_arm(tmp_path_factory.mktemp("rubbing"))
    return Rig.of_mjcf(file, major=[3, 5])


@pytest.mark.long
def test_errors_are_as_predicted_before_and_after_a_lock(rig):
    """Friction is most of the error; without it the prediction is far off."""
    path = rig.path("circle", duration_s=1.0, turn_s=1.0)
    run = rig.fly(rig.controller(), path, failures=LOCK)
    predicted = rig.predict(path, failures=LOCK, told=False)
    error = run.desired - run.true
    before, after = (np.sqrt((part**2).mean(axis=0)) for part in (error[:500], error[500:]))
    np.testing.assert_allclose(before, predicted.rms_before, rtol=0.02)
    np.testing.assert_allclose(after, predicted.rms_after, rtol=0.05)


@pytest.mark.long
def test_a_sound_robot_that_rubs_is_not_suspected(rig):
    """From the first test of the residuals on, at 0.8 s."""
    run = rig.fly(rig.supervisor(None), rig.path("circle", duration_s=2.0, turn_s=1.0))
    assert not run.diagnoses
    assert any("dry friction of shoulder, elbow, belt" in each for each in rig.warnings)
