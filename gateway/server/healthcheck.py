"""``python -m gateway.server.healthcheck``: exit code 0 if the gateway of this container is ready (HEALTHCHECK)."""

from __future__ import annotations

import os
import sys

from gateway.runtime.instance_probe import get


def main() -> int:
    """Return the exit code, 0 if ``/readyz`` responds with 200. The port comes from the environment."""
    response = get("127.0.0.1", int(os.environ.get("SCENEGATE_HTTP_PORT") or 8000), "/readyz")
    return 0 if response is not None and response[0] == 200 else 1


if __name__ == "__main__":
    sys.exit(main())
