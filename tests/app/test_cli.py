"""The command: bad input in one sentence, sound exit codes, nothing half-written."""

import json

import numpy as np
import pytest
import typer
from rerun.chunk import RrdReader

from experiments.app.cli import app_of, main
from fjh.study.errors import OutputError
from fjh.study.files import published
from sim import HEXAPOD_MJCF


def sentence(capsys) -> str:
    """What went to standard error, which must be one line without a traceback."""
    error = capsys.readouterr().err.strip()
    assert error.startswith("fjh: ")
    assert "\n" not in error
    assert "Traceback" not in error
    return error


@pytest.fixture
def mjcf(tmp_path):
    """Write an altered copy of the hexapod's file."""

    def write(*replacements: tuple[str, str]):
        text = HEXAPOD_MJCF.read_text()
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "machine.xml"
        path.write_text(text)
        return str(path)

    return write


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["table7"], "table7"),
        (["table1", "--seed", "-1"], "--seed"),
        (["table1", "--seed", "4294967296"], "--seed"),
        (["table1", "--jacobian", "guessed"], "--jacobian"),
        (["table1", "--fast"], "--fast"),
        (["table1", "--model", "nowhere.xml"], "nowhere.xml"),
    ],
)
def test_wrong_input_is_one_sentence_that_names_it(capsys, tmp_path, arguments, named):
    out = tmp_path / "out"
    if arguments[0] == "table1":
        arguments = [*arguments, "--out", str(out)]
    assert main(arguments) == 2
    assert named in sentence(capsys)
    assert not out.exists()


def test_an_output_path_that_is_a_file_is_refused(capsys, tmp_path):
    file = tmp_path / "taken"
    file.write_text("mine")
    assert main(["table1", "--out", str(file)]) == 2
    assert str(file) in sentence(capsys)
    assert file.read_text() == "mine"
    assert main(["table1", "--out", str(file / "below")]) == 2
    assert str(file / "below") in sentence(capsys)
    dangling = tmp_path / "dangling"
    dangling.symlink_to(tmp_path / "nowhere")
    assert main(["table1", "--out", str(dangling)]) == 2
    assert str(dangling) in sentence(capsys)
    assert main(["table1", "--out", str(tmp_path / ("x" * 300))]) == 2
    assert "too long" in sentence(capsys)


