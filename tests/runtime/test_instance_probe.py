"""``scenegate doctor`` distinguishes a running gateway from other programs."""

import contextlib
import json
import socket
import ssl
import threading
from pathlib import Path

import pytest

from gateway.runtime.diagnostics import findings
from gateway.runtime.installation import Verdict
from gateway.runtime.instance_probe import probe_instance
from tests.support.certificates import certificate
from tests.support.http_stub import http_server
from tests.support.waiting import wait_until

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


def port_of(url: str) -> int:
    return int(url.rpartition(":")[2])


def test_probe_returns_the_ports_of_a_gateway() -> None:
    with http_server(lambda _: (200, json.dumps(HEALTH).encode())) as url:
        for host in ("127.0.0.1", "localhost", "0.0.0.0"):
            found = probe_instance(host, port_of(url))
            assert (found.version, found.status) == ("1.2.3", "degraded")
            assert found.ports == frozenset({4001, 4002, 4003})


@pytest.mark.parametrize("body", [b"", b"hello", b"[]", b'{"status": "ok"}', b'{"version": 1}', b"[" * 100_000])
def test_probe_ignores_other_programs(body: bytes) -> None:
    with http_server(lambda _: (200, body)) as url:
        assert probe_instance("127.0.0.1", port_of(url)) is None


def test_probe_tries_https_where_http_gives_an_error(tmp_path: Path) -> None:
    """As at the TLS port of a proxy, which responds to plain HTTP with 400."""
    body = json.dumps(HEALTH).encode()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*certificate(tmp_path))

    def respond(listener: socket.socket) -> None:
        for head in (b"HTTP/1.1 400 Bad Request\r\ncontent-length: 0\r\n\r\n", b"HTTP/1.1 200 OK\r\n\r\n" + body):
            connection, _ = listener.accept()
            if body in head:
                connection = context.wrap_socket(connection, server_side=True)
            with connection:
                connection.recv(1 << 16)
                connection.sendall(head)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = threading.Thread(target=respond, args=(listener,))
        server.start()
        found = probe_instance("127.0.0.1", listener.getsockname()[1])
        server.join()
    assert found.version == "1.2.3"


@pytest.mark.parametrize(
    "head",
    [b"", b"HTTP/1.1 200 OK\r\ncontent-length: 1000000\r\n\r\n", b"\x16\x03\x03\x40\x00"],
    ids=["no response", "an endless body", "an endless TLS handshake"],
)
def test_probe_has_a_time_limit(head: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.runtime.instance_probe.TOTAL_SECONDS", 0.1)
    ended: list[bool] = []

    def drip(listener: socket.socket) -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError):
                connection.settimeout(0.01)
                connection.sendall(head)
                while True:
                    connection.sendall(b"x")
                    with contextlib.suppress(TimeoutError):
                        if not connection.recv(1 << 16):
                            break
            ended.append(True)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = threading.Thread(target=drip, args=(listener,))
        server.start()
        try:
            assert probe_instance("127.0.0.1", listener.getsockname()[1]) is None
            wait_until(lambda: len(ended) == 2)  # HTTP and HTTPS
        finally:
            listener.shutdown(socket.SHUT_RDWR)
            server.join()
    assert len(ended) == 2


def test_doctor_names_the_gateway_at_all_its_ports() -> None:
    with socket.create_server(("127.0.0.1", 0)) as grpc:
        health = {**HEALTH, "interfaces": {"stereo": {"port": grpc.getsockname()[1]}}}
        with http_server(lambda _: (200, json.dumps(health).encode())) as url:
            ports = {"--http-port": ("HTTP", port_of(url)), "--grpc-port": ("gRPC", grpc.getsockname()[1])}
            found = {finding.subject: finding for finding in findings("127.0.0.1", ports)}
    for flag, (name, number) in ports.items():
        finding = found[f"port {number}"]
        assert finding.verdict is Verdict.NOTE
        assert finding.detail == f"{name}: taken by a running gateway, Scenegate 1.2.3, degraded"
        assert finding.remedy == f"stop that one, or {flag} PORT"
