"""`fjh recover`: a strut fails in flight, and nobody says so."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from rerun.chunk import RrdReader

from experiments.hexapod.simulation import nominal_loops
from experiments.hexapod.testbed import Bench
from experiments.recover.cases import draw
from experiments.recover.false_alarms import Healthy, together
from experiments.recover.second import pairs
from experiments.recover.soundness import complaint
from experiments.recover.wrong import beliefs
from sim import load_model
from tests.rrd import scalars


def test_the_failures_are_found_named_and_flown_around(recover):
    isolation = recover["isolation"]
    assert isolation["all_cases_strut"] == isolation["strut_as_first_named"]
    assert isolation["all_cases_strut"]["rate"] == 1.0
    assert isolation["strut_and_kind_in_the_end"]["rate"] == 1.0
    assert recover["after_over_oracle"]["worst_case"] < 1.1
    assert recover["second_failure"]["all_right"]["rate"] == 1.0
    for case in recover["cases"]:
        assert 0 < case["alarm_ms"] <= case["named_ms"] < 60
        assert case["rms_after_urad"] < 0.95 * case["rms_after_uncorrected_urad"]
        assert case["first_strut_confidence"] >= recover["rules"]["confidence"]


def test_the_dither_costs_less_than_another_seed(recover):
    cost = recover["dither_cost"]
    assert np.abs(cost["change_urad"]).max() < 0.1 * np.abs(cost["reseeded_urad"]).max()


def test_a_healthy_flight_raises_no_alarm_and_the_model_is_near(recover):
    alarms = recover["false_alarms"]
    assert alarms["flown"]["alarms"] == alarms["with_fresh_noise"]["alarms"] == 0
    assert alarms["model_error_max_urad"] < 0.03  # a tenth of the detector's noise


def test_the_interval_of_a_rate_is_that_of_a_poisson_process():
    """Nothing in T hours: below 3 / T at 95 %, the rule of three."""
    assert Healthy(10.0, 0).upper_per_hour == pytest.approx(0.2996, abs=1e-3)
    assert together([Healthy(4.0, 1), Healthy(6.0, 0)]) == Healthy(10.0, 1)


def test_no_belief_about_one_strut_destabilizes_the_loop_and_a_bad_one_would_show(recover):
    table = recover["beliefs"]
    assert table["unstable"] == 0 and table["largest_pole"] < 1
    assert table["sensitivity_peak_worst"] < 3
    model, bench = load_model(), Bench()
    alpha, beta = (
        replace(loop, C=6 * loop.C, D=6 * loop.D) for loop in nominal_loops(model, bench)
    )
    found = beliefs(model, bench, (alpha, beta), struts=[])
    assert any(each.largest_pole > 1 for each in found)


def test_told_late_or_wrongly_the_pointing_stays_bounded(recover):
    """At worst the kick of a sound strut that is let go, and then the errors of a failed one."""
    for flight in recover["told"]:
        assert flight["peak_during_urad"] < 80
        assert flight["peak_after_urad"] < 15
    late = [each for each in recover["told"] if each["late_ms"] > 0]
    assert len(late) == 4
    for flight in late[:3]:  # told within half a second
        assert flight["rms_after_urad"] < 0.95 * flight["rms_after_told_nothing_urad"]


def test_the_ambiguity_is_that_of_antipodal_struts_and_the_dither_lifts_it(recover):
    for seen in recover["ambiguity"]["failures"]:
        opposite = (seen["failure"]["strut"] - 1 + 3) % 6 + 1
        if seen["setting"] == "angles" and seen["failure"]["kind"] == "locked":
            assert {"strut": opposite, "kind": "locked"}.items() <= seen["alike"][0].items()
        if seen["setting"] == "angles, dither":
            assert seen["alike"] == []


def test_draws_repeat_with_their_seed_and_cover_every_failure():
    cases = draw(7, 18)
    assert cases == draw(7, 18) and cases != draw(8, 18)
    assert len({(case.strut, case.kind) for case in cases}) == 18
    for first, second in pairs(7, 20):
        assert first.strut != second.strut and 0.1 <= second.time_s - first.time_s <= 2.0


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda s: s.update(closure_residual_max_m=2e-8), "closed loop opened"),
        (lambda s: s["beliefs"].update(unstable=1), "unstable"),
        (lambda s: s["isolation"]["strut_as_first_named"].update(rate=0.98), "isolated"),
        (lambda s: s["isolation"]["strut_and_kind_in_the_end"].update(rate=0.9), "isolated"),
        (lambda s: s["isolation"]["strut_as_first_named"].update(rate=None), "separated enough"),
        (lambda s: s["after_over_oracle"].update(pooled=1.2), "oracle"),
        (lambda s: s["after_over_oracle"].update(worst_case=1.2), "oracle"),
        (lambda s: s["second_failure"]["all_right"].update(rate=0.9), "two failures"),
        (lambda s: s["shown"]["locked"].update(right=False), "in the flight locked"),
        (lambda s: s["false_alarms"]["flown"].update(low_per_hour_95=0.2), "false alarms"),
        (
            lambda s: s["false_alarms"]["with_fresh_noise"].update(hours=99, high_per_hour_95=0.11),
            "false alarms",
        ),
    ],
)
def test_whatever_is_not_as_it_should_be_is_complained_of(recover, spoil, word):
    assert complaint(recover) is None
    spoilt = deepcopy(recover)
    spoil(spoilt)
    assert word in str(complaint(spoilt))


def test_the_recording_marks_the_strut_when_it_fails_and_when_it_is_found(recover_folder, recover):
    path = recover_folder / "locked.rrd"
    data = np.load(recover_folder / "locked.npz")
    failed_s = recover["shown"]["locked"]["happened"][0]["time_s"]
    times, failed = scalars(path, "/strut/input/strut_1_failed")
    assert times[0] == round(failed_s * 1e9)
    found, after = scalars(path, "/strut/input/strut_1_diagnosed")
    assert times[-1] == found[0] and 0 < (found[0] - times[0]) / 1e9 < 0.1
    tick = round(failed_s / 1e-3)
    np.testing.assert_array_equal(
        failed[:, 0], data["strut_input_percent"][tick : tick + len(failed), 0]
    )
    assert len(after) == len(data["time_s"]) - round(found[0] / 1e6)
    states = RrdReader(path).stream().filter(content="/state/strut_1", is_static=False)
    rows = [
        row
        for chunk in states.to_chunks()
        for row in chunk.to_record_batch().column("StateChange:state").to_pylist()
    ]
    assert rows == [["sound"], ["failed"], ["diagnosed"]]
    texts = RrdReader(path).stream().filter(content="/events", is_static=False).to_chunks()
    assert sum(len(chunk.to_record_batch()) for chunk in texts) == 2
