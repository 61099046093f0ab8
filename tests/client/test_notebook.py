"""What the client gives a notebook to show, without one."""

import html
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from http.server import BaseHTTPRequestHandler
from types import ModuleType

import pytest

from scenegate import AsyncTreeViewer
from scenegate.tree.notebook import NotebookFrame, NotebookViews
from tests.support.http_stub import http_server
from tests.support.waiting import SECONDS

PAGE = '<!doctype html><p title="a">1 & 2</p><script>"</script>'


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SCENEGATE_URL", "SCENEGATE_TOKEN"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def gateway() -> Iterator[tuple[str, list[str]]]:
    """URL of a server with a page and an image, and its requests."""
    requests: list[str] = []

    def answer(request: BaseHTTPRequestHandler) -> tuple[int, bytes]:
        requests.append(f"{request.path} {request.headers['Authorization']}")
        content = PAGE.encode() if ".html" in request.path else b"camera='nowhere' is not a camera"
        return 400 if "nowhere" in request.path else 200, content

    with http_server(answer) as url:
        yield url, requests


def frame_of(shown: NotebookFrame) -> dict[str, str | None]:
    """Return the attributes of the only element, the frame."""
    found: list[tuple[str, dict[str, str | None]]] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            found.append((tag, dict(attrs)))

    Reader().feed(shown._repr_html_())
    [(tag, attributes)] = found
    assert tag == "iframe"
    return attributes


@pytest.mark.parametrize(
    ("lcm_url", "page"),
    [
        ("tcpq://127.0.0.1:7700", "http://localhost:8000"),
        ("tcpq://localhost:7700", "http://localhost:8000"),
        ("tcpq://robot.lan:7700", "http://robot.lan:8000"),
        ("udpm://239.255.76.67:7667", "http://localhost:8000"),
        ("", "http://localhost:8000"),
    ],
)
def test_the_page_is_on_the_host_of_the_hub(lcm_url: str, page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert NotebookViews(lcm_url).page_url == page
    monkeypatch.setenv("SCENEGATE_URL", "https://robot.example/a/")
    assert NotebookViews(lcm_url).page_url == "https://robot.example/a"


def test_the_live_page_is_a_frame_without_a_request() -> None:
    views = NotebookViews("tcpq://127.0.0.1:7700")
    views.page_url = 'http://host:1/"><script>/'
    frame = frame_of(views.show(height=300))
    assert frame["src"] == 'http://host:1/"><script>/view'
    assert frame["height"] == "300"
    assert views._repr_html_() == views.show().html


def test_the_static_page_is_in_the_frame(gateway: tuple[str, list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    url, requests = gateway
    monkeypatch.setenv("SCENEGATE_TOKEN", "secret")
    views = NotebookViews("")
    views.page_url = url
    frame = frame_of(views.show(static=True, seconds=5))
    assert frame["srcdoc"] == PAGE
    assert frame["sandbox"] == "allow-scripts allow-downloads"
    assert requests == ["/view/scene.html?seconds=5 Bearer secret"]
    assert html.escape(PAGE) not in repr(views.show(static=True))


def test_colab_gets_the_static_page(gateway: tuple[str, list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "google.colab", ModuleType("google.colab"))
    views = NotebookViews("")
    views.page_url = gateway[0]
    assert frame_of(views.show())["srcdoc"] == PAGE
    assert "src" in frame_of(views.show(static=False))


def test_an_image_is_a_png(gateway: tuple[str, list[str]]) -> None:
    views = NotebookViews("")
    views.page_url = gateway[0]
    image = views.image("stereo", 320, 240, type="label")
    assert image._repr_png_() == image.png
    assert gateway[1] == ["/scene/render?camera=stereo&width=320&height=240&type=label None"]
    with pytest.raises(ValueError, match="scene/render: 400: camera='nowhere'"):
        views.image("nowhere")


def test_without_a_gateway_static_pages_are_a_sentence() -> None:
    views = NotebookViews("")
    views.page_url = "http://127.0.0.1:1"
    with pytest.raises(ConnectionError, match=r"http://127\.0\.0\.1:1 gives no view/scene\.html"):
        views.show(static=True)
    views.page_url = "/user/ann/proxy/8000"
    assert frame_of(views.show())["src"] == "/user/ann/proxy/8000/view"
    with pytest.raises(ValueError, match="'/user/ann/proxy/8000'"):
        views.show(static=True)


async def test_the_asynchronous_viewer_has_it(gateway: tuple[str, list[str]]) -> None:
    async with AsyncTreeViewer("memq://", timeout=SECONDS) as viewer:
        viewer.page_url = gateway[0]
        assert frame_of(await viewer.show(static=True))["srcdoc"] == PAGE
        assert (await viewer.image()).png
        assert f'src="{gateway[0]}/view"' in viewer._repr_html_()
