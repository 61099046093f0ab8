"""Fetch the ground truth of image sets (exact depth and labels) from a gateway, for ``stream``."""

from __future__ import annotations

import http.client
import json
import ssl
import urllib.error
import urllib.request
from typing import Any, Final
from urllib.parse import urlencode

from scenegate.camera.credentials import Credentials

_TIMEOUT_SECONDS: Final = 60.0
"""Timeout of a request. The gateway queues the frame and renders it again."""


class TruthFailure(RuntimeError):  # noqa: N818 - public name
    """The ground truth of a set cannot be fetched; the message is one sentence."""


def fetch_truth(address: str, timestamp: str, credentials: Credentials, pipeline: int = 0) -> bytes:
    """Return the content of ``/stereo/truth.npz`` for an image set.

    Args:
        address: address of the gateway's HTTP port, ``http://HOST:PORT``.
        timestamp: timestamp of the set, ``sec.nsec``.
        credentials: token and TLS certificates.
        pipeline: number of the camera.

    Raises:
        TruthFailure: the gateway does not respond, or does not have this set.
        OSError: a certificate cannot be read.
    """
    query = urlencode({"timestamp": timestamp, "pipeline": pipeline})
    url = f"{address.rstrip('/')}/stereo/truth.npz?{query}"
    if not url.startswith(("http://", "https://")):
        raise TruthFailure(f"the address for ground truth is {address!r}; it must begin with http:// or https://")
    context = ssl.create_default_context(cafile=credentials.ca) if url.startswith("https:") else None
    if context is not None and credentials.certificate is not None:
        context.load_cert_chain(credentials.certificate, credentials.key)
    request = urllib.request.Request(url, headers=dict(credentials.metadata))  # noqa: S310 - http or https, see above
    try:
        with urllib.request.urlopen(request, timeout=_TIMEOUT_SECONDS, context=context) as response:  # noqa: S310
            data: bytes = response.read()
            return data
    except urllib.error.HTTPError as error:
        raise TruthFailure(
            f"{address} has no ground truth of {timestamp}: {error.code}: {_error_message(error)}"
        ) from None
    except http.client.HTTPException:
        raise TruthFailure(f"{address} gives no ground truth: it does not speak HTTP") from None
    except (OSError, ValueError) as error:
        raise TruthFailure(f"{address} gives no ground truth: {error}") from None


def _error_message(error: urllib.error.HTTPError) -> str:
    """Return the message in the body of an error response, or the HTTP reason phrase."""
    try:
        body: Any = json.loads(error.read(10_000))
        return str(body["message"])
    except (ValueError, KeyError, TypeError, OSError):
        return str(error.reason)
