"""Send one request to the tree viewer."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from scenegate.messages.mesh_file import MeshFile
from scenegate.regular_files import read_regular
from scenegate.tree.requests import Requests

_IDENTITY: Final = {"translation": [0, 0, 0], "quaternion": [1, 0, 0, 0]}


def publish(url: str, request: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Send a request and return its response.

    Args:
        url: ``tcpq://host:port``.
        seconds: Maximum time to wait.

    Raises:
        RuntimeError: The response has a negative status.
        TimeoutError: There is no response in time.
        ConnectionError: The gateway cannot be reached.
    """
    requests = Requests(url, seconds, binary=False)
    try:
        response = requests.send(dict(request))
    finally:
        requests.connection.close()
    if response.status < 0:
        raise RuntimeError(f"the gateway rejected a request: {response.body.get('error', response.body)}")
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
