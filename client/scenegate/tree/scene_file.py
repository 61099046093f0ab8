"""Fetch the scene of a running gateway as a file: the page in HTML, or glTF."""

from __future__ import annotations

import http.client
import urllib.error
import urllib.request
from typing import Final
from urllib.parse import urlencode

TIMEOUT_SECONDS: Final = 300.0
"""Timeout of a request. A minute of a large scene takes seconds; others may wait before it."""


def fetch_scene_file(gateway: str, name: str, *, token: str | None = None, **query: object) -> bytes:
    """Return a file of the live scene.

    Args:
        gateway: Address of the gateway's HTTP port, ``http://HOST:PORT``, or of its page.
        name: Path of the file: ``view/scene.html``, ``scene.glb``.
        token: Bearer token of the gateway.
        query: Parameters of the request. None: left out.

    Raises:
        ValueError: The address does not begin with ``http://`` or ``https://``, or the gateway refuses a parameter.
        ConnectionError: The gateway does not respond.
    """
    if not gateway.startswith(("http://", "https://")):
        raise ValueError(f"{gateway!r}: the address of a gateway begins with http:// or https://")
    address = gateway.partition("#")[0].partition("?")[0].rstrip("/").removesuffix("/view")
    parameters = urlencode({key: value for key, value in query.items() if value is not None})
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    request = urllib.request.Request(f"{address}/{name}?{parameters}", headers=headers)  # noqa: S310 - as below
    try:
        with urllib.request.urlopen(request, timeout=TIMEOUT_SECONDS) as response:  # noqa: S310 - http or https
            data: bytes = response.read()
            return data
    except urllib.error.HTTPError as error:
        with error:
            text = error.read(1000).decode("utf-8", "replace").strip()
        raise ValueError(f"{gateway} gives no {name}: {error.code}: {text or error.reason}") from None
    except http.client.HTTPException:
        raise ConnectionError(f"{gateway} gives no {name}: it does not speak HTTP") from None
    except (OSError, ValueError) as error:
        reason = error.reason if isinstance(error, urllib.error.URLError) else error
        raise ConnectionError(f"{gateway} gives no {name}: {reason}") from None
