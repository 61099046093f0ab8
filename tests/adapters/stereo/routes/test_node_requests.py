"""Values in queries and bodies of the node routes, and how the routes are described."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Iterator
from typing import Any

import httpx2 as httpx
import pytest
import structlog
from fastapi import FastAPI

from gateway.adapters.stereo.routes.fault_routes import fault_router
from gateway.adapters.stereo.routes.node_routes import MAX_BODY, NUMBER_TEXT_LIMIT, node_router
from gateway.adapters.stereo.routes.system_routes import system_router
from gateway.adapters.stereo.routes.truth_routes import truth_router
from gateway.runtime.logs import log_setup
from tests.adapters.stereo.conftest import Camera, Start

NODES = "/api/v2/pipelines/0/nodes"
FPS = f"{NODES}/rc_camera/parameters/fps"


@pytest.fixture(autouse=True)
def _restore_logs() -> Iterator[None]:
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers[:], root.level = handlers, level
    structlog.reset_defaults()


@pytest.fixture
async def camera(start: Start) -> Camera:
    return await start()


@pytest.fixture
async def client(camera: Camera) -> AsyncIterator[httpx.AsyncClient]:
    app = FastAPI()
    for router in (node_router, system_router, truth_router, fault_router):
        app.include_router(router(camera.service))
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app=app), base_url="http://device") as http_client:
        yield http_client


@pytest.mark.parametrize(
    ("text", "value"),
    [("true", True), ("TRUE", True), ("false", False), ("False", False), ("1", True), ("0", False)],
)
async def test_booleans_in_a_query(client: httpx.AsyncClient, text: str, value: bool) -> None:
    await client.put(f"{NODES}/rc_camera/parameters/exp_auto", json={"value": not value})
    response = await client.put(f"{NODES}/rc_camera/parameters/exp_auto?value={text}")
    assert (response.status_code, response.json()["value"]) == (200, value)


async def test_words_after_true_are_no_booleans(client: httpx.AsyncClient) -> None:
    for text in ("truex", "zero"):
        response = await client.put(f"{NODES}/rc_camera/parameters/exp_auto?value={text}")
        assert response.status_code == 400
        assert f"'{text}' is not true or false" in response.json()["message"]


async def test_the_length_of_numbers_in_a_query(client: httpx.AsyncClient) -> None:
    longest = "5." + "0" * (NUMBER_TEXT_LIMIT - 3)
    response = await client.put(f"{FPS}?value={longest}")
    assert (response.status_code, response.json()["value"]) == (200, 5.0)
    assert (await client.put(f"{FPS}?value={longest}0")).status_code == 400


async def test_a_body_comes_before_the_query(client: httpx.AsyncClient) -> None:
    response = await client.put(f"{FPS}?value=5", json={"value": 7})
    assert response.json()["value"] == 7.0
    response = await client.put(f"{FPS}?value=5")
    assert response.json()["value"] == 5.0
    response = await client.put(FPS)
    assert response.status_code == 400
    assert 'the body is not like {"value": 1.0}' in response.json()["message"]


@pytest.mark.parametrize(("extra", "status"), [(0, 200), (1, 413)])
async def test_the_largest_body(client: httpx.AsyncClient, extra: int, status: int) -> None:
    text = '{"value": 5}'
    response = await client.put(FPS, content=text + " " * (MAX_BODY - len(text) + extra))
    assert response.status_code == status


async def test_documented_statuses(client: httpx.AsyncClient) -> None:
    """Above 200; 422 is FastAPI's own where a parameter has another type."""
    paths: dict[str, Any] = (await client.get("/openapi.json")).json()["paths"]
    documented = {
        f"{method.upper()} {path.removeprefix('/api/v2/pipelines/0')}": sorted(set(route["responses"]) - {"200", "422"})
        for path, methods in paths.items()
        for method, route in methods.items()
        if not path.startswith("/api/v1")
    }
    assert documented == {
        "GET /nodes": [],
        "GET /nodes/{node}": ["404"],
        "GET /nodes/{node}/status": ["404"],
        "GET /nodes/{node}/parameters": ["404"],
        "PUT /nodes/{node}/parameters": ["400", "404", "413", "507"],
        "GET /nodes/{node}/parameters/{name}": ["404"],
        "PUT /nodes/{node}/parameters/{name}": ["400", "404", "413", "507"],
        "GET /nodes/{node}/services": ["404"],
        "GET /nodes/{node}/services/{name}": ["404"],
        "PUT /nodes/{node}/services/{name}": ["400", "404", "413", "507"],
        "GET /api/v2/system": [],
        "GET /api/v2/system/backup": [],
        "POST /api/v2/system/backup": ["400", "413", "507"],
        **{f"GET /api/v2/system/{name}": [] for name in ("dns", "license", "network", "network/settings", "ntp")},
        **{f"PUT /api/v2/system/{name}": ["403"] for name in ("dns", "network/settings", "ntp")},
        **{f"POST /api/v2/system/{name}": ["400"] for name in ("license", "update")},
        "GET /api/v2/system/rollback": [],
        "PUT /api/v2/system/rollback": ["400"],
        "GET /api/v2/system/time": [],
        "PUT /api/v2/system/time": ["400", "403"],
        "GET /api/v2/system/ui_lock": [],
        "POST /api/v2/system/ui_lock": [],
        "DELETE /api/v2/system/ui_lock": [],
        "GET /api/v2/system/update": [],
        "PUT /api/v2/system/reboot": [],
        "GET /api/v2/datastreams": [],
        "GET /api/v2/logs": [],
        "GET /api/v2/logs/{log}": ["404"],
        "GET /api/v2/pipelines": [],
        "GET /api/v2/nodes": [],
        "GET ": [],
        "GET /stereo/truth.npz": ["400", "404", "503"],
        "GET /stereo/faults": ["403", "404"],
        "PUT /stereo/faults": ["400", "403", "404", "413"],
        "DELETE /stereo/faults": ["403", "404"],
        "POST /stereo/faults/disconnect": ["403", "404"],
    }


