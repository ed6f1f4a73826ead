"""To go over to another controller is a decision by predicted errors; what it predicts is true."""

import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fjh.rig import Rig
from ftc import DirectDrive, Goal
from ftc.fdi import Fault
from ftc.reconfiguration import Case, Outlook
from sim import Failure

RIG = Rig.hexapod()
STILL = np.zeros(12)
PATH = RIG.path("circle", duration_s=0.4)
NO_MOTION = np.zeros((3 * len(PATH), 6))
OUTLOOK = Outlook(RIG.nominal, np.zeros(2), PATH, secondary=NO_MOTION, unused=NO_MOTION)
GIVEN = dict(vars(OUTLOOK))


@pytest.mark.parametrize("kind", ["locked", "free", "weak"])
def test_the_predicted_error_is_that_of_the_linear_loop(kind):
    """The controller, stepped against the model, errs as the closed loop in matrices does."""
    pilot, left = copy.copy(RIG.controller()), 0.5 if kind == "weak" else 0.0
    pilot.drives = DirectDrive()  # converters round
    found = OUTLOOK.rms(pilot, pilot.start(), Case(1.0, [Fault(2, kind, left)], STILL))
    told = {"failures": [Failure(2, kind, 0.0)], "told": False, "noise": 0 * PATH}
    expected = np.linalg.norm(RIG.predict(PATH, **told).rms_after / RIG.nominal.noise)
    assert found == pytest.approx(expected, rel=1e-6)


def test_what_the_model_is_off_now_stays():
    """A reading that is 3 urad from the model's is 3 urad from it all the time, and integrated."""
    pilot, off = RIG.controller(), np.array([3e-6, 0.0])
    resting = replace(OUTLOOK, references=np.zeros((1, 2)), output=off)
    found = resting.rms(pilot, pilot.start(), Case(1.0, [], STILL))
    assert found == pytest.approx(3e-6 / RIG.nominal.noise[0])


def test_a_coil_that_is_taken_for_a_seventh_of_itself_is_driven_into_instability():
    """A sound one, commanded seven times as much, errs more and more: to stay costs less."""
    wrong = RIG.controller(Goal(joint_weight=(1.0,) * 6, effectiveness={0: 1 / 7}))
    sound, long = RIG.controller(), replace(OUTLOOK, references=np.tile(PATH, (3, 1)))
    case = Case(1.0, [], STILL)
    driven, calm = (long.rms(each, each.start(), case) for each in (wrong, sound))
    assert driven > 2 * calm


@given(part=st.floats(0.0, 2.0))
def test_an_error_that_is_enough_is_not_followed_to_its_end(part):
    """What is returned then lies between what was enough and the error to its end."""
    pilot, case = RIG.controller(), Case(1.0, [Fault(2, "free")], STILL)
    short = replace(OUTLOOK, references=PATH[:40])
    whole = short.rms(pilot, pilot.start(), case)
    found = short.rms(pilot, pilot.start(), case, part * whole)
    assert part * whole * (1 - 1e-12) <= found <= whole if part < 1 else found == whole


@dataclass(frozen=True)
class Table(Outlook):
    """Errors that are given, by controller and case."""

    errors: dict = None  # type: ignore[assignment]

    def rms(self, pilot, state, case, enough=np.inf):
        """From the table, as little of it as is enough."""
        return min(self.errors[pilot, case.probability], enough)


COSTS = st.floats(1e-3, 1e3)
STAYS: Any = ("stays", None)
GOES: Any = ("goes", None)


@given(p=st.floats(0.51, 1.0), costs=st.tuples(COSTS, COSTS, COSTS, COSTS))
def test_it_goes_over_if_the_expected_error_is_no_larger(p, costs):
    cases = [Case(p, [], STILL), Case(1 - p, [], STILL)]
    keys = [(name, case.probability) for name in ("stays", "goes") for case in cases]
    table = Table(**GIVEN, errors=dict(zip(keys, costs, strict=True)))
    goes = table.goes_over(STAYS, GOES, cases)
    staying, going = p * costs[0] + (1 - p) * costs[1], p * costs[2] + (1 - p) * costs[3]
    assert goes == (going <= max(staying, np.sqrt(2)))


def test_one_chance_in_a_thousand_of_instability_is_enough_to_stay():
    cases = [Case(0.999, [], STILL), Case(0.001, [], STILL)]
    errors = {("stays", 0.999): 9.0, ("stays", 0.001): 9.0, ("goes", 0.999): 0.1}
    table = Table(**GIVEN, errors=errors | {("goes", 0.001): np.inf})
    assert not table.goes_over(STAYS, GOES, cases)


@pytest.mark.long
def test_a_decision_looks_a_second_ahead_from_where_the_path_is(monkeypatch):
    """The references of the last second, the latest first, and two cases that are all there is."""
    seen: list[tuple[Outlook, list[Case]]] = []

    def declined(self: Outlook, _stays: Any, _goes: Any, cases: list[Case]) -> bool:
        seen.append((self, cases))
        return False

    monkeypatch.setattr(Outlook, "goes_over", declined)
    path = RIG.path("circle", duration_s=2.5)
    run = RIG.fly(RIG.supervisor(), path, failures=[Failure(1, "locked", 1.5)])
    outlook, cases = seen[0]
    assert len(outlook.references) * RIG.period_s == pytest.approx(1.0, rel=0.02)
    named = int(np.searchsorted(run.time_s, run.diagnoses[0].time_s))
    latest = path[named - 10 : named + 1]
    assert np.abs(latest - outlook.references[0]).max(axis=1).min() < 1e-12
    assert sum(case.probability for case in cases) == pytest.approx(1.0)
    assert [len(case.faults) for case in cases] == [1, 0]


def test_what_cannot_be_is_not_flown_and_an_infinite_error_of_it_does_not_count():
    """Nor are more cases of staying, once those before them cost as much as to go."""
    flown = []

    @dataclass(frozen=True)
    class Noted(Table):
        def rms(self, pilot, state, case, enough=np.inf):
            """Of the table, and noted."""
            flown.append((pilot[0], case.probability))
            return super().rms(pilot, state, case, enough)

    errors = {("stays", 1.0): 9.0, ("goes", 1.0): 3.0, ("stays", 0.0): np.inf}
    table = Noted(**GIVEN, errors=errors | {("goes", 0.0): np.inf})
    assert table.goes_over(STAYS, GOES, [Case(1.0, [], STILL), Case(0.0, [], STILL)])
    assert flown == [("g", 1.0), ("s", 1.0)]
    flown.clear()
    cases = [Case(0.9, [], STILL), Case(0.1, [], STILL)]
    errors = {("stays", 0.9): 9.0, ("goes", 0.9): 3.0, ("goes", 0.1): 3.0}
    assert Noted(**GIVEN, errors=errors).goes_over(STAYS, GOES, cases)
    assert ("s", 0.1) not in flown
