"""The board: what /readyz says follows from the states of the entries."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.runtime.service_registry import ServiceRegistry, State


class FakeService:
    def __init__(self) -> None:
        self.ready = False

    async def run(self) -> None:
        """Never called here."""

    def status(self) -> Mapping[str, Any]:
        return {"clients": 3}


def test_ready_only_when_everything_has_started() -> None:
    board = ServiceRegistry()
    board.expect("kernels", "render")
    assert board.verdict() == "starting"
    board.ready("kernels")
    assert board.verdict() == "starting"
    board.ready("render")
    assert board.verdict() == "ready"


def test_a_failure_degrades_but_an_essential_one_fails() -> None:
    board = ServiceRegistry(essential=frozenset({"kernels"}))
    board.ready("kernels")
    board.fail("treeviewer", "no multicast route")
    assert board.verdict() == "degraded"
    assert board.describe()["interfaces"]["treeviewer"] == {"state": "failed", "problem": "no multicast route"}
    board.fail("kernels", "broken")
    assert board.verdict() == "failed"


def test_a_service_has_a_word_in_its_state() -> None:
    board = ServiceRegistry()
    service = FakeService()
    board.ready("stereo", service=service, where="grpc://127.0.0.1:50051")
    assert board.verdict() == "starting"
    service.ready = True
    assert board.verdict() == "ready"
    assert board.describe()["interfaces"]["stereo"] == {
        "state": "ready",
        "where": "grpc://127.0.0.1:50051",
        "clients": 3,
    }


def test_stopping_keeps_failures_visible() -> None:
    board = ServiceRegistry()
    board.ready("render")
    board.fail("stereo", "port taken")
    board.stop()
    assert board.verdict() == "stopping"
    assert [entry.state for entry in board.entries.values()] == [State.STOPPED, State.FAILED]
