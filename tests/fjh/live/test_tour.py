"""The tour: one small file that plays without network on a phone, and says what was flown."""

import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page

from fjh.live.course import course
from fjh.live.tour import TOUR, write_tour
from fjh.rig.events import Event
from fjh.rig.mjcf import rig_of
from sim import Failure, FailureKind
from tests.fjh.live.browser import browsed

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("alone")]

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
BREAKS_S, ENDS_S = 1.5, 4.5
KINDS: dict[str, FailureKind] = {"Lock": "locked", "No force": "free"}
"""Of actuators; a stuck sensor is an event."""
ONES = {"µrad": 1e-6, "mrad": 1e-3, "µm": 1e-6, "mm": 1e-3}
LIVE = Path(__file__).parents[3] / "docs" / "live.md"


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("tour") / "tour.html"
    write_tour(place)
    return place


@pytest.fixture(scope="module")
def phone(file) -> Iterator[Page]:
    """The page on a phone that reaches nobody; what it asked for is in `asked`."""
    with browsed() as browser:
        context = browser.new_context(**PHONE)
        context.set_offline(True)
        page = context.new_page()
        page.set_default_timeout(120_000)
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: asked.append(f"http error {error}"))
        page.goto(file.as_uri())
        yield page


asked: list[str] = []


def chosen(page: Page, number: int) -> str:
    """The words below the picture after a touch of the button of a stop."""
    page.locator(f"nav button[value='{number}']").tap()
    return page.locator("article:visible").inner_text()


def picture(page: Page) -> bytes:
    canvas = page.frame_locator("iframe").locator("canvas[data-engine]")
    canvas.wait_for()
    return canvas.screenshot()


def test_the_tour_is_below_5_mb(file):
    assert file.stat().st_size < 5e6


def test_every_kind_of_failure_is_a_button(phone):
    failing, disturbing = ("Lock", "No force", "Half force", "Loose"), ("Bump", "Hum")
    buttons = phone.locator("nav button").all_inner_texts()
    assert set(buttons) == {*failing, *disturbing, "Stuck sensor", "Sagging supply"}
    assert len(buttons) == len(TOUR)


@pytest.mark.parametrize("number", [0, 6])
def test_a_touch_of_a_button_shows_its_words_and_no_others(phone, number):
    words = chosen(phone, number)
    assert words.splitlines()[0].split(",")[0] == TOUR[number].happening
    assert "What the supervisor said" in words and "RMS error after" in words
    assert phone.locator("article:visible").count() == 1


def test_a_button_is_large_enough_for_a_thumb_and_the_page_fits_a_phone(phone):
    boxes = [button.bounding_box() for button in phone.locator("nav button").all()]
    assert all(box and box["height"] >= 44 and box["width"] >= 44 for box in boxes)
    assert phone.evaluate("document.documentElement.scrollWidth") <= PHONE["viewport"]["width"]


@pytest.mark.parametrize("number", [0, 7])
def test_the_picture_moves_and_begins_again(phone, number):
    """It plays without a touch; its clock runs, and goes back after the end."""
    chosen(phone, number)
    first = picture(phone)
    clock = phone.frame_locator("iframe").locator("input").first
    times_s, pictures = list[float](), {first}
    for _ in range(40):
        times_s.append(float(clock.input_value()))
        pictures.add(picture(phone))
        if len(pictures) > 2 and (np.diff(times_s) < 0).any():
            break
        phone.wait_for_timeout(200)
    assert len(pictures) > 2
    assert (np.diff(times_s) < 0).any()


def test_it_asks_for_nothing_but_itself(phone, file):
    """The browser is offline, and no address of another host was tried."""
    chosen(phone, 5)
    picture(phone)
    assert asked and asked[0] == file.as_uri()
    assert [each for each in asked if each.startswith(("http", "ws", "//"))] == []


def written(file: Path, number: int) -> str:
    """The words of a stop, as the file has them: a line for each element."""
    article = file.read_text().split("<article")[1 + number].split("</article>")[0]
    lines = re.sub(r"<tr>", "\n", re.sub(r"</t[dh]><t[dh]>", "\t", article))
    return unescape(re.sub(r"<[^>]*>", "", lines))


def sizes(said: str) -> np.ndarray:
    """Numbers with units, in [rad] or [m]."""
    found = re.findall(r"([\d.]+) ([µm](?:rad|m))\b", said)
    return np.array([float(number) * ONES[unit] for number, unit in found])


def flown(stop: Any, of: str | None, supervised: bool) -> Any:
    """The same by a plan: the errors (N, m1) of a flight, and its run."""
    rig = rig_of(stop.model, stop.options)
    path, _ = course(rig, "circle").at(np.arange(round((ENDS_S + 1.0) / rig.period_s)))
    pilot = rig.supervisor() if supervised else rig.controller()
    failures = [Failure(rig.number(of), KINDS[stop.happening], BREAKS_S)] if of else []
    events = [] if of else [Event("stuck", BREAKS_S)]
    run = rig.fly(pilot, path, failures=failures, events=events, seed=0)
    return (path - run.true)[: round(ENDS_S / rig.period_s)], run


@pytest.mark.parametrize("number", [0, 1, 7])
def test_the_numbers_are_those_of_flights_that_were_planned(file, number):
    """To the three digits that are shown: before, from then on, at most."""
    stop, words = TOUR[number], written(file, number)
    of = re.search(r"Lock, (\w+)", words)
    for column, supervised in enumerate((True, False)):
        errors, run = flown(stop, of and of[1], supervised)
        size, breaks = np.linalg.norm(errors, axis=1), round(BREAKS_S * 1000)
        expected = {
            "RMS error before": np.sqrt((size[500:breaks] ** 2).mean()),
            "RMS error after": np.sqrt((size[breaks:] ** 2).mean()),
            "largest after": size[breaks:].max(),
        }
        for name, each in expected.items():
            (row,) = (line for line in words.splitlines() if line.startswith(name))
            np.testing.assert_allclose(sizes(row)[column], each, rtol=6e-3, err_msg=name)
        if supervised and run.diagnoses:
            assert f"{run.diagnoses[0]}" in words


def test_the_page_of_the_command_says_what_the_tour_measured(file):
    """Its table: each number stands in the words of that stop."""
    table = re.findall(r"^\| (?:arm|hexapod): .*$", LIVE.read_text(), re.MULTILINE)
    assert len(table) == 3
    for row, number in zip(table, (0, 7, 1), strict=True):
        words = written(file, number)
        for said in re.findall(r"[\d.]+ [µm](?:rad|m)\b", row.replace("a radius of 1.1 mm", "")):
            assert said in words, (said, words)
        if delay := re.search(r"named after ([\d.]+) s", row):
            assert f"at {BREAKS_S + float(delay[1]):.3f} s" in words
