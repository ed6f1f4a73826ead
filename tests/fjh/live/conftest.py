"""Fixtures of the tests of the page."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from filelock import FileLock

from fjh.live.page import LocalServer, Page
from tests.fjh.live.browser import free_port
from tests.fjh.rigs import shared_rig


@pytest.fixture(scope="module")
def alone(shared: Path) -> Iterator[None]:
    """Allow one browser at a time: without a graphics card it uses a whole core."""
    with FileLock(shared / "browser.lock"):
        yield


@pytest.fixture(scope="module")
def served_page(tmp_path_factory) -> Iterator[Page]:
    """Page of the hexapod, with its server in this process."""
    server = LocalServer(free_port())
    yield Page(server, shared_rig("hexapod"), tmp_path_factory.mktemp("out"), seed=0)
    server.stop()


@pytest.fixture
def page(served_page: Page) -> Page:
    """The served page with new machines."""
    served_page.session.restart()
    return served_page
