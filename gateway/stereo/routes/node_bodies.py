"""Request bodies and query values of the node routes."""

from __future__ import annotations

from typing import Any, Final

import msgspec
from fastapi import Request

from gateway.stereo.routes.rest_common import RestError, read_body

MAX_BODY: Final = 64 << 10
"""Maximum size of a body, bytes. All parameters of a node take about 2000."""
NUMBER_TEXT_LIMIT: Final = 64
"""Number of characters from which a query value is text: no number of a parameter is as long."""


class _ValueBody(msgspec.Struct):
    """Body that sets one parameter."""

    value: Any


class _Assignment(msgspec.Struct):
    """Entry of a body that sets several parameters."""

    name: str
    value: Any


class _CallBody(msgspec.Struct):
    """Body of a service call."""

    args: dict[str, Any] | None = None


_VALUE_DECODER: Final = msgspec.json.Decoder(_ValueBody)
_CALL_DECODER: Final = msgspec.json.Decoder(_CallBody)
_ASSIGNMENTS_DECODER: Final = msgspec.json.Decoder(list[_Assignment])


async def read_assignments(request: Request) -> list[tuple[str, object]]:
    """Return the parameter names and values in the query, followed by those in the body. Either may be empty.

    Raises:
        RestError: the body is malformed or too large.
    """
    body = await read_body(request, MAX_BODY)
    values: list[tuple[str, object]] = [(name, _query_value(text)) for name, text in request.query_params.multi_items()]
    if body:
        entries: list[_Assignment] = _decode(_ASSIGNMENTS_DECODER, body, '[{"name": "quality", "value": "High"}]')
        values += [(entry.name, entry.value) for entry in entries]
    return values


async def read_value(request: Request) -> object:
    """Return the value in the body, or in the query if there is no body.

    Raises:
        RestError: the body is malformed or too large, or there is no value.
    """
    body = await read_body(request, MAX_BODY)
    if not body and "value" in request.query_params:
        return _query_value(request.query_params["value"])
    content: _ValueBody = _decode(_VALUE_DECODER, body, '{"value": 1.0}')
    return content.value


async def check_call(request: Request) -> None:
    """Check the body of a service call. Its arguments are ignored, because no service has any.

    Raises:
        RestError: the body is malformed or too large.
    """
    if body := await read_body(request, MAX_BODY):
        _decode(_CALL_DECODER, body, '{"args": {}}')


def _query_value(text: str) -> object:
    """Return a query value as a boolean or number if it is one, else as text."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        return float(text) if len(text) < NUMBER_TEXT_LIMIT else text
    except ValueError:
        return text


def _decode(decoder: msgspec.json.Decoder[Any], body: bytes, example: str) -> Any:
    try:
        return decoder.decode(body)
    except msgspec.DecodeError as error:
        raise RestError(400, f"the body is not like {example}: {error}") from None
    except RecursionError:
        raise RestError(400, f"the body is not like {example}: it is nested too deep") from None
