"""What a person sees on opening a recording, by its pixels.

A Vulkan driver is needed, as for any picture: CI installs Mesa's, which needs no graphics card.
"""

import io
import os
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb
from PIL import Image

from experiments.app.cli import main
from fjh.recording.file import (
    RecordingInfo,
    log_series,
    recording_file,
    screen,
    time_column,
)
from fjh.recording.render import DRIVER, complaints, headless_viewer, photograph, show
from fjh.study.errors import WrongInput

# On a person's machine without Mesa's driver there is nothing to look at; in CI that is an error.
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        DRIVER is None and "CI" not in os.environ,
        reason="Mesa's Vulkan driver is not installed",
    ),
]


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def content(image: np.ndarray) -> float:
    """Share of a view's pixels that are neither background nor the greys of title and axes."""
    inside = image[30:]
    return float((np.ptp(inside, axis=-1) > 40).mean())


def lit(image: np.ndarray) -> float:
    """Share of a view's pixels that are not background; text counts."""
    return float((image[30:].max(axis=-1) > 100).mean())


@pytest.fixture(scope="module")
def viewer():
    with headless_viewer() as client:
        yield client


SOMETHING = 2e-4
"""A thin straight line across a plot fills twice this share of it."""


def views(viewer) -> dict[str, tuple[str, np.ndarray]]:
    """Kind and pixels of every view that is seen without a click, by origin."""
    photograph(viewer)  # until it has come to rest, the views may be another recording's
    seen = viewer.get_state().views
    shots = {view.origin: viewer.take_screenshot(view.view_id) for view in seen}
    return {view.origin: (view.view_class, pixels(shots[view.origin])) for view in seen}


def assert_useful(viewer, path: Path, time_s: float | None = None) -> set[str]:
    """Every view that is seen shows something, and the viewer has nothing to complain of.

    Returns the origins of these views.
    """
    show(viewer, path, time_s)
    seen = views(viewer)
    for origin, (kind, image) in seen.items():
        shown = content(image) if kind in ("TimeSeries", "2D") else lit(image)
        assert shown > SOMETHING, f"{path.name}: {origin}, a {kind}, is empty"
    assert complaints(viewer) == []
    return set(seen)


def test_a_run_shows_machine_detector_signals_and_notes_at_once(viewer, table1_folder):
    assert assert_useful(viewer, table1_folder / "W_e.rrd", 6.0) == {
        "/machine",
        "/plane",
        "/task/error",
        "/actuators/input",
        "/secondary/true",
        "/notes",
    }


def view(viewer, origin: str) -> np.ndarray:
    """Pixels of one view."""
    photograph(viewer)
    view_id = next(v.view_id for v in viewer.get_state().views if v.origin == origin)
    return pixels(viewer.take_screenshot(view_id))


def test_the_spiral_grows(viewer, table1_folder):
    shares = []
    for time_s in (2.0, 6.0, 15.0):
        show(viewer, table1_folder / "W_e.rrd", time_s)
        shares.append(content(view(viewer, "/plane")))
    assert 0 < 2 * shares[0] < shares[1] < 0.5 * shares[2]


def test_the_hexapod_moves_and_its_failed_strut_is_magenta(viewer, table1_folder):
    images = []
    for name, time_s in (("W_e", 4.0), ("W_e", 15.5), ("W_a", 15.5)):
        show(viewer, table1_folder / f"{name}.rrd", time_s)
        images.append(view(viewer, "/machine"))
    assert (np.abs(images[0] - images[1]).max(axis=-1) > 60).mean() > 0.01

    def magenta(image: np.ndarray) -> int:
        red, green, blue = np.moveaxis(image, -1, 0)
        return int(((red > 100) & (blue > 60) & (green < 0.5 * blue)).sum())

    assert magenta(images[1]) > 200 + magenta(images[2])


