"""The paper's other systems: the simulation does what the classification says."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from experiments import systems as study
from experiments.systems import (
    MECHANISMS,
    Examined,
    Mechanism,
    Probed,
    checks,
    classified,
    coast,
    examine,
    figure,
    respond,
)
from sim import load_model

BY_NAME = {mechanism.name: mechanism for mechanism in MECHANISMS}


def probed(mechanism: Mechanism, condition: str) -> Probed:
    return Probed(load_model(mechanism.path), mechanism, condition)


def failed_checks(systems: pd.DataFrame) -> list[str]:
    return [str(check) for check in checks(systems) if not check.passed]


@pytest.fixture(scope="module")
def entries(systems):
    return {(one["mechanism"], one["condition"]): one for one in systems["systems"]}


def test_what_moves_in_the_simulation_is_what_the_classification_says(entries):
    """Reachable major directions, self-motion and forbidden active rates, counted from outside."""
    assert len(entries) == sum(len(mechanism.conditions) for mechanism in MECHANISMS)
    for where, one in entries.items():
        assert one["agrees"], where
        # Steps of 1e-4 bend away by their curvature; closures and locks are good to 1e-9.
        assert one["motion_error"] < 1e-2, where
        assert one["drift_error"] < 1e-4, where
        assert one["torque_error"] < 1e-4, where
        # Internal force too: what the closures bear is what eq. (11) says of force and torques.
        assert one["closure_error"] < 1e-4, where
        assert one["yielded_steps"] < 1e-4, where
        if not one["unstable_major"]:
            assert one["major_error"] < 0.01, where
        # Far from any rank threshold: these verdicts are no accident.
        assert one["smallest_gap"] > 1e4, where


@pytest.mark.parametrize(
    ("where", "unstable", "major", "constrained"),
    [
        (("arm", "4 free"), True, True, 0),  # a limp elbow swings the camera
        (("arm", "7 free"), True, False, 0),  # a limp wrist roll turns it about its own axis
        (("hand", "sound"), False, False, 1),  # four motors, three freedoms: they can squeeze
        (("hand", "1 free"), False, False, 0),  # three motors still hold the object
        (("hand", "1 and 2 free"), True, True, 0),  # a limp finger lets it swing about the other
        (("arms", "sound"), False, False, 6),  # twelve motors, six freedoms
        # One arm carries both the load and the other.
        (("arms", "1, 2, 3, 4, 5 and 6 free"), False, False, 0),
        (("platform", "1 free"), False, False, 0),  # over-actuated: no self-motion
        (("platform", "1 and 2 free"), True, True, 0),
    ],
)
def test_each_mechanism_is_classified_as_a_mechanic_would(
    entries, where, unstable, major, constrained
):
    one = entries[where]
    assert (one["unstable"], one["unstable_major"]) == (unstable, major)
    assert one["constrained_active"] == constrained
    assert one["simulated_constrained_active"] == constrained


def test_an_arm_keeps_pointing_whatever_joint_locks_and_loses_a_column(entries):
    """Serial arms: the failed column is dropped, section 2.3.2."""
    model = load_model(BY_NAME["arm"].path)
    _, nominal = classified(model, BY_NAME["arm"], "SSSSSSS")
    _, locked = classified(model, BY_NAME["arm"], "SSSLSSS")
    np.testing.assert_array_equal(locked.J, np.delete(nominal.J, 3, axis=1))
    assert not entries["arm", "4 locked"]["unmanipulable"]
    assert entries["arm", "4 locked"]["lost_task_directions"] == 1


def test_in_a_hand_dropping_the_column_of_a_locked_finger_joint_is_wrong():
    """The warning that closes section 2.3.2, in the simulation: the rest is constrained too."""
    mechanism = BY_NAME["hand"]
    model = load_model(mechanism.path)
    _, nominal = classified(model, mechanism, "SSSS")
    _, locked = classified(model, mechanism, "LSSS")
    active, moved = respond(probed(mechanism, "LSSS"), locked.actuators)
    right = moved - locked.J @ active
    dropped = moved - np.delete(nominal.J, 0, axis=1) @ np.eye(3)
    assert np.linalg.norm(right) < 1e-3 * np.linalg.norm(moved)
    assert np.linalg.norm(dropped) > 0.1 * np.linalg.norm(moved)


def test_a_push_leaves_a_sound_mechanism_at_rest_and_a_limp_one_coasting():
    platform = BY_NAME["platform"]
    assert np.abs(coast(probed(platform, "SSSS"))).max() < 1e-6
    limp = coast(probed(platform, "FFSS"))
    assert np.abs(limp).max() > 0.05


@pytest.mark.parametrize(
    ("name", "happens", "known"),
    [
        ("arm", "SLSSSSS", "SSSSSSS"),
        ("arm", "SSSSSSF", "SSSSSSS"),
        ("hand", "FSSS", "SSSS"),
        ("hand", "LSSS", "FSSS"),
        ("arms", "SLSSSSSSSSSS", "SLSSSSSFSSSS"),
        ("arms", "SSSSSSSSSSSS", "SFSSSSSSSSSS"),
        ("platform", "SSSS", "FSSS"),
        ("platform", "LSSS", "FSSS"),
    ],
)
def test_a_wrong_classification_fails_a_check(monkeypatch, name, happens, known):
    """The simulation has one failure and the library knows of another: that must show."""
    mechanism = BY_NAME[name]
    monkeypatch.setattr(study, "classified", lambda model, it, _: classified(model, it, known))
    assert failed_checks(pd.DataFrame([examine(mechanism, happens, seed=0).row]))


def made_groups(count: int, path: np.ndarray) -> dict[Mechanism, list[Examined]]:
    """Seven conditions each of some mechanisms, all of them on the same path."""
    made, flags = {}, {"unstable_major": False, "unmanipulable": False}
    for k in range(count):
        it = replace(MECHANISMS[0], title=f"arm {k}")
        driven = {"desired_rad": path, "reached_rad": path}
        rows = [{"condition": f"{each + 1} locked"} | flags for each in range(7)]
        made[it] = [Examined(it, row, "", driven) for row in rows]
    return made


@pytest.mark.parametrize("count", [1, 4, 5])
def test_the_figure_has_a_panel_for_each_mechanism_and_a_line_for_each_condition(count):
    """The page on mechanisms adds a fifth, whoever goes on a seventh condition."""
    groups = made_groups(count, np.zeros((8, 2)))
    drawn = figure(groups)
    assert [axes.get_title() for axes in drawn.axes] == [each.title for each in groups]
    for axes in drawn.axes:
        _, labels = axes.get_legend_handles_labels()
        assert labels == [f"{k + 1} locked" for k in range(7)]
    drawn.draw_without_rendering()


def test_the_octagon_is_closed_and_leaves_out_the_corners_aside():
    """A run of three samples a corner: eight corners, then up and down a third direction."""
    corners = np.vstack([[[k, k**2, 0] for k in range(8)], [[0, 0, 1], [0, 0, -1]]])
    drawn = figure(made_groups(1, 1e-6 * np.repeat(corners, 3, axis=0)))
    at_rest, on_the_way, *_, commanded = [
        np.array(line.get_xydata()) for line in drawn.axes[0].lines
    ]
    closed = np.vstack([corners[:8, :2], corners[:1, :2]])
    np.testing.assert_allclose(at_rest, closed)
    np.testing.assert_allclose(commanded, closed)
    assert len(on_the_way) == 7 * 3 + 1


@pytest.mark.parametrize(
    "column",
    [
        *("agrees", "motion_error", "drift_error", "torque_error"),
        *("closure_error", "yielded_steps", "major_error"),
    ],
)
def test_each_check_fails_on_a_spoilt_table(systems, column):
    table = pd.DataFrame(systems["systems"])
    assert failed_checks(table) == []
    table.loc[0, column] = False if column == "agrees" else 0.02
    (sentence,) = failed_checks(table)
    assert sentence.startswith("arm, sound: ")
