"""Serve the page of a dataset to browsers on this machine."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from gateway.datasets.show.app import create_app
from gateway.runtime import process_tuning
from gateway.server.http_server import MainServer, server_config
from scenegate.datasets import Dataset

HOST: Final = "127.0.0.1"
"""Loopback: the page has no access control."""
SHUTDOWN_SECONDS: Final = 1.0
"""Time for images that are being drawn at the end."""


def serve_dataset(dataset: Dataset, port: int, started: Callable[[str], object]) -> None:
    """Serve the page until SIGINT or SIGTERM.

    Args:
        port: TCP port; 0: any.
        started: called with the URL of the page.

    Raises:
        OSError: the port cannot be used; the message is one sentence.
        RecordError: a line of the manifest cannot be read.
    """
    app = create_app(dataset)
    try:
        listener = process_tuning.listen(HOST, port)
    except OSError as error:
        raise OSError(f"--port {port}: {process_tuning.listen_error(error, HOST, port)}") from None
    started(f"http://{HOST}:{listener.getsockname()[1]}/")
    server = MainServer(server_config(app, SHUTDOWN_SECONDS, lifespan=False))
    asyncio.run(server.serve(sockets=[listener]))
