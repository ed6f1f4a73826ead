"""Tests of the command line: wrong arguments, help, completion, and files written."""

import os
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

from experiments.app.cli import app_of, main
from experiments.studies import LINES, PAPER, ROBOT, command_of, study
from fjh.study.option import command_arguments
from sim import HEXAPOD_MJCF, MODELS
from tests.synthetic import write_synthetic_run

ROOT = Path(__file__).parents[2]
LISTED = [*ROBOT, "live", "review", "render", "animate", "results", "paper"]
DIGITS = "9" * 5000
ARM = MODELS / "arm.xml"


@cache
def commands() -> dict[str, Any]:
    """Return all commands, by name."""
    group = typer.main.get_group(app_of(*LINES))
    return vars(group.commands["paper"])["commands"] | group.commands


@pytest.fixture(scope="module")
def filled_folder(tmp_path_factory) -> Path:
    """Folder with a run, an existing file, a dangling link and an empty folder."""
    folder = tmp_path_factory.mktemp("kept")
    write_synthetic_run(folder)
    (folder / "taken").write_text("mine")
    (folder / "dangling").symlink_to("nowhere")
    (folder / "empty").mkdir()
    return folder


@pytest.fixture
def place(filled_folder, monkeypatch):
    """Filled folder as working folder, checked to remain unchanged."""
    monkeypatch.chdir(filled_folder)
    before = {path: path.lstat().st_mtime_ns for path in filled_folder.rglob("*")}
    yield filled_folder
    assert {path: path.lstat().st_mtime_ns for path in filled_folder.rglob("*")} == before


# Arguments, and expected text of the message: the argument, or the intended name.
WRONG = [
    ("tabel1", "table1"),
    ("goals much", "much"),
    ("table1 --seed 4294967296", "--seed"),
    ("table1 --sed 3", "--seed"),
    ("table1 --jacobian analitic", "analytic"),
    # Places of results.
    ("table1 --out taken", "taken"),
    ("table1 --out taken/below", "taken/below"),
    ("table1 --out dangling", "dangling"),
    (f"table1 --out {'x' * 300}", "too long"),
    ("live --out taken/below", "below"),
    ("review made.npz --out review.txt", ".rrd"),
    ("render made.rrd --out a.jpg", ".png"),
    ("animate made.npz --out a.png", ".gif"),
    # Names of a robot's parts, failures and events.
    ("track ARM --site paylaod", "payload"),
    ("track ARM --pinned paylaod:point", "payload"),
    ("track ARM --fail joint44:locked@1", "joint4"),
    ("track --fail strut1:loked@1", "locked"),
    ("track --event hardover:strut1@3", "hard_over"),
    ("track --path spirl", "spiral"),
    ("track --controller json:lods", "loads"),
    # Options that do not go together.
    ("recover --events --hours 3", "--hours cannot be used with --events"),
    ("recover --scheduler x --controller ftc.loop:Stage", "imported on this computer alone"),
    ("recover --model ARM --dither often", "dither must be none, default, designed, or a freq"),
    ("recover --model ARM --scheduler tcp://there:1", "--scheduler cannot be used with --model"),
    ("recover --crossover 0.7", "--crossover needs --model"),
    *((f"track ARM --{option} {DIGITS}", "") for option in ("keyframe", "site", "pinned", "major")),
    # Numbers outside the range of options.
    *(
        (f"track ARM --{option}={value}", option.replace("-", "_"))
        for option in ("noise", "size", "servo", "crossover", "period", "turn", "duration")
        for value in ("1e300", "1e-300", "nan")
    ),
    *((f"track ARM --joint-weight={value}", "joint_weight") for value in ("1e200", "nan", "1,x")),
    ("track ARM --secondary-weight=1,inf", "secondary_"),
    # The live page, and commands on runs.
    ("live ARM --site payload --major 3,9", "major must be"),
    ("live --site tool", "--site needs a MODEL.xml"),
    ("live --port 70000", "--port"),
    ("review empty --out a.rrd", "empty"),
    ("review made.npz made.npz --out a.rrd", "made.npz"),
    ("review made.npz --model ARM --out a.rrd", "another machine"),
    ("render made.rrd --size big --out a.png", "--size"),
    ("animate made.npz made.npz made.npz --out a.gif", "one run or two"),
]


@pytest.mark.parametrize(("arguments", "expected"), WRONG, ids=lambda each: each[:50])
def test_wrong_arguments_are_one_sentence_that_names_them(place, refused, arguments, expected):
    assert expected in refused(*[str(ARM) if word == "ARM" else word for word in arguments.split()])


def test_for_a_mistyped_file_the_nearest_name_is_suggested(place, refused):
    assert "arm.xml" in refused("track", str(MODELS / "arme.xml"))
    assert "made.npz" in refused("review", "maed.npz")


