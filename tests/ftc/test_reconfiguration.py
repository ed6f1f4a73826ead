"""Reconfiguration after a diagnosis: the new goal, and the decision to switch controllers."""

import copy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fjh.rig import Rig
from fjh.rig.hexapod.rig import hexapod_rig
from ftc import DirectDrive, goal_after
from ftc.fdi import Fault
from ftc.reconfiguration import ErrorPrediction, Scenario, lost_displacement
from sim import Failure
from tests.ftc.hexapod import EQUAL, diagnosis

STILL = np.zeros(12)


def test_the_reconfigured_goal_contains_the_diagnoses():
    nominal = hexapod_rig().nominal
    known = [
        diagnosis(Fault(0, "locked"), 3e-6),
        diagnosis(Fault(2, "free"), 9e-6),
        diagnosis(Fault(5, "weak", 0.6), 1e-6),
    ]
    goal = goal_after(EQUAL, known, nominal, "locked")
    assert goal.locked_at == {0: 3e-6, 2: 0.0} and goal.effectiveness == pytest.approx({5: 0.6})
    assert goal.joint_weight == EQUAL.joint_weight
    commanded_m = np.full(6, 2e-6)
    locked, free, weak = (
        lost_displacement(nominal, each, [each.fault], commanded_m) for each in known
    )
    np.testing.assert_array_equal(locked, 0.0)
    assert free[2] == pytest.approx(2e-6, rel=1e-2)  # at most its command
    assert weak[5] == 0.0  # it has already reached its final displacement


def test_commands_of_a_weak_coil_are_at_most_doubled():
    """The command is at most doubled; an actuator with less than half its force is not used."""
    nominal, commanded_m = hexapod_rig().nominal, np.full(6, 8e-6)
    most = diagnosis(Fault(5, "weak", 0.501), 4e-6, confirmed=True)
    goal = goal_after(EQUAL, [most], nominal, "locked")
    assert goal.effectiveness == pytest.approx({5: 0.501})
    assert not lost_displacement(nominal, most, [most.fault], commanded_m).any()
    gone = diagnosis(Fault(5, "weak", 0.4), 4e-6)
    assert goal_after(EQUAL, [gone], nominal, "locked").locked_at == {5: 0.0}
    lost = lost_displacement(nominal, gone, [gone.fault], commanded_m)
    assert lost[5] == pytest.approx(4e-6 - 0.4 * 8e-6, rel=1e-2)


@cache
def error_prediction(duration_s: float = 0.4) -> tuple[Rig, Any, ErrorPrediction]:
    """Return the rig, its controller, and the prediction for a circle."""
    rig = Rig.hexapod()
    path = rig.path("circle", duration_s=0.4)[: round(duration_s / rig.period_s)]
    still = np.zeros((3 * len(path), 6))
    ahead = ErrorPrediction(rig.nominal, np.zeros(2), path, secondary=still, unused=still)
    return rig, rig.controller(), ahead


@pytest.mark.parametrize("kind", ["locked", "free", "weak"])
def test_the_predicted_error_is_that_of_the_linear_loop(kind):
    """The stepped controller has the error of the closed loop in matrices."""
    rig, controller, ahead = error_prediction()
    exact, remaining = copy.copy(controller), 0.5 if kind == "weak" else 0.0
    exact.drives = DirectDrive()  # by rounding of converters
    result = ahead.rms(exact, exact.start(), Scenario(1.0, [Fault(2, kind, remaining)], STILL))
    arguments = {"failures": [Failure(2, kind, 0.0)], "told": False, "noise": 0 * ahead.references}
    expected = rig.predict(ahead.references, **arguments).rms_after / rig.nominal.noise
    assert result == pytest.approx(np.linalg.norm(expected), rel=1e-6)


def test_the_present_model_error_is_assumed_constant():
    """A difference of 3 urad between reading and model is assumed constant."""
    rig, exact, ahead = error_prediction()
    resting = replace(ahead, references=np.zeros((1, 2)), output=np.array([3e-6, 0.0]))
    result = resting.rms(exact, exact.start(), Scenario(1.0, [], STILL))
    assert result == pytest.approx(3e-6 / rig.nominal.noise[0])


