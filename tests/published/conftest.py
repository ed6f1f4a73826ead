from collections.abc import Callable
from pathlib import Path

import pytest

from tests.pages import run

PAGE = Path(__file__).parents[2] / "docs" / "validated.md"


@pytest.fixture(scope="session")
def authority() -> Callable[..., float]:
    """Return the function on the page that computes the control authority of a hexacopter."""
    return run(PAGE.read_text())["authority"]
