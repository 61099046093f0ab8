"""Token, cookie, CSRF, headers and trusted hosts, without a server."""

from typing import Any

import httpx2
import pytest
from fastapi import APIRouter, FastAPI
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from gateway.runtime.http.access import COOKIE_NAME, Access, host_name, same_origin
from gateway.runtime.http.edge import Edge
from gateway.runtime.http.error_handlers import not_allowed, not_found
from gateway.runtime.http.protection import Protection
from gateway.runtime.http.tokens import COOKIE_SECONDS, Tokens

TOKEN, OTHER = "0123456789abcdef", "fedcba9876543210"
TOKENS = Tokens(OTHER, TOKEN)
NOW = 1.7e9
LOOPBACK = ("127.0.0.1", 8000)


async def hello(request: Request) -> PlainTextResponse:
    return PlainTextResponse(f"hello {request.url.query}")


def client(server: tuple[str, int] = LOOPBACK, **layers: Any) -> httpx2.AsyncClient:
    """Return a client of an application behind these layers of the edge, on a server with this address."""
    routes = [Route("/{path:path}", hello, methods=["GET", "POST", "PUT", "DELETE"])]
    app: Any = Edge(Starlette(routes=routes), **layers)

    async def at(scope: Any, receive: Any, send: Any) -> None:
        await app({**scope, "server": server}, receive, send)

    return httpx2.AsyncClient(transport=httpx2.ASGITransport(app=at), base_url="http://here:8000")


def with_tokens() -> httpx2.AsyncClient:
    return client(access=Access(tokens=TOKENS, open_paths={"/healthz"}))


def protected(server: tuple[str, int] = ("10.0.0.5", 8000), **options: Any) -> httpx2.AsyncClient:
    return client(server, protection=Protection(**options))


async def test_token_is_required_except_for_health() -> None:
    async with with_tokens() as http:
        assert (await http.get("/healthz")).status_code == 200
        refused = await http.get("/scene")
        assert (refused.status_code, refused.headers["www-authenticate"]) == (401, 'Bearer realm="scenegate"')
        assert (await http.get("/scene", headers={"Authorization": "Bearer wrong"})).status_code == 401
        assert (await http.get("/scene", headers={"Authorization": f"Bearer {TOKEN}"})).status_code == 200
        assert (await http.post(f"/scene?token={TOKEN}")).status_code == 401, "the address is for browsers only"


async def test_token_in_the_query_sets_an_httponly_cookie() -> None:
    async with with_tokens() as http:
        answer = await http.get(f"/view?a=1&token={TOKEN}&b=2")
        assert answer.status_code == 303
        assert answer.headers["location"] == "./view?a=1&b=2"
        cookie = answer.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=lax" in cookie
        assert TOKEN not in cookie
        assert f"max-age={COOKIE_SECONDS}" in cookie
        assert answer.headers["cache-control"] == "no-store"
        assert (await http.get("/view")).status_code == 200
        http.cookies.clear()
        assert (await http.get("/view", headers={"Cookie": f"{COOKIE_NAME}={TOKEN}"})).status_code == 401
        assert (await http.get("/view?token=wrong")).status_code == 401


@pytest.mark.parametrize(
    ("headers", "allowed"),
    [
        ({}, True),
        ({"Origin": "http://here:8000"}, True),
        ({"Origin": "https://here:8000"}, True),  # a proxy has the certificate
        ({"Origin": "http://evil.example"}, False),
        ({"Origin": "http://here:3000"}, False),
        ({"Origin": "http://here"}, False),
        ({"Origin": "null"}, False),
        ({"Origin": ""}, False),
        ({"Origin": "http://["}, False),
        ({"Origin": "https://dashboard.example"}, True),
        ({"Origin": "https://dashboard.example", "Sec-Fetch-Site": "cross-site"}, True),
        ({"Origin": "http://evil.example", "Sec-Fetch-Site": "cross-site"}, False),
        ({"Origin": "http://sub.here:8000", "Sec-Fetch-Site": "same-site"}, False),
        ({"Sec-Fetch-Site": "cross-site"}, False),
        ({"Sec-Fetch-Site": "same-origin"}, True),
        ({"Origin": "https://here", "Sec-Fetch-Site": "same-origin"}, True),  # a proxy has changed Host
        ({"Sec-Fetch-Site": "none"}, True),
        ({"Sec-Fetch-Site": "of tomorrow"}, False),
    ],
)
async def test_cross_site_requests_with_side_effects_are_refused(headers: dict[str, str], allowed: bool) -> None:
    async with protected(origins=("https://dashboard.example",)) as http:
        for method in ("POST", "PUT", "DELETE", "PATCH"):
            answer = await http.request(method, "/", headers=headers)
            assert (answer.status_code != 403) is allowed, method
            assert allowed or "--cors-origins" in answer.text
        for method in ("GET", "HEAD", "OPTIONS"):
            assert (await http.request(method, "/", headers=headers)).status_code != 403


