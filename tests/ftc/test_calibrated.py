"""What another run has learned of a machine: failures in the first tenths of a second are seen."""

import pytest

from fjh.rig import Rig
from sim import Failure

RIG = Rig.hexapod(mismatch="all", seed=5)


@pytest.fixture(scope="module")
def learned():
    """A run of 2 s with another seed of the noise."""
    pilot = RIG.supervisor()
    run = RIG.fly(pilot, RIG.path("circle", duration_s=2.0), seed=1)
    return pilot, run


@pytest.mark.long
def test_a_lock_while_others_still_learn_is_named(learned):
    """0.3 s after the start, within 0.3 s; without a calibration it is part of the machine."""
    pilot, run = learned
    path, lock = RIG.path("circle", duration_s=1.2), [Failure(3, "locked", 0.3)]
    seen = RIG.fly(pilot.calibrated(run.state), path, failures=lock).diagnoses
    assert [each.actuator for each in seen] == ["strut4"] and seen[0].time_s < 0.6
    assert not RIG.fly(pilot, path, failures=lock).diagnoses


def test_it_names_nothing_where_nothing_fails(learned):
    pilot, run = learned
    again = RIG.fly(pilot.calibrated(run.state), RIG.path("circle", duration_s=1.2))
    assert not again.diagnoses and not again.state.watch.alarm_ticks


def test_only_a_sound_run_that_was_long_enough_calibrates(learned):
    pilot, _ = learned
    with pytest.raises(ValueError, match=r"^state must be of a run without a failure, longer than"):
        pilot.calibrated(pilot.start())
    failed = RIG.fly(
        pilot, RIG.path("circle", duration_s=1.5), failures=[Failure(3, "locked", 1.1)]
    )
    with pytest.raises(ValueError, match=r"got: strut4 is locked"):
        pilot.calibrated(failed.state)
