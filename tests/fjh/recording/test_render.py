"""What a person sees on opening a recording, by its pixels; and a viewer that gives no answer.

A Vulkan driver is needed, as for any picture: CI installs Mesa's, which needs no graphics card.
"""

import io
import time
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
import rerun.blueprint as rrb
from PIL import Image

from experiments.app.cli import main
from fjh.recording import render
from fjh.recording.file import RecordingInfo, log_series, recording_file, screen, time_column
from fjh.recording.render import complaints, headless_viewer, photograph, show
from tests.fjh.recording.conftest import NEEDS_DRIVER

SOMETHING = 2e-4
"""A thin straight line across a plot fills twice this share of it."""


def drawn(test):
    """A test that looks at pictures, at night."""
    for mark in (pytest.mark.long, pytest.mark.night, NEEDS_DRIVER):
        test = mark(test)
    return test


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def content(image: np.ndarray) -> float:
    """Share of a view's pixels that are neither background nor the greys of title and axes."""
    return float((np.ptp(image[30:], axis=-1) > 40).mean())


def lit(image: np.ndarray) -> float:
    """Share of a view's pixels that are not background; text counts."""
    return float((image[30:].max(axis=-1) > 100).mean())


@pytest.fixture(scope="module")
def viewer():
    with headless_viewer() as client:
        yield client


def views(viewer) -> dict[str, tuple[str, np.ndarray]]:
    """Kind and pixels of every view that is seen without a click, by origin."""
    photograph(viewer)  # until it has come to rest, the views may be another recording's
    seen = viewer.get_state().views
    shots = {view.origin: viewer.take_screenshot(view.view_id) for view in seen}
    return {view.origin: (view.view_class, pixels(shots[view.origin])) for view in seen}


def empty_views(viewer, path: Path, time_s: float | None = None) -> tuple[set[str], set[str]]:
    """Origins of the views that are seen, and of those that show nothing."""
    show(viewer, path, time_s)
    seen, empty = views(viewer), set[str]()
    for origin, (kind, image) in seen.items():
        if (content(image) if kind in ("TimeSeries", "2D") else lit(image)) <= SOMETHING:
            empty.add(origin)
    assert complaints(viewer) == []
    return set(seen), empty


@drawn
@pytest.mark.parametrize(
    ("study", "name", "expected"),
    [
        ("table1", "W_e", "/machine /plane /task/error /actuators/input /secondary/true /notes"),
        ("recover", "locked", "/events /state"),
        ("systems", "arm", "/run_0/machine"),
        ("systems", "hand", ""),
        ("goals", "stroke", ""),
    ],
)
def test_every_view_of_a_recording_shows_something_at_once(viewer, request, study, name, expected):
    """Each opens with its own layout, and the viewer complains of nothing."""
    folder = request.getfixturevalue(f"{study}_folder")
    seen, empty = empty_views(viewer, folder / f"{name}.rrd")
    assert set(expected.split()) <= seen and empty == set()


@drawn
def test_no_notice_of_the_viewer_lies_over_a_picture(tmp_path):
    """An empty screen is empty, even where the viewer greets with what it listens to."""
    view = rrb.TextDocumentView(origin="nothing", name="nothing")
    about = RecordingInfo("empty", "empty", "notes", {"seed": 0})
    with recording_file(tmp_path / "empty.rrd", about, screen(rrb.Horizontal(view))) as recording:
        log_series(recording, time_column(np.arange(3.0)), "x", ["a [1]"], np.zeros((3, 1)))
    with headless_viewer((800, 600)) as client:
        show(client, tmp_path / "empty.rrd", None)
        corner = pixels(photograph(client))[60:300, 450:]
    assert (corner.max(axis=-1) > 60).mean() < 1e-3


