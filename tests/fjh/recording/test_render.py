"""Pixels of rendered recordings (with Mesa's Vulkan driver), and a viewer that does not respond."""

import io
import time
from typing import NoReturn

import numpy as np
import pytest
from PIL import Image

from experiments.app.cli import main
from fjh.recording import render
from fjh.recording.render import complaints, headless_viewer, photograph, show
from tests.fjh.recording.conftest import NEEDS_DRIVER


def at_night(test):
    """Mark a test of pictures for the night run."""
    for mark in (pytest.mark.long, pytest.mark.night, NEEDS_DRIVER):
        test = mark(test)
    return test


def pixels(png: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def content(image: np.ndarray, *, text: bool = False) -> float:
    """Return the share of a view's pixels that are neither background nor, without text, grey."""
    below_title = image[30:]
    visible = below_title.max(axis=-1) > 100 if text else np.ptp(below_title, axis=-1) > 40
    return float(visible.mean())


@pytest.fixture(scope="module")
def viewer():
    with headless_viewer() as client:
        yield client


@at_night
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
def test_every_view_of_a_recording_has_content(viewer, request, study, name, expected):
    """Recordings open with their layout and without warnings."""
    show(viewer, request.getfixturevalue(f"{study}_folder") / f"{name}.rrd", None)
    photograph(viewer)  # before, views may belong to another recording
    views = viewer.get_state().views
    for view in views:
        image = pixels(viewer.take_screenshot(view.view_id))
        text = view.view_class not in ("TimeSeries", "2D")
        # A thin straight line across a plot covers twice this share.
        assert content(image, text=text) > 2e-4, view.origin
    assert set(expected.split()) <= {view.origin for view in views}
    assert complaints(viewer) == []


@at_night
def test_render_makes_a_picture_of_the_requested_size_and_time(refused, made, tmp_path):
    path, out = str(made / "made.rrd"), tmp_path / "new" / "a.png"
    (tmp_path / "no.rrd").write_text("no recording")
    for arguments, message in (
        ([path, "--time=17"], "0 to 0.39"),
        ([str(tmp_path / "no.rrd")], "no.rrd"),
    ):
        assert (
            message in refused("render", *arguments, "--out", str(out)) and not out.parent.exists()
        )
    assert main(["render", path, "--time", "0.3", "--size", "800x600", "--out", str(out)]) == 0
    image = pixels(out.read_bytes())
    assert image.shape == (600, 800, 3) and content(image) > 0.01


@pytest.mark.parametrize(
    ("line", "error", "message"),
    [
        ("Error: Failed to find an appropriate graphics adapter", ConnectionError, "Vulkan driver"),
        ("WARN egui: late", TimeoutError, "does not respond at 9999x9999 pixels: late; WARN egui"),
    ],
)
def test_a_viewer_that_fails_after_connecting_is_one_sentence(
    refused, tmp_path, monkeypatch, line, error, message
):
    program, logged = tmp_path / "rerun", tmp_path / "logged"
    program.write_text(f"#!/bin/sh\necho '{line}'\ntouch {logged}\nexec sleep 600\n")
    program.chmod(0o755)

    class Mute:
        def open(self, recording: str) -> NoReturn:
            while not logged.exists():
                time.sleep(0.01)
            raise error("late")

    monkeypatch.setattr(render, "VIEWER", program)
    monkeypatch.setattr(render, "_connected", lambda *_: Mute())
    (tmp_path / "a.rrd").write_text("never opened")
    out = tmp_path / "new" / "a.png"
    arguments = ["render", str(tmp_path / "a.rrd"), "--size", "9999x9999", "--out", str(out)]
    assert message in refused(*arguments, code=1)
    assert not out.parent.exists()
