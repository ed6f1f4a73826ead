"""Pictures of recordings: Rerun's viewer without a window opens one and goes to a time."""

import io
import os
import re
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import rerun_cli
from PIL import Image
from rerun.experimental import ViewerClient

from fjh.recording.file import TIMELINE
from fjh.study.errors import Unsound, WrongInput

# `ViewerClient.spawn` would listen on all interfaces, print the viewer's log, and fix its size.
VIEWER = Path(str(rerun_cli.__file__)).with_name("rerun")
DRIVER = next(iter(sorted(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json"))), None)
"""Mesa's Vulkan driver that needs no graphics card, where it is installed."""

_LOG = "warn,egui_wgpu=error,re_renderer::context=error"  # both warn of drawing in software
_BAR, _TIME_PANEL = 36, 30  # rows [px] of a window's buttons, and of the time
_GREETINGS, _SHOTS = 12, 40  # frames until its notices are gone, and until it must be at rest
_PATIENCE_S = 60.0
_TICK_S = 0.05  # a run of 16 s has its last tick shortly before
_COLORFUL = 0.7  # difference between largest and least of R, G, B (0..1) of a colour of the palette


class ViewerError(Unsound):
    """The viewer does not start, or does not show all of the recording; the message says why."""


def picture_of(recording: Path, time_s: float | None, size: tuple[int, int]) -> Image.Image:
    """A recording at a time [s], None its end, in so many pixels: the views on white.

    Raises:
        ViewerError: The viewer does not start, gives no answer, or warns.
        WrongInput: It is no recording, or has no such time.
    """
    with headless_viewer(size) as viewer:
        show(viewer, recording, time_s)
        return on_white(photograph(viewer))


@contextmanager
def headless_viewer(size: tuple[int, int] = (1600, 900)) -> Iterator[ViewerClient]:
    """A viewer for this process alone, which ends with the block; its views have so many pixels.

    It draws with Mesa's software renderer where that is installed, so that pictures are the same on
    every machine; else with the graphics card. A `ViewerError` is raised, wherever in the block,
    when it dies or gives no answer: without a Vulkan driver, or with too many pixels.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = f"--headless --hide-welcome-screen --bind 127.0.0.1 --port {port}"
    words += f" --window-size {size[0]}x{size[1] + _BAR + _TIME_PANEL}"
    with tempfile.TemporaryDirectory(prefix="fjh-viewer-") as home:
        # In an empty home nobody's settings show.
        own = {"HOME": home, "XDG_RUNTIME_DIR": home, "RERUN_APP_ONLY": "true", "NO_COLOR": "1"}
        own |= dict.fromkeys(("VK_DRIVER_FILES", "VK_ICD_FILENAMES"), str(DRIVER)) if DRIVER else {}
        log = Path(home, "log")
        with log.open("w") as output:
            viewer = subprocess.Popen(
                [VIEWER, *words.split()],
                env={**os.environ, **own, "RUST_LOG": _LOG},
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C is for us: we end it
            )
        try:
            yield _connected(viewer, port)
        except OSError as error:  # anywhere in the block: without a driver it dies after connecting
            raise ViewerError(_cause(log.read_text(errors="replace"), size, error)) from None
        finally:
            viewer.kill()
            viewer.wait()


def _connected(viewer: subprocess.Popen, port: int) -> ViewerClient:
    deadline = time.monotonic() + _PATIENCE_S
    while viewer.poll() is None and time.monotonic() < deadline:
        with suppress(ConnectionError):
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            for _ in range(_GREETINGS):  # its notices cover views
                client.take_screenshot()
            return client
        time.sleep(0.1)
    raise ConnectionError("it does not start")


def _cause(log: str, size: tuple[int, int], error: OSError) -> str:
    """Why a viewer of so many pixels gives no answer, in one sentence."""
    if re.search("graphics adapter|render context", log):
        return (
            "the viewer needs a Vulkan driver; without a graphics card install Mesa's "
            "(mesa-vulkan-drivers and libvulkan1 on Debian and Ubuntu)"
        )
    reasons = "; ".join([str(error), *log.splitlines()[-1:]])
    return f"the viewer gives no answer at {size[0]}x{size[1]} pixels: {reasons}"


def show(viewer: ViewerClient, recording: Path, time_s: float | None) -> None:
    """Open a recording and go to a time of it [s], None its end; else `WrongInput`."""
    opened, state = viewer.open(str(recording.absolute())), viewer.get_state()
    if opened.loading or not opened.store_ids:
        said = complaints(viewer) or ["it is no recording"]
        raise WrongInput(f"the viewer cannot open {recording}: {said[0].splitlines()[0]}")
    shown = [one for one in state.recordings if one.store_id == state.active_recording]
    lines = {line.name: line for one in shown for line in one.timelines}
    line = lines.get(TIMELINE)
    if line is None or line.start is None or line.end is None:
        raise WrongInput(f"{recording} is no recording of fjh: it has no timeline {TIMELINE}")
    begin_s, end_s = 1e-9 * line.start, 1e-9 * line.end
    if time_s is not None and not begin_s <= time_s <= end_s + _TICK_S:
        raise WrongInput(
            f"{recording} lasts from {begin_s:g} to {end_s:g} s, time {time_s:g} s is not in it"
        )
    wanted_s = end_s if time_s is None else min(time_s, end_s)
    viewer.set_time(TIMELINE, duration=wanted_s, play_state="paused")


def photograph(viewer: ViewerClient) -> bytes:
    """A PNG of the whole screen at rest; `ViewerError` where it keeps changing, or warns."""
    last = b""
    for _ in range(_SHOTS):
        before, last = last, viewer.take_screenshot()
        if before == last:
            break
    else:
        raise ViewerError("the viewer's picture does not stop changing")
    if said := complaints(viewer):
        raise ViewerError(f"the viewer reports: {' '.join(said[0].split())}")
    return last


def complaints(viewer: ViewerClient) -> list[str]:
    """What the viewer logs as warnings or errors, and what its views fail to show."""
    reports = [str(report) for view in viewer.get_state().views for report in view.reports]
    return reports + [e.message for e in viewer.get_logs() if e.level in ("WARN", "ERROR")]


def on_white(png: bytes) -> Image.Image:
    """The views of a screen with dark and light greys exchanged; colours stay.

    Without a window the viewer has a dark theme only. A pixel that a line covers in part is a
    mixture of its colour and the background: the line's share is how colourful the pixel is, and
    the rest becomes light.
    """
    dark = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[_BAR:-_TIME_PANEL] / 255
    low, high = dark.min(axis=-1, keepdims=True), dark.max(axis=-1, keepdims=True)
    background = 1 - np.minimum(1, (high - low) / _COLORFUL)
    light = np.clip(dark + background * (1 - 2 * low), 0, 1)
    return Image.fromarray(np.round(255 * light).astype(np.uint8))