@pytest.mark.parametrize(
    ("origins", "headers", "allowed"),
    [
        ((), {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}, False),
        ((), {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}, True),
        ((), {"Sec-Fetch-Site": "same-site", "Sec-Fetch-Mode": "no-cors"}, True),
        (("https://dashboard.example",), {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "no-cors"}, True),
    ],
)
async def test_pages_of_other_sites_get_no_images(
    origins: tuple[str, ...], headers: dict[str, str], allowed: bool
) -> None:
    async with protected(origins=origins) as http:
        answer = await http.get("/", headers=headers)
    assert (answer.status_code == 200) is allowed
    assert answer.headers["cross-origin-resource-policy"] == ("cross-origin" if origins else "same-site")


@pytest.mark.parametrize("second", ["http://here:8000", "http://evil.example"])
async def test_several_origins_are_refused(second: str) -> None:
    async with protected() as http:
        answer = await http.post("/", headers=[("Origin", "http://here:8000"), ("Origin", second)])
        assert answer.status_code == 403


async def test_wildcard_origin_allows_cross_site_requests() -> None:
    async with protected(origins=("*",)) as http:
        for headers in ({"Origin": "null"}, {"Sec-Fetch-Site": "cross-site"}):
            assert (await http.post("/", headers=headers)).status_code == 200


async def test_refusal_quotes_the_origin_shortened_and_escaped() -> None:
    async with protected() as http:
        answer = await http.post("/", headers={b"Origin": b"http://\xff\x1b[31m" + b"x" * 5000})
    assert len(answer.content) < 300
    assert answer.content.isascii()
    assert b"\x1b" not in answer.content


@pytest.mark.parametrize(
    ("origin", "host", "scheme", "same"),
    [
        ("http://127.0.0.1:8000", "127.0.0.1:8000", "http", True),
        ("http://127.0.0.1:8000", "127.0.0.1:8000", "ws", True),
        ("https://Robot.example", "robot.example", "http", True),
        ("https://robot.example", "robot.example:443", "https", True),
        ("http://robot.example", "robot.example:80", "http", True),
        ("http://[::1]:8000", "[::1]:8000", "http", True),
        ("http://robot.example:8000", "robot.example:8000", "https", False),
        ("http://robot.example:8000", "robot.example:8000", "wss", False),
        ("https://robot.example", "robot.example:80", "http", False),
        ("file://", "127.0.0.1:8000", "http", False),
        ("chrome-extension://127.0.0.1:8000", "127.0.0.1:8000", "http", False),
        ("null", "", "http", False),
        ("http://", "", "http", False),
        ("http://a:99999", "a:99999", "http", False),
    ],
)
def test_same_origin(origin: str, host: str, scheme: str, same: bool) -> None:
    assert same_origin(origin, host, scheme) is same


LOCAL = "http://localhost:* http://127.0.0.1:*"


@pytest.mark.parametrize(
    ("origins", "ancestors"),
    [
        ((), f"'self' {LOCAL}"),
        (("https://b.example", "https://a.example", "null"), f"'self' {LOCAL} https://a.example https://b.example"),
        (("*",), "*"),
    ],
)
async def test_headers_against_frames_and_content_sniffing(origins: tuple[str, ...], ancestors: str) -> None:
    async with protected(frame_origins=origins) as http:
        headers = (await http.get("/")).headers
    assert headers["content-security-policy"] == f"frame-ancestors {ancestors}"
    assert headers["x-content-type-options"] == "nosniff"


