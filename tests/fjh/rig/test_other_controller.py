"""Controllers of other packages on the testbed: the page, its columns, its failures."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import control
import numpy as np
import pandas as pd
import pytest

from experiments.app.cli import main
from experiments.recover import hexapod_basis, plan
from experiments.table1 import CONFIGURATIONS
from experiments.table1 import checks as table1_checks
from fjh.rig.hexapod.columns import COLUMNS
from fjh.rig.hexapod.rig import pursuing
from fjh.rig.hexapod.testbed import TestbedConfig
from fjh.rig.other_controller import controller_factory, simulate_with
from fjh.study.errors import WrongInput
from ftc import Goal, Measurement, run_loop
from tests.fjh.rigs import shared_rig
from tests.pages import blocks
from tests.rrd import scalars

LEAST: list[plan.Block] = [
    *(("failure", mismatch, 1.0, 1) for mismatch in ("exact", "all")),
    ("pair", "all", 1.0, 1),
]
"""Smallest set of cases of `fjh paper recover`."""

PAGE = Path(__file__).parents[3] / "docs" / "control-without-simulator.md"
LQG = Path(__file__).with_name("lqg.py")
BROKEN = """
from page_examples import PseudoInverse

class Broken(PseudoInverse):  # where a failure is known, at 0.05 s
    def __init__(self, task):
        super().__init__(task)
        self.fails = bool(task.goal.locked_at)

    def step(self, state, reference, measurement):
        self.ticks = getattr(self, "ticks", -1) + 1
        if self.fails and self.ticks == 50:
            raise RuntimeError("no strut left")
        return super().step(state, reference, measurement)
"""
SHORT_S = 0.6


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory) -> Iterator[Path]:
    """Change to a working directory with the page's examples and one that fails."""
    place = tmp_path_factory.mktemp("own")
    examples = dict(blocks(PAGE.read_text()))["python"], LQG.read_text()
    (place / "page_examples.py").write_text("\n\n".join(examples))
    (place / "page_broken.py").write_text(BROKEN)
    (place / "page_unimportable.py").write_text("1 / 0")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", list(sys.path))
        patch.chdir(place)
        yield place
    for name in [name for name in sys.modules if name.startswith("page_")]:
        del sys.modules[name]


@pytest.mark.parametrize(
    ("name", "pattern"),
    [
        ("../own:LQG", "must be package.module:factory"),
        ("page_unimportable:LQG", "importing page_unimportable raised ZeroDivisionError"),
        ("page_examples:np.pi", "has no function or class np.pi"),
    ],
)
def test_a_wrong_factory_name_is_rejected_with_the_reason(name, pattern):
    with pytest.raises(WrongInput, match=pattern):
        controller_factory(name)


def test_a_users_module_does_not_hide_an_installed_one(tmp_path, monkeypatch):
    """`control` is python-control, even with a file of that name in the folder."""
    (tmp_path / "control.py").write_text("def lqg(task): ...")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(WrongInput, match=r"site-packages.* has no function or class lqg"):
        controller_factory("control:lqg")


def test_the_task_describes_the_machine_without_failures():
    """DC gain of the linear model against the Jacobian: flexures take 0.3 % of the motion."""
    known = Goal(secondary_weight=(1.0,) * 4, locked_at={0: 0.0})
    task = pursuing(shared_rig("hexapod"), known).task
    gain = -task.nominal.plant.C @ np.linalg.solve(task.nominal.plant.A, task.nominal.plant.B)
    np.testing.assert_allclose(gain, task.major_jacobian, atol=4e-3 * np.abs(gain).max())
    assert task.goal == known and np.array_equal(task.limits[0], -task.limits[1])


@pytest.mark.parametrize("name", ["LQG", "PseudoInverse"])
@pytest.mark.parametrize("locked", [(), (0,)])
def test_the_examples_reach_a_constant_reference_without_error(name, locked):
    """Integral action on the linear plant: zero on average, since the converters quantize."""
    goal = Goal(locked_at=dict.fromkeys(locked, 0.0))
    task = pursuing(shared_rig("hexapod"), goal).task
    plant = control.c2d(task.nominal.plant, task.period_s, "zoh")

    class Machine:
        x = np.zeros(plant.nstates)

        def measure(self):
            return Measurement(plant.C @ self.x, task.nominal.displacement @ self.x)

        def apply(self, inputs):
            self.x = plant.A @ self.x + plant.B @ task.drives.displacements(inputs)

    desired = np.tile([5e-5, -2e-5], (1500, 1))
    run = run_loop(Machine(), controller_factory(f"page_examples:{name}")(task), desired)
    assert np.abs((run.measured - desired)[-500:].mean(axis=0)).max() < 1e-3 * 5e-5
    assert not run.inputs[:, list(locked)].any()


