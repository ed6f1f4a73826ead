"""Fixtures of the command as a process, and of its page in a headless browser."""

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

from tests.processes import start_python

FLAGS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)
SMALL: ViewportSize = {"width": 800, "height": 420}
"""Small window: without a graphics card rendering time is proportional to the pixels."""
_SELDOM = """
const next = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = draw => setTimeout(() => next(draw), {});
window.cancelAnimationFrame = clearTimeout;
"""
"""Script that limits the frame rate, so that the processor is free for the simulation."""
_PATIENCE_S = 120.0
_LONG_S = 3.0
"""Simulated time [s] after which new machines have a smaller time than the former ones."""
_TEXT_PATTERN = re.compile(
    r"([\d.]+) s, [\d.]+ of real time\n+State: (.*)\n+supervised [^\n]* RMS\n(.*)\n+"
    r"not supervised [^\n]* RMS\n.*\n+(?:(.*)\n+)?Error, %"
)


@dataclass(frozen=True)
class PageText:
    """Text of the page: time, active failures and events, diagnosis, and the last message."""

    clock_s: float
    active: str
    supervised: str
    last: str

    def diagnosed_kinds(self, actuator: str) -> list[str]:
        """Return the diagnosed kinds of failure of an actuator, such as free or weak."""
        matched = re.match(rf"{actuator} is ([\w ]+)", self.supervised, re.IGNORECASE)
        return matched[1].split(" or ") if matched else []


class BrowserPage:
    """Page in a browser, with the actions of a user."""

    def __init__(self, page: Page, url: str, picture_s: float = 1.0) -> None:
        """Open the page and wait until the machines move; `picture_s` is the time of a frame."""
        self.page = page
        page.set_default_timeout(1e3 * _PATIENCE_S)
        page.add_init_script(_SELDOM.format(round(1e3 * picture_s)))
        page.goto(url)
        self.until(lambda page_text: page_text.clock_s > 0)

    def until(self, holds: Callable[[PageText], bool]) -> PageText:
        """Wait until a condition holds for the page's text; return the text."""
        end = time.monotonic() + _PATIENCE_S
        while True:
            text = self.page.locator("body").inner_text()
            if matched := _TEXT_PATTERN.search(text):
                clock_s, active, supervised, last = matched.groups(default="")
                page_text = PageText(float(clock_s), active, supervised, last)
                if holds(page_text):
                    return page_text
            assert time.monotonic() < end, f"the page still says {text}"
            self.page.wait_for_timeout(50)

    def make(self, actuator: str, word: str) -> None:
        self.row_of(actuator).get_by_role("button", name=word, exact=True).click()

    def row_of(self, label: str) -> Locator:
        """Return the row with a label."""
        name = self.page.get_by_text(label, exact=True)
        return name.locator("xpath=ancestor::div[.//button or .//input][1]")

    def click(self, button: str) -> None:
        self.page.get_by_role("button", name=button, exact=True).click()

    def tick(self, box: str) -> None:
        self.page.get_by_label(box, exact=True).click()

    def field(self, slider: str) -> Locator:
        return self.row_of(slider).locator("input[inputmode=decimal]")

    def renew(self) -> PageText:
        """Replace the machines and wait until the diagnosis has learned them."""
        former = self.until(lambda page_text: page_text.clock_s > _LONG_S).clock_s
        self.click("New machines")
        self.until(lambda page_text: page_text.clock_s < former)
        return self.until(
            lambda page_text: page_text.supervised == "All actuators are assumed healthy."
        )


@contextmanager
def browsed() -> Iterator[Browser]:
    """Start a browser."""
    program = shutil.which("chromium")
    assert program, "Chromium is not installed: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        yield browser
        browser.close()


def live(folder: Path, *arguments: str) -> "subprocess.Popen[str]":
    """Start `fjh live` with these arguments."""
    return start_python("-m", "experiments", "live", *arguments, "--out", str(folder))


@contextmanager
def served(folder: Path, *arguments: str) -> "Iterator[tuple[subprocess.Popen[str], str]]":
    """Serve the page during the block; yield the process and the address."""
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
    """Return a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def listens(process: int) -> list[tuple[str, int]]:
    """Return addresses and ports at which a process listens."""
    connections = psutil.Process(process).net_connections("inet")
    return [
        connection.laddr[:2]
        for connection in connections
        if connection.status == psutil.CONN_LISTEN
    ]
