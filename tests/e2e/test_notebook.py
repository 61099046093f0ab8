"""The example notebook runs unchanged, and a browser shows its outputs: live page, page in one file, image."""

import base64
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.support import clients
from tests.support.browser import chromium, new_page
from tests.support.gateway_process import gateway_process
from tests.support.http_stub import http_server
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.lcm]

NOTEBOOK = Path(__file__).parents[2] / "examples" / "notebook.ipynb"


@pytest.fixture(scope="module")
def outputs() -> Iterator[dict[str, dict[str, Any]]]:
    liblcm()
    nbformat = pytest.importorskip("nbformat", reason="nbclient is not installed")
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed")
    with gateway_process("--lcm-url", "off", "--grpc-port", "0", "--tcpq-port", "0") as (_, url):
        with clients.Client(base_url=url) as http:
            hub = http.get("/healthz").json()["interfaces"]["treeviewer"]["tcpq"]["url"]
        notebook = nbformat.read(NOTEBOOK, as_version=4)
        client = nbclient.NotebookClient(notebook, timeout=SECONDS, kernel_name="python3")
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("LCM_DEFAULT_URL", hub)
            patch.setenv("SCENEGATE_URL", url.replace("127.0.0.1", "localhost"))
            client.execute()
        found = {}
        for cell in notebook.cells:
            for output in cell.get("outputs", ()):
                assert output.output_type == "execute_result", output
                found[cell.source] = output.data
        yield found


@pytest.fixture(scope="module")
def page(outputs: dict[str, dict[str, Any]]) -> Iterator[Any]:
    body = "".join(data.get("text/html", "") for data in outputs.values())

    content = f"<!doctype html><title>Notebook</title>{body}".encode()
    with chromium() as browser, http_server(lambda _: (200, content), "text/html; charset=utf-8") as url:
        opened = new_page(browser, viewport={"width": 1000, "height": 1000})
        opened.goto(url.replace("127.0.0.1", "localhost"))
        yield opened


def red_share(pixels: Any) -> float:
    pixels = np.asarray(pixels).astype(int)
    return float(((pixels[:, :, 0] > pixels[:, :, 2] + 60) & (pixels[:, :, 1] > pixels[:, :, 2] + 20)).mean())


def test_outputs_are_frames_and_an_image(outputs: dict[str, dict[str, Any]]) -> None:
    live, still, image = outputs.values()
    assert [source.partition("\n")[0] for source in outputs] == [
        "viewer",
        "viewer.show(static=True, seconds=5)",
        'viewer.image("eye=1.5,-2,1.5;target=0,0,0.2", look="studio")',
    ]
    assert "/view" in live["text/html"]
    assert len(still["text/html"]) < 2_000_000
    assert red_share(Image.open(io.BytesIO(base64.b64decode(image["image/png"]))).convert("RGB")) > 0.01


@pytest.mark.parametrize("number", [0, 1])
def test_both_frames_show_the_scene(page: Any, number: int) -> None:
    frame = page.locator("iframe").nth(number)
    found = frame.content_frame.locator(".row").filter(has_text="arm")
    found.first.wait_for()

    def shows_the_arm() -> bool:
        return red_share(Image.open(io.BytesIO(frame.screenshot())).convert("RGB")) > 0.01

    wait_until(shows_the_arm)


def test_the_static_page_cannot_reach_the_notebook(page: Any) -> None:
    inner = page.frames[2]
    title = "() => { try { return parent.document.title; } catch (error) { return error.name; } }"
    assert inner.evaluate(title) == "SecurityError"
