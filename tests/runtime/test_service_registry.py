"""States of interfaces, and the status of /readyz that follows."""

from collections.abc import Mapping
from typing import Any

from gateway.runtime.service_registry import Entry, InterfaceState, ServiceRegistry


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
    assert [entry.state for entry in registry.entries.values()] == [InterfaceState.STOPPED, InterfaceState.FAILED]


def test_without_details_only_state_and_port_are_described() -> None:
    registry = ServiceRegistry()
    registry.ready("stereo", where="gRPC", figures=lambda: {"port": 50051, "clients": 3})
    registry.ready("render", where="/render", figures=lambda: {"queue": 1})
    registry.ready("scene", where="/scene")
    registry.fail("view", "/home/user/secret cannot be read")
    assert registry.describe(details=False)["interfaces"] == {
        "stereo": {"state": "ready", "port": 50051},
        "render": {"state": "ready"},
        "scene": {"state": "ready"},
        "view": {"state": "failed"},
    }


def test_progress_is_described_while_starting_and_figures_while_ready() -> None:
    registry = ServiceRegistry()
    registry.expect("kernels")
    registry.entries["kernels"].progress = lambda: {"seconds": 3}
    registry.entries["kernels"].figures = lambda: {"count": 43}
    assert registry.describe()["interfaces"]["kernels"] == {"state": "starting", "seconds": 3}
    assert registry.describe(details=False)["interfaces"]["kernels"] == {"state": "starting"}
    registry.entries["kernels"].state = InterfaceState.READY
    assert registry.describe()["interfaces"]["kernels"] == {"state": "ready", "count": 43}
    registry.expect("kernels")  # again: nothing changes
    assert registry.verdict() == "ready"


def test_the_verdict_prefers_stopping_to_starting_to_degraded() -> None:
    registry = ServiceRegistry()
    registry.fail("stereo", "port taken")
    assert registry.verdict() == "degraded"
    registry.expect("view")
    assert registry.verdict() == "starting"
    registry.entries["render"] = Entry(InterfaceState.STOPPED)
    assert registry.verdict() == "stopping"
