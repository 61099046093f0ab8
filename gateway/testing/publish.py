"""Send one request to the tree viewer over TCPQ, with the standard library only."""

from __future__ import annotations

import json
import re
import socket
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from gateway.runtime.regular_files import read_regular
from gateway.treeviewer import wire

_GREETING: Final = struct.pack(">II", 0x287617FB, 0x0100)
"""The greeting of a TCPQ client: magic number and protocol version (lcm/lcm_tcpq.c)."""
_PUBLISH: Final = 1
"""TCPQ message that publishes on a channel."""
_SUBSCRIBE: Final = 2
"""TCPQ message that subscribes to channels by a regular expression."""
_CLIENT_ID: Final = "scenegate-testing"
_REQUEST: Final = f"DIRECTOR_TREE_VIEWER_REQUEST_<{_CLIENT_ID}>"
_RESPONSE: Final = f"DIRECTOR_TREE_VIEWER_RESPONSE_<{_CLIENT_ID}>"
_IDENTITY: Final = {"translation": [0, 0, 0], "quaternion": [1, 0, 0, 0]}


def publish(url: str, request: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Send a request and return its response.

    Args:
        url: ``tcpq://host:port``.
        seconds: Maximum time to wait for data.

    Raises:
        RuntimeError: The response has a negative status, or the gateway closed the connection.
    """
    parts = urlsplit(url)
    with socket.create_connection((parts.hostname or "127.0.0.1", parts.port or 7700), timeout=seconds) as hub:
        received = hub.makefile("rb")
        pattern, channel = re.escape(_RESPONSE).encode(), _REQUEST.encode()
        message = wire.encode(json.dumps({"utime": 0, **request}).encode())
        hub.sendall(_GREETING + struct.pack(">II", _SUBSCRIBE, len(pattern)) + pattern)
        hub.sendall(struct.pack(">II", _PUBLISH, len(channel)) + channel + struct.pack(">I", len(message)) + message)
        _read_exactly(received, len(_GREETING))
        _, channel_bytes = struct.unpack(">II", _read_exactly(received, 8))
        _read_exactly(received, channel_bytes)
        (message_bytes,) = struct.unpack(">I", _read_exactly(received, 4))
        response: dict[str, Any] = json.loads(bytes(wire.decode(_read_exactly(received, message_bytes)).data))
        received.close()
    if response["status"] < 0:
        raise RuntimeError(f"the gateway rejected a request: {response.get('error', response)}")
    return response


def scene_request(path: Path) -> dict[str, Any]:
    """Return the request that publishes a file: the content of a ``.json`` file, else a mesh at the path ``scene``."""
    if path.suffix == ".json":
        request: dict[str, Any] = json.loads(read_regular(path))
        return request
    geometry = {"type": "mesh_file", "filename": str(path.resolve())}
    return {
        "setgeometry": [{"path": ["scene"], "geometry": geometry}],
        "settransform": [{"path": ["scene"], "transform": _IDENTITY}],
    }


def _read_exactly(file: Any, count: int) -> bytes:
    data = file.read(count)
    if len(data) != count:
        raise RuntimeError("the gateway closed the connection")
    return bytes(data)
