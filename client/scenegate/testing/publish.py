"""Send one request to the tree viewer."""

from __future__ import annotations

import json
import queue
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from scenegate.messages import wire
from scenegate.messages.mesh_file import MeshFile
from scenegate.messages.request_encoding import decode_response, encode_request
from scenegate.regular_files import read_regular
from scenegate.tree.connection import LcmConnection

_CLIENT_ID: Final = "scenegate-testing"
_IDENTITY: Final = {"translation": [0, 0, 0], "quaternion": [1, 0, 0, 0]}


def publish(url: str, request: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Send a request and return its response.

    Args:
        url: ``tcpq://host:port``.
        seconds: Maximum time to wait.

    Raises:
        RuntimeError: The response has a negative status, or there is none in time.
        ConnectionError: The gateway cannot be reached.
    """
    responses: queue.Queue[bytes] = queue.Queue()
    connection = LcmConnection(url, {f"{wire.RESPONSE}_<{_CLIENT_ID}>": responses.put}, seconds)
    try:
        message = encode_request({"timestamp": 0, **request}, 0, wire.JSON)
        connection.publish(f"{wire.REQUEST}_<{_CLIENT_ID}>", message)
        response = decode_response(responses.get(timeout=seconds))
    except queue.Empty:
        raise RuntimeError(f"the gateway did not respond within {seconds:g} s") from None
    finally:
        connection.close()
    if response is None or response.status < 0:
        reason = None if response is None else response.body.get("error", response.body)
        raise RuntimeError(f"the gateway rejected a request: {reason}")
    return response.body


def scene_request(path: Path) -> dict[str, Any]:
    """Return the request that publishes a file: the content of a ``.json`` file, else a mesh at the path ``scene``."""
    if path.suffix == ".json":
        request: dict[str, Any] = json.loads(read_regular(path))
        return request
    return {
        "setgeometry": [{"path": ["scene"], "geometry": MeshFile.read(path).body()}],
        "settransform": [{"path": ["scene"], "transform": _IDENTITY}],
    }
