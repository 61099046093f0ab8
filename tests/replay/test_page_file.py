"""The page and a recording in one HTML file."""

import base64
import hashlib
import html
import re
from collections.abc import AsyncIterator
from html.parser import HTMLParser

import httpx2
import pytest
from fastapi import FastAPI

from gateway.adapters.viewer.config import STATIC
from gateway.replay import page_file
from gateway.replay.page_file import scene_html
from gateway.replay.page_recorder import MAX_BYTES
from gateway.replay.share_routes import share_router
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.adapters.viewer.recordings import SECOND, headers_of
from tests.replay.test_page_recorder import moving_scene

MAX_PAGE_BYTES = 2_000_000
HOSTILE = "</script><script>alert(1)</script><!--"


class Parts(HTMLParser):
    """The elements of a file, as a browser finds them."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self._is_open = False
        self.elements: list[tuple[str, dict[str, str | None], str]] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs), ""))
        self._is_open = True

    def handle_endtag(self, tag: str) -> None:
        self._is_open = False

    def handle_data(self, data: str) -> None:
        if self._is_open:
            tag, attributes, text = self.elements[-1]
            self.elements[-1] = (tag, attributes, text + data)

    def texts(self, tag: str) -> list[str]:
        return [text for name, _, text in self.elements if name == tag]


def recording_of(page: bytes) -> bytes:
    """Return the recording in a file."""
    data = next(text for tag, attributes, text in Parts(page.decode()).elements if attributes.get("id") == "recording")
    return base64.b64decode(data, validate=True)


def test_the_policy_allows_the_scripts_of_the_page_alone() -> None:
    page = scene_html(b"recording").decode()
    parts = Parts(page)
    data, script = parts.texts("script")
    assert base64.b64decode(data) == b"recording"
    [style] = parts.texts("style")
    policy = next(attributes["content"] for tag, attributes, _ in parts.elements if "http-equiv" in attributes)
    for directive, text in (("script-src", script), ("style-src", style)):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{directive} 'sha256-{digest}';" in policy
    assert "default-src 'none'" in policy
    assert not re.search(r"(src|href)=\"(?!data:)", re.sub(r"<(script|style)[^>]*>.*?</\1>", "", page, flags=re.DOTALL))
    assert page.index("http-equiv") < page.index("charset=") < 1024


def test_the_licenses_of_the_libraries_are_in_the_file() -> None:
    [licenses] = Parts(scene_html(b"").decode()).texts("pre")
    assert licenses == html.unescape(STATIC.joinpath("THIRD_PARTY_LICENSES.md").read_text("utf-8"))
    assert "three" in licenses


def test_the_page_without_a_recording_is_small() -> None:
    assert len(scene_html(b"")) < MAX_PAGE_BYTES


class Served:
    """The route over a tree with a node that has a hostile name."""

    def __init__(self, max_bytes: int = MAX_BYTES, *, with_history: bool = False) -> None:
        self.tree = LiveTree()
        with self.tree.edit() as edit:
            edit.set_parts((HOSTILE,), (Part(Box((1, 1, 1)), Material()),))
        app = FastAPI()
        app.include_router(share_router(self.tree, LivePage(), moving_scene(9) if with_history else None, max_bytes))
        self.http = httpx2.AsyncClient(transport=httpx2.ASGITransport(app), base_url="http://view")


@pytest.fixture
async def served() -> AsyncIterator[Served]:
    made = Served()
    async with made.http:
        yield made


async def test_names_of_nodes_do_not_leave_the_data(served: Served) -> None:
    response = await served.http.get("/view/scene.html")
    assert response.status_code == 200
    assert response.headers["content-disposition"] == 'attachment; filename="scene.html"'
    assert "alert(1)" not in response.text
    assert len(Parts(response.text).texts("script")) == 2
    [update] = headers_of(recording_of(response.content), "update")
    assert [node["name"] for node in update["nodes"]] == [HOSTILE]


async def test_the_camera_is_an_attribute(served: Served) -> None:
    view = 'eye=1,2,3;target=0,0,0"><script>alert(1)</script>'
    response = await served.http.get("/view/scene.html", params={"view": view})
    parts = Parts(response.text)
    assert [attributes["data-view"] for _, attributes, _ in parts.elements if "data-view" in attributes] == [view]
    assert len(parts.texts("script")) == 2
    assert (await served.http.get("/view/scene.html", params={"view": "x" * 2001})).status_code == 422


async def test_the_route_has_the_last_seconds_of_the_history() -> None:
    served = Served(with_history=True)
    async with served.http as http:
        for query, count in (("?rate=1", 9), ("?rate=1&seconds=3", 4), ("?rate=1&seconds=1000", 9)):
            response = await http.get(f"/view/scene.html{query}")
            updates = headers_of(recording_of(response.content), "update")
            assert len({update["revision"] for update in updates}) == count, query
        still = await http.get("/view/scene.html?seconds=0")
        [update] = headers_of(recording_of(still.content), "update")
        assert update["timestamp"] == 9 * SECOND
        for query in ("seconds=-1", "rate=0", "rate=241", "seconds=nan", "seconds=inf"):
            assert (await http.get(f"/view/scene.html?{query}")).status_code == 422, query


async def test_a_file_beyond_the_limit_is_refused_with_a_sentence() -> None:
    served = Served(100)
    async with served.http as http:
        response = await http.get("/view/scene.html")
    assert response.status_code == 413
    assert response.text.startswith("the recording has more than 100 bytes")


def test_a_script_does_not_end_early(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_file, "_asset", lambda tag: 'a = "</SCRIPT><!--";' if "script" in tag else "p {}")
    page_file._page.cache_clear()  # noqa: SLF001 - it has the page of this build
    try:
        assert Parts(scene_html(b"").decode()).texts("script")[1] == 'a = "<\\/SCRIPT><\\!--";'
    finally:
        page_file._page.cache_clear()  # noqa: SLF001 - no public way to forget the page
