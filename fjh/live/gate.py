"""Access control of the live page: checks of connections and of browsers' messages.

In a browser any page can open a WebSocket to this computer. The browser states that page in
`Origin`, and in `Host` the requested address, which can be a foreign name for 127.0.0.1 (DNS
rebinding). Both must be those of the page that is served here. viser 1.1 checks neither, nor
messages. Therefore its `websockets` server gets a connection class that checks handshake and
messages first.
"""

import logging
from collections.abc import Callable
from functools import partial
from math import isfinite
from typing import Any, Literal

import msgspec
import viser
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

NOW = "● "
"""Prefix of the button of an actuator's present state."""
_LARGEST_MESSAGE = 1 << 16
_FARTHEST = 1e9
"""Largest accepted coordinate of a camera."""

_LOGGER = logging.getLogger(__name__)
"""Logger for errors of connections, without output in the terminal."""
_LOGGER.addHandler(logging.NullHandler())
_LOGGER.propagate = False


class _Value(msgspec.Struct, tag="GuiUpdateMessage", forbid_unknown_fields=True):
    """Message that an element of the page has another value, or was clicked."""

    uuid: str
    updates: dict[Literal["value"], bool | int | float | str]


class _Camera(msgspec.Struct, tag="ViewerCameraMessage", forbid_unknown_fields=True):
    """Message with the camera of a browser."""

    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up_direction: tuple[float, float, float]
    fov: float
    near: float
    far: float
    image_height: int
    image_width: int


def guarded(server: viser.ViserServer, started: list[bool]) -> Callable[..., Any]:
    """Return a function that serves a viser server with checks; each call appends to `started`."""

    def start(*arguments: Any, process_request: Any, **others: Any) -> serve:
        started.append(True)

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            port = connection.local_address[1]
            if not is_same_origin(request.headers, port):
                only = f"Only the page at http://127.0.0.1:{port} can connect.\n"
                return connection.respond(403, only)
            return process_request(connection, request)

        checks = {"logger": _LOGGER, "max_size": _LARGEST_MESSAGE}
        checks |= {"create_connection": partial(_Connection, server), "process_request": answer}
        return serve(*arguments, **others | checks)

    return start


def is_same_origin(headers: Headers, port: int) -> bool:
    """Return whether a request is for the page at a port; if for a WebSocket, also from it."""
    end = "" if port == 80 else f":{port}"
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if hosts not in ([f"127.0.0.1{end}"], [f"localhost{end}"]):
        return False
    return origins == [f"http://{hosts[0]}"] or not (origins or "Upgrade" in headers)


class _Connection(ServerConnection):
    """Connection of a browser that passes only valid messages to viser."""

    def __init__(self, server: viser.ViserServer, *arguments: Any, **others: Any) -> None:
        super().__init__(*arguments, **others)
        self._server = server

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next valid message."""
        while True:
            raw = await super().recv(decode)
            try:
                if (message := sane(self._server, raw)) is not None:
                    return message
            except msgspec.MsgspecError:  # the page sends no such message
                continue


def sane(server: viser.ViserServer, raw: Any) -> bytes | None:
    """Return a browser's message, checked and limited, for viser; None if it is invalid.

    A value must fit an existing element: a number (clamped to the slider's range), a label of a
    choice, or a Boolean. A camera must have finite coordinates and a view.

    Raises:
        msgspec.MsgspecError: The message is of another kind, or malformed.
    """
    if not isinstance(raw, bytes):
        return None
    message = msgspec.msgpack.decode(raw, type=_Value | _Camera)
    if isinstance(message, _Camera):
        vectors = (message.wxyz, message.position, message.look_at, message.up_direction)
        numbers = (*(x for v in vectors for x in v), message.fov, message.near, message.far)
        has_view = all(map(any, (message.wxyz, message.up_direction)))
        has_view = has_view and message.position != message.look_at
        has_view = has_view and min(message.image_height, message.image_width) > 0
        return raw if has_view and all(abs(x) < _FARTHEST for x in numbers) else None
    handle = server.gui._gui_input_handle_from_uuid.get(message.uuid)
    value = message.updates.get("value")
    if isinstance(handle, viser.GuiSliderHandle):
        if isinstance(value, bool | str | None) or not isfinite(value):
            return None
        value = min(max(value, handle.min), handle.max)
    elif isinstance(handle, viser.GuiButtonGroupHandle | viser.GuiDropdownHandle):
        labels = [str(option).removeprefix(NOW) for option in handle.options]
        value = value.removeprefix(NOW) if isinstance(value, str) else None
        if value not in labels:
            return None
    elif handle is None or not isinstance(value, bool):
        return None
    return msgspec.msgpack.encode(_Value(message.uuid, {"value": value}))
