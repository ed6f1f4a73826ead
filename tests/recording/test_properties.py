"""The results of a run as properties of its recording."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.recording.hexapod import of_hexapod
from experiments.recording.marks import Mark
from experiments.recording.properties import properties_of, results_of
from experiments.rig.hexapod.columns import hexapod_arrays
from experiments.study.results import Check
from experiments.study.study import WrongInput
from tests.made import keep_made, made_run

RUN = made_run()


def results(model, *marks: Mark, **stated):
    return results_of(of_hexapod(hexapod_arrays(RUN), model, marks), "made", **stated)


LOCK = Mark(1, 0.1, "strut 2 locked", 0.15, "found: strut 2 locked", "locked", "locked")


def test_the_errors_before_and_after_a_failure_are_those_of_the_whole_run(model):
    """Their sums of squares add up; and rows add up to all."""
    held, error = results(model, LOCK), RUN.error
    before, after = 100 * held["rms_before_rad"] ** 2, 300 * held["rms_after_rad"] ** 2
    assert before + after == pytest.approx((error**2).sum())
    both = np.hypot(held["rms_after_alpha_rad"], held["rms_after_beta_rad"])
    assert held["rms_after_rad"] == pytest.approx(both)


@pytest.mark.parametrize(("failed_s", "absent"), [(None, "after"), (0.0, "before")])
def test_a_run_that_nothing_divides_has_one_error(model, failed_s, absent):
    marks = [] if failed_s is None else [replace(LOCK, failed_s=failed_s)]
    held = results(model, *marks, predicted_before=(1e-6, 1e-6), predicted_after=(1e-6, 1e-6))
    assert not [name for name in held if f"rms_{absent}" in name]
    present = "before" if absent == "after" else "after"
    assert held[f"predicted_rms_{present}_rad"] == pytest.approx(np.sqrt(2) * 1e-6)


def test_the_first_failure_is_named_or_not(model):
    held = results(model, LOCK)
    assert held["failures"] == "strut 2 locked at 0.1 s"
    assert (held["actuator"], held["kind"], held["failed_s"]) == ("strut 2", "locked", 0.1)
    assert (held["named_s"], held["named_kind"]) == (pytest.approx(0.05), "locked")
    unfound = results(model, Mark(1, 0.1, "strut 2 locked", kind="locked"))
    assert not {"named_s", "named_kind"} & set(unfound)
    sound = results(model)
    assert sound["failures"] == "none" and not {"actuator", "kind", "failed_s"} & set(sound)


def test_rows_of_several_units_have_no_sum(model):
    shown = replace(of_hexapod(hexapod_arrays(RUN), model), row_units=("rad", "m"))
    held = results_of(shown, "made")
    assert {name for name in held if name.startswith("rms")} == {
        *("rms_before_alpha_rad", "rms_before_beta_m")
    }


def test_the_first_check_that_failed_is_said(model):
    passed, failed = Check("gap [m]", "here", 0.0, 1.0), Check("gap [m]", "there", 2.0, 1.0)
    assert results(model, checks=[passed])["checks"] == "passed"
    assert results(model, checks=[passed, failed])["checks"] == str(failed)


def test_properties_come_back_from_the_recording(model, tmp_path):
    keep_made(tmp_path, model)
    held = properties_of(tmp_path / "made.rrd")
    assert held["seed"] == 0
    assert (held["study"], held["checks"]) == ("made", "passed")
    assert held["rms_after_alpha_rad"] == RUN.rms()[0]
    (tmp_path / "no.rrd").write_text("no recording")
    with pytest.raises(WrongInput, match=r"no\.rrd is not a readable recording"):
        properties_of(tmp_path / "no.rrd")
