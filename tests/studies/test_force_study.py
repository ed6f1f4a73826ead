"""Theorems 7 to 9 in simulation: forces exerted on a fixture, and held against a push."""

import copy
import dataclasses
import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from experiments.app.cli import main
from experiments.force import runs
from experiments.force import tables as tables_module
from experiments.force.aims import LEVERED, SPARING, draw_aims
from experiments.force.answers import known_system, platform
from experiments.force.figure import figure_force
from experiments.force.results import summarize
from experiments.force.rig import FIXTURE, Condition, Gauges, hold, press, with_fixture
from experiments.force.runs import examine, payload_stiffness
from experiments.force.tables import checks, tables
from experiments.rig.hexapod.columns import MAJOR, SECONDARY
from experiments.rig.hexapod.fault_tolerance import strut_and_payload_stiffness
from prioritized import ConstrainedSystem, force_mapping
from sim import HEXAPOD_MJCF, NOMINAL, Plant, hexapod, jacobians, load_model
from tests.force_theorems import theorem_7, theorem_8
from tests.pages import assert_says


@pytest.fixture(scope="module")
def force(force_run):
    return force_run[1]


@pytest.fixture(scope="module")
def summary(force_folder):
    return json.loads((force_folder / "force.json").read_text())


@pytest.fixture(scope="module")
def by_kind(force):
    return {one.condition.kind: one for one in force.examinations}


@pytest.fixture(scope="module")
def rig():
    return with_fixture(HEXAPOD_MJCF)


@pytest.fixture(scope="module")
def lines():
    """A of l_dot = A v in closed form: rows are the struts' lines, and f = A^T strut forces."""
    return hexapod(load_model()).inverse_jacobian(NOMINAL)


def test_the_fixture_reads_what_the_payload_is_pushed_with(rig):
    """No torque, no mapping: the gauge against a known wrench."""
    plant, wrench = Plant(rig), np.array([1.0, -2.0, 3.0, 10.0, 20.0, -15.0])
    plant.data.eq_active[rig.equality(FIXTURE).id] = True
    gauges = Gauges(plant)
    plant.settle(0.05)
    before = gauges.read()[:6]
    plant.push(wrench)
    plant.step(np.zeros(6), 0.05)
    # The payload gives way by nanometres, and the springs take so much.
    np.testing.assert_allclose(gauges.read()[:6] - before, wrench, rtol=2e-4)


def test_the_struts_make_up_the_wrench_that_is_held_whatever_the_coils_do(rig, lines):
    """Six forces along six lines balance a push in one way only, springs or coils."""
    wrench = np.array([[1.0, -2.0, 0.5, 10.0, 5.0, -15.0]])
    by_springs = hold(rig, (), np.zeros((1, 6)), wrench).strut_n[:, -1]
    by_coils = hold(rig, (), np.linalg.solve(lines.T, wrench.T).T, wrench).strut_n[:, -1]
    # Against springs the payload moves, and the flexures take their share of 0.2 %.
    np.testing.assert_allclose(by_springs @ lines, wrench, rtol=5e-3)
    np.testing.assert_allclose(by_coils @ lines, wrench, rtol=1e-4)


def test_the_mapping_never_sees_the_fixture(rig):
    closed = jacobians(load_model(), mujoco.MjData(load_model()), "payload", "base")
    with_it = jacobians(rig, mujoco.MjData(rig), "payload", "base")
    np.testing.assert_array_equal(with_it.J_C, closed.J_C)
    assert known_system(Condition()).J_C.shape == closed.J_C.shape


def test_every_simulated_force_is_the_mappings(summary):
    kinds = [one["kind"] for one in summary["conditions"]]
    assert kinds == [None, "locked", "free", "loose"]
    for one in summary["conditions"]:
        assert [trial["theorem"] for trial in one["theorems"]] == [7, 8, 9]
        for trial in one["theorems"]:
            assert trial["exact"]
            assert trial["pressed_off_percent"] < 0.02
            assert trial["held_off_percent"] < 0.002
            assert trial["moved_percent"] < 0.005
            assert abs(trial["cost_excess"]) < 1e-12
            if one["kind"] != "locked":
                assert trial["pressed_major_off_percent"] < 0.005
        # 36 closures and a fixture together stay as closed as those of Table I.
        assert one["closure_residual_max_m"] < 5e-9


