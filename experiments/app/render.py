"""Pictures of recordings: Rerun's viewer without a window opens one and goes to a time."""

import ctypes
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rerun_cli
from rerun.experimental import ViewerClient, ViewerState

from experiments.app.light import on_white
from experiments.recording.file import TIMELINE
from experiments.study.study import Unsound, WrongInput

VIEWER = Path(str(rerun_cli.__file__)).with_name("rerun")
"""The viewer's program."""

SIZE = (1600, 900)
_PATIENCE_S = 60.0
_SHOTS = 40
_GREETING_S = 3.0
"""How long the viewer's notices stay, while it paints."""
_TICK_S = 0.05
_WINDOW_BAR = 36
"""Rows [px] at the top that the viewer keeps empty for the buttons of a window."""
_SET_PARENT_DEATH_SIGNAL = 1  # of prctl, Linux


class ViewerError(Unsound):
    """The viewer does not start, or does not show all of the recording; the message says why."""


def picture_of(recording: Path, time_s: float | None, size: tuple[int, int]) -> bytes:
    """A PNG of a recording at a time [s], None its end, of so many pixels: views on white.

    Raises:
        ViewerError: The viewer does not start, gives no answer, or warns.
        WrongInput: It is no recording, or has no such time.
    """
    with headless_viewer(size) as viewer:
        show(viewer, recording, time_s)
        _hide_time_panel(viewer)
        return on_white(photograph(viewer), _WINDOW_BAR)


@contextmanager
def headless_viewer(size: tuple[int, int] = SIZE) -> Iterator[ViewerClient]:
    """A viewer for this process alone, which ends with the block; its views have so many pixels.

    It draws with Mesa's software renderer where that is installed, so that pictures are the same on
    every machine; else with the graphics card. A `ViewerError` is raised, wherever in the block,
    when it dies or gives no answer: without a Vulkan driver, or with too many pixels.
    """
    with tempfile.TemporaryDirectory(prefix="fjh-viewer-") as home:
        log = Path(home) / "log"
        try:
            with _running(size, home, log) as client:
                _wait_for_greetings(client)
                yield client
        # Without a driver it dies after connecting, anywhere in the block.
        except OSError as error:
            raise ViewerError(_cause(log, size, error)) from None


@contextmanager
def _running(size: tuple[int, int], home: str, log: Path) -> Iterator[ViewerClient]:
    """The viewer's process, as long as the block lasts."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    options = ["--headless", "--hide-welcome-screen", "--bind", "127.0.0.1", "--port", str(port)]
    options += ["--window-size", f"{size[0]}x{size[1] + _WINDOW_BAR}"]
    with log.open("w") as output:
        viewer = subprocess.Popen(
            [VIEWER, *options],
            env=os.environ | _environment(home),
            stdout=output,
            stderr=subprocess.STDOUT,
            # Ctrl-C is for us: we end it.
            start_new_session=True,
            preexec_fn=_die_with_parent if sys.platform == "linux" else None,
        )
    try:
        yield _connected(viewer, port)
    finally:
        viewer.kill()
        viewer.wait()


def _die_with_parent() -> None:
    """Let the system end this process when its parent dies, by `kill -9` too."""
    ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


def show(viewer: ViewerClient, recording: Path, time_s: float | None) -> None:
    """Open a recording and go to a time of it [s], None its end; else `WrongInput`."""
    opened = viewer.open(str(recording.absolute()))
    deadline = time.monotonic() + _PATIENCE_S
    while (state := viewer.get_state()).loading and time.monotonic() < deadline:
        time.sleep(0.05)
    if state.loading or not opened.store_ids:
        said = complaints(viewer) or ["it is no recording"]
        raise WrongInput(f"the viewer cannot open {recording}: {said[0].splitlines()[0]}")
    begin_s, end_s = _span_s(state)
    # A run of 16 s has its last tick shortly before 16 s.
    if time_s is not None and not begin_s <= time_s <= end_s + _TICK_S:
        raise WrongInput(
            f"{recording} lasts from {begin_s:g} to {end_s:g} s, time {time_s:g} s is not in it"
        )
    wanted_s = end_s if time_s is None else min(time_s, end_s)
    viewer.set_time(TIMELINE, duration=wanted_s, play_state="paused")


def _hide_time_panel(viewer: ViewerClient) -> None:
    """Leave the views alone on the screen; the recording's own layout is not changed."""
    layout = viewer.get_blueprint().blueprint
    layout["/time_panel"]["TimePanelBlueprint"]["state"] = "Hidden"
    viewer.set_blueprint(layout, of="recording")


