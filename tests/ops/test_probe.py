"""The image's health check: its exit code is what /readyz says."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from gateway.ops import probe


@contextmanager
def answering(status: int) -> Iterator[int]:
    """Port of a server that answers everything with a status."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status if self.path == "/readyz" else 404)
            self.send_header("content-length", "0")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server.server_port
        finally:
            server.shutdown()
            thread.join()


@pytest.mark.parametrize(("status", "code"), [(200, 0), (503, 1)])
def test_the_exit_code_is_what_readyz_says(status: int, code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    with answering(status) as port:
        monkeypatch.setenv("SCENEGATE_HTTP_PORT", str(port))
        assert probe.main() == code


def test_nobody_is_not_ready_and_tls_is_spoken_where_a_certificate_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    with answering(200) as port:
        assert not probe.ready(port, tls=True), "it does not speak TLS"
    assert not probe.ready(port, tls=False), "nobody listens there any more"
