"""Responses of Director's protocol, with additional fields for the reasons of failed commands."""

from typing import Final

import msgspec

from gateway.adapters.treeviewer.requests import Finding
from gateway.scene.tree.nodes import Path
from scenegate.messages import wire
from scenegate.messages.clicks import Click
from scenegate.messages.controls import Value

SUPPORTED_FORMATS: Final = {name: [f"{wire.VERSION[0]}.{wire.VERSION[1]}"] for name in (wire.JSON, wire.BINARY)}


class Response(msgspec.Struct, omit_defaults=True):
    """Response to a request. The first six fields are those of Director."""

    timestamp: int
    """``utime`` of the request's LCM message. The timestamp in the message's data is ignored."""
    status: int
    deleted_paths: list[Path]
    added_geometries: list[Path]
    set_transforms: list[Path]
    missing_paths: list[Path]
    error: str = ""
    """The first error in one sentence, and the number of other errors."""
    errors: list[Finding] = []
    warnings: list[str] = []
    newer_commands: list[str] = []
    """Names of the request's commands that Director does not have, as a sign that this viewer knows them."""


class FormatResponse(msgspec.Struct):
    """Response to a request in an unknown format or version."""

    timestamp: int
    status: int
    supported_formats: dict[str, list[str]]


class ClickMessage(msgspec.Struct):
    """A click in a page, sent on the client's response channel. Clients that do not know it see a response to nothing.

    The fields of ``click`` are those of ``scenegate.messages.clicks.Click``.
    """

    click: Click
    timestamp: int = 0
    status: int = wire.OK


class ControlValue(msgspec.Struct):
    """Value of a control of the page."""

    path: Path
    value: Value


class ControlsMessage(msgspec.Struct):
    """New values of a client's controls, sent on its response channel."""

    controls: list[ControlValue]
    after: int
    """``utime`` of the client's last request with controls or values that was executed before."""
    timestamp: int = 0
    status: int = wire.OK


class ReadyMessage(msgspec.Struct):
    """Announcement that the viewer has started. Director's tests wait for it."""

    timestamp: int = 0
    status: int = wire.OK
    ready: bool = True


AnyResponse = Response | FormatResponse
PageMessage = ClickMessage | ControlsMessage
AnyMessage = AnyResponse | ReadyMessage | PageMessage

_json: Final = msgspec.json.Encoder()
_msgpack: Final = msgspec.msgpack.Encoder()


def encode(response: AnyMessage, message_format: str = wire.JSON) -> bytes:
    """Return a response as LCM message in the format of its request; in JSON if the viewer does not know the format."""
    if message_format == wire.BINARY:
        return wire.encode(_msgpack.encode(response), name=wire.BINARY)
    return wire.encode(_json.encode(response))


def failed(utime: int, reason: str) -> Response:
    """Return the response to a request of which no command was executed."""
    return Response(utime, wire.ERROR_HANDLING_REQUEST, [], [], [], [], error=reason)