def test_torques_of_the_sound_hexapod_are_those_of_the_printed_theorems(by_kind, force, lines):
    """Eqs. (34) and (36) with the closed-form Jacobian, and Theorem 9."""
    J = np.linalg.inv(lines)
    J_m, J_s = J[MAJOR], J[SECONDARY]
    by_theorem = {trial.answer.goal.theorem: trial.answer for trial in by_kind[None].trials}
    W3, W4 = np.diag(SPARING), np.diag(LEVERED)
    major, goals = theorem_7(J_m, J_s, W3, W4)
    printed = {
        7: force.aims.major @ major.T + force.aims.secondary @ goals[:, 6:].T,
        8: force.aims.major @ theorem_8(J_m, J_s, W3)[0].T,
        9: force.aims.wrench @ J,
    }
    for theorem, torques in printed.items():
        np.testing.assert_allclose(by_theorem[theorem].torques, torques, atol=1e-9)


def test_what_is_exact_is_not_cheaper_and_what_is_cheaper_is_not_exact(force):
    """Simulated: the stark contrast to a conventional weighted pseudo-inverse."""
    trade = force.tradeoff
    least = trade.mapping.weighed[0]
    assert trade.mapping.major_off[0] < 1e-4
    assert (trade.others.major_off < 1e-4).all()
    assert (trade.others.weighed > least).all()
    assert (trade.pseudo_inverse.weighed < least).all()
    assert (trade.pseudo_inverse.major_off > 1e-3).all()
    assert (np.diff(trade.pseudo_inverse.major_off) < 0).all()


def test_a_locked_strut_bears_what_comes_along_it_and_no_torque_sees(by_kind, lines):
    """Held, its reaction is J_1^T f; pressing, lock and fixture share that.

    Only their sum is determined: the wrench of the five coils.
    """
    for trial in by_kind["locked"].trials:
        said, reaction = trial.answer, trial.held.lock_n[:, -1, 0]
        np.testing.assert_allclose(said.strut[:, 0], said.wrench @ np.linalg.inv(lines)[:, 0])
        np.testing.assert_allclose(reaction, said.strut[:, 0], atol=1e-3)
        assert np.abs(reaction).max() > 5.0
        assert (said.torques[:, 0] == 0).all()
        unseen = np.eye(6) - said.seen
        np.testing.assert_allclose(lines[0] @ unseen, lines[0], atol=1e-12)
        assert np.trace(unseen) == pytest.approx(1.0)
        fixture, lock = trial.pressed.fixture[:, -1], trial.pressed.lock_n[:, -1, 0]
        np.testing.assert_allclose(
            fixture - lock[:, None] * lines[0], said.torques @ lines, atol=5e-3
        )
        assert np.abs(lock - said.strut[:, 0]).max() > 3.0


def test_a_free_strut_is_asked_for_nothing_and_the_rest_of_a_wrench_moves_the_payload(
    by_kind, lines
):
    """Eq. (9). Springs of the orthogonal hexapod do not couple: a secondary lack moves it aside.

    A mapping that lets the spring bear it lacks less, and tilts.
    """
    one = by_kind["free"]
    for trial in one.trials:
        np.testing.assert_allclose(trial.answer.wrench @ np.linalg.inv(lines)[:, 0], 0, atol=1e-12)
        np.testing.assert_allclose(trial.held.strut_n[:, -1, 0], 0, atol=1e-3)
    rigid, elastic = one.prescribed
    np.testing.assert_allclose(rigid.lacking[:, MAJOR], 0, atol=1e-12)
    assert (np.linalg.norm(rigid.simulated[:, 3:], axis=1) > 20e-6).all()
    assert (np.abs(rigid.simulated[:, MAJOR]) < 0.5e-6).all()
    assert (np.linalg.norm(elastic.simulated[:, MAJOR], axis=1) > 50e-6).all()
    for held in (rigid, elastic):
        np.testing.assert_allclose(held.simulated, held.predicted, atol=0.5e-6)


