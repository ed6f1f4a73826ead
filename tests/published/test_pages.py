"""Pages of other people's numbers are short, are on the site, and say what checks them."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "published").iterdir())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_short_is_on_the_site_and_names_its_test(page):
    text = page.read_text()
    assert len(text.splitlines()) <= 60
    assert f"<published/{page.stem}>" in (ROOT / "docs" / "index.md").read_text()
    (checked,) = re.findall(r"`(tests/published/test_\w+\.py)`", text)
    assert (ROOT / checked).is_file()
    assert "**Source.**" in text and "**Result.**" in text
