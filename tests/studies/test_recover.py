"""`fjh recover`: actuator failures that nothing announces."""

import re
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from matplotlib.figure import Figure

from experiments.recording.properties import properties_of
from experiments.recover import figure
from experiments.recover.checks import checks
from experiments.recover.exact_flights import INFORMED_LATE, informed_late_or_wrongly
from experiments.recover.flight import MISMATCHES, exact_rig
from experiments.recover.predictions import SETTINGS, beliefs, lookalikes
from experiments.recover.recordings import marks
from experiments.recover.recovery import Identification
from experiments.recover.results import described
from experiments.recover.row import SCHEMA
from experiments.recover.runs import SHOWN
from experiments.rig.hexapod.controller import nominal_loops
from experiments.rig.hexapod.rig import rig_of
from experiments.rig.hexapod.testbed import Testbed, TestbedConfig
from experiments.study.results import Results
from ftc.fdi.diagnosis import Diagnosis
from ftc.fdi.fault_model import Fault
from sim import load_model
from tests.made import made_run
from tests.rrd import rows, scalars


def test_the_failures_are_found_named_and_flown_around(recover):
    """With an exact plant and with all mismatches alike."""
    assert {entry["mismatch"] for entry in recover["failures"]} == {"exact", "all"}
    for entry in recover["failures"]:
        assert entry["strut"]["rate"] == entry["detected"]["rate"] == 1.0
        assert entry["alarm_before"]["right"] == entry["sound_named"]["right"] == 0
        assert entry["named_ms"]["median"] < 300
        assert 0.9 < entry["after_over_oracle"]["pooled"] < 1.1
    assert recover["second_failure"]["handled_or_declared"]["rate"] == 1.0


def test_the_rows_are_those_that_the_summary_counts(recover, recover_folder):
    table = pq.read_table(recover_folder / recover["dataset"])
    assert table.schema.names == SCHEMA.names
    rows = table.to_pylist()
    assert [row["case"] for row in rows] == list(range(recover["runs"]))
    assert sum(recover["flights"].values()) == len(rows)
    mixed = [row for row in rows if (row["sort"], row["mismatch"]) == ("failure", "all")]
    [entry] = [entry for entry in recover["failures"] if entry["mismatch"] == "all"]
    assert entry["strut"]["right"] == sum(row["strut_right"] for row in mixed)
    for row in mixed:
        assert row["rms_supervised_after_urad"] < 0.95 * row["rms_unaware_after_urad"]
        assert row["first_confidence"] >= recover["rules"]["confidence"]
        assert 0 < row["alarm_ms"] <= row["named_ms"]
    lasting = [row["duration_s"] for row in rows if row["sort"] == "sound"]
    assert recover["sound"]["hours"] == pytest.approx(sum(lasting) / 3600)


def test_the_curves_begin_at_the_exact_plant(recover):
    """Size zero is no mismatch, whichever it is."""
    [exact] = [entry for entry in recover["failures"] if entry["mismatch"] == "exact"]
    own = [entry for entry in recover["sizes"] if entry["mismatch"] == "all"]
    assert [entry["factor"] for entry in own] == [0.0, 0.3, 1.0, 3.0]
    assert own[0]["strut"] == exact["strut"] and own[0]["named_ms"] == exact["named_ms"]


def test_the_dither_costs_less_than_another_seed(recover):
    cost = recover["dither_cost"]
    assert np.abs(cost["change_urad"]).max() < 0.5 * np.abs(cost["reseeded_urad"]).max()


def test_without_a_failure_there_is_no_alarm_and_no_command_changes(recover):
    sound = recover["sound"]
    assert sound["alarms"] == sound["sound_named"] == sound["commands_changed"] == 0


def test_no_belief_about_one_strut_destabilizes_the_loop_and_a_bad_one_would_show(recover):
    table = recover["beliefs"]
    assert table["unstable"] == 0 and table["largest_pole"] < 1
    assert table["sensitivity_peak_worst"] < 3
    model, bench = load_model(), TestbedConfig()
    alpha, beta = (
        replace(loop, C=6 * loop.C, D=6 * loop.D) for loop in nominal_loops(model, bench)
    )
    found = beliefs(rig_of(Testbed(model, bench, (alpha, beta))), struts=[])
    assert any(each["largest_pole"] > 1 for each in found)


@pytest.mark.long
def test_told_late_or_wrongly_the_pointing_stays_bounded():
    """At worst the kick of a sound strut that is let go, and then the errors of a failed one."""
    told = informed_late_or_wrongly(exact_rig(), INFORMED_LATE[0])
    for flight in told:
        assert flight["peak_during_urad"] < 80
        assert flight["peak_after_urad"] < 15
    late = [each for each in told if each["late_ms"] > 0]
    assert len(late) == 4
    for flight in late[:3]:  # told within half a second
        assert flight["rms_after_urad"] < 0.95 * flight["rms_after_told_nothing_urad"]