def test_sound_or_locked_the_hexapod_holds_all_of_a_prescribed_wrench_and_stands_still(by_kind):
    for kind in (None, "locked"):
        (held,) = by_kind[kind].prescribed
        np.testing.assert_allclose(held.lacking, 0, atol=1e-12)
        assert np.abs(held.simulated).max() < 1e-8
        assert np.abs(held.unheld).max() > 1e-5


def test_without_eq_9_a_free_strut_presses_with_another_major_force(rig, force):
    """Theorem 8 as printed, for a mechanism that has the self-motion which section 3 excludes."""
    condition = Condition("free", 0)
    kin = known_system(condition).kinematics()
    printed = force_mapping(kin.J, MAJOR, SECONDARY, np.array(SPARING)[kin.actuators])
    torques = kin.expand(printed(force.aims.major))
    off = press(rig, condition.failures, torques).fixture[:, -1, MAJOR] - force.aims.major
    off_percent = 100 * np.linalg.norm(off, axis=1) / np.linalg.norm(force.aims.major, axis=1)
    assert [round(off_percent.min()), round(off_percent.max())] == [39, 96]
    assert "39 to 96 %" in PAGE.replace("\n  ", " ")


def test_the_platform_spends_its_internal_force_and_presses_with_the_same_wrench(force, summary):
    """Against every other internal force, and against none."""
    C = platform().kinematics().active_constraint[0]
    for use in force.internal:
        for eta in np.linspace(-60, 60, 25):
            other = use.used.torques + eta * C - use.desired
            best = use.used.torques - use.desired
            cost = [np.linalg.norm(tau * use.torque_weight, axis=1) for tau in (best, other)]
            assert (cost[0] <= cost[1] + 1e-9).all()
        fixture = [how.pressed.fixture[:, -1] for how in (use.without, use.used)]
        np.testing.assert_allclose(*fixture, atol=1e-3)
    for use in summary["internal_force"]:
        without, used = use["without"], use["used"]
        assert without["internal_rms_n"] < 1e-9
        assert used["internal_simulated_rms_n"] == pytest.approx(used["internal_rms_n"], rel=1e-4)
        assert max(used["wrench_off_percent"], used["legs_off_percent"]) < 0.01
        assert used["weighed_rms_n"] < 0.9 * without["weighed_rms_n"]
        if use["motor"]:
            assert used["hot_motor_rms_n"] < 0.5 * without["hot_motor_rms_n"]
        else:
            assert without["least_squeeze_n"] < 0 < used["least_squeeze_n"]


def failed(summary) -> list[str]:
    return [str(check) for check in checks(summary) if not check.passed]


def summary_of(force, one):
    return summarize(dataclasses.replace(force, examinations=[one]))


@pytest.mark.parametrize(
    ("happens", "believed"),
    [
        (Condition("locked"), Condition()),
        (Condition(), Condition("locked")),
        (Condition("free"), Condition()),
        (Condition("free"), Condition("locked")),
        (Condition("locked"), Condition("free")),
        (Condition("loose"), Condition("locked")),
        (Condition("locked", 1), Condition("locked")),
    ],
    ids=lambda condition: str(condition).replace(" ", "_"),
)
def test_a_mapping_that_knows_of_another_failure_fails_a_check(
    monkeypatch, force, happens, believed
):
    monkeypatch.setattr(runs, "known_system", lambda _: known_system(believed))
    one = examine(happens, draw_aims(np.random.default_rng(0), 1))
    assert failed(summary_of(force, one))


def test_a_coil_that_is_not_asked_is_as_good_as_one_that_is_gone(monkeypatch, force):
    """A mapping that takes a sound strut as free leaves its coil alone, and is exact."""
    monkeypatch.setattr(runs, "known_system", lambda _: known_system(Condition("free")))
    one = examine(Condition(), draw_aims(np.random.default_rng(0), 1))
    assert not failed(summary_of(force, one))


