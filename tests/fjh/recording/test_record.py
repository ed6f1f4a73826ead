"""A run recorded by one call equals the run read back, and MuJoCo's kinematics."""

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader

from fjh.recording.properties import properties_of
from fjh.recording.read import read_run
from fjh.recording.record import record, results_of
from fjh.recording.view import Change, view_of
from fjh.rig import DiagnosedFailure
from fjh.rig.events import Event
from tests import rrd
from tests.synthetic import ABOUT, synthetic_run, synthetic_view

EVERY = 5
"""Ticks per sample of a signal: 200 Hz."""
HEXAPOD = {
    "/task/desired": ("desired_rad", 1e6),
    "/task/true": ("true_rad", 1e6),
    "/task/measured": ("measured_rad", 1e6),
    "/actuators/input": ("strut_input_percent", 1.0),
    "/actuators/displacement": ("strut_displacement_m", 1e6),
    "/secondary/true": ("secondary", 1e6),
    "/secondary/estimated": ("secondary_estimated", 1e6),
    "/closure/residual": ("closure_residual_m", 1e9),
}
ARM = {"/task/true": ("true", 1e6), "/actuators/displacement": ("displacement", 1.0)}


@pytest.mark.parametrize("signals", [HEXAPOD, ARM], ids=["hexapod", "arm"])
def test_a_recording_holds_the_signals_of_the_run_to_the_bit(recorded, made, signals):
    """Names of lines have units."""
    file = made / "made.rrd" if signals is HEXAPOD else recorded.file
    with np.load(file.with_suffix(".npz")) as arrays:
        for entity, (name, factor) in signals.items():
            times, values = rrd.scalars(file, entity)
            reference = factor * arrays[name][::EVERY]
            np.testing.assert_array_equal(values, reference.reshape(values.shape), err_msg=entity)
            np.testing.assert_array_equal(times, np.rint(1e9 * arrays["time_s"][::EVERY]))
            names = rrd.static(file, entity, "SeriesLines:names")
            assert len(names) == values.shape[1]
            assert all(re.search(r"\[(u|n)?(rad|m|%)\]$", each) for each in names)


def test_error_and_arrays_are_those_of_the_run(recorded):
    file, _, run = recorded
    _, error = rrd.scalars(file, "/task/error")
    np.testing.assert_array_equal(error, 1e6 * (run.desired - run.true)[::EVERY])
    with np.load(file.with_suffix(".npz")) as arrays:
        np.testing.assert_equal(dict(arrays), run.arrays)


def test_missing_samples_of_a_sensor_are_read_back_as_missing(recorded, tmp_path):
    _, rig, run = recorded
    measured = run.measured.copy()
    measured[100:150] = np.nan
    record(tmp_path / "lost.rrd", rig, replace(run, measured=measured))
    _, logged = rrd.scalars(tmp_path / "lost.rrd", "/task/measured")
    np.testing.assert_array_equal(logged, 1e6 * measured[::EVERY])
    read = read_run(tmp_path / "lost.npz", rig.file).view
    np.testing.assert_array_equal(read.arrays["measured"], measured)


def test_bodies_are_where_mujoco_puts_them_at_the_angles_of_the_run(recorded):
    file, rig, run = recorded
    times, places = rrd.rows(file, "/machine/bodies/camera", "Transform3D:translation")
    assert len(set(times)) == 8  # 25 Hz; at the first time there is also the pose of the file
    data, expected = mujoco.MjData(rig.model), []
    for tick in times[-7:] // 1_000_000:
        data.qpos[:] = run.qpos[tick]
        mujoco.mj_forward(rig.model, data)
        expected.append(data.body("camera").xpos.copy())
    np.testing.assert_allclose(np.array(places)[-7:, 0], expected, atol=1e-7)


def test_the_failed_actuators_body_is_marked_from_its_failure_on(recorded):
    times, labels = rrd.rows(recorded.file, "/machine/labels/failure_0/text", "Points3D:labels")
    assert (times.tolist(), labels) == ([100_000_000], [["motor2 locked"]])
    for geom, changes in (("link1/geom_2", []), ("link2/geom_4", [100_000_000])):
        entity = f"/machine/visual_geometries/{geom}"
        times, _ = rrd.rows(recorded.file, entity, "Capsules3D:colors")
        assert times[times > 0].tolist() == changes


def test_a_failure_has_the_first_diagnosis_since_it_and_no_false_alarm(recorded):
    _, rig, run = recorded
    diagnoses = (
        DiagnosedFailure("motor2", "weak", 0.05, None),
        DiagnosedFailure("motor2", "locked", 0.2, None),
    )
    view = view_of(rig, replace(run, diagnoses=diagnoses))
    ((bodies, texts),) = view.failing
    assert list(bodies) == ["link2"]
    assert [time_s for time_s, _ in texts] == [0.1, 0.2]
    assert texts[1][1] == "motor2 locked, diagnosed as locked after 100 ms"
    assert view.diagnosis_of(view.failures[0]) == Change("motor2", "locked", 0.2)
    undiagnosed = view_of(rig, replace(run, diagnoses=diagnoses[:1]))
    assert undiagnosed.diagnosis_of(undiagnosed.failures[0]) is None


