"""``scenegate check`` tells a gateway of ours from other programs."""

from __future__ import annotations

import json
import socket

import pytest

from gateway.ops.checks import Verdict, findings
from gateway.ops.neighbours import gateway_at
from tests.ops.answering import answering

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


def test_a_gateway_says_which_ports_are_its_own() -> None:
    with answering(lambda _: (200, json.dumps(HEALTH).encode())) as port:
        for host in ("127.0.0.1", "localhost", "0.0.0.0"):
            found = gateway_at(host, port)
            assert found is not None
            assert (found.version, found.status, found.ports) == ("1.2.3", "degraded", {4001, 4002, 4003})


@pytest.mark.parametrize("body", [b"", b"hello", b"[]", b'{"status": "ok"}', b'{"version": 1}', b"[" * 100_000])
def test_other_programs_are_none(body: bytes) -> None:
    with answering(lambda _: (200, body)) as port:
        assert gateway_at("127.0.0.1", port) is None


def test_the_table_names_the_gateway_at_all_of_its_ports() -> None:
    with socket.create_server(("127.0.0.1", 0)) as grpc:
        health = {**HEALTH, "interfaces": {"stereo": {"port": grpc.getsockname()[1]}}}
        with answering(lambda _: (200, json.dumps(health).encode())) as port:
            ports = {"HTTP": port, "gRPC": grpc.getsockname()[1]}
            found = {finding.what: finding for finding in findings("127.0.0.1", ports, 1)}
    for name, number in ports.items():
        finding = found[f"port {number}"]
        assert finding.verdict is Verdict.NOTE
        assert finding.detail == f"{name}: taken by a running gateway, Scenegate 1.2.3, degraded"