def skewed(change) -> ConstrainedSystem:
    system = known_system(Condition())
    return ConstrainedSystem(change(system.J_T), system.J_C, system.active)


@pytest.mark.parametrize(
    "change",
    [
        lambda J_T: 1.02 * J_T,
        lambda J_T: np.vstack([-J_T[:1], J_T[1:]]),
        # The task point 10 mm off: v' = v + omega x (0, 0, 0.01).
        lambda J_T: J_T + 0.01 * np.vstack([np.zeros_like(J_T[:3]), J_T[1], -J_T[0], 0 * J_T[0]]),
    ],
    ids=["scaled", "flipped", "another_point"],
)
def test_a_wrong_jacobian_fails_a_check(monkeypatch, force, change):
    monkeypatch.setattr(runs, "known_system", lambda _: skewed(change))
    one = examine(Condition(), draw_aims(np.random.default_rng(0), 1))
    assert failed(summary_of(force, one))


@pytest.mark.parametrize(
    ("group", "part", "key", "value"),
    [
        ("conditions", None, "closure_residual_max_m", 1e-7),
        ("conditions", "theorems", "exact", False),
        ("conditions", "theorems", "cost_excess", 1e-3),
        ("conditions", "theorems", "pressed_off_percent", 2.0),
        ("conditions", "theorems", "pressed_major_off_percent", 2.0),
        ("conditions", "theorems", "held_off_percent", 2.0),
        ("conditions", "theorems", "moved_percent", float("nan")),
        ("conditions", "prescribed", "off_percent", 2.0),
        ("tradeoff", "mapping", "major_off_percent", 2.0),
        ("tradeoff", "others", "cheapest_over_mapping", 0.9),
        ("tradeoff", "others", "major_off_percent", 2.0),
        ("internal_force", None, "saved_at_least_n", -0.1),
        ("internal_force", "used", "wrench_off_percent", 2.0),
        ("internal_force", "without", "legs_off_percent", 2.0),
    ],
)
def test_every_number_that_must_be_small_has_its_check(summary, group, part, key, value):
    assert not failed(summary)
    spoilt = copy.deepcopy(summary)
    entry = spoilt[group] if isinstance(spoilt[group], dict) else spoilt[group][0]
    inner = entry if part is None else entry[part]
    (inner if isinstance(inner, dict) else inner[0])[key] = value
    assert len(failed(spoilt)) == 1


def test_an_unsound_run_ends_with_a_sentence_and_one(monkeypatch, capsys, tmp_path, force):
    monkeypatch.setattr(runs, "run_force", lambda **options: force)
    monkeypatch.setattr(tables_module, "LIMIT_PERCENT", 1e-9)
    assert main(["force", "--quick", "--out", str(tmp_path)]) == 1
    error = capsys.readouterr().err.strip()
    assert error.startswith(
        "fjh: a check failed: sound, theorem 7: difference between the wrench on the fixture"
    )
    assert "\n" not in error
    assert (tmp_path / "force.json").is_file()


def test_the_figure_says_what_its_bars_and_points_show(force, summary):
    left, right = figure_force(force.tradeoff, summary).axes
    without, used = ([bar.get_height() for bar in bars] for bars in right.containers)
    share = min(1 - b / a for a, b in zip(without, used, strict=True))
    assert f"takes {100 * share:.0f} % off a hot motor" in right.get_title()
    others, _, mapping = left.lines
    least, off_percent = np.asarray(mapping.get_xydata())[0]
    dearest = np.asarray(others.get_xdata()).max() / least
    assert f"up to {100 * (dearest - 1):.0f} % more" in str(others.get_label())
    assert f"to {off_percent:.1g} %" in left.get_title()