def test_every_event_is_in_the_list_and_among_the_states(recorded, tmp_path):
    _, rig, run = recorded
    identified = (
        DiagnosedFailure("motor2", "free", 0.15, 0.18),
        DiagnosedFailure("motor2", "locked", 0.2, None),
    )
    file = tmp_path / "a.rrd"
    record(file, rig, replace(run, diagnoses=identified, events=(Event("stuck", 0.05),)))
    when = {"stuck": 50, "motor2 locked": 100, "diagnosis: motor2 free": 150}
    when |= {"motor2 cleared": 180, "diagnosis: motor2 locked": 200}
    times, texts = rrd.rows(file, "/events", "TextLog:text")
    assert {text: at // 1_000_000 for at, (text,) in zip(times, texts, strict=True)} == when
    _, states = rrd.rows(file, "/state/motor2_taken_for", "StateChange:state")
    assert [state for (state,) in states] == ["healthy", "free", "healthy", "locked"]


@pytest.mark.long
def test_recording_does_not_change_settings_of_matplotlib():
    """Figures of a notebook still appear in their style."""
    code = """
import matplotlib
matplotlib.use("svg")
before = dict(matplotlib.rcParams)
import fjh
fjh.record
print([name for name, value in matplotlib.rcParams.items() if value != before[name]])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


LOCK = Change("strut2", "locked", 0.1)


def results(*incidents: Change, diagnoses: Sequence[Change] = (), **about):
    return results_of(replace(ABOUT, **about), synthetic_view(*incidents, diagnoses=diagnoses))


def test_the_errors_before_and_after_a_failure_are_those_of_the_whole_run():
    """Sums of squares before and after add up to that of the run, and rows to the total."""
    entries, error = results(LOCK), synthetic_run().error
    former, after = 100 * entries["rms_before_rad"] ** 2, 300 * entries["rms_after_rad"] ** 2
    assert former + after == pytest.approx((error**2).sum())
    both = np.hypot(entries["rms_after_alpha_rad"], entries["rms_after_beta_rad"])
    assert entries["rms_after_rad"] == pytest.approx(both)


def test_the_first_failure_is_diagnosed_or_not():
    entries = results(LOCK, diagnoses=[Change("strut2", "locked", 0.15)])
    assert entries["failures"] == "strut2 locked at 0.1 s"
    assert (entries["actuator"], entries["kind"], entries["failed_s"]) == ("strut2", "locked", 0.1)
    assert (entries["named_s"], entries["named_kind"]) == (pytest.approx(0.05), "locked")
    assert not {"named_s", "named_kind"} & set(results(LOCK))
    healthy = results()
    assert healthy["failures"] == "none" and not {"actuator", "kind", "failed_s"} & set(healthy)


def test_rows_of_several_units_have_no_sum():
    view = synthetic_view()
    view = replace(view, stated=replace(view.stated, row_units=["rad", "m"]))
    names = {name for name in results_of(ABOUT, view) if name.startswith("rms")}
    assert names == {"rms_before_alpha_rad", "rms_before_beta_m"}


def test_properties_come_back_from_the_recording(made):
    entries = properties_of(made / "made.rrd")
    assert (entries["seed"], entries["study"], entries["checks"]) == (0, "made", "passed")
    assert entries["failures"] == "strut1 locked, known at 0 s"
    assert entries["rms_after_alpha_rad"] == synthetic_run().rms()[0]


@pytest.mark.long
@pytest.mark.parametrize("study", ["table1", "release", "recover", "systems", "jacobian", "goals"])
def test_every_recording_of_a_study_is_whole_small_and_self_describing(request, study):
    """Recordings pass the viewer's check; each is one application with one screen."""
    files = sorted(request.getfixturevalue(f"{study}_folder").glob("*.rrd"))
    applications = {RrdReader(path).recordings()[0].application_id for path in files}
    assert len(applications) == len(files) > 0
    for path in files:
        entries = properties_of(path)
        assert {"seed", "model_sha256", "version_mujoco", "version_rerun_sdk"} <= set(entries), path
        assert len(RrdReader(path).blueprints()) == 1
        # Recordings have up to ten conditions; sizes of equal runs vary by 0.3 %.
        assert path.stat().st_size < (8e6 if study == "systems" else 3.1e6)
    rerun = shutil.which("rerun", path=str(Path(sys.executable).parent))
    done = subprocess.run(
        [str(rerun), "rrd", "verify", *map(str, files)], capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
