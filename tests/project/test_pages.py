"""The code of every page runs, once, prints what stands below it, and does what the page says."""

import contextlib
import json
import re
import shlex
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
import typer
from rerun.chunk import RrdReader

from experiments.app.cli import app_of
from experiments.app.command import command
from experiments.studies import LINES
from experiments.systems import systems
from sim import MODELS, Plant, jacobians, load_model
from tests.pages import assert_prints, blocks, run
from tests.robots import PANDA

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
DOCS = ROOT / "docs"
PAGES = [README, *sorted(DOCS.rglob("*.md"))]
WITH_CODE = [str(page.relative_to(ROOT)) for page in PAGES if "```python\n" in page.read_text()]


def text(page: str) -> str:
    return (ROOT / page).read_text()


def code(page: str, language: str) -> list[str]:
    return [content for kind, content in blocks(text(page)) if kind == language]


def prepare(page: str, folder: Path, request: pytest.FixtureRequest) -> None:
    """Put what the reader of a page has into a folder."""
    if page in ("README.md", "docs/track.md"):
        shutil.copy(
            MODELS / "arm.xml", folder / ("yours.xml" if page == "README.md" else "arm.xml")
        )
    elif page == "docs/add-a-mechanism.md":
        (folder / "panda.xml").write_text(PANDA)
    elif page == "docs/urdf.md":
        (folder / "arm.urdf").write_text(code(page, "xml")[0])
    elif page in ("docs/free-joints-and-forces.md", "docs/mechanism-files.md"):
        (folder / "rail.xml").write_text(code("docs/free-joints-and-forces.md", "xml")[0])
    elif page == "docs/find.md":
        (folder / "docs").symlink_to(DOCS)
    elif page == "docs/recordings.md":
        for file in ("W_e.npz", "W_e.rrd"):
            (folder / file).symlink_to(request.getfixturevalue("table1_folder") / file)
    elif page == "docs/sweep.md":
        rows = pd.DataFrame({"struts": ["SSSSSS"], "alpha_rms_urad": [2.5]})
        rows.to_parquet(folder / "sweep.parquet")


@pytest.fixture(scope="session")
def names_of(tmp_path_factory, request):
    """What a page's code leaves: its names, and `folder`, where it ran; each page runs once."""
    done: dict[str, dict[str, Any]] = {}

    def names(page: str) -> dict[str, Any]:
        if page not in done:
            folder = tmp_path_factory.mktemp("page")
            prepare(page, folder, request)
            with contextlib.chdir(folder):
                done[page] = run(text(page)) | {"folder": folder}
        return done[page]

    return names


pytestmark = pytest.mark.long


@pytest.mark.parametrize("page", WITH_CODE)
def test_the_code_of_a_page_runs_and_prints_what_stands_below_it(page, names_of):
    assert names_of(page)


@pytest.mark.parametrize("page", [page for page in PAGES if "```sh\n" in page.read_text()], ids=str)
def test_the_command_line_takes_every_command_of_a_page(page):
    """Names, options and their values; nothing is run."""
    app = typer.main.get_command(app_of(*LINES))
    for line in "".join(code(str(page), "sh")).splitlines():
        program, *words = shlex.split(line, comments=True) or [""]
        if Path(program).name == "fjh":
            found: Any = app
            context = found.make_context("fjh", words)
            while hasattr(found, "resolve_command"):
                words = [*context._protected_args, *context.args]
                _, found, words = found.resolve_command(context, words)
                context = found.make_context(found.name, words, parent=context)


def test_a_page_that_prints_something_else_is_seen():
    """The last digit may differ by one, and blanks; nothing else."""
    page = "encoder 0: d = 3.71, 7 alike [ 0. 1.]; 2.5e-03 um\n"
    for before, after in {"3.71": "3.72", "[ 0.": "[-0.", "2.5e": "2.4e", "e [": "e  ["}.items():
        assert_prints(page.replace(before, after), page)
    for before, after in {"3.71": "3.73", "r 0": "r 1", "7 a": "8 a", "-03": "-02"}.items():
        with pytest.raises(AssertionError):
            run(f"```python\nprint({page.replace(before, after)!r})\n```\n```text\n{page}\n```\n")


def late_rms(names: dict[str, Any], flight: str, since_s: float) -> float:
    """RMS error of a flight from a time on, as part of the path's size."""
    flown = names[flight]
    off = np.linalg.norm(flown.desired - flown.true, axis=1)[flown.time_s > since_s]
    return float(np.sqrt((off**2).mean()) / names["rig"].size)


