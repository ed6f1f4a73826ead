"""Designs and benches that nobody could build are refused before any run, in one sentence."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from experiments.app.cli import main
from experiments.sweep_design import CHOICES, VARIED, read_design
from experiments.sweep_design import LIMITS as NUMBERS
from fjh.rig.hexapod.testbed import LIMITS, TestbedConfig
from fjh.study.errors import WrongInput


@pytest.mark.parametrize("name", LIMITS)
def test_a_bench_has_no_constant_beyond_its_limits(name):
    low, high = LIMITS[name]
    for value in (low, high):
        constant: Any = {name: value}
        assert getattr(TestbedConfig(**constant), name) == value
    beyond = [low - 1, np.nextafter(low, -np.inf), np.nextafter(high, np.inf), 10**400]
    others = [np.nan, np.inf, -np.inf, True, "1", [1.0], 1j]
    if name != "demand_limit_urad":  # where None is no limit
        others.append(None)
    for value in [*beyond, *others]:
        with pytest.raises(ValueError, match=rf"{name} must be a .*number from .* to .*, got"):
            replace(TestbedConfig(), **{name: value})


def test_every_constant_has_its_limits_and_converters_have_whole_bits():
    choices = {"spiral_direction", "anti_windup"}
    assert set(LIMITS) | choices == {field.name for field in fields(TestbedConfig)}
    assert set(VARIED) == {"struts", *CHOICES, *NUMBERS}
    bits: Any = {"dac_bits": 16.5}
    with pytest.raises(ValueError, match="must be a whole number from 2 to 32"):
        replace(TestbedConfig(), **bits)


HUGE = "1" + 400 * "0"
DAC = "dac_bits must be a whole number from 2 to 32, got"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("layout = ", "Invalid value"),
        ("layout = 'random'", "layout must be latin-hypercube or grid, got 'random'"),
        ("layout = 'grid'\nrun = 3", "no 'run'; there are layout, runs"),
        ("layout = 'grid'", r"\[vary\] must name at least one"),
        ("layout = 'grid'\nruns = 3\nvary.seed = [1]", "runs must not be given for a grid"),
        ("layout = 'latin-hypercube'\nvary.seed = [1]", "runs must be a whole number"),
        ("layout = 'latin-hypercube'\nruns = 2\nvary.seed = {from=1, to=2, points=2}", "points"),
        ("layout = 'latin-hypercube'\nruns = 300_000\nvary.seed = [1]", "at most 200000 runs"),
        (f"layout = 'latin-hypercube'\nruns = {HUGE}\nvary.seed = [1]", "at most 200000 runs"),
        ("duration_s = 99\nvary.seed = [1]", "duration_s .* from 0.001 to 16, got 99"),
        (f"duration_s = {HUGE}\nvary.seed = [1]", "duration_s must be a number from 0.001 to 16"),
        (
            "duration_s = 0.02\nvary.control_period_s = [1e-3, 0.05]",
            "duration_s .* from 0.05 to 16",
        ),
        ("vary.colour = ['red']", "no 'colour' to vary; there are struts, known"),
        ("vary.struts = ['SSSXSS']", "struts must be six letters out of SLFB, got 'SSSXSS'"),
        ("vary.struts = {from = 1, to = 2, points = 2}", "struts must be a list of values"),
        ("vary.weight = ['W_z']", 'weight must be one of "W_a", .*, got .W_z.'),
        ("vary.known = [1]", "known must be one of true, false, got 1"),
        ("vary.spiral_direction = [1, true]", "spiral_direction must be one of 1, -1, got True"),
        ("vary.seed = [-1]", "seed must be a whole number from 0 to .*, got -1"),
        (f"vary.seed = [{HUGE}]", "seed must be a whole number from 0 to"),
        ("vary.seed = 1979-05-27", "seed must be a whole number from 0 to"),
        ("vary.roll_off_hz = 0", "roll_off_hz .* from 0.01 to 10000, got 0"),
        ("vary.roll_off_hz = []", "roll_off_hz must have at least one"),
        ("vary.roll_off_hz = {from = 1, to = 2}", "points of roll_off_hz must be a number from 2"),
        ("vary.roll_off_hz = {from = 2, to = 1, points = 2}", "from below to, got 2.0 to 1.0"),
        ("vary.roll_off_hz = {from = 1, too = 2}", "no 'too' in roll_off_hz"),
        ("vary.roll_off_hz = {from = 1, to = 1e9, points = 2}", "roll_off_hz must .* got 1"),
        (
            "vary.roll_off_hz = {from = 1, to = 2, points = 1_000_000_000_000}",
            "at most 200000 runs",
        ),
        ("vary.dac_bits = {from = 2, to = 9, log = true, points = 2}", "dac_bits can have log"),
        ("vary.dac_bits = [16, 0]", f"{DAC} 0"),
        ("vary.dac_bits = 16.0", f"{DAC} 16.0"),
        (f"vary.dac_bits = 0x{'f' * 6000}", f"{DAC} a huge int"),
        (f"vary.dac_bits = {'9' * 6000}", "4300"),
        (f"vary.settling_s = {HUGE}", "settling_s must be a number from 0.001 to 3600, got 10"),
        ("vary.joint_weight_1 = 1e300", "joint_weight_1 must be a number from 0 to 1e"),
        ("vary.focal_length_m = nan", "focal_length_m must be a number .* got nan"),
        (f"vary.seed = {'[' * 100_000}", "recursion"),
    ],
)
def test_a_design_that_cannot_be_run_is_one_sentence(capsys, tmp_path, text, said):
    file, out = tmp_path / "design.toml", tmp_path / "out"
    file.write_text(text if text.startswith("layout") else f"layout = 'grid'\n{text}")
    with pytest.raises(WrongInput, match=said):
        read_design(file)
    assert main(["sweep", "--design", str(file), "--out", str(out)]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith(f"fjh: --design {file}: ") and printed.err.count("\n") == 1
    assert printed.out == "" and not out.exists()


def test_a_design_that_is_none_is_one_sentence(tmp_path):
    with pytest.raises(WrongInput, match="cannot be read: No such file"):
        read_design(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(WrongInput, match="can't decode"):
        read_design(tmp_path / "binary.toml")
