"""Runs as an animation: what is drawn is the run's, and two runs are on the same scales."""

import io
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from experiments.app.cli import main
from experiments.recording import animation as animations
from experiments.recording.animated import Animated
from experiments.recording.animation import Animation, figure_at, state_at, write_animation
from experiments.recording.read import read_run
from experiments.recording.record import write_views
from experiments.recording.view import Change, RunView, Stated
from experiments.rig.arm import ARM_MJCF
from experiments.rig.hexapod.columns import hexapod_arrays
from experiments.rig.units import ROWS
from experiments.study.files import write_arrays
from experiments.study.palette import BLACK, BLUE, VERMILION
from experiments.study.study import WrongInput
from sim import HEXAPOD_MJCF, load_model, model_sha256
from tests.made import ABOUT, made_run, made_view

FAILED, NAMED = 150, 170
"""Ticks of 10 ms of the failure and of its diagnosis, in the runs that are made here."""


def keep_arm_run(folder: Path, left: float, *, found: bool) -> Path:
    """A circle of an arm whose motor 2 locks, its second row so many times as long from then on."""
    arm, time_s = load_model(ARM_MJCF), np.arange(400) / 100
    turn = np.pi * time_s / 2
    desired = 0.01 * np.column_stack([np.sin(turn), 1 - np.cos(turn), 0 * turn])
    true = desired.copy()
    true[FAILED:, 1] += (left - 1) * (desired[FAILED:, 1] - desired[FAILED, 1])
    qpos = np.tile(arm.qpos0, (400, 1))
    qpos[:, 1:4] = 1e-3 * np.column_stack([np.sin(turn), np.cos(turn), turn])
    its = Stated(
        robot="arm",
        hexapod=False,
        model_file="",
        model_sha256=model_sha256(ARM_MJCF),
        actuators=[f"motor{k}" for k in range(1, 8)],
        actuator_units=["rad"] * 7,
        input_units=["rad"] * 7,
        limits=[[None] * 7] * 2,
        bodies=[*([f"link{k}"] for k in range(1, 7)), ["camera"]],
        rows=list(ROWS),
        major=[3, 5, 4],
        row_units=["m"] * 3,
        incidents=[Change("motor2", "locked", FAILED / 100)],
        diagnoses=[Change("motor2", "locked", NAMED / 100)] if found else [],
    )
    folder.mkdir(parents=True)
    arrays = {"time_s": time_s, "desired": desired, "true": true, "measured": true, "qpos": qpos}
    arrays |= {"task": np.zeros((400, 6)), "closure_residual_m": np.zeros(400)}
    arrays |= dict.fromkeys(("inputs", "displacement"), qpos)
    write_arrays(folder / "track.npz", arrays)
    write_views(folder / "track.rrd", ABOUT, {"arm": RunView(its, arrays, arm)})
    return folder / "track.npz"


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("arms")
    return [
        keep_arm_run(folder / "unaware", -1.0, found=False),
        keep_arm_run(folder / "supervised", 0.99, found=True),
    ]


def arm_run(file: Path) -> Animated:
    return Animated(file.parent.name, read_run(file).view)


def changed(one: Animated, stated: dict[str, Any] | None = None, **arrays: np.ndarray) -> Animated:
    its, own = replace(one.run.stated, **stated or {}), {**one.run.arrays, **arrays}
    return replace(one, run=replace(one.run, stated=its, arrays=own))


@pytest.fixture(scope="module")
def both(files) -> Animation:
    return Animation([arm_run(file) for file in files])


def panels(animation: Animation, tick: int) -> list[list[Axes]]:
    """Machine, path and error of each run."""
    axes = figure_at(animation, tick).axes
    return [axes[k : k + 3] for k in range(0, len(axes), 3)]


def words(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.texts]


def test_two_runs_have_the_same_scales(both):
    """Also where one leaves the path far and the other hardly moves."""
    qpos = both.runs[1].run.arrays["qpos"]
    spread = changed(both.runs[1], qpos=qpos[0] + 0.01 * (qpos - qpos[0]))
    assert spread.factor > both.runs[0].factor
    for animation in (both, Animation([both.runs[0], spread])):
        left, right = panels(animation, 300)
        for one, other in zip(left, right, strict=True):
            assert (one.get_xlim(), one.get_ylim()) == (other.get_xlim(), other.get_ylim())
        assert animation.factor == both.runs[0].factor
        path, out = left[1], both.runs[0].true[:, :2]
        assert (out > [path.get_xlim()[0], path.get_ylim()[0]]).all()
        assert (out < [path.get_xlim()[1], path.get_ylim()[1]]).all()


