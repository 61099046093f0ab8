"""``python -m gateway.runtime.http.healthcheck``: exit code 0 if this container is ready (HEALTHCHECK)."""

import os
import sys

from gateway.runtime.instance_probe import responses


def main() -> int:
    """Return the exit code, 0 if ``/readyz`` responds with 200. The port comes from the environment."""
    port = int(os.environ.get("SCENEGATE_HTTP_PORT") or 8000)
    return 0 if any(status == 200 for status, _ in responses("127.0.0.1", port, "/readyz")) else 1


if __name__ == "__main__":
    sys.exit(main())