@pytest.mark.long
@pytest.mark.parametrize("setting", SETTINGS[:2])
def test_the_ambiguity_is_that_of_antipodal_struts_and_the_dither_lifts_it(setting):
    for seen in lookalikes(exact_rig(), setting, [0]):
        if setting.name == "angles" and seen["failure"]["kind"] == "locked":
            assert {"strut": 4, "kind": "locked"}.items() <= seen["alike"][0].items()
        if setting.name == "angles, dither":
            assert seen["alike"] == []


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (
            lambda s: s.update(closure_residual_max_m=2e-8),
            "runs at the usual sizes: closure residual",
        ),
        (lambda s: s["beliefs"].update(unstable=1), "unstable"),
        (lambda s: s.update(diverged=1), "diverged"),
        (
            lambda s: s["isolation"]["all"]["strut_as_first_named"].update(rate=0.98),
            "all mismatches, strut as first named",
        ),
        (
            lambda s: s["isolation"]["exact"]["strut_and_kind_in_the_end"].update(rate=0.9),
            "exact plant, strut and kind in the end",
        ),
        (lambda s: s["isolation"]["all"]["strut_as_first_named"].update(rate=None), "is nan"),
        (lambda s: s["after_over_oracle"]["all"].update(pooled=1.2), "mismatches: RMS after"),
        (lambda s: s["failures"][-1]["named_ms"].update(median=301.0), "until the failed strut"),
        (lambda s: s["failures"][0]["sound_named"].update(right=1), "a sound strut was named"),
        (lambda s: s["sound"].update(sound_named=1), "without failures: .* sound strut"),
        (lambda s: s["sound"].update(commands_changed=1), "whose commands an alarm changed"),
        (lambda s: s["second_failure"]["handled_or_declared"].update(rate=0.9), "two failures"),
        (lambda s: s["shown"]["locked"].update(right=False), "run locked: wrong diagnosis"),
        (lambda s: s["sound"].update(low_per_hour_95=0.2), "lower 95 % bound"),
        (
            lambda s: s["sound"].update(hours=99, high_per_hour_95=0.11),
            "without failures: upper 95 % bound of the false alarms",
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
    told = described(recover)
    assert (recover_folder / "recover.md").read_text() == told.markdown()
    assert set(recover["files"]) == {path.name for path in recover_folder.iterdir()}
    for table in told.tables:
        assert {len(row) for row in table.rows} == {len(table.headings)}


def test_a_mark_says_what_happened_and_what_was_found_if_it_was():
    run, failure = made_run(9000), SHOWN["locked"][0]
    found = replace(Diagnosis.told(Fault(0, "locked")), tick=8324)
    unknown, known = (
        marks(run, Identification((failure,), (8250,), (), each, (), (), False, False, False, 0.0))
        for each in ((), (found,))
    )
    assert [(mark.failed_s, mark.failure) for mark in unknown + known] == [
        (8.25, "strut 1 locked")
    ] * 2
    assert [mark.is_found for mark in unknown + known] == [False, True]
    assert (known[0].diagnosed_s, known[0].diagnosis) == (8.324, "found: strut 1 locked")


def test_in_the_figure_failures_that_are_not_named_are_missing_from_its_shares():
    """One of four has no diagnosis, one is taken for another strut's: half are named."""
    truth = {"kind": "free", "rms_informed_after_urad": 1.0}
    truth |= {"rms_supervised_after_urad": 1.0, "rms_unaware_after_urad": 2.0}
    found = [(True, 3), (True, 9), (False, 5), (False, None)]
    cases = [truth | {"strut_right": right, "named_ms": ms} for right, ms in found]
    delays, after = Figure().subplots(1, 2)
    figure.draw_delays(delays, cases)
    (curve,) = delays.lines
    assert curve.get_xydata().tolist() == [[3, 0], [3, 25], [9, 50], [9, 50]]
    assert curve.get_label() == "free: 2 of 4"
    figure.draw_after(after, cases)
    ends = {line.get_label(): line.get_xydata()[-1].tolist() for line in after.lines}
    assert ends == {"supervised: up to 1.00": [1, 100], "fault-unaware: up to 2.00": [2, 100]}


def test_the_figures_groups_hold_every_mismatch_once_and_count_all_their_flights():
    names = [name for group in figure.GROUPS.values() for name in group]
    assert sorted(names) == sorted(set(MISMATCHES) - {"exact"})
    sizes = [
        {"mismatch": name, "factor": factor, "strut": {"right": right, "cases": 6}}
        for name, factor, right in (("gain", 3.0, 6), ("hysteresis", 3.0, 5), ("all", 1.0, 6))
    ]
    axes = Figure().add_subplot()
    figure.draw_sizes(axes, sizes)
    assert {text.get_text() for text in axes.texts} == {"11 of 12", "6 of 6"}
    assert figure.tolerated(sizes) == 1 and "up to 1 times" in axes.get_title()


def test_the_figures_title_says_what_the_summary_does(recover):
    [entry] = [entry for entry in recover["failures"] if entry["mismatch"] == "all"]
    right, cases = entry["strut"]["right"], entry["strut"]["cases"]
    said = figure.headline(recover)
    assert f"{right} of {cases} failures, {entry['named_ms']['median']:.0f} ms" in said


def test_the_recording_marks_the_strut_when_it_fails_and_when_it_is_found(recover_folder, recover):
    path = recover_folder / "locked.rrd"
    data = np.load(recover_folder / "locked.npz")
    failed_s = recover["shown"]["locked"]["happened"][0]["time_s"]
    times, failed = scalars(path, "/actuators/input/failed_0")
    assert 0 <= times[0] - round(failed_s * 1e9) < 5e6  # shown every 5 ms
    ticks = np.searchsorted(data["time_s"], times / 1e9 - 1e-9)
    np.testing.assert_array_equal(failed[:, 0], data["strut_input_percent"][ticks, 0])
    held = properties_of(path)
    named_s = round((failed_s + held["named_s"]) * 1e9)
    assert 0 < held["named_s"] < 0.3 and held["named_kind"] == "locked"
    for lane, at in (("is", round(failed_s * 1e9)), ("taken_for", named_s)):
        times, states = rows(path, f"/state/strut_1_{lane}", "StateChange:state")
        assert states == [["sound"], ["locked"]]
        assert abs(times[-1] - at) < 10
    times, texts = rows(path, "/events", "TextLog:text")
    assert len(texts) == 2 and abs(times - [round(failed_s * 1e9), named_s]).max() < 10
