"""Tests of the common contract of studies: files, figures, and checks that can fail."""

import re
import sys
from inspect import signature
from math import nan
from typing import Any

import pandas as pd
import pytest
from PIL import Image

from experiments.studies import LINES, study
from experiments.sweep import compare_with_model
from fjh.study.result import records_of
from tests.conftest import NIGHT_STUDIES
from tests.experiments.results import Results

pytestmark = pytest.mark.long


@pytest.fixture
def results(request, name) -> Results:
    """Results of the study of this name, of its short version except in night runs."""
    if name in NIGHT_STUDIES and not request.node.get_closest_marker("night"):
        return Results(request.getfixturevalue("smaller_study")(name), name)
    return Results(request.getfixturevalue(f"{name}_folder"), name)


WHOLE = [
    pytest.param(name, marks=pytest.mark.night, id=f"{name} in full")
    for name in sorted(NIGHT_STUDIES)
]


@pytest.mark.parametrize("name", [*LINES, *WHOLE])
def test_a_study_writes_the_files_in_its_json_tables_and_figures(results, name):
    """Figures are PNG and PDF without date, so that two runs write the same bytes."""
    summary, files = results.summary, {path.name for path in results.folder.iterdir()}
    assert summary["experiment"] == name
    assert {"seed", "versions", "model_sha256", "files"} <= set(summary)
    assert set(summary["files"]) == files
    referenced = re.findall(r'"([\w.-]+\.(?:rrd|npz|parquet))"', str(summary).replace("'", '"'))
    assert {f"{name}.json", f"{name}.md", *referenced} <= files
    assert all(check["passed"] for check in summary["checks"])
    for file in files:
        table = re.fullmatch(rf"{name}_(\w+)\.parquet", file)
        if table and summary[table[1]]:
            written = records_of(pd.read_parquet(results.folder / file))
            stated = [{key: entry.get(key) for key in written[0]} for entry in summary[table[1]]]
            assert written == stated, file
    page = (results.folder / f"{name}.md").read_text()
    pdfs = sorted(results.folder.glob("*.pdf"))
    assert pdfs and {path.stem for path in pdfs} == {p.stem for p in results.folder.glob("*.png")}
    for path in pdfs:
        assert f"]({path.stem}.png)" in page
        with Image.open(path.with_suffix(".png")) as picture:
            picture.verify()
        content = path.read_bytes()
        assert content.startswith(b"%PDF-") and b"/CreationDate" not in content
        assert len(content) < 1e6