@given(part=st.floats(0.0, 2.0))
def test_a_prediction_ends_once_the_error_is_large_enough(part):
    """The partial error lies between the threshold and the full error."""
    _, exact, short = error_prediction(0.04)
    case = Scenario(1.0, [Fault(2, "free")], STILL)
    whole = short.rms(exact, exact.start(), case)
    result = short.rms(exact, exact.start(), case, part * whole)
    assert part * whole * (1 - 1e-12) <= result <= whole if part < 1 else result == whole


def should_switch(*cases: tuple[float, float, float]) -> tuple[bool, list]:
    """Return the decision and the predictions, for cases (probability, error now, error then)."""
    requested: list = []
    errors: dict[Any, float] = {("stays", p): present for p, present, _ in cases}
    errors |= {("goes", p): candidate for p, _, candidate in cases}

    class Table(ErrorPrediction):
        def rms(self, controller, state, case, enough=np.inf):
            requested.append((controller, case.probability))
            return min(errors[controller, case.probability], enough)

    present: Any = ("stays", None)
    candidate: Any = ("goes", None)
    table = Table(**vars(error_prediction()[2]))
    scenarios = [Scenario(p, [], STILL) for p, *_ in cases]
    return table.should_switch(present, candidate, scenarios), requested


COSTS = st.floats(1e-3, 1e3)


@example(p=0.9, costs=(0.1, 0.1, 1.0, 1.0))  # smaller than noise of two rows
@example(p=0.9, costs=(0.1, 0.1, 2.0, 2.0))
@given(p=st.floats(0.51, 1.0), costs=st.tuples(COSTS, COSTS, COSTS, COSTS))
def test_the_controller_is_switched_if_the_expected_error_is_no_larger(p, costs):
    result, _ = should_switch((p, costs[0], costs[2]), (1 - p, costs[1], costs[3]))
    stay_cost, switch_cost = p * costs[0] + (1 - p) * costs[1], p * costs[2] + (1 - p) * costs[3]
    assert result == (switch_cost <= max(stay_cost, np.sqrt(2)))


def test_a_probability_of_instability_above_one_in_a_thousand_prevents_a_switch():
    assert not should_switch((0.999, 9.0, 0.1), (0.001, 9.0, np.inf))[0]


def test_impossible_scenarios_are_not_predicted():
    """The present controller is evaluated only until its error exceeds that of the candidate."""
    switches, requested = should_switch((1.0, 9.0, 3.0), (0.0, np.inf, np.inf))
    assert switches and requested == [("goes", 1.0), ("stays", 1.0)]
    switches, requested = should_switch((0.9, 9.0, 3.0), (0.1, np.nan, 3.0))
    assert switches and ("stays", 0.1) not in requested


@pytest.mark.long
def test_a_decision_predicts_one_second_from_the_present_place_on_the_path(monkeypatch):
    """The prediction replays the last second in reverse, for two scenarios of probability one."""
    rig, seen = Rig.hexapod(), []

    def declined(self: ErrorPrediction, _now: Any, _then: Any, cases: list[Scenario]) -> bool:
        seen.append((self, cases))
        return False

    monkeypatch.setattr(ErrorPrediction, "should_switch", declined)
    path = rig.path("circle", duration_s=2.5)
    run = rig.fly(rig.supervisor(), path, failures=[Failure(1, "locked", 1.5)])
    ahead, cases = seen[0]
    assert len(ahead.references) * rig.period_s == pytest.approx(1.0, rel=0.02)
    isolated = int(np.searchsorted(run.time_s, run.diagnoses[0].time_s))
    latest = path[isolated - 10 : isolated + 1]
    assert np.abs(latest - ahead.references[0]).max(axis=1).min() < 1e-12
    assert sum(case.probability for case in cases) == pytest.approx(1.0)
    assert [len(case.faults) for case in cases] == [1, 0]
