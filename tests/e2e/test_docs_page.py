"""The page /docs in a real browser: "Try it out" sends each example as it is, and the response arrives."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support import clients
from tests.support.browser import chromium, new_page
from tests.support.forms import gltf
from tests.support.gateway_process import gateway_process

pytestmark = [pytest.mark.browser, pytest.mark.slow]

PARAMETER = "/api/v2/pipelines/0/nodes/{node}/parameters/{name}"


@pytest.fixture(scope="module")
def docs() -> Iterator[tuple[Any, dict[str, Any]]]:
    with (
        chromium() as browser,
        gateway_process("--lcm-url", "off", "--grpc-port", "0", "--tcpq-port", "0", "--demo") as (_, url),
    ):
        with clients.Client(base_url=url) as http:
            schema = http.get("/openapi.json").json()
        page = new_page(browser, viewport={"width": 1280, "height": 1000})
        foreign: list[str] = []
        page.on(
            "request",
            lambda request: (
                foreign.append(request.url) if not request.url.startswith((url, "data:", "blob:")) else None
            ),
        )
        page.goto(f"{url}/docs")
        page.locator(".opblock").first.wait_for()
        yield page, schema
        assert foreign == [], "the page loads nothing from other hosts"


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("get", "/healthz"),
        ("get", "/scene"),
        ("get", "/scene/render"),
        ("get", "/view/frame.jpg"),
        ("get", PARAMETER),
        ("put", PARAMETER),
        ("post", "/render"),
    ],
)
def test_try_it_out_sends_the_example(docs: tuple[Any, dict[str, Any]], method: str, path: str, tmp_path: Path) -> None:
    page, schema = docs
    operation = schema["paths"][path][method]["operationId"]
    block = page.locator(f".opblock[id$='-{operation}']")
    block.locator(".opblock-summary-control").click()
    block.get_by_role("button", name="Try it out").click()
    if path == "/render":
        scene = tmp_path / "scene.gltf"
        scene.write_text(json.dumps(gltf()))
        block.locator("input[type=file]").set_input_files(scene)
    with page.expect_response(lambda response: response.request.method == method.upper()) as sent:
        block.get_by_role("button", name="Execute").click()
    assert sent.value.status == 200, sent.value.text()
    block.locator(".live-responses-table .response-col_status", has_text="200").first.wait_for()
    block.locator(".opblock-summary-control").click()
