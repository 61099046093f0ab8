"""Hostile HTTP against a whole gateway: paths, headers, hosts, WebSockets, encodings."""

import gzip
import socket
import time
from collections.abc import Callable
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from gateway.adapters.viewer.routes import MAX_MESSAGE_CHARS
from tests.support import clients, forms
from tests.support.waiting import SECONDS


def raw(url: str, data: bytes, *, finish: bool = True) -> bytes:
    """Send bytes and return the response up to the end of the connection. ``finish``: half-close after sending."""
    parts = urlsplit(url)
    with socket.create_connection((parts.hostname or "", parts.port or 0), timeout=SECONDS) as connection:
        connection.sendall(data)
        if finish:
            connection.shutdown(socket.SHUT_WR)
        received = b""
        try:
            while piece := connection.recv(65536):
                received += piece
        except ConnectionError:
            pass
        return received


def statuses(answer: bytes) -> list[int]:
    return [int(part[:3]) for part in answer.split(b"HTTP/1.1 ")[1:]]


@pytest.mark.parametrize(
    "path",
    [
        "/view/assets/..%2f..%2findex.html",
        "/view/assets/../../../app.py",
        "/view/assets/%2e%2e/%2e%2e/routes.py",
        "/view/assets/..%5c..%5croutes.py",
        "/view/assets//etc/passwd",
        "/view/assets/%00",
        "/static-offline-docs/..%2f..%2f..%2fetc%2fpasswd",
        "/static-offline-docs/../../../../etc/passwd",
        "/..%2f..%2fetc/passwd",
        "//etc/passwd",
    ],
)
def test_path_traversal_is_refused(gateway_url: str, path: str) -> None:
    request = f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    answer = raw(gateway_url, request.encode(), finish=False)
    assert statuses(answer) in ([404], [400]), answer[:200]
    assert b"root:" not in answer
    assert b"from __future__" not in answer


HOST = b"Host: localhost\r\n"


@pytest.mark.parametrize(
    "head",
    [
        b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n",
        b"Transfer-Encoding: chunked\r\nContent-Length: 5\r\n",
        b"Content-Length: 5\r\nContent-Length: 6\r\n",
        b"Content-Length: +5\r\n",
        b"Content-Length: -1\r\n",
        b"Content-Length: 99999999999999999999999\r\n",
        b"Transfer-Encoding: xchunked\r\n",
        b"Transfer-Encoding : chunked\r\n",
        b"X-Name\0: 1\r\n",
        b"X-Name: a\0b\r\n",
        b" folded: 1\r\n",
    ],
)
def test_request_smuggling_gets_no_second_response(gateway_url: str, head: bytes) -> None:
    smuggled = b"GET /healthz HTTP/1.1\r\n" + HOST + b"\r\n"
    answer = raw(gateway_url, b"POST /render HTTP/1.1\r\n" + HOST + head + b"\r\n0\r\n\r\n" + smuggled)
    assert 200 not in statuses(answer), answer[:300]
    assert len(statuses(answer)) <= 1


@pytest.mark.parametrize(
    "start", [b"GET / HTTP/9.9", b"G\0T / HTTP/1.1", b"\x16\x03\x01\x02\x00\x01", b"PRI * HTTP/2.0"]
)
def test_other_protocols_are_refused(gateway_url: str, start: bytes) -> None:
    answer = raw(gateway_url, start + b"\r\n" + HOST + b"\r\n")
    assert 200 not in statuses(answer)
    assert clients.get(f"{gateway_url}/healthz").status_code == 200


def test_line_breaks_in_a_request_id_are_dropped(gateway_url: str) -> None:
    answer = raw(gateway_url, b"GET /healthz HTTP/1.1\r\n" + HOST + b"X-Request-ID: a\rSet-Cookie: b=1\r\n\r\n")
    assert b"Set-Cookie" not in answer


def test_dns_rebinding_is_refused(gateway_url: str) -> None:
    """DNS rebinding: the browser believes to talk to the attacker's host."""
    for path in ("/scene", "/view", "/healthz", "/api/v2/system"):
        answer = clients.get(gateway_url + path, headers={"Host": "rebound.example:8000"})
        assert answer.status_code == 421, path
    asked = b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    asked += b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nOrigin: http://rebound.example\r\n\r\n"
    refused = raw(gateway_url, b"GET /view/ws HTTP/1.1\r\nHost: rebound.example\r\n" + asked, finish=False)
    assert statuses(refused) == [403]


def test_two_host_headers_are_refused(gateway_url: str) -> None:
    answer = raw(gateway_url, b"GET /healthz HTTP/1.1\r\n" + HOST + b"Host: rebound.example\r\n\r\n")
    assert statuses(answer) == [421]