def photograph(viewer: ViewerClient) -> bytes:
    """A PNG of the whole screen at rest; `ViewerError` where it keeps changing, or warns."""
    last = b""
    for _ in range(_SHOTS):
        picture = viewer.take_screenshot()
        if picture == last:
            break
        last = picture
    else:
        raise ViewerError("the viewer's picture does not stop changing")
    if said := complaints(viewer):
        raise ViewerError(f"the viewer reports: {' '.join(said[0].split())}")
    return last


def complaints(viewer: ViewerClient) -> list[str]:
    """What the viewer logs as warnings or errors, and what its views fail to show."""
    reports = [str(report) for view in viewer.get_state().views for report in view.reports]
    logs = [entry for entry in viewer.get_logs() if entry.level in ("WARN", "ERROR")]
    # It warns of drawing in software, which is wanted.
    return reports + [e.message for e in logs if "oftware rasterizer" not in e.message]


def software_driver() -> Path | None:
    """Mesa's Vulkan driver that needs no graphics card, where it is installed."""
    return next(iter(sorted(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json"))), None)


def _environment(home: str) -> dict[str, str]:
    """An empty home, so that nobody's settings show; and the driver."""
    own = {"HOME": home, "XDG_RUNTIME_DIR": home, "RERUN_APP_ONLY": "true", "RUST_LOG": "warn"}
    own["NO_COLOR"] = "1"  # its log may end up in a sentence
    if driver := software_driver():
        own |= dict.fromkeys(("VK_DRIVER_FILES", "VK_ICD_FILENAMES"), str(driver))
    return own


def _connected(viewer: subprocess.Popen, port: int) -> ViewerClient:
    deadline = time.monotonic() + _PATIENCE_S
    while viewer.poll() is None and time.monotonic() < deadline:
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
        except ConnectionError:
            time.sleep(0.1)
        else:
            return client
    raise ConnectionError("it does not start")


def _cause(log: Path, size: tuple[int, int], error: OSError) -> str:
    """Why a viewer of so many pixels gives no answer, in one sentence."""
    logged = log.read_text(errors="replace")
    if re.search("graphics adapter|render context", logged):
        return (
            "the viewer needs a Vulkan driver; without a graphics card install Mesa's "
            "(mesa-vulkan-drivers and libvulkan1 on Debian and Ubuntu)"
        )
    reasons = [str(error), *logged.splitlines()[-1:]]
    return f"the viewer gives no answer at {size[0]}x{size[1]} pixels: {'; '.join(reasons)}"


def _wait_for_greetings(viewer: ViewerClient) -> None:
    """Let it paint until the notices with which it starts, and which cover views, are gone."""
    gone = time.monotonic() + _GREETING_S
    while time.monotonic() < gone:
        viewer.take_screenshot()
        time.sleep(0.1)


def _span_s(state: ViewerState) -> tuple[float, float]:
    """When the recording that is shown begins and ends [s]."""
    shown = [one for one in state.recordings if one.store_id == state.active_recording]
    for line in (line for one in shown for line in one.timelines):
        if line.name == TIMELINE and line.start is not None and line.end is not None:
            return 1e-9 * line.start, 1e-9 * line.end
    raise WrongInput(f"this is no recording of fjh: it has no timeline {TIMELINE}")