def test_the_error_drawn_is_that_of_the_run(both):
    """As number, as bar, and as the gap between where the run should be and where it is."""
    for tick in (FAILED - 1, 399):
        for one, (_, path, error) in zip(both.runs, panels(both, tick), strict=True):
            off_mm = 1e3 * np.sqrt(((one.desired - one.true)[tick] ** 2).sum())
            assert error.patches[0].get_width() == pytest.approx(off_mm, abs=1e-12)  # pyright: ignore[reportAttributeAccessIssue]
            assert error.get_title() == f"error {off_mm:.{0 if off_mm >= 10 else 1}f} mm"
            ends = np.array([one.desired[tick], one.true[tick]])[:, :2]
            gap = [line for line in path.lines if line.get_color() == VERMILION]
            np.testing.assert_allclose(np.asarray(gap[0].get_xydata()), ends)
            trace = np.asarray(path.lines[1].get_xydata())
            np.testing.assert_array_equal(trace, one.true[: tick + 1, :2])
            worst = max(each.error.max() for each in both.runs)
            assert error.get_xlim() == pytest.approx((0, 1e3 * worst))


def test_runs_of_different_paths_or_durations_are_refused(both):
    one = both.runs[0]
    for other, said in (
        (changed(one, desired=1.01 * one.desired), "different paths"),
        (changed(one, time_s=2 * one.time_s), "duration"),
        (changed(one, time_s=one.time_s[:-1], desired=one.desired[:-1]), "duration"),
        (changed(one, {"row_units": ["rad"] * 3}), "the same task"),
        (changed(one, {"row_units": ["m", "m", "rad"]}), "the same task"),
    ):
        with pytest.raises(WrongInput, match=f"^unaware and unaware .*{said}[^.]*$"):
            Animation([one, other])


def test_each_column_says_what_its_controller_knows(both):
    works, found = (
        (BLACK, "all actuators work"),
        (BLUE, "motor2 locked, diagnosed as locked after 200 ms"),
    )
    failed = VERMILION, "motor2 locked"
    for tick, left, right in (
        *((FAILED - 1, works, works), (FAILED, failed, failed)),
        *((NAMED - 1, failed, failed), (NAMED, failed, found)),
    ):
        assert [state_at(one, tick) for one in both.runs] == [left, right]
    assert words(figure_at(both, NAMED))[:4] == ["unaware", failed[1], "supervised", found[1]]


def test_what_has_failed_is_red_from_the_failure_on(both):
    reds = []
    for tick in (FAILED - 1, FAILED):
        for machine, *_ in panels(both, tick):
            colors = np.asarray(machine.collections[0].get_facecolor())[:, :3]
            reds.append(int((colors[:, 0] > 2 * colors[:, 2]).sum()))
    assert reds[:2] == [0, 0]
    assert min(reds[2:]) > 50


def test_a_robot_is_drawn_where_its_joints_have_it_and_magnified_about_its_start(both, files):
    """Points of its geoms by MuJoCo's kinematics; origins of bodies move so many times as far."""
    one, data = both.runs[0], mujoco.MjData(both.runs[0].run.model)
    with np.load(files[0]) as arrays:
        qpos = arrays["qpos"]
    origins = []
    for tick in (0, 90):
        data.qpos[:] = qpos[tick]
        mujoco.mj_kinematics(one.run.model, data)
        origins.append(data.xpos.copy())
        placed = one.surface.placed(one.motion(tick, 1), 0)
        for body in set(one.surface.bodies.tolist()):
            own = one.surface.bodies == body
            rotation = data.xmat[body].reshape(3, 3)
            np.testing.assert_allclose(
                (placed[own] - data.xpos[body]) @ rotation, one.surface.points_m[own], atol=1e-12
            )
    assert one.factor > 1
    larger = one.motion(90, one.factor).position_m[0]
    np.testing.assert_allclose(
        larger - origins[0], one.factor * (origins[1] - origins[0]), atol=1e-12
    )


def test_the_frames_begin_shortly_before_the_failure_and_run_forward(both):
    ticks = [frame.tick for frame in both.frames]
    assert ticks == sorted(set(ticks))
    assert ticks[-1] == 399
    before, after = FAILED - ticks[0], 399 - FAILED
    assert before == pytest.approx(0.15 * after, abs=1)
    assert [frame.tick for frame in both.frames if frame.shown_ms > 400] == [FAILED, 399]
    # A reader sees the failure in the first two seconds, and its cost in the third.
    shown_ms = sum(frame.shown_ms for frame in both.frames if frame.tick <= FAILED)
    assert shown_ms < 2000
    assert sum(frame.shown_ms for frame in both.frames) < 8000
    whole = Animation([changed(both.runs[0], {"incidents": []})]).frames
    assert whole[0].tick == 0
    assert np.ptp(np.diff([frame.tick for frame in whole])) <= 1


@pytest.fixture(scope="module")
def run() -> dict[str, np.ndarray]:
    return hexapod_arrays(made_run())


def test_the_hexapod_is_drawn_alone_with_its_own_factor(run):
    time_s, off = run["time_s"], run["desired_rad"] - run["true_rad"]
    lock, diagnosis = (Change("strut1", "locked", float(time_s[k])) for k in (200, 224))
    alone = Animation([Animated("locked", made_view(lock, diagnoses=[diagnosis]))])
    ((machine, _, error),) = panels(alone, 300)
    assert error.get_title() == f"error {1e6 * np.linalg.norm(off[300]):.1f} µrad"
    assert words(figure_at(alone, 300)) == [
        *("locked", "strut1 locked, diagnosed as locked after 24 ms"),
        f"{time_s[300]:.2f} s; motion magnified {alone.factor} times",
    ]
    assert machine.collections


