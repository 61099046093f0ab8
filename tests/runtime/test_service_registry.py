"""States of interfaces, and the status of /readyz that follows."""

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
    registry = ServiceRegistry()
    registry.expect("kernels", "render")
    assert registry.verdict() == "starting"
    registry.ready("kernels")
    assert registry.verdict() == "starting"
    registry.ready("render")
    assert registry.verdict() == "ready"


def test_a_failure_degrades_but_an_essential_one_fails() -> None:
    registry = ServiceRegistry(essential=frozenset({"kernels"}))
    registry.ready("kernels")
    registry.fail("treeviewer", "no multicast route")
    assert registry.verdict() == "degraded"
    assert registry.describe()["interfaces"]["treeviewer"] == {"state": "failed", "problem": "no multicast route"}
    registry.fail("kernels", "broken")
    assert registry.verdict() == "failed"


def test_entry_is_starting_until_its_service_is_ready() -> None:
    registry = ServiceRegistry()
    service = FakeService()
    registry.ready("stereo", service=service, where="grpc://127.0.0.1:50051")
    assert registry.verdict() == "starting"
    service.ready = True
    assert registry.verdict() == "ready"
    assert registry.describe()["interfaces"]["stereo"] == {
        "state": "ready",
        "where": "grpc://127.0.0.1:50051",
        "clients": 3,
    }


def test_stopping_keeps_failures_visible() -> None:
    registry = ServiceRegistry()
    registry.ready("render")
    registry.fail("stereo", "port taken")
    registry.stop()
    assert registry.verdict() == "stopping"
    assert [entry.state for entry in registry.entries.values()] == [State.STOPPED, State.FAILED]
