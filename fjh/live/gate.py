"""Who may connect to the page, and which of a browser's messages count.

A browser lets any page open a WebSocket to this machine, and names that page in `Origin`; it names
in `Host` the address that it was told, also where that is a stranger's name for 127.0.0.1 (DNS
rebinding). Both have to be those of the page that is served here. viser 1.1 has no hook for either
and trusts every message, so the server of `websockets` that it starts is given its connections:
one class that answers the handshake and reads the messages, before viser does.
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
"""Stands before what an actuator is at present, on its button."""
_LARGEST_MESSAGE = 1 << 16
_FARTHEST = 1e9
"""Coordinate of a camera."""

_LOGGER = logging.getLogger(__name__)
"""Of what goes wrong with a connection, which is the browser's affair: the terminal stays clean."""
_LOGGER.addHandler(logging.NullHandler())
_LOGGER.propagate = False


class _Value(msgspec.Struct, tag="GuiUpdateMessage", forbid_unknown_fields=True):
    """An element of the page has another value, or was clicked."""

    uuid: str
    updates: dict[Literal["value"], bool | int | float | str]


class _Camera(msgspec.Struct, tag="ViewerCameraMessage", forbid_unknown_fields=True):
    """Where this browser looks from."""

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
    """What begins to listen for a server of viser; `started` grows when it is called."""

    def start(*arguments: Any, process_request: Any, **others: Any) -> serve:
        started.append(True)

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            port = connection.local_address[1]
            if not is_same_origin(request.headers, port):
                return connection.respond(403, f"Only the page at http://127.0.0.1:{port} may.\n")
            return process_request(connection, request)

        own = {"logger": _LOGGER, "max_size": _LARGEST_MESSAGE}
        own |= {"create_connection": partial(_Connection, server), "process_request": answer}
        return serve(*arguments, **others | own)

    return start


def is_same_origin(headers: Headers, port: int) -> bool:
    """Whether a request is to the page that is served at a port, and a WebSocket from that page."""
    end = "" if port == 80 else f":{port}"
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if hosts not in ([f"127.0.0.1{end}"], [f"localhost{end}"]):
        return False
    return origins == [f"http://{hosts[0]}"] or not (origins or "Upgrade" in headers)


class _Connection(ServerConnection):
    """One from a browser, of which viser sees the messages that count."""

    def __init__(self, server: viser.ViserServer, *arguments: Any, **others: Any) -> None:
        super().__init__(*arguments, **others)
        self._server = server

    async def recv(self, decode: bool | None = None) -> Any:
        """The next message that counts."""
        while True:
            raw = await super().recv(decode)
            try:
                if (taken := sane(self._server, raw)) is not None:
                    return taken
            except msgspec.MsgspecError:  # not of the page, which sends nothing else
                continue


def sane(server: viser.ViserServer, raw: Any) -> bytes | None:
    """A message of a browser as viser may have it; None: it does not count.

    Of an element that the page has, a value of its kind: a number within the range of its slider,
    to which larger ones are clamped, a word that can be chosen, or yes or no. Of a camera finite
    places from which something is seen.

    Raises:
        msgspec.MsgspecError: It is of another kind, or broken.
    """
    if not isinstance(raw, bytes):
        return None
    message = msgspec.msgpack.decode(raw, type=_Value | _Camera)
    if isinstance(message, _Camera):
        places = (message.wxyz, message.position, message.look_at, message.up_direction)
        numbers = (*(x for place in places for x in place), message.fov, message.near, message.far)
        seen = all(map(any, (message.wxyz, message.up_direction)))
        seen = seen and message.position != message.look_at
        seen = seen and min(message.image_height, message.image_width) > 0
        return raw if seen and all(abs(x) < _FARTHEST for x in numbers) else None
    handle = server.gui._gui_input_handle_from_uuid.get(message.uuid)
    value = message.updates.get("value")
    if isinstance(handle, viser.GuiSliderHandle):
        if isinstance(value, bool | str | None) or not isfinite(value):
            return None
        value = min(max(value, handle.min), handle.max)
    elif isinstance(handle, viser.GuiButtonGroupHandle | viser.GuiDropdownHandle):
        words = [str(each).removeprefix(NOW) for each in handle.options]
        value = value.removeprefix(NOW) if isinstance(value, str) else None
        if value not in words:
            return None
    elif handle is None or not isinstance(value, bool):
        return None
    return msgspec.msgpack.encode(_Value(message.uuid, {"value": value}))
