"""An actuator that works again is given back to the controller, without a bump."""

import numpy as np
import pytest

from fjh.rig import Rig
from fjh.rig.events import Event

RIG = Rig.hexapod(mismatch="all", seed=3)


class _Dead:
    """Coil 2 has no current for two seconds, more than it takes to be confirmed."""

    def sent(self, tick, inputs):
        """Of the period."""
        return np.where((np.arange(6) == 1) & (1300 <= tick < 3300), 0.0, inputs)


@pytest.mark.long
@pytest.mark.parametrize("what", [_Dead(), [Event("lock_released", 1.3, 1)]], ids=["coil", "lock"])
def test_it_is_named_then_cleared_and_the_mapping_is_that_of_the_sound_machine(what):
    pilot = RIG.supervisor()
    run = RIG.fly(pilot, RIG.path("circle", duration_s=6.0), events=what)
    named = run.diagnoses[0]
    assert named.actuator == "strut2" and named.withdrawn_s is not None
    ended_s = 3.3 if isinstance(what, _Dead) else 1.4
    assert ended_s + 1.0 < named.withdrawn_s < ended_s + 2.0  # a second to confirm it
    assert 1 not in [each.fault.actuator for each in run.state.standing]
    assert not run.state.current.mapping.unused[1]
    back = round(named.withdrawn_s / RIG.period_s)
    steps = np.abs(np.diff(run.inputs, axis=0)).max(axis=1)
    assert steps[back - 1 : back + 2].max() < 3 * np.quantile(steps[: back - 200], 0.99)