def test_the_quickstart_stays_on_its_circle_and_without_diagnosis_misses_by_its_radius(names_of):
    names = names_of("docs/quickstart.md")
    rates, kin = names["rates"], names["stuck"]
    np.testing.assert_allclose(kin.J[3:] @ rates[kin.actuators], [0, 0, 0.01], atol=1e-12)
    since_s = names["supervised"].time_s[names["late"]][0]
    assert late_rms(names, "supervised", since_s) < 0.05 and late_rms(names, "unaware", since_s) > 1
    for flight in ("supervised", "unaware"):
        assert np.ptp(names[flight].displacement[names["late"], 3]) < 1e-5  # it is locked


def test_the_robot_of_a_urdf_file_stays_on_its_path_with_a_locked_joint(names_of):
    names = names_of("docs/urdf.md")
    (found,) = names["run"].diagnoses
    assert (found.actuator, found.kind) == ("elbow", "locked")
    assert late_rms(names, "run", 1.7) < 0.05


def test_the_bump_of_the_page_on_tracks_is_felt_and_is_no_failure(names_of):
    """A push of 0.2 N for 50 ms moves the lens; only joint 4, which locks after it, is named."""
    names = names_of("docs/track.md")
    rig, pushed, path = names["rig"], names["run"], names["path"]
    assert [(found.actuator, found.kind) for found in pushed.diagnoses] == [("motor4", "locked")]
    before = pushed.time_s < 2.45
    calm = rig.fly(rig.supervisor(), path[before], seed=0)
    assert 1e-6 < np.abs(calm.true - pushed.true[before]).max() < 1e-3


def test_the_downloaded_robot_follows_its_path_and_joint4_stands(names_of):
    """Within 2 % of the path before the lock; from then on joint4 stands in the physics."""
    names = names_of("docs/add-a-mechanism.md")
    flown, path = names["run"], np.array(names["path"])
    assert 0.1 < max(names["errors_m"]) / 1e-6 < 1.0 and np.ptp(path[:, 3]) == 0.0
    struck = flown.time_s >= 1.2
    error = np.linalg.norm(flown.desired - flown.true, axis=1)
    assert np.sqrt((error[~struck] ** 2).mean()) < 0.02 * names["rig"].size
    assert np.ptp(flown.displacement[struck, 3][5:]) < 2e-5