@drawn
def test_the_spiral_grows_the_hexapod_moves_and_its_lock_is_magenta(viewer, table1_folder):
    shares, machines = [], []
    for name, time_s in (("W_e", 2.0), ("W_e", 6.0), ("W_e", 15.5), ("W_a", 15.5)):
        show(viewer, table1_folder / f"{name}.rrd", time_s)
        seen = views(viewer)
        shares.append(content(seen["/plane"][1]))
        machines.append(seen["/machine"][1])
    assert 0 < 2 * shares[0] < shares[1] < 0.5 * shares[2]
    assert (np.abs(machines[1] - machines[2]).max(axis=-1) > 60).mean() > 0.01
    magenta = []
    for image in machines[2:]:
        red, green, blue = np.moveaxis(image, -1, 0)
        magenta.append(int(((red > 100) & (blue > 60) & (green < 0.5 * blue)).sum()))
    assert magenta[0] > 200 + magenta[1]


@drawn
def test_all_of_table_1_side_by_side(viewer, table1_folder, tmp_path):
    """Six columns of four plots on the first page, none of them empty."""
    path = tmp_path / "review.rrd"
    assert main(["review", str(table1_folder), "--out", str(path)]) == 0
    show(viewer, path, None)
    page = pixels(photograph(viewer))[60:870]
    for row in np.array_split(page, 4):
        for cell in np.array_split(row, 6, axis=1):
            assert content(cell) > SOMETHING


@drawn
def test_render_makes_a_picture_of_the_size_and_time_asked_for(capsys, made, tmp_path):
    path, out = str(made / "made.rrd"), tmp_path / "new" / "a.png"
    (tmp_path / "no.rrd").write_text("no recording")
    for words, said in (
        ([path, "--time", "17"], "0 to 0.39"),
        ([str(tmp_path / "no.rrd")], "no.rrd"),
    ):
        assert main(["render", *words, "--out", str(out)]) == 2
        told = capsys.readouterr().err
        assert told.startswith("fjh: ") and told.count("\n") == 1 and said in told
        assert not out.parent.exists()
    assert main(["render", path, "--time", "0.3", "--size", "800x600", "--out", str(out)]) == 0
    image = pixels(out.read_bytes())
    assert image.shape == (600, 800, 3) and content(image) > 0.01


# A viewer that dies or gives no answer. It is a stand-in, so no driver is needed.


class Mute:
    """A client whose viewer has logged something, and gives no answer since."""

    def __init__(self, logged: Path, error: OSError) -> None:
        self.logged, self.error = logged, error

    def open(self, recording: str) -> NoReturn:
        """Fail, once the viewer has logged what it had to."""
        while not self.logged.exists():
            time.sleep(0.01)
        raise self.error


@pytest.mark.parametrize(
    ("line", "error", "said"),
    [
        (
            "Error: Failed to find an appropriate graphics adapter",
            ConnectionError("transport error"),
            "the viewer needs a Vulkan driver",
        ),
        (
            "WARN egui: Failed to render screenshot",
            TimeoutError("late"),
            "no answer at 9999x9999 pixels: late; WARN egui",
        ),
        ("", ConnectionError("transport error"), "9999x9999 pixels: transport error"),
    ],
)
def test_a_viewer_that_fails_after_connecting_is_one_sentence(
    capsys, tmp_path, monkeypatch, line, error, said
):
    program, logged = tmp_path / "rerun", tmp_path / "logged"
    program.write_text(f"#!/bin/sh\necho '{line}'\ntouch {logged}\nexec sleep 600\n")
    program.chmod(0o755)
    monkeypatch.setattr(render, "VIEWER", program)
    monkeypatch.setattr(render, "_connected", lambda *_: Mute(logged, error))
    (tmp_path / "a.rrd").write_text("never opened")
    out = tmp_path / "new" / "a.png"
    words = ["render", str(tmp_path / "a.rrd"), "--size", "9999x9999", "--out", str(out)]
    assert main(words) == 1
    told = capsys.readouterr().err
    assert told.startswith("fjh: ") and told.count("\n") == 1 and said in told
    assert not out.parent.exists()