async def test_documented_values_of_parameters(client: httpx.AsyncClient) -> None:
    paths: dict[str, Any] = (await client.get("/openapi.json")).json()["paths"]
    body = paths[f"{NODES}/{{node}}/parameters"]["put"]["requestBody"]
    entries = body["content"]["application/json"]["schema"]["items"]["anyOf"]
    values = {entry["title"]: entry["properties"]["value"] for entry in entries}
    assert not body["required"]
    assert values["fps"] == {"type": "number", "minimum": 1.0, "maximum": 25.0}
    assert values["exp_auto"] == {"type": ["boolean", "integer"], "minimum": 0, "maximum": 1}
    assert values["seg"] == {"type": "integer", "minimum": 0, "maximum": 4000}
    assert values["quality"]["type"] == "string"
    assert values["quality"]["enum"] == ["Low", "Medium", "High", "Full"]
    assert "AlternateExposureActive" in values["out1_mode"]["enum"]
    one = paths[f"{NODES}/{{node}}/parameters/{{name}}"]["put"]["requestBody"]
    assert one["required"]
    call = paths[f"{NODES}/{{node}}/services/{{name}}"]["put"]["requestBody"]
    assert not call["required"]


async def test_the_number_of_log_entries(client: httpx.AsyncClient) -> None:
    log_setup.configure("json", "info")
    for number in range(120):
        structlog.get_logger("stereo").warning(f"entry {number}")
    path = "/api/v2/logs/stereo.log"

    async def messages(query: str) -> list[str]:
        return [entry["message"] for entry in (await client.get(path + query)).json()["log"]]

    assert len(await messages("")) == 100
    assert await messages("?limit=1") == ["entry 119"]
    assert (await messages("?limit=200"))[-120:] == [f"entry {number}" for number in range(120)]
    for limit in (0, -1):
        assert (await client.get(f"{path}?limit={limit}")).status_code == 422


async def test_unknown_names_are_shortened_to_80_characters(client: httpx.AsyncClient) -> None:
    for path in ("/api/v2/nodes", "/api/v2/logs", NODES):
        message = (await client.get(f"{path}/{'x' * 90}")).json()["message"]
        assert f" '{'x' * 80}'; " in message
