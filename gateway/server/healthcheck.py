"""``python -m gateway.server.healthcheck``: whether the gateway of this container is ready; the image's HEALTHCHECK."""

from __future__ import annotations

import http.client
import os
import ssl
import sys

SECONDS = 2.0
"""An event loop that does not answer in this time is not well."""


def ready(port: int, *, tls: bool) -> bool:
    """What ``/readyz`` of 127.0.0.1 says; False, too, when nobody answers."""
    connection: http.client.HTTPConnection
    if tls:
        # Asked over loopback, and the certificate is for the name that others use.
        context = ssl._create_unverified_context()  # noqa: S323 - to itself; whose certificate does not matter
        connection = http.client.HTTPSConnection("127.0.0.1", port, timeout=SECONDS, context=context)
    else:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=SECONDS)
    try:
        connection.request("GET", "/readyz")
        return connection.getresponse().status == http.client.OK
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def main() -> int:
    """The exit code: 0 is ready. Port and TLS are those of the environment, as in the image."""
    port = int(os.environ.get("SCENEGATE_HTTP_PORT") or 8000)
    return 0 if ready(port, tls=bool(os.environ.get("SCENEGATE_HTTP_CERTIFICATE"))) else 1


if __name__ == "__main__":
    sys.exit(main())
