"""Page of the live simulation: server on the loopback interface, and real-time clock."""

import io
import time
from collections import deque
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import viser
import websockets.asyncio.server

from fjh.live.gate import guarded
from fjh.live.panel import Panel
from fjh.live.save import save_recording
from fjh.live.session import LONGEST_S, Session
from fjh.live.stage import FRAME_S, Stage
from fjh.rig import Rig
from fjh.study.errors import WrongInput
from sim import ModelError, SimulationDiverged

HOST = "127.0.0.1"
PORT = 8080
_TEXT_EVERY = 5
"""Number of frames between updates of the text."""
_BEHIND_S = 0.1
"""Largest delay behind real time [s] that the simulation catches up; a longer one is skipped."""
_AT_ONCE = 5
"""Number of ticks between checks for clicks."""


class LocalServer(viser.ViserServer):
    """Server that accepts only its own page in browsers on this computer, without a tunnel."""

    def __init__(self, port: int | None) -> None:
        """Listen on a port of the loopback interface; None: `PORT` or the next free one.

        Raises:
            WrongInput: The port is in use.
        """
        started, serve = list[bool](), websockets.asyncio.server.serve
        websockets.asyncio.server.serve = guarded(self, started)  # type: ignore[assignment]
        try:
            with redirect_stdout(io.StringIO()):  # viser would print a table of addresses
                super().__init__(HOST, PORT if port is None else port, verbose=False)
        finally:
            websockets.asyncio.server.serve = serve
        if not started:  # another version of viser, which would run without the checks
            self.stop()
            version = viser.__version__
            raise WrongInput(f"viser {version} is not supported: pip install viser==1.1.1")
        if port not in (None, self.get_port()):
            self.stop()
            raise WrongInput(
                f"--port {port} is used by another program: choose another, or omit --port"
            )

    def stop(self) -> None:
        """Stop the server without output."""
        with redirect_stdout(io.StringIO()):
            super().stop()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Return None: no tunnel to the internet is opened."""
        return None


class Page:
    """Page with two simulated machines in real time, and buttons.

    Attributes:
        session: Session of the machines.
    """

    def __init__(self, server: viser.ViserServer, rig: Rig, folder: Path, seed: int) -> None:
        """Make the elements of the page; its recordings of the last minute go to the folder."""
        self.session, self._folder = Session(rig, seed), folder
        self._clicks = SimpleQueue[Callable[[], object]]()
        self._stage = Stage(server, self.session)
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        server.gui.main_panel.dock_right()
        server.gui.set_panel_label(f"fjh live: {rig.title}")
        self._panel = Panel(server, self.session, self._stage, self._do, self._save)
        self._paces = deque([(time.perf_counter(), 0.0)], maxlen=round(1 / FRAME_S))
        self._simulated_s, self._frame, self._server = 0.0, 0, server

    def run(self) -> None:
        """Simulate and draw until interrupted."""
        last, behind_s = time.perf_counter(), 0.0
        while True:
            now = time.perf_counter()
            behind_s, last = min(behind_s + now - last, _BEHIND_S), now
            behind_s -= self.advance(behind_s, now + FRAME_S)
            self.show()
            time.sleep(max(0.0, now + FRAME_S - time.perf_counter()))

    def advance(self, seconds: float, until: float) -> float:
        """Simulate `seconds` or until the clock passes `until`; return the simulated time [s]."""
        session, period_s = self.session, self.session.rig.period_s
        ticks, done = int(seconds / period_s), 0
        while done < ticks and time.perf_counter() < until:
            self._click()
            try:
                more = session.advance(min(_AT_ONCE, ticks - done))
            except SimulationDiverged as diverged:
                more = self._replace(f"{diverged}")
            done += more or self._replace(f"The limit of {LONGEST_S / 60:g} minutes is reached")
        self._click()
        self._panel.add_errors(min(done, session.tick))
        self._simulated_s += done * period_s
        return done * period_s

    def _replace(self, why: str) -> int:
        self.session.restart()
        self._panel.reset(f"{why}: the page shows new machines, healthy and at rest.")
        return self.session.tick

    def _do(self, action: Callable[..., object], *arguments: Any) -> None:
        self._clicks.put(partial(action, *arguments))

    def _click(self) -> None:
        while not self._clicks.empty():
            try:
                self._clicks.get()()
            except (ModelError, WrongInput, OSError) as error:
                self._panel.message = str(error)

    def show(self) -> None:
        """Draw one frame."""
        start, simulated_s = self._paces[0]
        now = time.perf_counter()
        self._paces.append((now, self._simulated_s))
        with self._server.atomic():
            self._stage.show()
            if self._frame % _TEXT_EVERY == 0:
                self._panel.show((self._simulated_s - simulated_s) / max(now - start, 1e-6))
        self._frame += 1

    def _save(self) -> None:
        self._panel.message = save_recording(self._folder, self.session)