def test_another_controller_gets_the_same_noise():
    """Measured minus true angle at each tick is equal up to the angles' round-off."""
    path = TestbedConfig().spiral_rad(SHORT_S)
    rig = shared_rig("hexapod")
    reference = rig.fly(rig.controller(), path, seed=3)
    other_run, failure = simulate_with(rig, "page_examples:PseudoInverse", path, seed=3)
    assert failure is None
    own, other = reference.measured - reference.true, other_run.measured - other_run.true
    assert own.std() > 2e-7
    np.testing.assert_allclose(other, own, atol=1e-12)


@pytest.mark.long
@pytest.mark.night
def test_table1_includes_another_controller_and_fails_if_its_run_fails(folder, tmp_path):
    """Table I runs for 0.6 s with a controller that fails in one of its columns."""
    out = tmp_path / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(CONFIGURATIONS, "calibrated", TestbedConfig(quick_duration_s=SHORT_S))
        arguments = ["table1", "--quick", "--out", str(out), "--controller", "page_broken:Broken"]
        assert main(arguments) == 1
    summary = json.loads((out / "table1.json").read_text())
    assert {path.name for path in out.iterdir()} == set(summary["files"])
    other_columns, page = summary["columns"][-3:], (out / "table1.md").read_text()
    assert [each["name"] for each in summary["columns"][:-3]] == [each.name for each in COLUMNS]
    assert [each["name"][:10] for each in other_columns] == [
        "Broken_W_a",
        "Broken_W_d",
        "Broken_W_a",
    ]
    sentence = "page_broken:Broken raised RuntimeError: no strut left (page_broken.py, line 12), at"
    assert [str(each["failure"]).startswith(sentence) for each in other_columns] == [
        False,
        True,
        False,
    ]
    for column in other_columns:
        with np.load(out / column["data"]) as data:
            off_urad = 1e6 * (data["desired_rad"] - data["true_rad"])
        stated = column["alpha_rms_urad"], column["beta_rms_urad"]
        np.testing.assert_allclose(stated, np.sqrt((off_urad**2).mean(axis=0)), rtol=1e-12)
        assert f"{stated[0]:.4f}" in page
        assert len(scalars(out / column["recording"], "/task/true")[0]) > 0
    with np.load(out / "Broken_W_d.npz") as data:  # as sent last
        inputs = data["strut_input_percent"]
    assert np.ptp(inputs[:50], axis=0).max() > 0 and not np.ptp(inputs[49:], axis=0).any()
    columns, further = (pd.DataFrame(summary[name]) for name in ("columns", "further_runs"))
    [failed] = [str(each) for each in table1_checks(columns, further, SHORT_S) if not each.passed]
    assert sentence in failed and sentence in page


@pytest.mark.long
@pytest.mark.night
def test_recover_includes_another_controller(folder, tmp_path, monkeypatch):
    """The smallest study writes JSON, dataset and recording."""
    monkeypatch.setattr(plan, "QUICK", LEAST)
    arguments = ["--quick", "--quiet", "--out", str(tmp_path)]
    main(["recover", *arguments, "--controller", "page_examples:LQG"])
    summary = json.loads((tmp_path / "recover.json").read_text())
    [entry] = summary["controller"]
    assert entry["name"] == "page_examples:LQG" and entry["failed"] == 0
    assert {"LQG_locked.npz", "LQG_locked.rrd"} <= set(summary["files"])
    rows = pd.read_parquet(tmp_path / "recover.parquet")
    [row] = rows.query("sort == 'failure' and mismatch == 'all'").itertuples()
    ratio = row.rms_other_after / row.rms_informed_after
    assert entry["after_over_informed"] == pytest.approx(ratio)


def test_a_controller_with_a_changed_module_is_a_different_one(folder):
    """Runs of both must not be mixed by --resume."""

    def basis() -> dict[str, Any]:
        return hexapod_basis(0, True, False, "page_examples:LQG")

    before, page = basis(), folder / "page_examples.py"
    text = page.read_text()
    page.write_text(text + "\n# edited\n")
    after = basis()
    page.write_text(text)
    assert [name for name in after if after[name] != before[name]] == ["controller_sha256"]
    assert basis() == before
