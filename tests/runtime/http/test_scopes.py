"""What the middleware leaves alone, what the log says of open interfaces, and how tokens are described."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from structlog.testing import capture_logs

from gateway.runtime.http import openapi
from gateway.runtime.http.access import Access
from gateway.runtime.http.edge import Edge
from gateway.runtime.http.protection import Protection
from gateway.runtime.http.security import Security
from gateway.runtime.http.start_gate import StartGate
from gateway.runtime.http.tokens import Tokens, read_tokens
from gateway.runtime.logs.metrics_registry import Metrics
from gateway.runtime.settings import Settings


@pytest.fixture
def tokens(tmp_path: Path) -> Tokens:
    path = tmp_path / "token"
    path.write_text("0123456789abcdef\n")
    return read_tokens(path)


class App:
    """Notes the scopes that reach it."""

    def __init__(self) -> None:
        self.scopes: list[str] = []

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        self.scopes.append(scope["type"])


async def test_lifespans_pass_the_edge(tokens: Tokens) -> None:
    app = App()
    never: Any = None
    edge = Edge(
        app,
        access=Access(tokens=tokens),
        protection=Protection(hosts=("here",)),
        metrics=Metrics(),
        gate=StartGate(started=asyncio.Event(), problem=lambda: "broken", open_paths=frozenset()),
    )
    await edge({"type": "lifespan", "path": ""}, never, never)
    assert app.scopes == ["lifespan"]


def log_of(**settings: Any) -> list[tuple[str, str]]:
    with capture_logs() as entries:
        Security.from_settings(Settings(**settings)).log_exposure()
    return [(entry["log_level"], entry["event"]) for entry in entries]


def test_open_interfaces_are_logged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LCM_DEFAULT_URL", raising=False)
    assert log_of() == []
    assert log_of(host="0.0.0.0", only="render", http_port=1234) == [
        (
            "warning",
            "HTTP is open to other machines (0.0.0.0 port 1234) without TLS and a token; see docs/security.md",
        )
    ]
    token = tmp_path / "token"
    token.write_text("0123456789abcdef\n")
    ((level, event),) = log_of(host="10.1.2.3", only="render", http_token_file=token)
    assert (level, event.partition(" without ")[2]) == ("warning", "TLS; see docs/security.md")


@pytest.mark.parametrize(
    ("url", "listed"),
    [
        ("udpm://239.1.1.1:1?ttl=1", True),
        ("udpm://239.1.1.1:1?ttl=0", False),
        ("udpm://239.1.1.1:1", False),
        ("tcpq://h:1?ttl=1", False),
    ],
)
def test_lcm_is_open_with_a_time_to_live(url: str, listed: bool) -> None:
    exposed = Security.from_settings(Settings(lcm_url=url)).exposed()
    assert [name for name, *_ in exposed] == ["LCM"] * listed


@pytest.mark.parametrize("token", [False, True])
def test_tokens_and_common_errors_are_described(token: bool) -> None:
    app = FastAPI()

    @app.get("/open")
    async def get(number: int) -> int:
        return number

    @app.post("/closed")
    async def post() -> None:
        return None

    openapi.describe(app, token=token, open_paths={"/open"})
    schema = app.openapi()
    assert app.openapi() is schema, "cached"
    schemes = schema["components"].get("securitySchemes", {})
    assert set(schemes) == set(openapi.SECURITY_SCHEMES if token else ()), "the page has a button for each"
    assert schema.get("security") == ([{name: []} for name in openapi.SECURITY_SCHEMES] if token else None)
    opened, closed = schema["paths"]["/open"]["get"], schema["paths"]["/closed"]["post"]
    assert opened.get("security") == ([] if token else None)
    assert "security" not in closed
    assert ("401" in closed["responses"]) == token
    assert "401" not in opened["responses"]
    assert "403" in closed["responses"]
    assert "403" not in opened["responses"]
    assert "text/plain" in opened["responses"]["422"]["content"]
    assert opened["responses"]["422"]["description"] != "Validation Error"
