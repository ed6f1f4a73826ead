"""The paper's other systems: the simulation does what the classification says."""

import copy
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from experiments.systems import runs as systems_module
from experiments.systems.figure import figure_systems
from experiments.systems.probe import Probed, coast, respond
from experiments.systems.results import checks, summarize
from experiments.systems.runs import MECHANISMS, Mechanism, Systems, classified, examine
from sim import Failure, load_model

BY_NAME = {mechanism.name: mechanism for mechanism in MECHANISMS}


def probed(mechanism: Mechanism, *failures: Failure) -> Probed:
    return Probed(load_model(mechanism.path), failures, mechanism.task, mechanism.major)


def failed_checks(summary: dict) -> list[str]:
    return [str(check) for check in checks(summary) if not check.passed]


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
    assert one["simulated"]["constrained_active"] == constrained


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
    active, moved = respond(probed(mechanism, Failure(0, "locked")), locked.actuators)
    right = moved - locked.J @ active
    dropped = moved - np.delete(nominal.J, 0, axis=1) @ np.eye(3)
    assert np.linalg.norm(right) < 1e-3 * np.linalg.norm(moved)
    assert np.linalg.norm(dropped) > 0.1 * np.linalg.norm(moved)


def test_a_push_leaves_a_sound_mechanism_at_rest_and_a_limp_one_coasting():
    platform = BY_NAME["platform"]
    assert np.abs(coast(probed(platform))).max() < 1e-6
    limp = coast(probed(platform, Failure(0, "free"), Failure(1, "free")))
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
    monkeypatch.setattr(
        systems_module, "classified", lambda model, it, _: classified(model, it, known)
    )
    one = examine(mechanism, happens, seed=0)
    assert failed_checks(summarize(Systems(0, {mechanism: [one]})))


def made_examinations(count: int, path: np.ndarray) -> dict[Mechanism, list[SimpleNamespace]]:
    """Seven conditions each of some mechanisms, all of them on the same path."""
    return {
        replace(MECHANISMS[0], title=f"arm {k}"): [
            SimpleNamespace(
                in_words=f"{k + 1} locked",
                report=SimpleNamespace(unstable_major=False, unmanipulable=False),
                polygon=SimpleNamespace(reached=path, desired=path),
            )
            for k in range(7)
        ]
        for k in range(count)
    }


@pytest.mark.parametrize("count", [1, 4, 5])
def test_the_figure_has_a_panel_for_each_mechanism_and_a_line_for_each_condition(count):
    """The page on mechanisms adds a fifth, whoever goes on a seventh condition."""
    examined = made_examinations(count, np.zeros((8, 2)))
    figure = figure_systems(cast("Systems", SimpleNamespace(examinations=examined)))
    assert [axes.get_title() for axes in figure.axes] == [one.title for one in examined]
    for axes in figure.axes:
        shown = {str(line.get_label()) for line in axes.lines}
        assert {label for label in shown if not label.startswith("_")} == {
            f"{k + 1} locked" for k in range(7)
        }
    figure.draw_without_rendering()


def test_the_octagon_is_closed_and_leaves_out_the_corners_aside():
    """A run of three samples a corner: eight corners, then up and down a third direction."""
    corners = np.vstack([[[k, k**2, 0] for k in range(8)], [[0, 0, 1], [0, 0, -1]]])
    examined = made_examinations(1, 1e-6 * np.repeat(corners, 3, axis=0))
    figure = figure_systems(cast("Systems", SimpleNamespace(examinations=examined)))
    at_rest, on_the_way, *_, commanded = [
        np.array(line.get_xydata()) for line in figure.axes[0].lines
    ]
    closed = np.vstack([corners[:8, :2], corners[:1, :2]])
    np.testing.assert_allclose(at_rest, closed)
    np.testing.assert_allclose(commanded, closed)
    assert len(on_the_way) == 7 * 3 + 1


def test_an_unsound_experiment_is_called_so(systems):
    assert failed_checks(systems) == []
    for key, value in (
        ("agrees", False),
        ("motion_error", 0.02),
        ("torque_error", 0.02),
        ("closure_error", 0.02),
        ("major_error", 0.02),
    ):
        spoilt = copy.deepcopy(systems)
        spoilt["systems"][0][key] = value
        (sentence,) = failed_checks(spoilt)
        assert sentence.startswith("arm, sound: ")
