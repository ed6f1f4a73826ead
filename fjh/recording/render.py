"""Pictures of recordings at a given time, by Rerun's viewer without a window."""

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

# Not `ViewerClient.spawn`: it listens on all interfaces, prints the log, and has a fixed size.
VIEWER = Path(str(rerun_cli.__file__)).with_name("rerun")
DRIVER = next(iter(sorted(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json"))), None)
"""File of Mesa's software Vulkan driver, which needs no graphics card; None: not installed."""

_LOG = "warn,egui_wgpu=error,re_renderer::context=error"  # both warn of software rendering
_BAR, _TIME_PANEL = 36, 30  # heights [px] of the window's buttons and of the time panel
_GREETINGS, _SHOTS = 12, 40  # frames until notices disappear, and until the picture must be static
_PATIENCE_S = 60.0
_TICK_S = 0.05  # accepted time after the last tick, which of a 16 s run is shortly before 16 s
_COLORFUL = 0.7  # difference between largest and least of R, G, B (0..1) of colours of the palette


class ViewerError(Unsound):
    """Error of the viewer: it does not start, or cannot show the recording completely."""


def picture_of(recording: Path, time_s: float | None, size: tuple[int, int]) -> Image.Image:
    """Return a picture of a recording's views at a time [s], on white, of `size` [px].

    A time of None is the end of the recording.

    Raises:
        ViewerError: The viewer does not start, does not respond, or warns.
        WrongInput: The file is no recording, or has no such time.
    """
    with headless_viewer(size) as viewer:
        show(viewer, recording, time_s)
        return on_white(photograph(viewer))


@contextmanager
def headless_viewer(size: tuple[int, int] = (1600, 900)) -> Iterator[ViewerClient]:
    """Start a viewer without a window, with views of `size` [px], until the end of the block.

    If Mesa's software renderer is installed, pictures are the same on every machine; else the
    viewer uses the graphics card. The block raises a `ViewerError` if the viewer ends or does not
    respond, for example without a Vulkan driver or with too many pixels.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    arguments = f"--headless --hide-welcome-screen --bind 127.0.0.1 --port {port}"
    arguments += f" --window-size {size[0]}x{size[1] + _BAR + _TIME_PANEL}"
    with tempfile.TemporaryDirectory(prefix="fjh-viewer-") as home:
        # An empty home keeps the user's settings of the viewer out.
        env = {"HOME": home, "XDG_RUNTIME_DIR": home, "RERUN_APP_ONLY": "true", "NO_COLOR": "1"}
        env |= dict.fromkeys(("VK_DRIVER_FILES", "VK_ICD_FILENAMES"), str(DRIVER)) if DRIVER else {}
        log = Path(home, "log")
        with log.open("w") as output:
            viewer = subprocess.Popen(
                [VIEWER, *arguments.split()],
                env={**os.environ, **env, "RUST_LOG": _LOG},
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C is handled here, where the viewer is ended
            )
        try:
            yield _connected(viewer, port)
        except OSError as error:  # without a driver the viewer dies after connecting
            raise ViewerError(_cause(log.read_text(errors="replace"), size, error)) from None
        finally:
            viewer.kill()
            viewer.wait()


def _connected(viewer: subprocess.Popen, port: int) -> ViewerClient:
    deadline = time.monotonic() + _PATIENCE_S
    while viewer.poll() is None and time.monotonic() < deadline:
        with suppress(ConnectionError):
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            for _ in range(_GREETINGS):  # notices cover views
                client.take_screenshot()
            return client
        time.sleep(0.1)
    raise ConnectionError("the viewer does not start")


def _cause(log: str, size: tuple[int, int], error: OSError) -> str:
    """Return a clause on why a viewer of this size does not respond."""
    if re.search("graphics adapter|render context", log):
        return (
            "the viewer needs a Vulkan driver; without a graphics card install Mesa's "
            "(mesa-vulkan-drivers and libvulkan1 on Debian and Ubuntu)"
        )
    reasons = "; ".join([str(error), *log.splitlines()[-1:]])
    return f"the viewer does not respond at {size[0]}x{size[1]} pixels: {reasons}"


def show(viewer: ViewerClient, recording: Path, time_s: float | None) -> None:
    """Open a recording at a time [s], or at its end; raise `WrongInput` if that is impossible."""
    opened, state = viewer.open(str(recording.absolute())), viewer.get_state()
    if opened.loading or not opened.store_ids:
        messages = complaints(viewer) or ["it is no recording"]
        raise WrongInput(f"the viewer cannot open {recording}: {messages[0].splitlines()[0]}")
    active = [one for one in state.recordings if one.store_id == state.active_recording]
    lines = {line.name: line for one in active for line in one.timelines}
    line = lines.get(TIMELINE)
    if line is None or line.start is None or line.end is None:
        raise WrongInput(f"{recording} is no recording of fjh: it has no timeline {TIMELINE}")
    start_s, end_s = 1e-9 * line.start, 1e-9 * line.end
    if time_s is not None and not start_s <= time_s <= end_s + _TICK_S:
        raise WrongInput(
            f"{recording} lasts from {start_s:g} to {end_s:g} s, time {time_s:g} s is not in it"
        )
    target_s = end_s if time_s is None else min(time_s, end_s)
    viewer.set_time(TIMELINE, duration=target_s, play_state="paused")


def photograph(viewer: ViewerClient) -> bytes:
    """Return the static screen as PNG; raise `ViewerError` if it keeps changing, or on warnings."""
    last = b""
    for _ in range(_SHOTS):
        before, last = last, viewer.take_screenshot()
        if before == last:
            break
    else:
        raise ViewerError("the viewer's picture does not stop changing")
    if messages := complaints(viewer):
        raise ViewerError(f"the viewer reports: {' '.join(messages[0].split())}")
    return last


def complaints(viewer: ViewerClient) -> list[str]:
    """Return the viewer's warnings and errors, and the error reports of its views."""
    reports = [str(report) for view in viewer.get_state().views for report in view.reports]
    return reports + [e.message for e in viewer.get_logs() if e.level in ("WARN", "ERROR")]


def on_white(png: bytes) -> Image.Image:
    """Return the views of a screen with dark and light greys exchanged and colours kept.

    Without a window the viewer has only a dark theme. Where a line covers a pixel in part, the
    line's share is the pixel's colourfulness, and the background's share becomes light.
    """
    dark = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[_BAR:-_TIME_PANEL] / 255
    low, high = dark.min(axis=-1, keepdims=True), dark.max(axis=-1, keepdims=True)
    background = 1 - np.minimum(1, (high - low) / _COLORFUL)
    light = np.clip(dark + background * (1 - 2 * low), 0, 1)
    return Image.fromarray(np.round(255 * light).astype(np.uint8))
