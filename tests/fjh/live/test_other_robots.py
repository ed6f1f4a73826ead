"""The page of an arm and of a hand, apart: each robot has the processor for itself."""

import pytest

from sim import MODELS
from tests.fjh.live.browser import SMALL, Seen, browsed, free_port, served

SOUND = "All actuators are believed sound"


@pytest.mark.long
@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    ("robot", "words", "broken"),
    [
        ("arm", ("--site", "payload", "--major", "3,4,5"), 3),
        ("hand", ("--major", "3,4"), 0),
    ],
)
def test_an_actuator_of_another_robot_that_locks_is_named(tmp_path, robot, words, broken):
    file = str(MODELS / f"{robot}.xml")
    serving = served(tmp_path / "out", file, *words, "--port", str(free_port()))
    with serving as command, browsed() as browser:
        page = Seen(browser.new_page(viewport=SMALL), command.url)
        page.until(lambda said: said.supervised.startswith(SOUND))
        actuator = page.actuators[broken]
        page.make(actuator, "lock")
        said = page.until(lambda said: "locked" in said.named(actuator))
        assert said.happens == f"{actuator} locked"
        page.page.close()
    assert not (tmp_path / "out").exists()
