"""The command `fjh live`: what it refuses, where it listens, and how it ends."""

import os
import signal
import socket
import time
from collections.abc import Callable
from contextlib import suppress

import pytest

from experiments.app.cli import main
from fjh.live.page import PORT
from fjh.recording.properties import properties_of
from sim import MODELS
from tests.fjh.live.browser import SMALL, Seen, browsed, free_port, listens, served, started

ARM = str(MODELS / "arm.xml")
INTERRUPTED = "fjh: interrupted: no file was left half-written\n"


@pytest.fixture
def no_model(tmp_path) -> str:
    (tmp_path / "text.xml").write_text("no MJCF")
    return str(tmp_path / "text.xml")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((ARM, "--site", "tools", "--major", "3,4,5"), '"tools"'),
        ((ARM, "--site", "payload", "--major", "3,9"), "major must be"),
        (("--site", "tool"), "--site needs a MODEL.xml"),
        (("--port", "0"), "'--port': Input should be greater"),
        (("--port", "70000"), "'--port': Input should be less"),
        (("--port", "many"), "--port"),
    ],
)
def test_what_no_robot_has_is_one_sentence(capfd, tmp_path, words, sentence):
    assert sentence in refused(capfd, *words, "--out", str(tmp_path / "out"))


def test_a_file_that_is_no_robot_is_one_sentence(capfd, tmp_path, no_model):
    words = (no_model, "--major", "3,4,5", "--out", str(tmp_path / "out"))
    assert "text.xml" in refused(capfd, *words)


def test_a_folder_that_cannot_be_written_to_is_one_sentence_before_anything_is_drawn(
    capfd, tmp_path
):
    (tmp_path / "file").write_text("")
    assert "file" in refused(capfd, "--out", str(tmp_path / "file"))
    assert "out" in refused(capfd, "--out", str(tmp_path / "file" / "out"))


@pytest.mark.long
def test_a_port_that_is_taken_is_one_sentence(capfd, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = refused(capfd, "--port", str(port), "--out", str(tmp_path / "out"))
    assert said == f"fjh: --port {port}: another program listens there; leave --port out\n"


def refused(capfd, *words: str) -> str:
    """The sentence."""
    code = main(["live", *words])
    out, said = capfd.readouterr()
    assert code == 2, said
    assert said.startswith("fjh: ") and said.count("\n") == 1 and not out
    return said


# What is really served.


@pytest.mark.long
def test_where_the_usual_port_is_taken_the_next_one_is_printed_and_nobody_else_can_listen(tmp_path):
    """On the loopback interface alone, as the kernel lists it."""
    with socket.socket() as taken:
        try:
            taken.bind(("127.0.0.1", PORT))
            taken.listen()
        except OSError:  # somebody else's has it already, which will do
            pass
        with served(tmp_path / "out") as command:
            assert command.port > PORT
            assert listens(command.process.pid) == [("127.0.0.1", command.port)]


@pytest.mark.long
@pytest.mark.usefixtures("alone")
def test_an_interrupted_command_leaves_no_listener_no_process_and_no_half_written_file(tmp_path):
    """In the middle of the writing of a recording: it is there whole, or not at all."""
    folder = tmp_path / "out"
    with served(folder, "--port", str(free_port())) as command:
        with browsed() as browser:
            page = Seen(browser.new_page(viewport=SMALL), command.url)
            page.click("Save the last minute")
            assert within(30.0, lambda: any(folder.glob("*")))  # the writing has begun
        code, out, error = command.ended()
        assert (code, out, error) == (130, "", INTERRUPTED)
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", command.port))
        assert is_gone(command.process.pid)
    assert {each.name for each in folder.glob("*")} <= {"live_1.rrd"}
    for recording in folder.glob("*"):
        assert properties_of(recording)["study"] == "live"


@pytest.mark.long
def test_an_interruption_before_the_page_is_there_is_one_sentence_too(tmp_path):
    process = started(tmp_path / "out", "--port", str(free_port()))
    assert within(60.0, lambda: any(listens(process.pid)))
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (130, INTERRUPTED)
    assert is_gone(process.pid) and not (tmp_path / "out").exists()


def is_gone(group: int) -> bool:
    """Whether no process of a group is left, after a moment for Python's own tracker."""

    def gone() -> bool:
        with suppress(ProcessLookupError):
            os.killpg(group, 0)
            return False
        return True

    return within(10.0, gone)


def within(seconds: float, holds: Callable[[], bool]) -> bool:
    """Whether something holds before so many seconds are over."""
    end = time.monotonic() + seconds
    while not (held := holds()) and time.monotonic() < end:
        time.sleep(0.01)
    return held
