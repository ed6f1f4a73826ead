"""Screenshot of the live page for the documentation: `python -m tools.live_picture FILE.png`."""

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import ViewportSize

from tests.fjh.live.browser import BrowserPage, browsed, free_port, served

SIZE: ViewportSize = {"width": 1400, "height": 900}
SINCE_S = 4.0
"""Simulated time between failure and screenshot [s]."""


def main(file: Path) -> None:
    """Write the picture of a hexapod whose strut 1 becomes free."""
    with (
        browsed() as browser,
        tempfile.TemporaryDirectory() as out,
        served(Path(out), "--port", str(free_port())) as (_, url),
    ):
        page = BrowserPage(browser.new_page(viewport=SIZE), url)
        # Close the notice that the browser draws without a graphics card.
        notice = page.page.get_by_role("alert").filter(has_text="Software WebGL")
        notice.get_by_role("button").click()
        start = page.until(lambda text: "assumed healthy" in text.supervised).clock_s
        page.make("strut1", "free")
        page.until(lambda text: text.clock_s > start + SINCE_S)
        page.page.screenshot(path=file)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