CLOSURE, RMS = "closure residual [m]", "RMS error of "
TUNED = "strict priority over that of clipping"
HEALTHY_ARM = "mechanism == 'arm' and condition == 'healthy'"
SURE = "struts == 'SSSSSS' and jacobian == 'constant'"
ALTERED: list[tuple[str, str, str, str, Any, str]] = [
    ("table1", "columns", "name == 'W_d'", "closure_residual_max_m", 7e-8, f"W_d: {CLOSURE}"),
    ("table1", "columns", "name == 'W_d'", "beta_rms_urad", 9.0, f"difference of the {RMS}beta"),
    ("table1", "columns", "name == 'W_a'", "mismatched_alpha_rms_urad", 9.0, "all mismatches"),
    *(
        ("systems", "systems", HEALTHY_ARM, column, value, "arm, healthy: ")
        for column, value in {
            **{"agrees": False, "motion_error": 0.02, "drift_error": 0.02, "torque_error": 0.02},
            **{"closure_error": 0.02, "yielded_steps": 0.02, "major_error": 0.02},
        }.items()
    ),
    ("release", "spirals", "", "closure_residual_max_m", 1e-7, "closure residual"),
    ("release", "spirals", "", "motion_mismatch_linear_model_percent", 2.0, "the linear model"),
    ("release", "spirals", "", "alpha_rms_urad", 9.0, f"{RMS}alpha"),
    ("release", "sweep", "", "mismatch_elastic_percent", 2.0, "elastic and the simulation"),
    ("release", "sweep", "", "mismatch_linear_model_percent", 2.0, "model and the simulation"),
    ("release", "sweep", "", "alpha_corrected_urad", 98.0, "error of the corrected mapping"),
    ("release", "on_the_ground_without_spring", "", "strut_1_um", 0.0, "strut 1 from its stop"),
    *(
        ("force", table, f"index == {row}", column, value, "")
        for table, row, column, value in [
            ("theorems", 0, "closure_residual_max_m", 1e-7),
            ("theorems", 1, "exact", False),
            ("theorems", 2, "cost_excess", 1e-3),
            ("theorems", 3, "pressed_off_percent", 2.0),
            ("theorems", 0, "pressed_major_off_percent", 2.0),
            ("theorems", 4, "held_off_percent", 2.0),
            ("theorems", 5, "moved_percent", nan),
            ("prescribed", 0, "off_percent", 2.0),
            ("tradeoff", 0, "major_off_percent", 2.0),
            ("tradeoff", 9, "weighed_over_mapping", 0.9),
            ("tradeoff", 9, "weighed_over_mapping", nan),
            ("tradeoff", 9, "major_off_percent", 2.0),
            ("internal_force", 1, "saved_at_least_n", -0.1),
            ("internal_force", 1, "wrench_off_percent", 2.0),
            ("internal_force", 0, "legs_off_percent", 2.0),
        ]
    ),
    ("goals", "runs", "name == 'pursued'", "worst", nan, "pursued: secondary measure beyond"),
    ("goals", "runs", "name == 'nothing'", "worst", nan, "nothing: distance of the secondary"),
    ("goals", "runs", "", "closure_residual_max_m", 2e-8, f"{CLOSURE} is 2e-08, expected below"),
    *(
        ("goals", "angles", "name == 'pursued'", key, -1e3, "over that by another seed,")
        for key in ("rms_change_urad", "difference_rms_urad", "difference_peak_urad")
    ),
    ("limits", "spirals", "strategy == 'clipping'", "rms_over_strict", 0.9, TUNED),
    ("limits", "spirals", "strategy == 'strict_winding_up'", "rms_over_strict", 0.9, "anti-windup"),
    ("limits", "spirals", "strategy == 'strict'", "recovery_s", 0.6, "to recovered pointing"),
    ("limits", "spirals", "strategy == 'strict'", "beyond_limit_um", 0.03, "beyond its limit [um]"),
    ("limits", "spirals", "strategy == 'strict'", "rest_peak_urad", 6.0, "at rest afterwards"),
    ("limits", "spirals", "strategy == 'strict'", "closure_residual_max_m", 2e-8, CLOSURE),
    ("limits", "arm", "strategy == 'strict'", "peak_mrad", 11.0, "peak error of strict priority"),
    ("limits", "arm", "strategy == 'clipping'", "beyond_limit_rad", 1e-6, "joint beyond its"),
    ("limits", "conditions", "", "circle_margin", -0.1, "circle criterion"),
    ("limits", "out_of_reach", "strategy == 'strict'", "excess_largest_percent", 1e-3, "the least"),
    ("jacobian", "variation", "norm == 'two'", "value", 0.004, "two norm: value found divided"),
    ("jacobian", "variation", "norm == 'frobenius'", "certified_upper_bound", 0.0032, "certified"),
    ("jacobian", "", "", "J0_from_mjcf_largest_difference", 1e-6, "eq. (39): largest difference"),
    ("uncorrected", "runs", "index == 0", "beta_simulated_urad", 9.0, "lost_strut, W_a: relative"),
    ("uncorrected", "runs", "index == 0", "closure_residual_max_m", 1e-6, f"W_a: {CLOSURE}"),
    ("recover", "rows", "", "closure_residual_max_m", 2e-8, "near the path"),
    ("recover", "rows", "", "status", "ended", "ended early"),
    ("recover", "beliefs", "", "largest_pole", 1.0, "unstable"),
    ("recover", "by_mismatch", "", "isolable_right_rate", 0.98, "identified first"),
    ("recover", "by_mismatch", "", "isolable_all_right_rate", nan, "kind in the end"),
    ("recover", "by_mismatch", "", "over_informed_after_pooled", 1.2, "RMS after"),
    ("recover", "by_mismatch", "", "named_median_s", 0.301, "until the failed actuator"),
    ("recover", "healthy", "", "healthy_named_count", 1, "an actuator was identified"),
    ("recover", "healthy", "", "commands_changed", 1, "whose commands an alarm changed"),
    ("recover", "healthy", "", "alarms_per_hour_low_95", 0.2, "lower 95 % bound"),
    ("recover", "healthy", "", "hours", 99.0, "upper 95 % bound"),
    ("recover", "pairs", "", "handled_rate", 0.9, "two failures"),
    ("recover", "shown", "", "all_right", False, "run locked: wrong diagnosis"),
    ("sweep", "rows", "struts == 'SSSSSS'", "beta_rms_urad", 9.0, "difference between the RMS"),
    ("sweep", "rows", "", "closure_residual_max_m", 1e-7, f"all runs: {CLOSURE} is 1e-07"),
    ("atlas", "rows", "struts == 'SSLSSS'", "beta_rms_urad", 9.0, "SSLSSS with W_a and the"),
    ("atlas", "rows", "struts == 'SFFSLF'", "beta_rms_urad", 99.0, "SFFSLF with W_a and the"),
    ("atlas", "rows", "struts == 'SLLSLL'", "status", "exact", "SLLSLL with W_a"),
    ("atlas", "rows", SURE, "alpha_rms_urad", nan, "SSSSSS with W_a"),
    ("atlas", "rows", SURE, "closure_residual_max_m", 1e-7, f"{CLOSURE} is 1e-07"),
    ("track", "", "", "prediction_off_after", 0.21, "relative error of the predicted RMS"),
    ("track", "", "", "closure_residual_max_m", 0.002, CLOSURE),
]
"""Study, table (empty: JSON), query of rows, column, number, expected text (empty: one check)."""


