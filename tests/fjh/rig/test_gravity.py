"""Arms under gravity whose servos weaken: what the supervisor makes of it costs no accuracy."""

import numpy as np
import pytest

from fjh.rig import Rig, Run
from sim import Failure

LINK = """
<body pos="{x} 0 0"><joint name="{name}" axis="0 1 0" armature="0.1"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="{mass}"/>{rest}
</body>"""
ONSET_S, AFTER_S = 1.1, 1.0


@pytest.fixture(scope="module")
def arm(tmp_path_factory) -> Rig:
    """Three links stretched out sideways, 6 kg, whose tool moves up and down."""
    links = '<site name="payload" pos="0.3 0 0"/>'
    for name, mass, x in (("wrist", 1, 0.3), ("elbow", 2, 0.3), ("shoulder", 3, 0)):
        links = LINK.format(name=name, mass=mass, x=x, rest=links)
    servos = "".join(
        f'<position name="{name}" joint="{name}" kp="2000" kv="60"/>'
        for name in ("shoulder", "elbow", "wrist")
    )
    file = tmp_path_factory.mktemp("gravity") / "arm.xml"
    file.write_text(
        '<mujoco><option timestep="0.001" integrator="implicitfast"/>'
        f"<worldbody>{links}</worldbody><actuator>{servos}</actuator></mujoco>"
    )
    return Rig.of_mjcf(file, major=[5])


def rms(rig: Rig, run: Run) -> float:
    """Error from the failure on."""
    error = (run.true - run.desired)[round(ONSET_S / rig.period_s) :]
    return float(np.sqrt((error**2).sum(axis=1).mean()))


@pytest.mark.long
@pytest.mark.parametrize("actuator", ["shoulder", "elbow"])
def test_a_weak_servo_that_carries_a_load_costs_no_more_than_doing_nothing(arm, actuator):
    """It sags by its load, then goes where it is told: there is no command to double."""
    path = arm.path("circle", duration_s=ONSET_S + AFTER_S)
    weak = [Failure(actuator, "weak", ONSET_S, 0.5)]
    run = arm.fly(arm.supervisor(), path, failures=weak)
    nothing_done = arm.fly(arm.controller(), path, failures=weak)
    assert [(each.actuator, each.kind) for each in run.diagnoses] == [(actuator, "weak")]
    assert rms(arm, run) <= 1.1 * rms(arm, nothing_done)
