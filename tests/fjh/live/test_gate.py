"""Tests that only the served page can use its buttons, and invalid messages have no effect."""

import socket
import time
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from fjh.live.page import Page


def connected(page: Page, origin: str | None, host: str = "127.0.0.1") -> ClientConnection:
    """Connect a client with a stated origin and host."""
    port = page._server.get_port()
    place = socket.create_connection(("127.0.0.1", port))
    stated = None if origin is None else Origin(origin.format(port=port))
    known = [Subprotocol(f"viser-v{viser.__version__}")]
    return connect(f"ws://{host}:{port}", sock=place, origin=stated, subprotocols=known)


@pytest.mark.parametrize(
    ("origin", "host"),
    [
        (None, "127.0.0.1"),
        ("null", "127.0.0.1"),
        ("http://example.org", "127.0.0.1"),
        ("http://127.0.0.1:1", "127.0.0.1"),
        ("https://127.0.0.1:{port}", "127.0.0.1"),
        ("http://127.0.0.1.example.org:{port}", "127.0.0.1"),
        ("http://localhost:{port}", "127.0.0.1"),
        ("http://example.org:{port}", "example.org"),
    ],
)
def test_page_of_another_origin_or_name_is_rejected(page, capfd, origin, host):
    with pytest.raises(InvalidStatus, match="403"):
        connected(page, origin, host)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_served_page_is_accepted(page, host):
    with connected(page, f"http://{host}:{{port}}", host) as client:
        assert client.recv(timeout=10)
        client.send(b"0" * 100_000)  # it only ends the connection
        with pytest.raises(ConnectionClosed):
            while True:
                client.recv(timeout=10)


CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage", "wxyz": (1, 0, 0, 0), "position": (0, 0, -3), "fov": 1.0,
    "near": 0.01, "far": 1000, "image_height": 420, "image_width": 800, "look_at": (0, 0, 0),
    "up_direction": (0, 0, 1),
}  # fmt: skip
NO_VALUES = (None, np.nan, np.inf, "x", [0.5] * 900, {"a": 1}, b"1", "free\0", [])


def updated(uuid: str, **updates: Any) -> dict[str, Any]:
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}


def test_invalid_values_are_rejected_and_values_beyond_a_range_clamped(page, capfd):
    """Elements of all kinds get invalid values of all kinds, then a valid click."""
    handles = page._server.gui._gui_input_handle_from_uuid
    group, weight, times = (
        next(uuid for uuid, h in handles.items() if getattr(h, "label", "") == label)
        for label in ("strut2", "W1 strut3", "Magnification")
    )
    former = {uuid: handle.value for uuid, handle in handles.items()}
    with connected(page, "http://127.0.0.1:{port}") as client:

        def send(message: Any) -> None:
            raw = message if isinstance(message, str | bytes) else msgspec.msgpack.encode(message)
            client.send(raw)

        for invalid in (
            *({"position": (np.nan, 0, 0)}, {"wxyz": (0, 0, 0, 0)}, {"fov": "wide"}),
            *({"image_height": 0}, {"look_at": (1, 2)}, {"position": (0, 0, 0)}, {"more": 1}, {}),
        ):
            send(CAMERA | invalid)
        for uuid in handles:
            for value in NO_VALUES:
                send(updated(uuid, value=value))
            for other in ("min", "update_cb", "is_button", "options", "nothing"):
                send(updated(uuid, **{other: 1}))
        for message in (
            *("text", b"", b"\xc1", [], {"type": "Nothing"}, {"type": "ShareUrlRequest"}),
            updated("nobody", value=1.0),
        ):
            send(message)
        send(updated(weight, value=-1))
        send(updated(times, value=1e300))
        send(updated(group, value="free"))
        until(page, lambda: page.session.states[1] == "free")
        until(page, lambda: page._stage.factor == handles[times].max)
        until(page, lambda: page.session.goal.joint_weight == (1.0, 1.0, 0.1, 1.0, 1.0, 1.0))
    changed = {uuid for uuid, handle in handles.items() if handle.value != former[uuid]}
    assert changed == {group, weight, times}
    page.show()
    assert handles[group].options == ("healthy", "lock", "● free", "weak")
    assert capfd.readouterr() == ("", "")


def until(page: Page, holds: Any) -> None:
    end = time.monotonic() + 20.0
    while not holds():
        assert time.monotonic() < end
        page.advance(0.001, until=np.inf)
        time.sleep(0.01)
