"""The results of a run as properties of its recording."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from fjh.recording.properties import properties_of
from fjh.recording.record import results_of
from fjh.recording.view import Change
from fjh.study.errors import WrongInput
from fjh.study.result import Check
from tests.made import ABOUT, keep_made, made_run, made_view

RUN = made_run()


def results(*incidents: Change, diagnoses: Sequence[Change] = (), **about):
    return results_of(replace(ABOUT, **about), made_view(*incidents, diagnoses=diagnoses))


LOCK = Change("strut2", "locked", 0.1)


def test_the_errors_before_and_after_a_failure_are_those_of_the_whole_run():
    """Their sums of squares add up; and rows add up to all."""
    held, error = results(LOCK), RUN.error
    before, after = 100 * held["rms_before_rad"] ** 2, 300 * held["rms_after_rad"] ** 2
    assert before + after == pytest.approx((error**2).sum())
    both = np.hypot(held["rms_after_alpha_rad"], held["rms_after_beta_rad"])
    assert held["rms_after_rad"] == pytest.approx(both)


@pytest.mark.parametrize(("failed_s", "absent"), [(None, "after"), (0.0, "before")])
def test_a_run_that_nothing_divides_has_one_error(failed_s, absent):
    failures = [] if failed_s is None else [replace(LOCK, time_s=failed_s)]
    held = results(*failures, predicted=((1e-6, 1e-6), (1e-6, 1e-6)))
    assert not [name for name in held if f"rms_{absent}" in name]
    present = "before" if absent == "after" else "after"
    assert held[f"predicted_rms_{present}_rad"] == pytest.approx(np.sqrt(2) * 1e-6)


def test_the_first_failure_is_diagnosed_or_not():
    held = results(LOCK, diagnoses=[Change("strut2", "locked", 0.15)])
    assert held["failures"] == "strut2 locked at 0.1 s"
    assert (held["actuator"], held["kind"], held["failed_s"]) == ("strut2", "locked", 0.1)
    assert (held["named_s"], held["named_kind"]) == (pytest.approx(0.05), "locked")
    assert not {"named_s", "named_kind"} & set(results(LOCK))
    healthy = results()
    assert healthy["failures"] == "none" and not {"actuator", "kind", "failed_s"} & set(healthy)


def test_rows_of_several_units_have_no_sum():
    view = made_view()
    view = replace(view, stated=replace(view.stated, row_units=["rad", "m"]))
    assert {name for name in results_of(ABOUT, view) if name.startswith("rms")} == {
        *("rms_before_alpha_rad", "rms_before_beta_m")
    }


def test_the_first_check_that_failed_is_said():
    passed, failed = Check("gap [m]", "here", 0.0, 1.0), Check("gap [m]", "there", 2.0, 1.0)
    assert results(checks=[passed])["checks"] == "passed"
    assert results(checks=[passed, failed])["checks"] == str(failed)


def test_properties_come_back_from_the_recording(tmp_path):
    keep_made(tmp_path)
    held = properties_of(tmp_path / "made.rrd")
    assert held["seed"] == 0
    assert (held["study"], held["checks"]) == ("made", "passed")
    assert held["failures"] == "strut1 locked, known at 0 s"
    assert held["rms_after_alpha_rad"] == RUN.rms()[0]
    (tmp_path / "no.rrd").write_text("no recording")
    with pytest.raises(WrongInput, match=r"no\.rrd is not a readable recording"):
        properties_of(tmp_path / "no.rrd")
