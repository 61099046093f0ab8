"""``scenegate check`` tells a gateway of ours from other programs."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from gateway.ops.checks import Verdict, findings
from gateway.ops.neighbours import gateway_at

HEALTH = {
    "version": "1.2.3",
    "status": "degraded",
    "interfaces": {
        "render": {"state": "ready"},
        "stereo": {"state": "ready", "port": 4001},
        "treeviewer": {"tcpq": {"url": "tcpq://127.0.0.1:4002"}},
        "rest": {"port": 4003},
    },
}


@contextmanager
def answering(body: bytes) -> Iterator[int]:
    """Port of a server that answers everything with that."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("content-length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

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


def test_a_gateway_says_which_ports_are_its_own() -> None:
    with answering(json.dumps(HEALTH).encode()) as port:
        for host in ("127.0.0.1", "localhost", "0.0.0.0"):
            found = gateway_at(host, port)
            assert found is not None
            assert (found.version, found.status, found.ports) == ("1.2.3", "degraded", {4001, 4002, 4003})


@pytest.mark.parametrize("body", [b"", b"hello", b"[]", b'{"status": "ok"}', b'{"version": 1}', b"[" * 100_000])
def test_other_programs_are_none(body: bytes) -> None:
    with answering(body) as port:
        assert gateway_at("127.0.0.1", port) is None


def test_the_table_names_the_gateway_at_all_of_its_ports() -> None:
    with socket.create_server(("127.0.0.1", 0)) as grpc:
        health = {**HEALTH, "interfaces": {"stereo": {"port": grpc.getsockname()[1]}}}
        with answering(json.dumps(health).encode()) as port:
            ports = {"HTTP": port, "gRPC": grpc.getsockname()[1]}
            found = {finding.what: finding for finding in findings("127.0.0.1", ports, 1)}
    for name, number in ports.items():
        finding = found[f"port {number}"]
        assert finding.verdict is Verdict.NOTE
        assert finding.detail == f"{name}: taken by a running gateway, Scenegate 1.2.3, degraded"