async def test_origins_may_embed_pages_and_refusals_have_the_headers_too() -> None:
    async with protected(origins=("https://a.example",), frame_origins=("https://b.example",)) as http:
        refused = await http.post("/", headers={"Origin": "https://b.example"})
    assert refused.status_code == 403
    assert refused.headers["content-security-policy"].endswith("https://a.example https://b.example")


@pytest.mark.parametrize("path", ["//evil.example", "///evil.example/x", "/%2f/evil.example", "/\\evil.example"])
async def test_redirect_never_leads_to_another_host(path: str) -> None:
    async with with_tokens() as http:
        answer = await http.get(httpx2.URL(f"http://here:8000{path}?token={TOKEN}"))
        location = answer.headers["location"]
        assert location.startswith("./")
        assert "/" not in location.removeprefix("./")


async def test_websocket_requires_the_token() -> None:
    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def inner(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "websocket.accept"})

    async def receive() -> Any:
        raise AssertionError

    access = Edge(inner, access=Access(tokens=TOKENS, clock=lambda: NOW))
    scope = {"type": "websocket", "path": "/view/ws", "headers": [], "query_string": f"token={TOKEN}".encode()}
    await access(scope, receive, send)
    cookie = [(b"cookie", f"other=1; {COOKIE_NAME}={TOKENS.cookie(TOKEN, NOW)}".encode())]
    await access({**scope, "headers": cookie}, receive, send)
    assert [message["type"] for message in sent] == ["websocket.close", "websocket.accept"]


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost:8000", 200),
        ("me.localhost", 200),
        ("127.0.0.1:8000", 200),
        ("[::1]:8000", 200),
        ("192.168.1.7:8000", 200),
        ("evil.example:8000", 421),
        ("localhost.evil.example", 421),
        ("127.0.0.1.evil.example", 421),
    ],
)
async def test_unknown_host_names_are_refused(host: str, status: int) -> None:
    async with protected(LOOPBACK) as http:
        assert (await http.get("/scene", headers={"Host": host})).status_code == status


async def test_any_host_name_is_accepted_on_external_addresses_by_default() -> None:
    async with protected() as http:
        assert (await http.get("/", headers={"Host": "gateway.example"})).status_code == 200
    async with protected(hosts=("gateway.example", "*.lab.example")) as http:
        for host, status in {
            "Gateway.Example:80": 200,
            "cell.lab.example": 200,
            "a.cell.lab.example": 200,
            "lab.example": 421,
            "other.example": 421,
        }.items():
            assert (await http.get("/", headers={"Host": host})).status_code == status, host
    async with protected(LOOPBACK, hosts=("*",)) as http:
        assert (await http.get("/", headers={"Host": "evil.example"})).status_code == 200


def test_host_name_is_parsed() -> None:
    assert [host_name(h) for h in ("A:1", "a", "[::1]:80", "::1", "[::1]")] == ["a", "a", "::1", "::1", "::1"]


async def test_405_lists_every_method_of_the_path() -> None:
    app = FastAPI()
    routes = APIRouter()
    for method in ("GET", "PUT"):
        routes.add_api_route("/thing/{name}", lambda name: name, methods=[method])
    app.include_router(routes)
    app.add_exception_handler(405, not_allowed)
    async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app=app), base_url="http://here") as http:
        answer = await http.delete("/thing/it")
        assert (answer.status_code, answer.headers["allow"]) == (405, "GET, HEAD, PUT")
        assert answer.text == "DELETE is not possible here; GET, HEAD, PUT is.\n"
        assert (await http.delete("/nothing")).status_code == 404


async def test_404_points_to_the_docs() -> None:
    app = FastAPI()
    app.add_exception_handler(404, not_found)
    async with httpx2.AsyncClient(transport=httpx2.ASGITransport(app=app), base_url="http://here") as http:
        answer = await http.get("/nothing?here=1")
        of_the_device = await http.get("/api/v2/nothing")
    assert answer.status_code == 404
    assert answer.text.startswith("Nothing is at /nothing here. /docs describes what there is")
    assert of_the_device.status_code == 404
    assert of_the_device.json()["return_code"] == {"value": -1, "message": of_the_device.json()["message"]}
