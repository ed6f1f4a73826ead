"""What the tests of the page share."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from filelock import FileLock

from fjh.live.page import LocalServer, Page
from tests.fjh.live.browser import free_port
from tests.fjh.rigs import rig


@pytest.fixture(scope="module")
def alone(shared: Path) -> Iterator[None]:
    """One browser at a time: without a graphics card it takes a core for itself."""
    with FileLock(shared / "browser.lock"):
        yield


@pytest.fixture(scope="module")
def served_page(tmp_path_factory) -> Iterator[Page]:
    """A page of the hexapod, with its server in this process."""
    server = LocalServer(free_port())
    yield Page(server, rig("hexapod"), tmp_path_factory.mktemp("out"), seed=0)
    server.stop()


@pytest.fixture
def page(served_page: Page) -> Page:
    """That, its machines new."""
    served_page.session.restart()
    return served_page
