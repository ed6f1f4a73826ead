"""A viewer that dies or gives no answer: one sentence. It is a stand-in, so no driver is needed."""

import time
from pathlib import Path
from typing import NoReturn

import pytest

from experiments.app.cli import main
from fjh.recording import render

ADAPTER = "Error: Failed to find an appropriate graphics adapter"
SLOW = "WARN egui: Failed to render screenshot"


class Mute:
    """A client whose viewer has logged something, and gives no answer since."""

    def __init__(self, logged: Path, error: OSError) -> None:
        self.logged, self.error = logged, error

    def open(self, recording: str) -> NoReturn:
        """Fail, once the viewer has logged what it had to."""
        while not self.logged.exists():
            time.sleep(0.01)
        raise self.error


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Let a program that logs one line be the viewer, and its client fail with an error."""

    def put(line: str, error: OSError) -> None:
        program, logged = tmp_path / "rerun", tmp_path / "logged"
        program.write_text(f"#!/bin/sh\necho '{line}'\ntouch {logged}\nexec sleep 600\n")
        program.chmod(0o755)
        monkeypatch.setattr(render, "VIEWER", program)
        monkeypatch.setattr(render, "_connected", lambda *_: Mute(logged, error))

    return put


@pytest.mark.parametrize(
    ("line", "error", "said"),
    [
        (ADAPTER, ConnectionError("transport error"), "the viewer needs a Vulkan driver"),
        (SLOW, TimeoutError("late"), f"no answer at 9999x9999 pixels: late; {SLOW}"),
        ("", ConnectionError("transport error"), "9999x9999 pixels: transport error"),
    ],
)
def test_a_viewer_that_fails_after_connecting_is_one_sentence(
    capsys, tmp_path, stand_in, line, error, said
):
    stand_in(line, error)
    (tmp_path / "a.rrd").write_text("never opened")
    out = tmp_path / "new" / "a.png"
    words = ["render", str(tmp_path / "a.rrd"), "--size", "9999x9999", "--out", str(out)]
    assert main(words) == 1
    told = capsys.readouterr().err
    assert told.startswith("fjh: ")
    assert told.count("\n") == 1
    assert said in told
    assert not out.parent.exists()
