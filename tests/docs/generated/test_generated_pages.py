"""The generated pages in docs/ are those of the source, and their parts say what they should."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import DemoGateway
from tests.support import clients
from tools.docs_pages import commands_page, grpc_page, http_page, lcm_page, limits_page, settings_page
from tools.docs_pages.openapi_text import curl, field_rows, type_text

DOCS = Path(__file__).parents[3] / "docs"


@pytest.mark.parametrize(
    ("name", "page"),
    [
        ("configuration.md", settings_page.page),
        ("reference/commands.md", commands_page.page),
        ("reference/grpc.md", grpc_page.page),
        ("reference/lcm.md", lcm_page.page),
    ],
)
def test_page_is_up_to_date(name: str, page: Callable[[], str]) -> None:
    if page is grpc_page.page:
        pytest.importorskip("grpc_tools", reason="grpcio-tools is not installed")
    assert (DOCS / name).read_text("utf-8") == page(), "make docs writes it anew"


def test_pages_of_the_site_can_be_made(demo_gateway: DemoGateway) -> None:
    schema = clients.get(f"{demo_gateway.url}/openapi.json").json()
    http = http_page.page(schema)
    assert {"### `POST /render`", "### `GET /scene`"} <= {*http.splitlines()}
    limits = limits_page.page()
    for name, value, text in (
        ("max_body_bytes", "256 Mi", "Size of one request's body. "),
        ("max_json_values", "2,000,000", "Commas, "),
        ("arrival_seconds", "5", "Seconds for which "),
    ):
        assert f"| `{name}` | {value} | {text}" in limits


@pytest.mark.parametrize(
    ("schema", "text"),
    [
        ({"type": "integer", "minimum": 1, "maximum": 16384}, "integer, 1 to 16384"),
        ({"type": "number", "exclusiveMinimum": 0.0}, "number, more than 0"),
        ({"type": ["number", "string"]}, "number or string"),
        ({"type": "array", "items": {"enum": ["a", "b"]}}, "array of: `a`, `b`"),
        ({"enum": [1, 4]}, "`1`, `4`"),
        ({"anyOf": [{"type": "integer", "minimum": 1}, {"type": "null"}], "maximum": 9}, "integer, 1 to 9"),
        ({"type": "string", "format": "binary"}, "file"),
    ],
)
def test_types_as_text(schema: dict[str, Any], text: str) -> None:
    assert type_text(schema) == text


def test_fields_of_a_body() -> None:
    schema = {"required": ["a"], "properties": {"a": {"type": "string", "description": "One | two."}, "b": {}}}
    assert list(field_rows(schema)) == ["| `a` | string | Required. One \\| two. |", "| `b` | any |  |"]


def test_request_has_the_examples_that_are_not_defaults() -> None:
    def parameter(name: str, place: str, value: Any, **schema: Any) -> dict[str, Any]:
        example = {"example": {"value": value}}
        return {"name": name, "in": place, "required": place == "path", "schema": schema, "examples": example}

    operation = {
        "parameters": [
            parameter("name", "path", "left"),
            parameter("width", "query", 320),
            parameter("look", "query", "plain", default="plain"),
            parameter("camera", "query", "a b"),
        ],
        "responses": {"200": {"content": {"image/jpeg": {}}}},
    }
    command = curl("GET", "/view/{name}.jpg", operation)
    assert command == "curl -o left.jpg \\\n  'http://127.0.0.1:8000/view/left.jpg?width=320&camera=a%20b'"
    body = {"content": {"application/json": {"example": {"value": True}}}}
    operation = {"requestBody": body, "responses": {"200": {}}}
    assert "-X PUT -H 'Content-Type: application/json'" in curl("PUT", "/x", operation)
    assert """-d '{"value": true}'""" in curl("PUT", "/x", operation)
