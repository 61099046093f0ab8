"""Health with and without a token, and readiness."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import httpx2
import msgspec
import pytest
from fastapi import FastAPI

from gateway import __version__
from gateway.app import create_app
from gateway.runtime.http import health
from gateway.runtime.http.access import Access
from gateway.runtime.http.edge import Edge
from gateway.runtime.http.tokens import Tokens
from gateway.runtime.logs.metrics_registry import Metrics
from gateway.runtime.service_registry import ServiceRegistry
from gateway.runtime.settings import Settings
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.runtime.workers.worker_reports import WorkerReports
from gateway.wiring.context import Context

TOKEN = "0123456789abcdef"
BEARER = {"Authorization": f"Bearer {TOKEN}"}
SECRETS = ("/srv/secret", "10.1.2.3", "of a client")


def client(*, token: bool) -> httpx2.AsyncClient:
    def figures() -> Mapping[str, Any]:
        return {"port": 4001, "warnings": ["a message of a client"], "nested": {"file": "/srv/secret.db"}}

    registry = ServiceRegistry()
    registry.ready("state", where="/srv/secret.db", figures=figures)
    registry.ready("view", where="10.1.2.3")
    registry.fail("stereo", "cannot read /srv/secret.pem")
    app = FastAPI()
    app.include_router(health.router(registry, Metrics(), "1.2.3"))
    if token:
        app.add_middleware(Edge, access=Access(tokens=Tokens(TOKEN), open_paths=health.OPEN_PATHS))
    return httpx2.AsyncClient(transport=httpx2.ASGITransport(app=app), base_url="http://here")


@pytest.mark.parametrize("path", ["/healthz", "/readyz"])
async def test_names_of_files_may_have_any_bytes(path: str) -> None:
    name = os.fsdecode(b"t\xfcr.obj")
    registry = ServiceRegistry()
    registry.ready("state", figures=lambda: {"file": name, "warnings": [f"{name} is full"]})
    registry.warn("stereo", name, f"{name} has no triangles")
    registry.fail("view", f"{name}: Permission denied")
    app = FastAPI()
    app.include_router(health.router(registry, Metrics(), "1.2.3"))
    async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app=app), base_url="http://here") as http:
        answer = await http.get(path)
    interfaces = answer.json()["interfaces"]
    assert interfaces["state"] == {"state": "ready", "file": name, "warnings": ["t?r.obj is full"]}
    assert interfaces["stereo"]["warnings"] == ["t?r.obj has no triangles"]
    assert interfaces["view"]["problem"] == "t?r.obj: Permission denied"
    assert msgspec.json.encode([entry.describe().get("warnings", ()) for entry in registry.entries.values()])


@pytest.mark.parametrize("path", ["/healthz", "/readyz"])
async def test_health_without_the_token_has_states_only(path: str) -> None:
    async with client(token=True) as http:
        answer = await http.get(path)
    assert answer.status_code == 200
    described = answer.json()
    assert described["status"] == "degraded"
    assert described["interfaces"] == {
        "state": {"state": "ready", "port": 4001},
        "view": {"state": "ready"},
        "stereo": {"state": "failed"},
    }
    assert not [secret for secret in SECRETS if secret in answer.text]
    assert "Bearer TOKEN" in described["details"]


@pytest.mark.parametrize("path", ["/healthz", "/readyz"])
@pytest.mark.parametrize("token", [True, False], ids=["token shown", "no token wanted"])
async def test_health_with_the_token_has_all_details(path: str, token: bool) -> None:
    async with client(token=token) as http:
        answer = await http.get(path, headers=BEARER if token else {})
        assert all(secret in answer.text for secret in SECRETS)
        assert answer.json()["interfaces"]["stereo"]["problem"] == "cannot read /srv/secret.pem"
        if token:
            wrong = await http.get(path, headers={"Authorization": "Bearer wrong"})
            assert wrong.status_code == 200
            assert "/srv" not in wrong.text


def pool(*, busy: bool) -> WorkerPool:
    """A pool whose queue is full, or not."""

    class Pool(WorkerPool):
        busy = property(lambda self: busy)

    return Pool(1)


@pytest.mark.parametrize(
    ("states", "started", "busy", "status", "code"),
    [
        ("ready", True, False, "ready", 200),
        ("ready", True, True, "busy", 503),
        ("ready", False, False, "starting", 503),
        ("ready", False, True, "starting", 503),
        ("degraded", True, False, "degraded", 200),
        ("degraded", True, True, "degraded", 200),
        ("degraded", False, False, "starting", 503),
        ("starting", True, True, "starting", 503),
        ("stopping", True, False, "stopping", 503),
        ("failed", True, False, "failed", 503),
        ("failed", False, True, "failed", 503),
    ],
)
async def test_readiness_follows_states_start_and_queue(
    states: str, started: bool, busy: bool, status: str, code: int
) -> None:
    app = create_app(Settings(only=("render",)))
    context: Context = app.state.context
    context.workers = pool(busy=busy)
    registry = context.registry
    registry.ready("kernels")
    if states == "degraded":
        registry.fail("view", "a problem")
    elif states == "starting":
        registry.expect("view")
    elif states == "stopping":
        registry.stop()
    elif states == "failed":
        registry.fail("kernels", "a problem")
    if started:
        context.started.set()
    async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app=app), base_url="http://localhost") as http:
        ready, live = await http.get("/readyz"), await http.get("/healthz")
    assert (ready.json()["status"], ready.status_code) == (status, code)
    assert (live.json()["status"], live.status_code, live.json()["version"]) == (states, 200, __version__)


async def test_one_of_several_processes_responds_for_all(tmp_path: Path) -> None:
    reports = WorkerReports(tmp_path, 2)
    reports.register()
    app = create_app(Settings(only=("render",), workers=2), reports=reports)
    context: Context = app.state.context
    context.registry.ready("kernels")
    context.started.set()
    async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app=app), base_url="http://localhost") as http:
        alone = await http.get("/readyz")
        WorkerReports(tmp_path, 2, os.getppid()).write("ready", context.metrics.exposition().decode())
        both, live, metrics = [await http.get(path) for path in ("/readyz", "/healthz", "/metrics")]
    assert (alone.status_code, alone.json()["status"]) == (503, "starting")
    assert (both.status_code, both.json()["status"]) == (200, "ready")
    assert live.json()["workers"]["states"] == {str(os.getpid()): "ready", str(os.getppid()): "ready"}
    lines = metrics.text.splitlines()
    assert 'scenegate_http_requests_total{method="GET",route="/readyz",status="503"} 2.0' in lines