@pytest.mark.parametrize("command", LISTED)
def test_an_empty_path_is_not_the_current_folder(place, refused, command):
    for arguments in (["--out", ""], ["--out="]):
        assert "--out is empty" in refused(command, *arguments)
    assert f"after {command} is empty" in refused(command, "")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('<site name="base"', '<site name="foot"', 'site named "base"'),
        ('<site name="payload"', '<site name="top"', 'site named "payload"'),
        ('name="coil2"', 'name="motor2"', 'actuator named "coil2"'),
        ('"tip6"', '"end6"', 'body named "tip6"'),
        # Complete, but unable to point.
        ("<weld ", "<weld active='false' ", "six degrees of freedom"),
        ('gainprm="126000"', 'gainprm="0"', "has gain 0"),
        ('damping="110"', 'damping="110000"', "alpha loop is unstable"),
        ("</actuator>", '<motor name="coil7" joint="top_twist1"/></actuator>', "has 7"),
        ('joint1="strut2"', 'joint1="strut3"', '"lock2"'),
        pytest.param(  # raised in the worker processes
            *('timestep="1.25e-4"', 'timestep="3e-4"', "0.0003 s does not divide"),
            marks=[pytest.mark.long, pytest.mark.night],
        ),
    ],
)
def test_an_unusable_hexapod_is_rejected(place, refused, tmp_path_factory, old, new, expected):
    text = HEXAPOD_MJCF.read_text()
    assert old in text
    file = tmp_path_factory.mktemp("machine") / "it.xml"
    file.write_text(text.replace(old, new))
    assert expected in refused("table1", "--model", str(file), "--out", "out")


@pytest.mark.long
@pytest.mark.night
def test_a_diverging_machine_stops_with_its_time_and_state(capsys, tmp_path):
    out, file = tmp_path / "out", tmp_path / "machine.xml"
    slow = HEXAPOD_MJCF.read_text().replace('timestep="1.25e-4"', 'timestep="1e-3"')
    file.write_text(slow.replace('damping="110"', 'damping="2000"'))
    assert main(["table1", "--quick", "--model", str(file), "--out", str(out)]) == 1
    message = capsys.readouterr().err
    with np.load(out / "diverged.npz") as saved:
        assert f"{float(saved['time_s']):.4f} s" in message
        assert saved["state"].size > 50 and np.isfinite(saved["state"]).all()
    assert [path.name for path in out.iterdir()] == ["diverged.npz"]


# Help and completion.


@pytest.mark.parametrize("name", [*LINES, "report"])
def test_every_option_has_help_and_the_example_is_a_command(capsys, place, name):
    assert main([*command_of(name)[1:], "--help"]) == 0
    text = re.sub(r"\s+", " ", capsys.readouterr().out)
    [example] = re.findall(rf"Example: fjh (?:paper )?{name}(.*?) (?:Arguments|Options):", text)
    arguments = [str(ARM) if word.endswith(".xml") else word for word in shlex.split(example)]
    commands()[name].make_context(name, arguments)  # raises the errors of the command
    options = [
        parameter for parameter in commands()[name].params if parameter.param_type_name == "option"
    ]
    assert all(parameter.help or parameter.hidden for parameter in options)
    assert name == "report" or len((study(name).__doc__ or "").split("\n\n")) > 1  # for the report


@pytest.mark.parametrize(
    ("arguments", "offered"),
    [
        ("fjh ", LISTED),
        ("fjh paper ", [*PAPER, "report"]),
        *(
            pytest.param(arguments, offered, marks=pytest.mark.long)  # options are those of a study
            for arguments, offered in (
                ("fjh table1 --jacobian ", ["analytic", "constant"]),
                ("fjh paper jacobian --lo", ["--loop"]),
            )
        ),
    ],
)
def test_tab_completes_commands_options_and_choices_at_once(tmp_path, arguments, offered):
    typed = {"COMP_WORDS": arguments, "COMP_CWORD": str(arguments.count(" "))}
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "experiments"],
        env=os.environ | typed | {"_FJH_COMPLETE": "complete_bash", "PYTHONPATH": str(ROOT)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == offered
    # Completion is fast, as no large package is imported.
    assert "typer" in done.stderr
    for slow in ("mujoco", "matplotlib", "numpy", "scipy", "rerun", "distributed", "pyarrow"):
        assert "--" in arguments or not re.search(rf"\| +{slow}$", done.stderr, re.MULTILINE), slow
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("survey", {"major": "x,y", "sensors": "off", "postures": 0}),
        ("track", {"crossover": 0.5, "joint_weight": "1.0,2.0", "fail": ["a:free@1", "b:free@2"]}),
        ("sweep", {"workers": 2, "resume": True}),
    ],
)
def test_arguments_made_from_options_are_read_as_these_options(name, given):
    """Fields of dataclass parameters are included, default values left out."""
    arguments = command_arguments(study(name), given)
    assert len(arguments) <= 2 + 2 * len(given)
    read = commands()[name].make_context(name, arguments).params
    assert {key: read[key] for key in given} == given
