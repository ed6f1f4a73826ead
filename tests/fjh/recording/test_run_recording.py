"""A run recorded by one call: what is read back equals the run, and MuJoCo's kinematics."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

import fjh
from experiments.app.cli import main
from fjh.recording import read as reading
from fjh.recording.properties import properties_of
from fjh.recording.read import read_run
from fjh.recording.record import record
from fjh.recording.view import Change, view_of
from fjh.rig import Diagnosed
from fjh.rig.events import Event
from fjh.study.errors import OutputError, WrongInput
from fjh.study.files import write_arrays
from sim import HEXAPOD_MJCF
from tests import rrd
from tests.made import keep_made

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
    folder = tmp_path_factory.mktemp("run")
    (folder / "arm.xml").write_text(ARM)
    rig = fjh.Rig.of_mjcf(folder / "arm.xml", site="tool", major=[3, 4], size=0.02)
    path, lock = rig.path("circle", duration_s=0.3, turn_s=0.3), fjh.Failure("b", "locked", 0.1)
    run = rig.fly(rig.controller(), path, failures=[lock])
    record(folder / "new" / "run.rrd", rig, run)
    return folder / "new" / "run.rrd", rig, run


def test_the_arrays_are_those_of_the_run(kept):
    file, _, run = kept
    with np.load(file.with_suffix(".npz")) as arrays:
        assert set(arrays) == set(run.arrays)
        for name, values in run.arrays.items():
            np.testing.assert_array_equal(arrays[name], values)


def test_the_signals_are_those_of_the_run_to_the_bit(kept):
    file, _, run = kept
    times, error = rrd.scalars(file, "/task/error")
    np.testing.assert_array_equal(error, 1e6 * (run.desired - run.true)[::EVERY])
    np.testing.assert_array_equal(times, np.rint(1e9 * run.time_s[::EVERY]))
    _, moved = rrd.scalars(file, "/actuators/displacement")
    np.testing.assert_array_equal(moved, run.displacement[::EVERY])
    names = rrd.static(file, "/task/error", "SeriesLines:names")
    assert names == ["x [um]", "y [um]"]


def test_missing_samples_of_a_sensor_are_missing_in_the_recording_and_read_back_so(kept, tmp_path):
    _, rig, run = kept
    measured = run.measured.copy()
    measured[100:150] = np.nan
    record(tmp_path / "lost.rrd", rig, replace(run, measured=measured))
    _, shown = rrd.scalars(tmp_path / "lost.rrd", "/task/measured")
    np.testing.assert_array_equal(shown, 1e6 * measured[::EVERY])
    read = read_run(tmp_path / "lost.npz", rig.file).view
    np.testing.assert_array_equal(read.arrays["measured"], measured)
    assert main(["review", str(tmp_path / "lost.npz"), "--out", str(tmp_path / "both.rrd")]) == 0


def test_the_hand_is_where_mujoco_puts_it_at_the_angles_of_the_run(kept):
    file, rig, run = kept
    times, places = rrd.rows(file, "/machine/bodies/hand", "Transform3D:translation")
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
    times, labels = rrd.rows(file, "/machine/labels/failure_0/text", "Points3D:labels")
    assert (times.tolist(), labels) == ([100_000_000], [["b locked"]])
    magenta = 0xE7298AFF
    for body in ("upper", "fore", "hand"):
        geom = f"/machine/visual_geometries/{body}/geom_{('upper', 'fore', 'hand').index(body)}"
        times, colors = rrd.rows(file, geom, "Capsules3D:colors")
        failed = [(int(t), color) for t, (color,) in zip(times, colors, strict=True) if t]
        assert failed == ([(100_000_000, magenta)] if body == "fore" else [])


def test_a_failure_has_the_first_diagnosis_since_and_no_false_alarm_before_it(kept):
    _, rig, run = kept
    diagnoses = Diagnosed("b", "weak", 0.05, None), Diagnosed("b", "locked", 0.2, None)
    view = view_of(rig, replace(run, diagnoses=diagnoses))
    ((bodies, words),) = view.failing
    assert list(bodies) == ["fore"]
    assert words == [(0.1, "b locked"), (0.2, "b locked, diagnosed as locked after 100 ms")]
    assert view.diagnosis_of(view.failures[0]) == Change("b", "locked", 0.2)
    assert view.stated.diagnoses == [Change("b", "weak", 0.05), Change("b", "locked", 0.2)]
    unfound = view_of(rig, replace(run, diagnoses=diagnoses[:1]))
    assert unfound.diagnosis_of(unfound.failures[0]) is None


def test_its_properties_have_the_rms_error_of_each_row(kept):
    file, _, run = kept
    held, cut = properties_of(file), 100  # ticks before the failure
    for when, ticks in (("before", slice(cut)), ("after", slice(cut, None))):
        rms = np.sqrt(((run.desired - run.true)[ticks] ** 2).mean(axis=0))
        assert [held[f"rms_{when}_{row}_m"] for row in "xy"] == pytest.approx(rms.tolist())
        assert held[f"rms_{when}_m"] == pytest.approx(np.hypot(*rms))


def test_another_ending_is_refused_and_nothing_written(kept, tmp_path):
    _, rig, run = kept
    with pytest.raises(OutputError, match=r"path .*run\.npz must end in \.rrd"):
        record(tmp_path / "run.npz", rig, run)
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_who_records_keeps_his_settings_of_matplotlib():
    """A notebook's figures still appear, in its own style."""
    code = """
import matplotlib
matplotlib.use("svg")
before = dict(matplotlib.rcParams)
import fjh
from fjh.recording.record import record
fjh.record
print([name for name, value in matplotlib.rcParams.items() if value != before[name]])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_run_read_back_is_shown_as_it_was(kept):
    file, rig, run = kept
    read, view = read_run(file.with_suffix(".npz")).view, view_of(rig, run)
    assert read.stated == view.stated
    assert read.factor == view.factor
    for name, values in view.arrays.items():
        np.testing.assert_array_equal(read.arrays[name], values)
    displacements, qpos = (run.arrays[name][[0, 299]] for name in ("task", "qpos"))
    own, other = (each.motion(displacements, qpos, 3.0) for each in (read, view))
    np.testing.assert_array_equal(own.position_m, other.position_m)


@pytest.fixture
def moved(kept, tmp_path):
    """The run in a folder of its own, and no machine file where it was run."""
    file, *_ = kept
    for suffix in (".npz", ".rrd"):
        shutil.copy(file.with_suffix(suffix), tmp_path)
    machine = file.parents[1] / "arm.xml"
    machine.rename(tmp_path / "elsewhere.xml")
    yield tmp_path
    (tmp_path / "elsewhere.xml").rename(machine)


def test_a_robot_is_drawn_with_its_own_file_wherever_that_is_now(moved, capsys):
    data, out = moved / "run.npz", moved / "new" / "review.rrd"
    for option, code in (([], 2), (["--model", str(HEXAPOD_MJCF)], 2)):
        assert main(["review", str(data), "--out", str(out), *option]) == code
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and "run of another machine" in said and "--model FILE" in said
        assert not out.parent.exists()
    assert (
        main(["review", str(data), "--out", str(out), "--model", str(moved / "elsewhere.xml")]) == 0
    )
    assert "/machine/bodies/hand" in rrd.entities(out)


def test_runs_of_different_robots_are_reviewed_side_by_side(kept, model, tmp_path):
    """Each on scales of its own."""
    file, *_ = kept
    keep_made(tmp_path)
    out, runs = tmp_path / "review.rrd", [str(file.with_suffix(".npz")), str(tmp_path)]
    assert main(["review", *runs, "--out", str(out)]) == 0
    assert {"/run_0/machine/bodies/hand", "/run_1/machine/bodies/payload"} <= rrd.entities(out)
    assert "| run | arm | x " in rrd.notes(out) and "hexapod | alpha " in rrd.notes(out)


def test_every_event_is_a_line_over_the_axis_of_every_plot_and_in_the_list(kept, tmp_path):
    _, rig, run = kept
    named = Diagnosed("b", "free", 0.15, 0.18), Diagnosed("b", "locked", 0.2, None)
    record(tmp_path / "a.rrd", rig, replace(run, diagnoses=named, events=(Event("stuck", 0.05),)))
    when = {"stuck": 50, "b locked": 100, "diagnosis: b free": 150, "b cleared": 180}
    when |= {"diagnosis: b locked": 200}
    times, texts = rrd.rows(tmp_path / "a.rrd", "/events", "TextLog:text")
    assert {text: at // 1_000_000 for at, (text,) in zip(times, texts, strict=True)} == when
    times, states = rrd.rows(tmp_path / "a.rrd", "/state/b_taken_for", "StateChange:state")
    assert [state for (state,) in states] == ["sound", "free", "sound", "locked"]
    for panel in ("task/error", "actuators/input", "secondary/true"):
        drawn = {e for e in rrd.entities(tmp_path / "a.rrd") if e.startswith(f"/{panel}/event_")}
        assert len(drawn) == 4  # failure, diagnoses, what was cleared, something else
        at = {t // 1_000_000 for e in drawn for t in rrd.scalars(tmp_path / "a.rrd", e)[0]}
        assert at == set(when.values())
        _, values = rrd.scalars(tmp_path / "a.rrd", f"/{panel}")
        for entity in drawn:
            _, ends = rrd.scalars(tmp_path / "a.rrd", entity)
            assert np.nanmin(ends) < values.min() and np.nanmax(ends) > values.max()


@pytest.mark.parametrize(
    "spoilt",
    [
        {"actuators": None},
        {"actuators": ["a", "b"]},
        {"robot": 3},
        {"hexapod": True},
        {"bodies": [["upper"], ["fore"], ["elsewhere"]]},
        {"rows": ["x"]},
        {"major": [3, 9]},
        {"major": [3]},
        {"major": []},
        {"row_units": ["m"]},
        {"limits": [[None], [None]]},
        {"limits": [["a"] * 3] * 2},
        {"input_units": []},
        {"incidents": [{"actuator": "z", "kind": "locked", "time_s": 0.1}]},
        {"incidents": [{"actuator": "a", "kind": 3, "time_s": 0.1}]},
        {"incidents": [{"actuator": "a", "kind": "locked", "time_s": -1.0}]},
        {"incidents": [{"actuator": "a", "kind": "locked", "time_s": "soon"}]},
        {"incidents": [{"actuator": "a", "kind": "locked"}]},
        {"diagnoses": [3]},
        {"diagnoses": [{"actuator": "a", "kind": "locked", "time_s": float("nan")}]},
    ],
)
def test_what_a_recording_states_of_its_run_is_checked(kept, monkeypatch, spoilt):
    file, *_ = kept
    properties, results = reading.groups_of(file)
    stated = json.dumps(json.loads(properties["flight"]) | spoilt)
    monkeypatch.setattr(reading, "groups_of", lambda _: [{"flight": stated}, results])
    with pytest.raises(WrongInput, match=r"run\.npz and run\.rrd are not a run: ") as refused:
        read_run(file.with_suffix(".npz"))
    assert "\n" not in str(refused.value)


def test_a_robots_run_without_its_recording_is_one_sentence(kept, tmp_path):
    file, *_ = kept
    shutil.copy(file.with_suffix(".npz"), tmp_path)
    with pytest.raises(WrongInput, match=r"run\.npz .* run\.rrd") as refused:
        read_run(tmp_path / "run.npz")
    assert "\n" not in str(refused.value)


def test_a_recording_of_another_run_is_noticed(kept, tmp_path):
    file, *_ = kept
    with np.load(file.with_suffix(".npz")) as arrays:
        write_arrays(tmp_path / "run.npz", dict(arrays) | {"true": arrays["true"] + 1e-12})
    shutil.copy(file, tmp_path)
    with pytest.raises(WrongInput, match=r"run\.rrd is not the recording of run\.npz"):
        read_run(tmp_path / "run.npz")


def test_the_list_of_events_of_several_runs_says_whose_they_are(kept, tmp_path):
    file, *_ = kept
    out, runs = tmp_path / "review.rrd", [str(file.with_suffix(".npz"))]
    for suffix in (".npz", ".rrd"):
        shutil.copy(file.with_suffix(suffix), tmp_path / f"again{suffix}")
    assert main(["review", *runs, str(tmp_path / "again.npz"), "--out", str(out)]) == 0
    for number, name in enumerate(("run", "again")):
        _, texts = rrd.rows(out, f"/run_{number}/events", "TextLog:text")
        assert texts == [[f"{name}: b locked"]]