@pytest.mark.parametrize("robot", ["unknown_arm", "unnamed_gantry"])
def test_the_readmes_lines_survive_a_robot_that_they_do_not_know(
    robot, tmp_path, monkeypatch, capsys
):
    """They name the lock; by sensors whose noise hides everything they say why there is none."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(Path(__file__).parents[1] / "models" / f"{robot}.xml", tmp_path / "yours.xml")
    site, joint, rig = {
        "unknown_arm": ('"tool"', "j2", "major=[4, 5]"),
        "unnamed_gantry": ("3", "car", "major=[3, 4], noise=1.0, crossover=0.5"),
    }[robot]
    own = code("README.md", "python")[0].replace('fjh.MODELS / "arm.xml"', '"yours.xml"')
    own = own.replace("motor4", joint).replace('"payload"', site)
    names: dict = {}
    exec(own.replace('major=["x", "y", "z"]', rig), names)
    last = capsys.readouterr().out.splitlines()[-1]
    if robot == "unknown_arm":
        assert "m2 was named locked at 2." in last
        assert float(last.split()[0]) < 0.5 * 1e6 * names["rig"].size
    else:
        assert names["rig"].actuators == ("beam", "car", "fine")
        assert "Nothing was diagnosed; the sensors read what the model without" in last


def test_the_circle_of_the_page_on_mink_is_followed_and_a_joint_locked(names_of):
    names = names_of("docs/coming-from-mink.md")
    data, hand = names["data"], names["hand"]
    assert np.linalg.norm(hand.on(names["model"]).error(names["model"], data)) < 1e-5
    assert data.qvel[2] == 0.0 and np.abs(data.qvel).max() > 0.1


def test_the_tick_of_the_page_takes_its_general_way_where_a_rank_is_in_doubt(capsys):
    (script,), (printed,) = (code("docs/performance.md", kind) for kind in ("python", "text"))
    exec(script.replace("if qvel is None", "if True"), {})
    assert_prints(capsys.readouterr().out, printed)


def test_the_platforms_legs_move_alike_and_turn_it_where_it_is(names_of):
    names = names_of("docs/diagnosis-design.md")
    np.testing.assert_allclose(names["design"].dither.direction, np.ones(4), atol=1e-6)
    assert names["design"].task_motion.max() < 1e-10


def test_a_loop_without_simulator_recovers_as_without_diagnosis_it_does_not(names_of):
    """J_m M = I with the three drives left, as with four."""
    names = names_of("docs/control-without-simulator.md")
    assert names["after"] < names["before"]
    unaware = names["ftc"].run_loop(
        names["Machine"](), names["controller"](names["goal"]), names["desired"]
    )
    off = np.linalg.norm(names["desired"] - unaware.measured, axis=1)[1500:]
    assert np.sqrt(np.mean(off**2)) > 1.3 * names["after"]


def test_the_mechanism_of_the_page_moves_locked_coasts_free_and_bears_a_force(names_of):
    names = names_of("docs/free-joints-and-forces.md")
    assert names["error"] < 0.01 and names["command"][1] == 0.0
    # A mapping that does not know of the lock misses.
    unaware = names["system"].kinematics().velocity_mapping([1, 2], joint_weight=[1, 1, 1])
    plant = Plant(names["model"])
    plant.lock(1)
    plant.step(unaware(names["move_m"]), 1.0)
    assert np.abs(plant.displacement()[[3, 4]] - names["move_m"]).max() > 0.1 * 2e-4
    drift, basis = names["drift"], names["limp"].self_motion
    assert np.linalg.norm(drift - basis @ basis.T @ drift) < 0.01 * np.linalg.norm(drift)
    assert np.linalg.norm(drift) > 1e-6
    plant, torques = names["plant"], names["torques"]
    np.testing.assert_allclose(plant.coil_force_n(), torques, rtol=0.01)
    yields = np.abs(torques / names["model"].actuator_gainprm[:, 0]).max()
    assert np.abs(plant.displacement()).max() < 0.01 * yields and np.abs(torques).max() > 0.1


def test_the_mechanism_of_the_page_passes_the_study(names_of, monkeypatch):
    """Each of its conditions, simulated and classified."""
    names = names_of("docs/mechanism-files.md")
    monkeypatch.chdir(names["folder"])
    monkeypatch.setattr("experiments.systems.MECHANISMS", (names["rail"],))
    result = systems(seed=0, quick=False, on_progress=lambda done, total: None)
    conditions = result.tables["systems"].condition.tolist()
    assert conditions == ["sound", "1 locked", "2 locked", "1 free", "2 free"]
    assert all(check.passed for check in result.checks)


MOTOR, SERVO = '<position name="motor2" joint="left"', ' kp="80" kv="1.2"'
SITE = '<site name="payload" pos="-0.2 0.2 0"/>'
REFUSED = {
    "torque motor": (MOTOR + SERVO, '<motor name="motor2" joint="left"'),
    "velocity servo": (MOTOR + ' kp="80"', '<velocity name="motor2" joint="left"'),
    "muscle": (MOTOR + SERVO, '<muscle name="motor2" joint="left" lengthrange="0 1"'),
    "state of its own": (
        MOTOR + SERVO,
        '<intvelocity name="motor2" joint="left" actrange="-1 1"',
    ),
    "feels a length": (MOTOR, '<position name="motor2" site="payload"'),
    "adheres": (MOTOR + SERVO, '<adhesion name="motor2" body="left_rod" ctrlrange="0 1"'),
    "has gear 0": (MOTOR, MOTOR + ' gear="0"'),
    "no enabled actuator": ("<option", '<option actuatorgroupdisable="0"'),
    "no actuator moves": ('<site name="base"/>', f'<site name="base"/>{SITE}'),
    "is open by": ('joint1="rail" active="false"', 'joint1="rail" polycoef="0.02 0 0 0 0"'),
    "flags disable": ('contact="disable"', 'contact="disable" equality="disable"'),
    "no site": ('name="payload"', 'name="tool"'),
    "no equality": ('<joint name="lock3" joint1="right" active="false"/>', ""),
    "must lock": ('name="lock3" joint1="right"', 'name="lock3" joint1="right_elbow"'),
}
"""Words of a refusal, and what is put in place of what in the file of the page."""


@pytest.mark.parametrize("words", REFUSED)
def test_a_mechanism_is_refused_in_the_words_of_the_page(tmp_path, words):
    before, after = REFUSED[words]
    mjcf = code("docs/free-joints-and-forces.md", "xml")[0]
    if words == "no actuator moves":
        mjcf = mjcf.replace(SITE, "")
    assert before in mjcf
    (tmp_path / "rail.xml").write_text(mjcf.replace(before, after))
    model = load_model(tmp_path / "rail.xml")
    with pytest.raises(ValueError, match=words) as refused:
        jacobians(model, mujoco.MjData(model), site="payload", axes="base")
        Plant(model)
    assert f"| `{refused.value}` |" in text("docs/mechanism-files.md")


def table(heading: str) -> Iterator[list[str]]:
    """Rows of the table on recordings whose first heading this is."""
    page = text("docs/recordings.md")
    for line in page.split(f"| {heading} |")[1].split("\n\n")[0].splitlines()[2:]:
        yield [cell.strip(" `") for cell in line.strip("|").split("|")]


def test_the_tables_of_entities_and_arrays_have_all_that_the_files_hold(names_of):
    """No entity in no row or in two, and as many as the row says."""
    folder = names_of("docs/recordings.md")["folder"]
    schema = RrdReader(folder / "W_e.rrd").store().schema()
    patterns = {entity.replace("*", "[^/]+"): int(count) for entity, count, *_ in table("entity")}
    present = schema.entity_paths(include_properties=True)
    rows = [[row for row in patterns if re.fullmatch(row, path)] for path in present]
    assert all(len(row) == 1 for row in rows)
    assert Counter(row[0] for row in rows) == patterns
    with np.load(folder / "W_e.npz") as arrays:
        assert {name for name, *_ in table("array")} == set(arrays)


def test_the_study_of_the_page_writes_its_files_and_its_checks_can_fail(names_of, tmp_path):
    names = names_of("docs/add-an-experiment.md")
    app = typer.Typer()
    app.command()(command(names["seeds"]))
    app(["--quick", "--out", str(tmp_path)], standalone_mode=False)
    summary = json.loads((tmp_path / "seeds.json").read_text())
    assert {path.name for path in tmp_path.iterdir()} == set(summary["files"])
    runs = pd.DataFrame(summary["runs"])
    assert 0 < np.ptp(runs.alpha_rms_urad) < 0.05 * runs.alpha_rms_urad[0]
    assert [each.passed for each in names["checks"](runs)] == [True] * 4
    for column, factor, failed in (("alpha_rms_urad", 1.06, 1), ("gap_m", 1e9, 3)):
        spoilt = runs.copy()
        spoilt.loc[1, column] = spoilt.loc[1, column] * factor + 1e-6 * (column == "gap_m")
        passed = [each.passed for each in names["checks"](spoilt)]
        assert passed == [k != failed for k in range(4)]


TOLD = {
    **{"stiffness": "tiffness|N m/rad", "damping": "[Dd]amp", "mass": "mass|drawn only|draw "},
    **{"range": "[Ss]troke", "springref": "springref", "gainprm": "gainprm", "timestep": "ms"},
    **{"forcerange": "80 N", "solref": "time constant", "solreflimit": "stops"},
    **{"gravity": "Gravity", "diaginertia": r"kg m\^2"},
}
"""What the comment above must speak of when a physical attribute is set."""


def unmarked(mjcf: str) -> list[str]:
    """Elements with a number whose nearest comment above names no origin, or not this number."""
    origin = re.compile(r"\[(paper|geometry|chosen|derived)\b")
    comment, found = "", []
    for token in re.findall(r"<!--.*?-->|<[^!?/][^>]*>", mjcf, re.DOTALL):
        if token.startswith("<!--"):
            comment = token
            continue
        numbers = re.findall(r'(\w+)="[-+.\d][^"]*"', token)
        told = all(re.search(TOLD.get(name, ""), comment) for name in numbers)
        if numbers and not (origin.search(comment) and told):
            found.append(token)
    return found


@pytest.mark.parametrize("name", ["fjh", "arm", "arms", "hand", "platform"])
def test_every_number_of_a_machine_file_says_where_it_comes_from(name):
    assert unmarked((MODELS / f"{name}.xml").read_text()) == []


def test_a_number_without_origin_is_seen():
    mjcf = (MODELS / "fjh.xml").read_text()
    for before, after in {"[chosen": "[guessed", "springref is": "it is"}.items():
        assert unmarked(mjcf.replace(before, after)) != []