def failures(
    name: str, summary: dict[str, Any], rows: pd.DataFrame, tables: dict[str, pd.DataFrame]
) -> list[str]:
    """Return the failed checks of a study, called with the parameters of its `checks`."""
    module: Any = sys.modules[study(name).__module__]
    available: dict[str, Any] = {
        **tables,
        **{"tables": tables, "rows": rows, "settings": summary, "results": summary},
        "further": tables.get("further_runs"),
        "duration_s": summary.get("duration_s"),
        "from_mjcf": summary.get("J0_from_mjcf_largest_difference"),
    }
    if name in ("atlas", "sweep"):
        available["rows"] = compare_with_model(rows)
    checks = module.atlas_checks if name == "atlas" else module.checks
    names = [key for key in signature(checks).parameters if key != "_"]
    return [str(check) for check in checks(*map(available.get, names)) if not check.passed]


@pytest.mark.parametrize(("name", "table", "where", "column", "value", "expected"), ALTERED)
def test_each_check_of_a_study_fails_on_an_altered_number(
    results, name, table, where, column, value, expected
):
    summary, tables = dict(results.summary), dict(results.tables)
    rows = results.rows if "dataset" in summary else pd.DataFrame()
    assert failures(name, summary, rows, tables) == []
    if not table:
        summary[column] = value
    else:
        altered = (rows if table == "rows" else tables[table]).copy()
        chosen = altered.eval(where) if where else slice(None)
        altered[column] = altered[column].astype(object)
        altered.loc[chosen, column] = value
        altered = altered.infer_objects()
        rows, tables = (altered, tables) if table == "rows" else (rows, tables | {table: altered})
    failed = failures(name, summary, rows, tables)
    assert failed and all(expected in sentence for sentence in failed)
    assert expected or len(failed) == 1
