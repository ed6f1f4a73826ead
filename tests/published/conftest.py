from pathlib import Path
from typing import Any

import pytest

from tests.pages import run

DOCS = Path(__file__).parents[2] / "docs" / "published"


@pytest.fixture(scope="module")
def page(request) -> dict[str, Any]:
    """Return the names defined by the script of a page, which prints the numbers of the page."""
    name = request.path.stem.removeprefix("test_").replace("_", "-")
    return run((DOCS / f"{name}.md").read_text())


@pytest.fixture(scope="module")
def authority(page) -> Any:
    """Return the function of a page on multirotors."""
    return page["authority"]
