"""A flight kept by one call: what is read back equals the run, and MuJoCo's kinematics."""

import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import fjh
from experiments.recording.flight import driven, record
from experiments.rig import Named
from experiments.study.files import OutputError
from tests import rrd

EVERY = 5
"""Ticks a row of a signal: 200 Hz."""
ARM = """
<mujoco>
  <option timestep="0.001" gravity="0 0 0"/>
  <default><geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0"/></default>
  <worldbody>
    <body name="upper"><joint name="shoulder" axis="0 0 1" damping="1"/><geom/>
      <body name="fore" pos="0.4 0 0"><joint name="elbow" axis="0 0 1" damping="1"/><geom/>
        <body name="hand" pos="0.4 0 0"><joint name="wrist" axis="0 0 1" damping="1"/><geom/>
          <site name="tool" pos="0.4 0 0"/>
  </body></body></body></worldbody>
  <keyframe><key qpos="0.5 -0.9 0.7"/></keyframe>
  <actuator>
    <position name="a" joint="shoulder" kp="400" kv="20"/>
    <position name="b" joint="elbow" kp="400" kv="20"/>
    <position name="c" joint="wrist" kp="400" kv="20"/>
  </actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A planar arm of three joints whose elbow locks on the way, its flight, and its recording."""
    folder = tmp_path_factory.mktemp("flight")
    (folder / "arm.xml").write_text(ARM)
    rig = fjh.Rig.of_mjcf(folder / "arm.xml", site="tool", major=[3, 4], size=0.02)
    path, lock = rig.path("circle", duration_s=0.3, turn_s=0.3), fjh.Failure("b", "locked", 0.1)
    run = rig.fly(rig.controller(), path, failures=[lock])
    record(folder / "new" / "flight.rrd", rig, run)
    return folder / "new" / "flight.rrd", rig, run


def test_the_arrays_are_those_of_the_run(kept):
    file, _, run = kept
    with np.load(file.with_suffix(".npz")) as arrays:
        assert set(arrays) == set(run.arrays)
        for name, values in run.arrays.items():
            np.testing.assert_array_equal(arrays[name], values)


def test_the_signals_are_those_of_the_run_to_the_bit(kept):
    file, _, run = kept
    times, error = rrd.scalars(file, "/condition_0/error")
    np.testing.assert_array_equal(error, 1e6 * (run.desired - run.true)[::EVERY])
    np.testing.assert_array_equal(times, np.rint(1e9 * run.time_s[::EVERY]))
    _, moved = rrd.scalars(file, "/condition_0/actuators")
    np.testing.assert_array_equal(moved, run.displacement[::EVERY])
    names = rrd.static(file, "/condition_0/error", "SeriesLines:names")
    assert names == ["x off [um]", "y off [um]"]


def test_the_hand_is_where_mujoco_puts_it_at_the_angles_of_the_run(kept):
    file, rig, run = kept
    times, places = rrd.rows(file, "/condition_0/machine_x1/bodies/hand", "Transform3D:translation")
    assert len(set(times)) == 8  # 25 Hz; at the first time there is also the pose of the file
    data, expected = mujoco.MjData(rig.model), []
    for tick in times[-7:] // 1_000_000:
        data.qpos[:] = run.qpos[tick]
        mujoco.mj_forward(rig.model, data)
        expected.append(data.body("hand").xpos.copy())
    np.testing.assert_allclose(np.array(places)[-7:, 0], expected, atol=1e-7)


def test_the_failed_actuators_body_is_marked_from_its_failure_on(kept):
    file, rig, run = kept
    (lock,) = run.failures
    assert rig.actuators[lock.number] == "b"
    mark = "/condition_0/machine_x1/bodies/fore/failed"
    times, labels = rrd.rows(file, mark, "Points3D:labels")
    assert (times.tolist(), labels) == ([100_000_000], [["b locked"]])
    others = {f"/condition_0/machine_x1/bodies/{body}/failed" for body in ("upper", "hand")}
    assert not others & rrd.entities(file)


def test_a_mark_has_the_first_diagnosis_since_the_failure_and_no_false_alarm_before_it(kept):
    _, rig, run = kept
    diagnoses = Named("b", "weak", 0.05, None), Named("b", "locked", 0.2, None)
    ((body, mark),) = driven(rig, replace(run, diagnoses=diagnoses)).marks
    assert (body, mark.failed_s, mark.diagnosed_s) == ("fore", 0.1, 0.2)
    assert mark.diagnosis == "b locked, named locked"
    ((_, unfound),) = driven(rig, replace(run, diagnoses=diagnoses[:1])).marks
    assert not unfound.is_found


def test_its_properties_have_the_rms_error_of_each_row(kept):
    file, _, run = kept
    held = rrd.properties(file)
    rms = np.sqrt(((run.desired - run.true) ** 2).mean(axis=0))
    assert [held["rms_error_x_m"], held["rms_error_y_m"]] == pytest.approx(rms.tolist())


def test_another_ending_is_refused_and_nothing_written(kept, tmp_path):
    _, rig, run = kept
    with pytest.raises(OutputError, match=r"path .*flight\.npz must end in \.rrd"):
        record(tmp_path / "flight.npz", rig, run)
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_who_records_keeps_his_settings_of_matplotlib():
    """A notebook's figures still appear, in its own style."""
    code = """
import matplotlib
matplotlib.use("svg")
before = dict(matplotlib.rcParams)
import fjh
from experiments.recording.flight import driven, record
fjh.record
print([name for name, value in matplotlib.rcParams.items() if value != before[name]])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
