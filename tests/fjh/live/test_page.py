"""The page in a browser: each of its elements does what it says, and the page says what came of it.

Of a failure that is seen for a moment a pilot may name two kinds, such as "free or weak"; the one
that happened is among them.
"""

import io
import json
from collections.abc import Iterator

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from playwright.sync_api import Browser

from fjh.live.stage import COLORS
from fjh.recording.properties import properties_of
from tests.fjh.live.browser import SMALL, Seen, Served, browsed, free_port, served

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("alone")]
STRUTS = [
    pytest.param(f"strut{k}", marks=() if k in (1, 4) else pytest.mark.night) for k in range(1, 7)
]
"""Of those that were free, 3 and 6 are not always given back (docs/live.md)."""
KINDS = {"weak": "weak", "lock": "locked", "free": "free"}
"""Each of new machines: one kind after another of the same strut is not always told apart."""
SOUND = "All actuators are believed sound"
HAPPENS = {
    "Hum": "a sinusoid of 20 Hz",
    "Stuck sensor": "one row stays as it is",
    "Sagging supply": "all inputs times 0.8",
}


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with browsed() as one:
        yield one


@pytest.fixture(scope="module")
def hexapod(tmp_path_factory) -> Iterator[Served]:
    """The command for all tests that do not end it."""
    with served(tmp_path_factory.mktemp("live") / "out", "--port", str(free_port())) as command:
        yield command


@pytest.fixture(scope="module")
def page(browser, hexapod) -> Seen:
    return Seen(browser.new_page(viewport=SMALL), hexapod.url)


@pytest.mark.parametrize("strut", STRUTS)
def test_a_strut_that_breaks_is_named_and_when_it_is_repaired_all_is_sound(page, strut):
    for word, kind in KINDS.items():
        page.renew()
        page.make(strut, word)
        said = page.until(lambda said, kind=kind: kind in said.named(strut))
        assert said.happens == f"{strut} {kind}"
        page.beside(strut).get_by_role("button", name=f"● {word}", exact=True).wait_for()
    page.make(strut, "sound")
    assert page.until(lambda said: said.supervised.startswith(SOUND)).happens == "all is sound"


@pytest.mark.parametrize("box", HAPPENS)
def test_a_disturbance_is_said_as_long_as_it_lasts(page, box):
    page.renew()
    page.tick(box)
    said = page.until(lambda said: HAPPENS[box] in said.happens)
    assert said.supervised.startswith(SOUND)
    if box == "Stuck sensor":
        held = page.until(lambda said: "repeats one value" in said.supervised)
        assert "the commands are held" in held.supervised
    page.tick(box)
    page.until(lambda said: said.happens == "all is sound")


def test_a_bump_is_said(page):
    page.renew()
    page.click("Bump")
    page.until(
        lambda said: (
            said.last == "Bumped: 5/54 of the payload's weight for 5 ms, 5 N on the hexapod."
        )
    )


def test_diagnosis_goes_off_and_on(page):
    page.renew()
    page.tick("Diagnosis")
    page.until(lambda said: said.supervised.startswith("Does not diagnose"))
    page.tick("Diagnosis")
    page.until(lambda said: said.supervised.startswith(SOUND))


def test_each_path_is_flown(page):
    """Steps are far from what a machine can follow; at rest the noise of the sensors is left."""
    page.renew()
    circle = page.until(lambda said: said.clock_s > 2.5).errors[0]
    page.choose("Path", "steps")
    page.until(lambda said: said.errors[0] > 3 * circle)
    page.choose("Path", "rest")
    page.until(lambda said: said.errors[0] < 0.3 * circle)
    page.choose("Path", "spiral")
    page.until(lambda said: 0.3 * circle < said.errors[0] < 3 * circle)
    page.choose("Path", "circle")


def test_magnified_motion_is_seen_as_larger(page):
    """By the area that the path of the supervised machine takes up."""
    page.close_notice()
    page.renew()
    page.until(lambda said: said.clock_s > 4.0)
    wide = extent(page)
    page.write("motion times", 10000)
    page.until(lambda _: extent(page) > 1.5 * wide)


def extent(page: Seen) -> float:
    """How many pixels the path of the supervised machine is across."""
    picture = Image.open(io.BytesIO(page.page.locator("canvas").first.screenshot())).convert("RGB")
    near = np.abs(np.asarray(picture) - 255 * np.array(to_rgb(COLORS[0]))).max(axis=2) < 40
    columns = np.flatnonzero(near[:, : SMALL["width"] // 2].any(axis=0))
    assert len(columns)
    return float(np.ptp(columns)) + 1.0


def test_a_saved_minute_is_where_the_page_says_and_holds_what_happened(page, hexapod):
    page.renew()
    page.make("strut3", "lock")
    page.until(lambda said: "strut3" in said.supervised)
    page.click("Save the last minute")
    said = page.until(lambda said: "live_1.rrd" in said.last).last
    file = hexapod.folder / "live_1.rrd"
    assert said.endswith(f"are in {file}.") and [*hexapod.folder.iterdir()] == [file]
    stated = json.loads(properties_of(file)["flight"])
    assert [(each["actuator"], each["kind"]) for each in stated["incidents"]] == [
        ("strut3", "locked")
    ]
    assert stated["diagnoses"] and stated["diagnoses"][0]["actuator"] == "strut3"


def test_two_pages_see_the_same_and_one_goes_on_when_the_other_is_closed(browser, hexapod, page):
    """What is clicked on one shows on the other, the elements too."""
    page.renew()
    other = Seen(browser.new_page(viewport=SMALL), hexapod.url, picture_s=10.0)
    other.make("strut2", "free")
    for each in (page, other):
        each.until(lambda said: said.supervised.startswith("strut2 is free"))
    other.page.get_by_text("Weights: what a motion costs").click()
    other.write("W1 strut5", 7.5)
    page.page.get_by_text("Weights: what a motion costs").click()
    field = page.beside("W1 strut5").locator("input[inputmode=decimal]")
    page.until(lambda _: field.input_value() == "7.5")
    other.page.close()
    begin = page.until(lambda _: True).clock_s
    page.until(lambda said: said.clock_s > begin + 0.5)
    page.make("strut2", "sound")
    page.until(lambda said: said.happens == "all is sound" and said.supervised.startswith(SOUND))