@pytest.mark.parametrize("command", [*typer.main.get_group(app_of()).commands])
def test_an_empty_path_is_not_the_current_folder(capsys, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    for words in (["--out", ""], ["--out="]):
        assert main([command, *words]) == 2
        assert sentence(capsys) == "fjh: --out is empty, expected a value"
    assert main([command, ""]) == 2
    assert sentence(capsys) == f"fjh: an argument after {command} is empty, expected a value"
    assert list(tmp_path.iterdir()) == []


def test_a_broken_machine_file_is_refused(capsys, tmp_path, mjcf):
    path = mjcf(("</mujoco>", ""))
    assert main(["table1", "--model", path, "--out", str(tmp_path / "out")]) == 2
    assert path in sentence(capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('<site name="base"', '<site name="foot"', 'site named "base"'),
        ('<site name="payload"', '<site name="top"', 'site named "payload"'),
        ('name="coil2"', 'name="motor2"', 'actuator named "coil2"'),
        ('"tip6"', '"end6"', 'body named "tip6"'),
        ('"strut5"', '"leg5"', 'joint named "strut5"'),
        ('"top_twist1"', '"spin1"', 'joint named "top_twist1"'),
        ('"stem1"', '"rod1"', 'body named "stem1"'),
        # Nothing is missing, but it cannot point.
        ("<weld ", "<weld active='false' ", "six degrees of freedom"),
        ('gainprm="126000"', 'gainprm="0"', "has gain 0"),
        ('damping="110"', 'damping="110000"', "alpha loop is unstable"),
        (
            "</actuator>",
            '<motor name="coil7" joint="top_twist1"/></actuator>',
            "six actuators, the model has 7",
        ),
        ('joint1="strut2"', 'joint1="strut3"', '"lock2"'),
        pytest.param(  # which the processes see that compute in parallel
            *('timestep="1.25e-4"', 'timestep="3e-4"', "0.0003 s does not divide"),
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_machine_that_will_not_do_is_refused(capsys, tmp_path, mjcf, old, new, named):
    path = mjcf((old, new))
    assert main(["table1", "--model", path, "--out", str(tmp_path / "out")]) == 2
    assert named in sentence(capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_a_diverging_machine_stops_with_its_time_and_state(capsys, tmp_path, mjcf):
    out = tmp_path / "out"
    path = mjcf(('timestep="1.25e-4"', 'timestep="1e-3"'), ('damping="110"', 'damping="2000"'))
    assert main(["table1", "--quick", "--model", path, "--out", str(out)]) == 1
    message = sentence(capsys)
    with np.load(out / "diverged.npz") as saved:
        assert f"{float(saved['time_s']):.4f} s" in message
        assert saved["state"].size > 50
        assert np.isfinite(saved["state"]).all()
    assert [file.name for file in out.iterdir()] == ["diverged.npz"]


def test_files_that_cannot_all_be_written_leave_the_old_ones_whole(tmp_path):
    (tmp_path / "index.json").write_text("old")
    (tmp_path / "b.npz").mkdir()
    with (
        pytest.raises(OutputError, match=r"b\.npz is a folder"),
        published(tmp_path, index="index.json") as staging,
    ):
        for name in ("a.npz", "b.npz", "index.json"):
            (staging / name).write_text("new")
    assert {file.name for file in tmp_path.iterdir()} == {"index.json", "b.npz"}
    assert (tmp_path / "index.json").read_text() == "old"


@pytest.mark.long
def test_quick_writes_everything_at_full_rate_and_prints_one_table(capsys, tmp_path):
    words = ["table1", "--quick", "--configuration", "demand-limit", "--seed", "5"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    summary = json.loads((tmp_path / "table1.json").read_text())
    assert summary["seed"] == 5
    assert summary["configuration"] == "demand-limit"
    assert summary["bench"]["demand_limit_urad"] == 95.0
    assert summary["columns"][-1]["origin"] == "fitted"
    names = {f"{c['name']}.{kind}" for c in summary["columns"] for kind in ("npz", "rrd")}
    figures = {f"figure{k}.{kind}" for k in (4, 5, 6) for kind in ("png", "pdf")}
    figures |= {"result.png", "result.pdf"}
    figures |= {f"table1_{name}.parquet" for name in ("columns", "further_runs", "loops")}
    expected = names | figures | {"table1.json", "table1.md"}
    assert {file.name for file in tmp_path.iterdir()} == expected
    for column in summary["columns"]:
        with np.load(tmp_path / column["data"]) as data:
            assert np.diff(data["time_s"]).max() <= 1 / 250
        assert f"{column['alpha_rms_urad']:.4f}" in printed
        assert f"{column['alpha_rms_urad']:.4f}" in (tmp_path / "table1.md").read_text()
        assert column["alpha_rms_urad"] == pytest.approx(
            column["predicted_alpha_rms_urad"], rel=0.05
        )

    # The paper's numbers are of 16 s, and have no place beside these: on screen or in a recording.
    for shown in (printed, (tmp_path / "table1.md").read_text()):
        assert "detector" in shown
        assert "9.8167" not in shown
        assert "13.9 %" not in shown
    reader = RrdReader(tmp_path / "W_a.rrd")
    assert reader.recordings()[0].application_id.startswith("fjh-table1-demand-limit-W_a-seed5-")
    notes = reader.stream().filter(content="/notes").to_chunks()
    said = str([chunk.to_record_batch().to_pydict() for chunk in notes])
    assert "linear model" in said
    assert "2.4476" not in said
