"""Fetch the ground truth of image sets (exact depth and labels) from a gateway, for ``stream``."""

from __future__ import annotations

from typing import Final

from scenegate.credentials import Credentials
from scenegate.gateway_http import fetch

_TIMEOUT_SECONDS: Final = 60.0
"""Timeout of a request. The gateway queues the frame and renders it again."""
_ANONYMOUS: Final = Credentials()


def fetch_truth(address: str, timestamp: str, credentials: Credentials = _ANONYMOUS, pipeline: int = 0) -> bytes:
    """Return the content of ``/stereo/truth.npz`` for an image set.

    Args:
        address: address of the gateway's HTTP port, ``http://HOST:PORT``.
        timestamp: timestamp of the set, ``sec.nsec``.
        credentials: token and TLS certificates.
        pipeline: number of the camera.

    Raises:
        GatewayError: the gateway does not respond, or does not have this set.
        OSError: a certificate cannot be read.
    """
    wanted, path = f"ground truth of {timestamp}", "stereo/truth.npz"
    return fetch(address, path, credentials, wanted, _TIMEOUT_SECONDS, timestamp=timestamp, pipeline=pipeline)
