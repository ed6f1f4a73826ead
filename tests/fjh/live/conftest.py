"""What the tests of the page in a browser share."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from filelock import FileLock


@pytest.fixture(scope="module")
def alone(shared: Path) -> Iterator[None]:
    """One browser at a time: without a graphics card it takes a core for itself."""
    with FileLock(shared / "browser.lock"):
        yield
