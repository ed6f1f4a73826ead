"""Screenshots of the live page for the documentation: `python -m tools.live_pictures FOLDER`."""

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import ViewportSize

from fjh.rig import Rig
from sim import MODELS
from tests.fjh.live.browser import BrowserPage, browsed, free_port, served

SIZE: ViewportSize = {"width": 1400, "height": 900}
SINCE_S = 4.0
"""Simulated time between failure and screenshot [s]."""
ARM = (str(MODELS / "arm.xml"), "--site", "payload", "--major", "3,4,5")
ELBOW = Rig.of_mjcf(ARM[0], major=[3, 4, 5]).actuators[3]
PICTURES = {"live": ((), "strut1", "free"), "live_arm": (ARM, ELBOW, "lock")}
"""Arguments of the command, actuator and failure, by the name of the picture."""


def main(folder: Path) -> None:
    """Write all screenshots to a folder."""
    with browsed() as browser, tempfile.TemporaryDirectory() as out:
        for name, (arguments, actuator, fault) in PICTURES.items():
            with served(Path(out), *arguments, "--port", str(free_port())) as (_, url):
                page = BrowserPage(browser.new_page(viewport=SIZE), url)
                # Close the notice that the browser draws without a graphics card.
                notice = page.page.get_by_role("alert").filter(has_text="Software WebGL")
                notice.get_by_role("button").click()
                start = page.until(lambda text: "assumed healthy" in text.supervised).clock_s
                page.make(actuator, fault)
                page.until(lambda text, end=start + SINCE_S: text.clock_s > end)
                page.page.screenshot(path=folder / f"{name}.png")
                page.page.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