def test_cross_site_page_cannot_open_the_websocket(gateway_url: str) -> None:
    with pytest.raises(InvalidStatus):
        clients.websocket(_websocket(gateway_url), origin="https://evil.example")
    # With a limited queue the client stops reading, and waits 10 s for the end of the connection.
    with clients.websocket(_websocket(gateway_url), max_size=None, max_queue=None) as socket:
        assert isinstance(socket.recv(SECONDS), bytes)


def test_cross_site_page_cannot_read_responses(gateway_url: str) -> None:
    answer = clients.get(f"{gateway_url}/scene", headers={"Origin": "https://evil.example"})
    assert not [name for name in answer.headers if name.startswith("access-control")]


@pytest.mark.parametrize("headers", [{"Origin": "http://evil.example"}, {"Sec-Fetch-Site": "cross-site"}])
def test_cross_site_page_cannot_change_anything(gateway_url: str, headers: dict[str, str]) -> None:
    """CSRF: a form or a simple request that any page may send; without these headers it is a program's."""
    with clients.Client(base_url=gateway_url, timeout=SECONDS) as http:
        camera = "/api/v2/pipelines/0/nodes/rc_stereocamera/parameters"
        for method, path in (
            ("POST", "/stereo/faults/disconnect"),
            ("PUT", "/stereo/faults"),
            ("PUT", camera),
            ("POST", "/render"),
            ("POST", "/nothing"),
        ):
            refused = http.request(method, path, content=b"{}", headers=headers)
            assert refused.status_code == 403, path
            assert "--cors-origins" in refused.text, path  # and not that faults are off
            assert "--cors-origins" not in http.request(method, path, content=b"{}").text, path
        own = {"Origin": gateway_url, "Sec-Fetch-Site": "same-origin"}
        assert http.put(camera, content=b"{}", headers=own).status_code != 403


def test_frames_of_other_sites_are_refused(gateway_url: str) -> None:
    ancestors = "frame-ancestors 'self' http://localhost:* http://127.0.0.1:*"
    for path in ("/view", "/", "/docs", "/nothing"):
        headers = clients.get(gateway_url + path).headers
        assert headers["content-security-policy"].split(", ")[-1] == ancestors, path
        assert headers["x-content-type-options"] == "nosniff", path


@pytest.mark.slow
def test_head_works_for_every_route_with_get(gateway_url: str) -> None:
    with clients.Client(base_url=gateway_url) as http:
        described = http.get("/openapi.json").json()["paths"]
        paths = [path for path, methods in described.items() if "get" in methods and "{" not in path]
        for path in (*paths, "/", "/view", "/docs", "/openapi.json", "/view/sensor", "/view/renders", "/render"):
            head = http.head(path)
            assert head.content == b"", path
            if path == "/view/stream.mjpg":  # GET would not end
                assert head.status_code == 200
                continue
            get = http.get(path)
            assert head.status_code == get.status_code, path
            assert head.headers["content-type"] == get.headers["content-type"], path


def receive_for(seconds: float, receive: Callable[[float], object]) -> None:
    """Receive messages for a time: the page's status comes every second."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        receive(seconds)


@pytest.mark.parametrize("message", ["x" * (MAX_MESSAGE_CHARS + 1), "x" * 1_000_000, b"\0" * 100])
def test_long_messages_close_their_own_websocket_only(gateway_url: str, message: str | bytes) -> None:
    with clients.websocket(_websocket(gateway_url), max_size=None) as socket:
        socket.send(message)
        with pytest.raises(ConnectionClosed):
            receive_for(SECONDS, socket.recv)
    assert clients.get(f"{gateway_url}/healthz").status_code == 200


def test_compressed_bodies_are_not_unpacked(gateway_url: str) -> None:
    body = gzip.compress(bytes(64 << 20))
    headers = {"Content-Type": forms.CONTENT_TYPE, "Content-Encoding": "gzip"}
    answer = clients.post(f"{gateway_url}/render", content=body, headers=headers, timeout=SECONDS)
    assert answer.status_code == 415


@pytest.mark.parametrize("value", ["1e9", "-1", "99999999999999999999", "nan", "1" * 5000])
def test_huge_dimensions_are_refused_before_anything_is_allocated(gateway_url: str, value: str) -> None:
    for query in ({"width": value}, {"height": value}):
        assert clients.get(f"{gateway_url}/scene/render", params=query).status_code in (400, 422)
        assert clients.get(f"{gateway_url}/view/frame.jpg", params=query).status_code in (400, 422)


def _websocket(url: str) -> str:
    return url.replace("http", "ws") + "/view/ws"