def test_each_recording_opens_with_its_own_layout(viewer, systems_folder, table1_folder):
    """The viewer keeps one layout for an application: two of ours are two."""
    for path in (table1_folder / "W_a.rrd", systems_folder / "arm.rrd"):
        show(viewer, path, None)
        photograph(viewer)
        origins = {v.origin for v in viewer.get_state().views}
        assert ("/run_0/machine" in origins) == (path.stem == "arm")


def test_failures_in_flight_are_told_without_a_click(viewer, recover_folder):
    seen = assert_useful(viewer, recover_folder / "locked.rrd")
    assert {"/events", "/state"} <= seen


def test_the_other_studies_recordings_open_to_something(viewer, systems_folder, goals_folder):
    """One of each kind of screen."""
    for path in (
        systems_folder / "hand.rrd",
        goals_folder / "stroke.rrd",
    ):
        assert_useful(viewer, path)


def test_all_of_table_1_side_by_side(viewer, table1_folder, tmp_path):
    """Six columns of four plots on the first page, none of them empty."""
    path = tmp_path / "review.rrd"
    assert main(["review", str(table1_folder), "--out", str(path)]) == 0
    show(viewer, path, None)
    page = pixels(photograph(viewer))[60:870]
    for row in np.array_split(page, 4):
        for cell in np.array_split(row, 6, axis=1):
            assert content(cell) > SOMETHING


def test_an_empty_view_is_found_out(viewer, tmp_path):
    """The check can fail: a view of what is not there."""
    path, time_s = tmp_path / "empty.rrd", np.arange(10.0)
    empty = screen(rrb.Horizontal(rrb.TimeSeriesView(origin="nothing")))
    with recording_file(
        path, RecordingInfo("empty", "empty", "notes", {"seed": 0}), empty
    ) as recording:
        log_series(recording, time_column(time_s), "x", ["a [1]"], time_s[:, None])
    with pytest.raises(AssertionError, match="/nothing, a TimeSeries, is empty"):
        assert_useful(viewer, path)


def test_no_notice_of_the_viewer_lies_over_a_picture(tmp_path):
    """An empty screen is empty, even where the viewer greets with what it listens to."""
    path = tmp_path / "empty.rrd"
    empty = screen(rrb.Horizontal(rrb.TextDocumentView(origin="nothing", name="nothing")))
    with recording_file(path, RecordingInfo("none", "none", "notes", {}), empty) as recording:
        log_series(recording, time_column(np.arange(3.0)), "x", ["a [1]"], np.zeros((3, 1)))
    with headless_viewer((800, 600)) as client:
        show(client, path, None)
        corner = pixels(photograph(client))[60:300, 450:]
    assert (corner.max(axis=-1) > 60).mean() < 1e-3


def test_what_is_no_recording_is_refused_with_the_viewers_words(tmp_path):
    (tmp_path / "no.rrd").write_text("no recording")
    with headless_viewer() as client, pytest.raises(WrongInput, match=r"no\.rrd: .*RRD"):
        show(client, tmp_path / "no.rrd", None)


def test_render_makes_a_picture_of_the_size_and_time_asked_for(table1_folder, tmp_path):
    path, out = str(table1_folder / "W_d.rrd"), tmp_path / "a.png"
    assert main(["render", path, "--time", "3", "--size", "800x600", "--out", str(out)]) == 0
    at_3_s = pixels(out.read_bytes())
    assert at_3_s.shape == (600, 800, 3)
    assert content(at_3_s) > 0.01


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--time", "17"], "0 to 15.9"),
        (["--size", "big"], "--size"),
        (["--out", "picture.jpg"], "picture.jpg"),
    ],
)
def test_a_picture_that_cannot_be_is_one_sentence(capsys, table1_folder, tmp_path, options, named):
    out = ["--out", str(tmp_path / "out" / "a.png")]
    assert main(["render", str(table1_folder / "W_e.rrd"), *out, *options]) == 2
    said = capsys.readouterr().err
    assert said.startswith("fjh: ")
    assert said.count("\n") == 1
    assert named in said
    assert not (tmp_path / "out").exists()
