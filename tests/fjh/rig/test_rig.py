"""Rigs of all robots: names, units, paths, files, copies, threads and texts."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fjh.rig import Rig, Run
from fjh.rig.units import by_unit, quantity_text
from fjh.study.errors import WrongInput
from ftc import Goal, OracleController
from sim import Failure
from sim.mjcf import drives
from tests.arms import ARMS
from tests.fjh.rigs import ARM, path_of, readings, rig_of, shared_rig
from tests.models import model_of

BOTH = pytest.mark.parametrize("name", ["hexapod", "arm"])
EQUAL = (1.0,) * 6


@BOTH
def test_an_actuator_fails_by_its_name_or_its_number(name):
    rig, path = shared_rig(name), path_of(name, 0.4)
    joint = rig.actuators[2]
    first, *others = (
        rig.fly(rig.controller(), path, failures=[Failure(which, "locked", 0.3)])
        for which in (2, joint, rig.aliases[2][0])
    )
    for run in others:
        np.testing.assert_array_equal(run.true, first.true)
    stands = first.displacement[round(0.3 / rig.period_s) :, 2]
    assert np.ptp(stands) < 0.02 * np.ptp(first.displacement[:, 2])
    with pytest.raises(WrongInput, match=rf'no actuator or joint "{joint}x"; did you mean'):
        rig.fly(rig.controller(), path, failures=[Failure(f"{joint}x", "free", 0.1)])


@pytest.mark.parametrize(("major", "rows"), [(["ry", 5], (1, 5)), ("z,x", (5, 3))])
def test_rows_are_called_by_name_or_by_number(major, rows):
    assert Rig.of_mjcf(ARM, major=major, crossover=0.7).major == rows


@pytest.mark.long
def test_both_rigs_of_the_hexapod_treat_a_free_strut_equally():
    """The strut counts as locked by its spring, and the task as possible, in both rigs."""
    failures = [Failure("strut1", "free", 1.2)]  # the diagnosis learns until 0.8 s
    for name in ("hexapod", "fjh"):
        rig = shared_rig(name)
        assert rig.unused == "locked"
        run = rig.fly(rig.supervisor("none"), path_of(name, 1.6), failures=failures)
        first = rig.actuators[0]  # the name in the file is coil1
        assert run.diagnoses[0].actuator == first and not run.task_lost
        assert f"{first} was identified as free at" in run.status


@BOTH
def test_feedforward_through_the_inverse_reduces_the_error(name):
    """Feedforward is an option of either rig, and the prediction includes it."""
    options = {} if name == "hexapod" else {"crossover": 0.7}
    rms = {}
    for feedforward in (True, False):
        rig = shared_rig(name, feedforward=feedforward, **options)
        path = rig.path("circle", duration_s=0.6)
        run = rig.fly(rig.controller(), path)
        rms[feedforward] = np.linalg.norm(run.rms())
        predicted = rig.predict(path, noise=run.measured - run.true)
        assert rms[feedforward] == pytest.approx(np.linalg.norm(predicted.rms_before), rel=0.05)
    assert rms[True] < 0.05 * rms[False]  # the remaining error is noise


def test_every_controller_demands_the_path_through_the_inverse():
    """Supervisor and oracle act as a plain controller without failures."""
    rig, path = shared_rig("arm"), path_of("arm", 0.1)
    control = rig.controller()
    plain = rig.fly(control, path).inputs
    for each in (rig.supervisor("none"), OracleController(control, control, None)):
        np.testing.assert_array_equal(rig.fly(each, path).inputs, plain)
    assert rig.feedforward_demands(path) is not None
    assert shared_rig("hexapod").feedforward_demands(path) is None  # as in the paper


def test_a_mapping_changes_at_the_given_time():
    rig, path, known = (
        shared_rig("hexapod"),
        path_of("hexapod", 0.1),
        Goal(EQUAL, locked_at={0: 0.0}),
    )
    before, changing = rig.controller(Goal(EQUAL)), rig.reconfigured(Goal(EQUAL), known, 0.05)
    sent, plain = (rig.fly(each, path).inputs for each in (changing, before))
    assert np.flatnonzero((sent != plain).any(axis=1))[0] == 50


def test_a_robot_starts_at_the_given_positions():
    start = np.array([0.1, 0.5, 0.2, -1.2, 0.1, 0.6, 0.0])
    rig = Rig.of_mjcf(ARM, major=[3, 4, 5], start=start, crossover=0.7)
    np.testing.assert_allclose(rig.fly(rig.controller(), np.zeros((2, 3))).qpos[0], start)


def test_a_robot_among_other_objects_moves_as_predicted():
    """The finger follows on its spring, the cup rests: both are only in the physics."""
    rig = rig_of("arm_and_cup", site="tool", major=(3, 5), joint_weight=(1.0, 4.0))
    assert rig.actuators == ("m1", "m2") and rig.goal.joint_weight == (1.0, 4.0)
    assert rig.left_out == ("finger", "cup") and "finger, cup" in rig.warnings[0]
    path = rig.path("circle", duration_s=1.0)
    run = rig.fly(rig.controller(), path)
    expected = rig.predict(path, noise=run.measured - run.true).rms_before
    np.testing.assert_allclose(run.rms(), expected, rtol=0.05)
    cup = rig.model.joint(rig.model.body("cup").jntadr[0]).qposadr[0]
    assert np.ptp(run.qpos[:, cup : cup + 3], axis=0).max() < 1e-4


@pytest.mark.long
def test_a_finger_on_one_cable_moves_as_its_springs_determine():
    """Springs determine the ratio of two joints that one cable moves."""
    rig = rig_of("finger", site="tip", major=(5,))
    run = rig.fly(rig.controller(), rig.path("circle", duration_s=2.0))
    assert run.rms() < 2e-3 * rig.size


@pytest.mark.long
@pytest.mark.parametrize("name", ARMS)
def test_an_arm_tracks_within_two_percent_with_its_own_servos(name, tmp_path):
    """Servos lag by 0.1 to 0.2 s: 19 to 33 % of the path if the path itself is demanded."""
    file = ARMS[name].write(tmp_path / f"{name}.xml")
    for noise in (None, 1e-12):
        rig = Rig.of_mjcf(file, site="tool", major=[3, 4, 5], noise=noise)
        path = rig.path("circle", duration_s=4.0)
        run = rig.fly(rig.controller(), path)
        error = np.sqrt(((run.desired - run.true) ** 2).sum(axis=1).mean())
        predicted = rig.predict(path, noise=run.measured - run.true)
        assert error < 0.005 * rig.size  # the goal is 0.02
        assert error == pytest.approx(np.linalg.norm(predicted.rms_before), rel=0.1)


@cache
def controller_of(name: str, made: str) -> Any:
    return getattr(shared_rig(name), made)()


def pickled(thing: Any) -> Any:
    return pickle.loads(pickle.dumps(thing))


def simulated(rig: Rig, controller: Any, actuator: int = 0) -> Run:
    """Simulate a run with an actuator that is weak from the start and locks halfway."""
    path = rig.path("circle", duration_s=0.1, turn_s=0.1)
    failures = [Failure(actuator, "weak"), Failure(actuator, "locked", 0.05)]
    return rig.fly(controller, path, failures=failures, seed=actuator)


def assert_same(run: Run, other: Run) -> None:
    for name in ("true", "measured", "inputs", "displacement", "qpos", "closure_m"):
        np.testing.assert_array_equal(getattr(run, name), getattr(other, name), err_msg=name)
    assert run.status == other.status


@pytest.mark.parametrize("made", ["controller", "supervisor"])
@pytest.mark.parametrize(
    "name", ["hexapod", pytest.param("arm", marks=[pytest.mark.long, pytest.mark.night])]
)
@pytest.mark.parametrize("copied", [pickled, pytest.param(deepcopy, marks=pytest.mark.long)])
def test_a_copy_gives_the_same_run_to_the_bit(copied, name, made):
    """Copies are of the rig, the controller, both at once, and a run with its state."""
    rig, control = shared_rig(name), controller_of(name, made)
    run, both = simulated(rig, control), copied((rig, control))
    for a_rig, a_controller in (both, (copied(rig), control), (rig, copied(control))):
        assert_same(run, simulated(a_rig, a_controller))
    assert_same(run, copied(run))


@pytest.mark.parametrize("copied", [deepcopy, pickled])
@BOTH
def test_a_machine_copied_during_a_run_continues_unchanged(copied, name):
    """Copies share nothing: failures, physics and noise are independent."""
    rig = shared_rig(name, "all")
    time_s, n = np.arange(40) * rig.period_s, len(rig.actuators)
    inputs = 1e-3 * np.sin(np.add.outer(0.5 * np.arange(40), np.arange(n)))
    bench = rig.bench(time_s, [Failure(0, "weak", 0.0), Failure(1, "locked", 0.03)], 5)
    readings(bench, inputs[:20])
    copies = copied(bench), copied(bench)
    for each in (copies[0], bench, copies[1]):
        readings(each, inputs[20:])
    for each in copies:
        for log in ("qpos", "rotation", "displacement", "actuator_force"):
            np.testing.assert_array_equal(getattr(each, log), getattr(bench, log), err_msg=log)
        assert each.plant.model is not bench.plant.model


@pytest.mark.long
@pytest.mark.night
@pytest.mark.usefixtures("switching")
@pytest.mark.parametrize("name", ["arm", "hand", "hexapod"])
def test_threads_that_share_a_rig_and_a_controller_give_equal_runs(name):
    rig, control, actuators = shared_rig(name), controller_of(name, "supervisor"), [0, 1, 0, 1]
    with ThreadPoolExecutor(4) as pool:
        runs = pool.map(lambda actuator: simulated(rig, control, actuator), actuators)
        for actuator, run in zip(actuators, list(runs), strict=True):
            assert_same(run, simulated(rig, control, actuator))


@given(rows=st.lists(st.tuples(st.sampled_from(["rad", "m"]), st.floats(-1, 1)), min_size=1))
def test_each_value_is_in_the_entry_of_its_unit_in_order(rows):
    units = [unit for unit, _ in rows]
    entries = by_unit("rms", [value for _, value in rows], units)
    left = {key: iter(own) for key, own in entries.items()}
    assert [next(left[f"rms_{unit}"]) for unit in units] == [value for _, value in rows]
    assert all(list(own) == [] for own in left.values())
    assert by_unit("rms", None, units) == dict.fromkeys(entries)


@given(size=st.floats(1e-12, 1e9), sign=st.sampled_from([1, -1]))
def test_a_number_is_read_back_from_its_unit_with_three_digits(size, sign):
    number, unit = quantity_text(sign * size, "m").split()
    power = {"m": 0, "mm": -3, "µm": -6, "nm": -9}[unit]
    assert float(number) * 10.0**power == pytest.approx(sign * size, rel=5.1e-3)
    assert unit in ("nm", "m") or 1 <= abs(float(number)) < 1000
    assert size > 9e5 or "e" not in number


@pytest.mark.parametrize("name", ["limited", "gantry"])
def test_rotary_actuators_move_by_angles_and_linear_ones_by_lengths(name):
    """Actuators are on hinges, slides, ball joints, and tendons over these."""
    units = {"limited": ["rad", "m", "m", "rad"], "gantry": ["rad", "m", "m"]}
    units_of_drives = [drive.unit for drive in drives(model_of(name))]
    assert units_of_drives[: len(units[name])] == units[name]


def test_the_hexapod_moves_by_lengths_and_points_by_angles():
    assert set(shared_rig("hexapod").units) == {"m"} and set(shared_rig("hexapod").row_units) == {
        "rad"
    }


@BOTH
def test_the_model_of_the_diagnosis_has_an_output_for_each_measurement(name):
    model = shared_rig(name).diagnosis_model
    assert len(model.noise) == len(model.plant.C) >= len(shared_rig(name).major)