@pytest.mark.long
def test_an_animation_is_small_repeats_and_is_the_same_file_every_time(both, tmp_path, monkeypatch):
    monkeypatch.setattr(animations, "FRAMES", 4)
    few, done = Animation(both.runs), []
    for name in ("one.gif", "other.gif"):
        write_animation(tmp_path / name, few, lambda *so_far: done.append(so_far))
    one = (tmp_path / "one.gif").read_bytes()
    assert one == (tmp_path / "other.gif").read_bytes()
    assert len(one) * 74 / len(few.frames) < 1.5e6
    assert done[-1] == (len(few.frames), len(few.frames))
    picture = Image.open(io.BytesIO(one))
    assert getattr(picture, "n_frames", 1) == len(few.frames)
    assert picture.width == 640
    assert picture.info["loop"] == 0
    assert picture.convert("RGB").getpixel((2, 2)) == (255, 255, 255)


@pytest.mark.parametrize("count", [1, 2])
def test_the_command_writes_the_animation_of_one_run_or_two(files, count, tmp_path, monkeypatch):
    monkeypatch.setattr(animations, "FRAMES", 2)
    out, runs = tmp_path / "new" / "run.gif", [str(file) for file in files[:count]]
    assert main(["animate", *runs, "--model", str(ARM_MJCF), "--out", str(out)]) == 0
    with Image.open(out) as picture:
        assert picture.width == 320 * count
    assert [path.name for path in out.parent.iterdir()] == ["run.gif"]


def test_the_command_writes_the_animation_of_the_hexapod(run, tmp_path, monkeypatch):
    monkeypatch.setattr(animations, "FRAMES", 2)
    write_arrays(tmp_path / "run.npz", run)
    out = tmp_path / "run.gif"
    assert main(["animate", str(tmp_path / "run.npz"), "--out", str(out)]) == 0
    assert out.read_bytes()[:6] == b"GIF89a"


@pytest.mark.parametrize("units", [["m"], ["rad", "m"], ["rad", "m", "m"]])
def test_rows_that_make_no_plane_are_drawn_over_time(both, units):
    """The first row, and the error of those in its unit alone."""
    n = len(units)
    one = changed(
        both.runs[0],
        {"row_units": units, "major": both.runs[0].run.stated.major[:n]},
        desired=both.runs[0].desired[:, :n],
        true=both.runs[0].true[:, :n],
    )
    ((_, path, _),) = panels(Animation([one]), 300)
    trace = np.asarray(path.lines[1].get_xydata())
    assert (np.diff(trace[:, 0]) > 0).all()
    np.testing.assert_array_equal(trace[:, 1], one.true[:301, 0])
    np.testing.assert_allclose(one.error, np.abs(one.desired - one.true)[:, 0])


ARM = ["--model", str(ARM_MJCF)]


@pytest.mark.parametrize(
    ("names", "options", "said"),
    [
        ("run.npz", ["--out", "run.png"], "must end in .gif"),
        ("text.npz", [], "is not a readable .npz"),
        ("other.npz", [], "is not a run of the hexapod"),
        ("missing.npz", [], "there is no file"),
        ("run.npz", ARM, "six actuators"),
        ("arm/track.npz", ["--model", str(HEXAPOD_MJCF)], "is a run of another machine"),
        ("other_file/track.npz", ARM, "is a run of another machine"),
        ("other_file/track.npz", [], "none of models/, and the file is not there as it was"),
        ("run.npz run.npz run.npz", [], "one run or two, got 3"),
        ("no_recording/track.npz", ARM, "cannot be read without track.rrd"),
    ],
)
def test_what_cannot_be_animated_is_one_sentence(
    capsys, files, run, tmp_path, names, options, said
):
    write_arrays(tmp_path / "run.npz", run)
    write_arrays(tmp_path / "other.npz", {"x": np.zeros(3)})
    (tmp_path / "text.npz").write_text("text")
    for folder in ("arm", "no_recording", "other_file"):
        shutil.copytree(files[1].parent, tmp_path / folder)
    (tmp_path / "no_recording" / "track.rrd").unlink()
    its = changed(arm_run(files[1]), {"model_sha256": "0"}).run
    write_views(tmp_path / "other_file" / "track.rrd", ABOUT, {"arm": its})
    out = ["--out", str(tmp_path / "new" / "a.gif")]
    places = [str(tmp_path / name) for name in names.split()]
    assert main(["animate", *places, *out, *options]) == 2
    told = capsys.readouterr().err
    assert told.startswith("fjh: ")
    assert told.count("\n") == 1
    assert said in told
    assert not (tmp_path / "new").exists()
