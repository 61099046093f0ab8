"""Values in queries and bodies of the node routes, and how the routes are described."""

from typing import Any

import httpx2 as httpx
import pytest
import structlog

from gateway.adapters.stereo.routes.node_routes import MAX_BODY, NUMBER_TEXT_LIMIT

NODES = "/api/v2/pipelines/0/nodes"
FPS = f"{NODES}/rc_camera/parameters/fps"


@pytest.mark.parametrize(
    ("text", "value"), [("true", True), ("TRUE", True), ("false", False), ("False", False), ("1", True), ("0", False)]
)
async def test_booleans_in_a_query(rest_client: httpx.AsyncClient, text: str, value: bool) -> None:
    await rest_client.put(f"{NODES}/rc_camera/parameters/exp_auto", json={"value": not value})
    response = await rest_client.put(f"{NODES}/rc_camera/parameters/exp_auto?value={text}")
    assert (response.status_code, response.json()["value"]) == (200, value)


async def test_words_after_true_are_no_booleans(rest_client: httpx.AsyncClient) -> None:
    for text in ("truex", "zero"):
        response = await rest_client.put(f"{NODES}/rc_camera/parameters/exp_auto?value={text}")
        assert response.status_code == 400
        assert f"'{text}' is not true or false" in response.json()["message"]


async def test_the_length_of_numbers_in_a_query(rest_client: httpx.AsyncClient) -> None:
    longest = "5." + "0" * (NUMBER_TEXT_LIMIT - 3)
    response = await rest_client.put(f"{FPS}?value={longest}")
    assert (response.status_code, response.json()["value"]) == (200, 5.0)
    assert (await rest_client.put(f"{FPS}?value={longest}0")).status_code == 400


async def test_a_body_comes_before_the_query(rest_client: httpx.AsyncClient) -> None:
    response = await rest_client.put(f"{FPS}?value=5", json={"value": 7})
    assert response.json()["value"] == 7.0
    response = await rest_client.put(f"{FPS}?value=5")
    assert response.json()["value"] == 5.0
    response = await rest_client.put(FPS)
    assert response.status_code == 400
    assert 'the body is not like {"value": 1.0}' in response.json()["message"]


@pytest.mark.parametrize(("extra", "status"), [(0, 200), (1, 413)])
async def test_the_largest_body(rest_client: httpx.AsyncClient, extra: int, status: int) -> None:
    text = '{"value": 5}'
    response = await rest_client.put(FPS, content=text + " " * (MAX_BODY - len(text) + extra))
    assert response.status_code == status


async def test_documented_statuses(rest_client: httpx.AsyncClient) -> None:
    """Above 200; 422 is FastAPI's own where a parameter has another type."""
    paths: dict[str, Any] = (await rest_client.get("/openapi.json")).json()["paths"]
    for method, path, statuses in (
        ("get", f"{NODES}/{{node}}/parameters/{{name}}", {"404"}),
        ("put", f"{NODES}/{{node}}/parameters/{{name}}", {"400", "404", "413", "507"}),
        ("put", f"{NODES}/{{node}}/services/{{name}}", {"400", "404", "413", "507"}),
        ("get", "/api/v2/system", set()),
        ("post", "/api/v2/system/backup", {"400", "413", "507"}),
        ("put", "/api/v2/system/time", {"400", "403"}),
        ("get", "/stereo/truth.npz", {"400", "404", "503"}),
        ("put", "/stereo/faults", {"400", "403", "404", "413"}),
        ("get", "/stereo/faults", {"403", "404"}),
        ("delete", "/stereo/faults", {"403", "404"}),
    ):
        assert set(paths[path][method]["responses"]) - {"200", "422"} == statuses, (method, path)


async def test_documented_values_of_parameters(rest_client: httpx.AsyncClient) -> None:
    paths: dict[str, Any] = (await rest_client.get("/openapi.json")).json()["paths"]
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


@pytest.mark.usefixtures("logs")
async def test_the_number_of_log_entries(rest_client: httpx.AsyncClient) -> None:
    for number in range(120):
        structlog.get_logger("stereo").warning(f"entry {number}")
    path = "/api/v2/logs/stereo.log"

    async def messages(query: str) -> list[str]:
        return [entry["message"] for entry in (await rest_client.get(path + query)).json()["log"]]

    assert len(await messages("")) == 100
    assert await messages("?limit=1") == ["entry 119"]
    assert (await messages("?limit=200"))[-120:] == [f"entry {number}" for number in range(120)]
    for limit in (0, -1):
        assert (await rest_client.get(f"{path}?limit={limit}")).status_code == 422


async def test_unknown_names_are_shortened_to_80_characters(rest_client: httpx.AsyncClient) -> None:
    for path in ("/api/v2/nodes", "/api/v2/logs", NODES):
        message = (await rest_client.get(f"{path}/{'x' * 90}")).json()["message"]
        assert f" '{'x' * 80}'; " in message
