"""`fjh recover`: actuator failures that nothing announces."""

import re
from copy import deepcopy
from dataclasses import fields, replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from rerun.chunk import RrdReader

from experiments.hexapod.controller import nominal_loops
from experiments.hexapod.simulation import Trajectory
from experiments.hexapod.testbed import Testbed, TestbedConfig
from experiments.output.results import Results
from experiments.recover import figure
from experiments.recover.predictions import beliefs
from experiments.recover.recovery import Identification, draw
from experiments.recover.results import ambiguity, checks, notes, recovery
from experiments.recover.robustness import FaultFree, together
from experiments.recover.runs import SHOWN, pairs
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault
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
    assert FaultFree(10.0, 0).upper_per_hour == pytest.approx(0.2996, abs=1e-3)
    assert together([FaultFree(4.0, 1), FaultFree(6.0, 0)]) == FaultFree(10.0, 1)


def test_no_belief_about_one_strut_destabilizes_the_loop_and_a_bad_one_would_show(recover):
    table = recover["beliefs"]
    assert table["unstable"] == 0 and table["largest_pole"] < 1
    assert table["sensitivity_peak_worst"] < 3
    model, bench = load_model(), TestbedConfig()
    alpha, beta = (
        replace(loop, C=6 * loop.C, D=6 * loop.D) for loop in nominal_loops(model, bench)
    )
    found = beliefs(Testbed(model, bench, (alpha, beta)), struts=[])
    assert any(each["largest_pole"] > 1 for each in found)


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
    assert len({(case.fault.actuator, case.fault.kind) for case in cases}) == 18
    for first, second in pairs(7, 20):
        assert first.actuator != second.actuator and 0.1 <= second.time_s - first.time_s <= 2.0


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda s: s.update(closure_residual_max_m=2e-8), "all runs: closure residual"),
        (lambda s: s["beliefs"].update(unstable=1), "unstable"),
        (lambda s: s["isolation"]["strut_as_first_named"].update(rate=0.98), "as first named"),
        (lambda s: s["isolation"]["strut_and_kind_in_the_end"].update(rate=0.9), "in the end"),
        (lambda s: s["isolation"]["strut_as_first_named"].update(rate=None), "is nan"),
        (lambda s: s["after_over_oracle"].update(pooled=1.2), "pooled: RMS after recovery"),
        (lambda s: s["after_over_oracle"].update(worst_case=1.2), "worst case: RMS after"),
        (lambda s: s["second_failure"]["all_right"].update(rate=0.9), "two failures"),
        (lambda s: s["shown"]["locked"].update(right=False), "run locked: wrong diagnosis"),
        (lambda s: s["false_alarms"]["flown"].update(low_per_hour_95=0.2), "false alarms"),
        (
            lambda s: s["false_alarms"]["with_fresh_noise"].update(hours=99, high_per_hour_95=0.11),
            "with fresh noise: 95 % bound of the false alarms",
        ),
    ],
)
def test_whatever_is_not_as_it_should_be_fails_its_check(recover, spoil, words):
    assert Results(recover, checks=checks(recover)).failed_check is None
    spoilt = deepcopy(recover)
    spoil(spoilt)
    assert re.search(words, str(Results(spoilt, checks=checks(spoilt)).failed_check))


def test_tables_and_notes_are_those_of_the_json_file_and_all_files_are_listed(
    recover, recover_folder
):
    told = Results(recover, (recovery(recover), ambiguity(recover)), notes(recover))
    assert (recover_folder / "recover.md").read_text() == told.markdown()
    assert set(recover["files"]) == {path.name for path in recover_folder.iterdir()}
    for table in told.tables:
        assert {len(row) for row in table.rows} == {len(table.headings)}


def test_in_the_figure_a_failure_that_is_not_found_is_named_by_what_happened(recover_folder):
    """And one that is, by what was found, with a line where that was."""
    with np.load(recover_folder / "locked.npz") as data:
        run = Trajectory(**{each.name: data[each.name] for each in fields(Trajectory)})
    found = Diagnosis(Fault(0, "locked"), 1.0, 1.0, 0.0, 8250, 8260, 8270, confirmed=True)
    labels = {}
    for diagnoses in ((), (found,)):
        happened = Identification(
            SHOWN["locked"], 8250, diagnoses, (), False, False, False, False, 0.0
        )
        axes = Figure().add_subplot()
        figure.draw_shown(axes, run, happened)
        labels[len(diagnoses)] = [text.get_text() for text in axes.texts], len(axes.lines)
    assert labels == {0: (["not found: strut 1 locked"], 2), 1: (["found: strut 1 locked"], 3)}


def test_in_the_figure_failures_that_are_not_named_stand_out():
    """One of four has no diagnosis, one is taken for another strut's: half are not named."""
    truth = {"truth": {"strut": 1, "kind": "free"}, "rms_after_oracle_urad": 1.0}
    truth |= {"rms_after_urad": 1.0, "rms_after_uncorrected_urad": 2.0}
    named, other = {"strut": 1, "kind": "free"}, {"strut": 4, "kind": "free"}
    found = [(named, 3), (named, 9), (other, 5), (None, None)]
    cases = [truth | {"first": first, "named_ms": ms} for first, ms in found]
    delays, after = Figure().subplots(1, 2)
    figure.draw_delays(delays, cases)
    curve, cross = delays.lines
    assert curve.get_xydata().tolist() == [[3, 0], [3, 25], [9, 50], [9, 50]]
    assert cross.get_ydata().tolist() == [50]
    assert delays.get_xticklabels()[-1].get_text() == "not named"
    figure.draw_after(after, cases)
    points = {line.get_label(): len(line.get_xdata()) for line in after.lines}
    assert points["supervised"] == points["supervised, strut not named"] == 2


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
