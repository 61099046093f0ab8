"""One request to the tree viewer over TCPQ and its answer, with the standard library alone."""

from __future__ import annotations

import json
import re
import socket
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from gateway.treeviewer import wire

_SECONDS: Final = 60.0
_HELLO: Final = struct.pack(">II", 0x287617FB, 0x0100)
"""TCPQ's, of a client (lcm/lcm_tcpq.c)."""
_CLIENT: Final = "scenegate-testing"
_REQUEST: Final = f"DIRECTOR_TREE_VIEWER_REQUEST_<{_CLIENT}>"
_RESPONSE: Final = f"DIRECTOR_TREE_VIEWER_RESPONSE_<{_CLIENT}>"
_IDENTITY: Final = {"translation": [0, 0, 0], "quaternion": [1, 0, 0, 0]}


def publish(url: str, request: Mapping[str, Any]) -> dict[str, Any]:
    """Sends a request and waits for the answer.

    Args:
        url: ``tcpq://host:port``.

    Raises:
        RuntimeError: the answer's status is negative; with its reason.
    """
    parts = urlsplit(url)
    with socket.create_connection((parts.hostname or "127.0.0.1", parts.port or 7700), timeout=_SECONDS) as hub:
        file = hub.makefile("rb")
        pattern, channel = re.escape(_RESPONSE).encode(), _REQUEST.encode()
        message = wire.encode(json.dumps({"utime": 0, **request}).encode())
        hub.sendall(_HELLO + struct.pack(">II", 2, len(pattern)) + pattern)
        hub.sendall(struct.pack(">II", 1, len(channel)) + channel + struct.pack(">I", len(message)) + message)
        _exactly(file, 8)
        _, length = struct.unpack(">II", _exactly(file, 8))
        _exactly(file, length)
        (size,) = struct.unpack(">I", _exactly(file, 4))
        answer: dict[str, Any] = json.loads(bytes(wire.decode(_exactly(file, size)).data))
        file.close()
    if answer["status"] < 0:
        raise RuntimeError(f"the gateway refused a request: {answer.get('error', answer)}")
    return answer


def scene_request(path: Path) -> dict[str, Any]:
    """The request that publishes a file: its own for ``.json``, else the mesh at the path ``scene``."""
    if path.suffix == ".json":
        request: dict[str, Any] = json.loads(path.read_text("utf-8"))
        return request
    geometry = {"type": "mesh_file", "filename": str(path.resolve())}
    return {
        "setgeometry": [{"path": ["scene"], "geometry": geometry}],
        "settransform": [{"path": ["scene"], "transform": _IDENTITY}],
    }


def _exactly(file: Any, count: int) -> bytes:
    data = file.read(count)
    if len(data) != count:
        raise RuntimeError("the gateway closed the connection")
    return bytes(data)
