"""The command as a process of its own, and its page in a browser that nobody sees."""

import re
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil
from playwright.sync_api import Browser, Locator, Page, ViewportSize, sync_playwright

from tests.processes import started

FLAGS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)
SMALL: ViewportSize = {"width": 800, "height": 420}
"""Of a window: what is drawn without a graphics card costs time by the pixel."""
_SELDOM = """
const next = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = draw => setTimeout(() => next(draw), {});
window.cancelAnimationFrame = clearTimeout;
"""
"""A picture in so many ms leaves the processor to the machines."""
_PATIENCE_S = 120.0
_LONG_S = 3.0
"""Longer than a click takes: after it, new machines are younger than the former ones were."""
_TEXT_PATTERN = re.compile(
    r"([\d.]+) s, [\d.]+ of real time\n+State: (.*)\n+supervised [^\n]* RMS\n(.*)\n+"
    r"not supervised [^\n]* RMS\n.*\n+(?:(.*)\n+)?Error, %"
)


@dataclass(frozen=True)
class PageText:
    """Time of the machines, what happens, what the supervised one believes, the last click."""

    clock_s: float
    active: str
    supervised: str
    last: str

    def diagnosed_kinds(self, actuator: str) -> list[str]:
        """What kinds an actuator is taken for, such as free or weak."""
        matched = re.match(rf"{actuator} is ([\w ]+)", self.supervised, re.IGNORECASE)
        return matched[1].split(" or ") if matched else []


class BrowserPage:
    """A page of a browser, by what a person sees of it and does with it."""

    def __init__(self, page: Page, url: str, picture_s: float = 1.0) -> None:
        """Open the page and wait until the machines move; it draws at most so often."""
        self.page = page
        page.set_default_timeout(1e3 * _PATIENCE_S)
        page.add_init_script(_SELDOM.format(round(1e3 * picture_s)))
        page.goto(url)
        self.until(lambda said: said.clock_s > 0)

    def until(self, holds: Callable[[PageText], bool]) -> PageText:
        """What it says when something holds of it."""
        end = time.monotonic() + _PATIENCE_S
        while True:
            text = self.page.locator("body").inner_text()
            if matched := _TEXT_PATTERN.search(text):
                clock_s, active, supervised, last = matched.groups(default="")
                said = PageText(float(clock_s), active, supervised, last)
                if holds(said):
                    return said
            assert time.monotonic() < end, f"the page still says {text}"
            self.page.wait_for_timeout(50)

    def make(self, actuator: str, word: str) -> None:
        """Click a word beside the name of an actuator."""
        self.row_of(actuator).get_by_role("button", name=word, exact=True).click()

    def row_of(self, label: str) -> Locator:
        """The row of a label."""
        name = self.page.get_by_text(label, exact=True)
        return name.locator("xpath=ancestor::div[.//button or .//input][1]")

    def click(self, button: str) -> None:
        """A button."""
        self.page.get_by_role("button", name=button, exact=True).click()

    def tick(self, box: str) -> None:
        """A box, which changes."""
        self.page.get_by_label(box, exact=True).click()

    def field(self, slider: str) -> Locator:
        """Where its number is written."""
        return self.row_of(slider).locator("input[inputmode=decimal]")

    def renew(self) -> PageText:
        """New machines, when the diagnosis has learned what they are like."""
        former = self.until(lambda said: said.clock_s > _LONG_S).clock_s
        self.click("New machines")
        self.until(lambda said: said.clock_s < former)
        return self.until(lambda said: said.supervised == "All actuators are believed sound.")


@contextmanager
def browsed() -> Iterator[Browser]:
    """A browser."""
    program = shutil.which("chromium")
    assert program, "Chromium is not installed: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        yield browser
        browser.close()


def live(folder: Path, *arguments: str) -> "subprocess.Popen[str]":
    """`fjh live` with these words."""
    return started("-m", "experiments", "live", *arguments, "--out", str(folder))


@contextmanager
def served(folder: Path, *arguments: str) -> "Iterator[tuple[subprocess.Popen[str], str]]":
    """The command and the address of its page, from when it is there to the end of the block."""
    process = live(folder, *arguments)
    try:
        assert process.stdout and process.stderr
        line = process.stdout.readline()
        matched = re.search(r"http://127\.0\.0\.1:\d+", line)
        assert matched, line + process.stderr.read()
        yield process, matched[0]
    finally:
        process.kill()
        process.communicate()


def free_port() -> int:
    """Where nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def listens(process: int) -> list[tuple[str, int]]:
    """Addresses and ports at which a process listens."""
    connections = psutil.Process(process).net_connections("inet")
    return [
        connection.laddr[:2]
        for connection in connections
        if connection.status == psutil.CONN_LISTEN
    ]
