"""``python -m gateway.server.healthcheck``: exit code 0 if the gateway of this container is ready (HEALTHCHECK)."""

from __future__ import annotations

import http.client
import os
import ssl
import sys

TIMEOUT_SECONDS = 2.0
"""Time limit for the response."""


def ready(port: int, *, tls: bool) -> bool:
    """Return whether ``/readyz`` of 127.0.0.1 responds with 200."""
    connection: http.client.HTTPConnection
    if tls:
        # The connection is to this container, and the certificate is for the name that clients use.
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        connection = http.client.HTTPSConnection("127.0.0.1", port, timeout=TIMEOUT_SECONDS, context=context)
    else:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT_SECONDS)
    try:
        connection.request("GET", "/readyz")
        return connection.getresponse().status == http.client.OK
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def main() -> int:
    """Return the exit code, 0 if ready. Port and TLS come from the environment, as for the gateway."""
    port = int(os.environ.get("SCENEGATE_HTTP_PORT") or 8000)
    return 0 if ready(port, tls=bool(os.environ.get("SCENEGATE_HTTP_CERTIFICATE"))) else 1


if __name__ == "__main__":
    sys.exit(main())