def test_the_data_are_what_was_computed(force_folder, summary, force):
    assert set(summary["model_sha256"]) == {"fjh", "platform"}
    with np.load(force_folder / summary["data"]) as data:
        np.testing.assert_array_equal(data["asked_wrench"], force.aims.wrench)
        for part in ("torques_n", "pressed_fixture", "held_strut_n", "held_lock_n"):
            assert np.isfinite(data[f"strut_1_locked_theorem_9_{part}"]).all()
        assert data["strut_1_free_prescribed_elastic_displacement"].shape[-1] == 6


def test_the_same_seed_asks_for_the_same_and_another_for_something_else():
    first, again, other = (draw_aims(np.random.default_rng(seed), 2).wrench for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1.0


PAGE = (Path(__file__).parents[2] / "docs" / "force.md").read_text()


def printed_row(label: str) -> list[str]:
    """Cells of the page's table row that starts with a label."""
    row = re.search(rf"^\| {re.escape(label)} \|(.*)\|$", PAGE, re.MULTILINE)
    assert row, label
    return [cell.strip() for cell in row.group(1).split("|")]


def numbers(cells) -> list[float]:
    return [float(number) for cell in cells for number in re.findall(r"-?\d+\.?\d*", cell)]


def test_the_pages_largest_distances_are_not_exceeded(summary):
    """The page speaks of all six struts; strut 1 must be within, and not far below."""
    for one in summary["conditions"]:
        worst = [
            max(trial[key] for trial in one["theorems"])
            for key in (
                "pressed_major_off_percent",
                "pressed_off_percent",
                "held_off_percent",
                "moved_percent",
            )
        ]
        cells = re.findall(rf"^\| {one['kind'] or 'sound'} \|(.*)\|$", PAGE, re.MULTILINE)[0]
        for cell, found in zip(cells.split("|"), worst, strict=True):
            if "not" not in cell:
                assert 0.3 * float(cell) < found < 1.1 * float(cell)


def test_the_pages_other_tables_are_those_that_come_out(summary):
    _, prescribed, tradeoff, internal = tables(summary)
    for table in (prescribed, internal):
        for label, *cells in table.rows:
            found = re.findall(rf"^\| {label} \|(.*)\|$", PAGE, re.MULTILINE)[-1].split("|")
            width = len(numbers(found))
            np.testing.assert_allclose(numbers(found), numbers(cells)[:width], atol=0.06)
    for label, *cells in tradeoff.rows:
        if label.startswith("pseudo") and f"| {label} |" in PAGE:
            np.testing.assert_allclose(numbers(printed_row(label)), numbers(cells), rtol=0.02)
    others = summary["tradeoff"]["others"]
    low, high, off = numbers(printed_row(f"{others['count']} others of the same major force"))
    found = (others["cheapest_over_mapping"], others["dearest_over_mapping"])
    np.testing.assert_allclose((low, high), found, rtol=5e-3)
    assert off == pytest.approx(others["major_off_percent"], rel=0.1)


def test_the_pages_sentences_are_true(summary, by_kind, lines):
    K = payload_stiffness(load_model())
    np.testing.assert_allclose(K, np.diag(np.diag(K)), atol=1e-9 * K.max())
    assert "$K$ = 252 kN/m in translation" in PAGE.replace("\n", " ")
    np.testing.assert_allclose(np.diag(K)[[0, 1, 3, 4, 5]] / 1e3, [10.4] * 2 + [252] * 3, rtol=4e-3)
    elastic = by_kind["free"].prescribed[1]
    assert np.linalg.norm(elastic.lacking[0, MAJOR]) == pytest.approx(1.9, abs=0.05)
    locked = next(one for one in summary["conditions"] if one["kind"] == "locked")
    for trial in locked["theorems"]:
        assert 16 < trial["pressed_major_off_percent"] < 96
    flexures = strut_and_payload_stiffness(load_model())[6:, 6:]
    column = np.linalg.inv(lines)[:, 0]
    stop_n = column @ flexures @ column * 0.635e-3
    assert_says(PAGE, f"gives way to its stop at {stop_n:.2f} N")
    (mapping,) = (row for row in tables(summary)[2].rows if row[0] == "the mapping")
    assert float(mapping[2]) == pytest.approx(0.0008, rel=0.1)
