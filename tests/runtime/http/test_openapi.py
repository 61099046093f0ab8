"""The OpenAPI description of a whole gateway."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.adapters.stereo.device.parameter_specs import NODE_ALIASES, NODES
from gateway.app import create_app
from gateway.runtime.http.openapi import SECURITY_SCHEMES
from gateway.runtime.settings import Settings
from gateway.scene.draw.cameras import CAMERA_PATTERN, CameraError, parse_camera
from gateway.scene.draw.shown import COLOR_PATTERN, parse_color
from tests.conftest import DemoGateway
from tests.support import clients


@pytest.fixture(scope="module")
def schema(demo_gateway: DemoGateway) -> Any:
    return clients.get(f"{demo_gateway.url}/openapi.json").json()


def operations(schema: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for path, methods in schema["paths"].items():
        for method, operation in methods.items():
            yield f"{method.upper()} {path}", operation


def test_every_route_has_examples(schema: dict[str, Any]) -> None:
    lacks = []
    for name, operation in operations(schema):
        lacks += [f"{name} {p['name']}" for p in operation.get("parameters", ()) if not p.get("examples")]
        for kind, content in operation.get("requestBody", {}).get("content", {}).items():
            # Images are no JSON: the form with files has a command line instead.
            if not content.get("examples") and "curl" not in operation["requestBody"].get("description", ""):
                lacks.append(f"{name} {kind}")
        answer = operation["responses"]["200"].get("content", {})
        if "application/json" in answer and "example" not in answer["application/json"]:
            lacks.append(f"{name} 200")
    assert lacks == []


def test_responses_are_described_as_generated_clients_need_it(schema: dict[str, Any]) -> None:
    """They drop JSON without a schema, and fail to write text as binary."""
    wrong = []
    for name, operation in operations(schema):
        for kind, content in operation["responses"]["200"].get("content", {}).items():
            described = content.get("schema", {})
            if kind == "application/json" and described.get("items", described).get("type") != "object":
                wrong.append(f"{name} {described}")
            if kind.startswith("text/") and described.get("format") == "binary":
                wrong.append(f"{name} {kind}")
    assert wrong == []


def test_every_body_is_described_and_names_are_enumerated(schema: dict[str, Any]) -> None:
    found = dict(operations(schema))
    for name in ("/stereo/faults", "/api/v1/nodes/{node}/parameters", "/api/v1/nodes/{node}/services/{name}"):
        assert found[f"PUT {name}"]["requestBody"]["content"]["application/json"]["schema"]["type"], name
    assert found["PUT /api/v1/nodes/{node}/parameters"]["requestBody"]["required"] is False
    for name, operation in found.items():
        for parameter in operation.get("parameters", ()):
            if parameter["in"] == "path":
                assert parameter["schema"]["enum"], name
            if parameter["name"] == "node":
                assert parameter["schema"]["enum"] == [*NODES, *NODE_ALIASES]


def test_scenes_to_render_are_required_and_pages_are_not_described(schema: dict[str, Any]) -> None:
    assert schema["paths"]["/render"]["post"]["requestBody"]["required"] is True
    assert schema["paths"].keys() & {"/", "/view", "/docs", "/redoc", "/openapi.json"} == set()


def test_common_errors_are_described(schema: dict[str, Any]) -> None:
    for name, operation in operations(schema):
        assert {"421", "500", "503"} <= operation["responses"].keys(), name
        assert name.startswith("GET ") or "text/plain" in operation["responses"]["403"]["content"], name
    assert "text/plain" in schema["paths"]["/scene/render"]["get"]["responses"]["422"]["content"]
    assert "security" not in schema


def test_token_is_described_except_for_health(tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text("0123456789abcdef\n")
    schema = create_app(Settings(http_token_file=tokens)).openapi()
    assert schema["security"] == [{"token": []}, {"cookie": []}]
    assert schema["components"]["securitySchemes"].keys() == SECURITY_SCHEMES.keys()
    free = {name for name, operation in operations(schema) if operation.get("security") == []}
    assert free == {"GET /healthz", "GET /readyz"}
    assert "401" in schema["paths"]["/metrics"]["get"]["responses"]
    assert "401" not in schema["paths"]["/healthz"]["get"]["responses"]


@given(st.from_regex(COLOR_PATTERN, fullmatch=True))
def test_the_pattern_of_colours_is_their_grammar(text: str) -> None:
    assert bytes(parse_color("background", text)).hex() == text.lower()


@given(st.from_regex(CAMERA_PATTERN))
def test_the_pattern_of_cameras_is_their_grammar(text: str) -> None:
    try:
        parse_camera(text)
    except CameraError as error:
        assert re.search("same point as eye|has no direction", str(error)), error  # what a pattern cannot say
