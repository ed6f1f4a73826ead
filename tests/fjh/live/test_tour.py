"""The films on the front page of the documentation play, and a page says what they show."""

import re
from pathlib import Path
from runpy import run_path

import numpy as np
import pytest

from fjh.rig.units import norms_said
from tests.fjh.live.browser import SMALL, browsed

DOCS = Path(__file__).parents[3] / "docs"
TOUR = run_path(str(DOCS / "_extensions" / "tour.py"))
ROWS = re.findall(r"^\| (?:arm|hexapod): (.*)\|$", (DOCS / "live.md").read_text(), re.MULTILINE)
BREAKS_S = 1.5


@pytest.mark.long
@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(("name", "row"), [*zip(TOUR["FILMS"], ROWS, strict=True)])
def test_a_film_plays_by_itself_and_a_page_says_what_was_flown(tmp_path, name, row):
    session = TOUR["film"](name, tmp_path)
    plays(tmp_path / f"{name}.html")
    for cell, flight in zip(row.split("|")[1:], session.flights, strict=True):
        after = flight.error(slice(round(BREAKS_S / session.rig.period_s), flight.tick))
        worst = after[np.linalg.norm(after, axis=1).argmax()]
        rms = np.sqrt((after**2).mean(axis=0))
        said = {norms_said(each, session.rig.row_units) for each in (rms, worst)}
        assert any(each in cell for each in said), (said, cell)
        if delay := re.search(r"named after ([\d.]+) s", cell):
            assert f"at {BREAKS_S + float(delay[1]):.3f} s" in flight.run(0).status


def plays(file: Path) -> None:
    """It moves, and asks nobody for anything."""
    asked, pictures = list[str](), set[bytes]()
    with browsed() as browser:
        context = browser.new_context(viewport=SMALL)
        context.set_offline(True)
        page = context.new_page()
        page.set_default_timeout(120_000)
        page.on("request", lambda request: asked.append(request.url))
        page.goto(file.as_uri())
        for _ in range(40):
            pictures.add(page.locator("canvas[data-engine]").screenshot())
            if len(pictures) > 2:
                break
            page.wait_for_timeout(200)
    assert len(pictures) > 2
    assert [url for url in asked if url.startswith(("http", "ws"))] == []
