"""``scenegate serve``: flags, exit codes and what is logged, with a server that does not listen."""

import asyncio
import gc
import os
import re
import signal
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest
import structlog
import typer
from structlog.testing import capture_logs
from typer.testing import CliRunner

from gateway.cli import serve, serve_app
from gateway.cli.commands import app
from gateway.runtime.http import http_server
from gateway.runtime.logs import log_setup
from gateway.runtime.settings import Settings
from gateway.runtime.workers import process_tuning
from tests.support.waiting import SECONDS


@pytest.fixture(autouse=True)
def _process() -> Iterator[None]:
    """Keep signals, the garbage collector and the log as they are."""
    handler = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, handler)
    gc.enable()
    structlog.reset_defaults()


def flags(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> tuple[int, list[Settings], str]:
    """Run the command up to its settings; return exit code, settings and standard error."""
    used: list[Settings] = []

    def run(settings: Settings) -> int:
        used.append(settings)
        return 0

    def end(code: int) -> NoReturn:
        raise typer.Exit(code)

    monkeypatch.setattr(serve, "run", run)
    monkeypatch.setattr(serve, "end", end)
    result = CliRunner().invoke(app, ["serve", *arguments])
    return result.exit_code, used, result.stderr


def test_flags_become_settings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    config = tmp_path / "scenegate.toml"
    config.write_text("queue = 5\nhttp_port = 1\n")
    code, (settings,), _ = flags(
        monkeypatch, "--config", str(config), "--port", "9000", "--demo", "--no-stereo-noise", "--only", "render,view"
    )
    assert code == 0
    assert (settings.http_port, settings.queue, settings.demo, settings.stereo_noise) == (9000, 5, True, False)
    assert settings.only == ("render", "view")
    _, (settings,), _ = flags(monkeypatch)
    assert settings == Settings()


def test_invalid_flags_are_a_sentence_on_standard_error(monkeypatch: pytest.MonkeyPatch) -> None:
    code, used, error = flags(monkeypatch, "--http-port", "x")
    assert (code, used) == (2, [])
    assert error.startswith("scenegate: --http-port: input should be a valid integer")


def help_text(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["serve", *arguments], env={"COLUMNS": "100", "TERM": "dumb"})
    assert result.exit_code == 0
    return result.stdout


def test_help_has_the_common_flags_and_help_all_has_all() -> None:
    short, full = help_text("--help"), help_text("--help-all")
    flags = {name: "--" + name.replace("_", "-") for name in Settings.model_fields}
    assert set(flags) >= serve.COMMON
    shown = {name for name, flag in flags.items() if re.search(rf"{flag}[ ,/]", short)}
    assert shown == serve.COMMON
    assert [flag for flag in flags.values() if flag not in full] == []
    assert "--help-all" in short
    assert help_text("--help") == short  # asking for all flags changes nothing for later calls


class FakeServer:
    """Serves nothing; ``on_serve`` is called instead."""

    started = True
    fails = False

    def __init__(self, config: Any, on_shutdown: Any) -> None:
        self.app, self.on_shutdown = config.app, on_shutdown
        self.should_exit = False

    async def serve(self, sockets: list[socket.socket]) -> None:
        context = self.app.state.context
        assert sockets[0].getsockname()[1] > 0
        assert not self.app.state.closing()
        if self.fails:
            context.on_fatal()
            assert self.app.state.closing()
        self.on_shutdown()
        await context.close()
        sockets[0].close()


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> type[FakeServer]:
    fake = type("Server", (FakeServer,), {})
    monkeypatch.setattr(http_server, "MainServer", fake)
    monkeypatch.setattr(log_setup, "configure", lambda *_, **__: None)
    monkeypatch.setattr(process_tuning, "pause_gc", lambda: None)
    return fake


@pytest.mark.parametrize(("started", "fails", "code"), [(True, False, 0), (False, False, 3), (True, True, 1)])
def test_exit_codes(server: type[FakeServer], started: bool, fails: bool, code: int) -> None:
    server.started, server.fails = started, fails
    with capture_logs() as entries:
        assert serve.run(Settings(http_port=0, shutdown_seconds=1.0)) == code
    assert [entry["event"] for entry in entries][-2:] == [
        "Scenegate stops; requests that it has accepted may finish",
        "Scenegate has stopped",
    ]


@pytest.mark.parametrize(
    ("settings", "pages", "url"),
    [
        ({}, "/view, / and /docs", "http://127.0.0.1:"),
        ({"only": ("render",)}, "/ and /docs", "http://127.0.0.1:"),
        ({"only": ("render", "view")}, "/view, / and /docs", "http://127.0.0.1:"),
        ({"host": "::1"}, "/view, / and /docs", "http://[::1]:"),
        ({"host": "0.0.0.0"}, "/view, / and /docs", "http://localhost:"),
    ],
)
def test_the_address_is_logged(server: type[FakeServer], settings: dict[str, Any], pages: str, url: str) -> None:
    with capture_logs() as entries:
        assert serve.run(Settings(http_port=0, **settings)) == 0
    (entry,) = [entry for entry in entries if "listens" in entry["event"]]
    assert entry["event"] == f"Scenegate listens; look at {pages}"
    assert entry["url"].startswith(url)


def test_a_taken_port_is_an_error(server: type[FakeServer]) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with capture_logs() as entries:
            assert serve.run(Settings(http_port=port)) == 1
    assert entries[-1]["log_level"] == "error"
    assert f"(127.0.0.1 port {port}); choose another with --http-port or --host." in entries[-1]["event"]


def test_a_state_file_that_cannot_be_used_is_an_error(server: type[FakeServer], tmp_path: Path) -> None:
    path = tmp_path / "state"
    path.write_bytes(b"something else, and longer than a header of a database")
    with capture_logs() as entries:
        assert serve.run(Settings(http_port=0, state=path)) == 1
    assert str(path) in entries[-1]["event"]


def test_unknown_variables_are_warnings(server: type[FakeServer], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENEGATE_HTPP_PORT", "1")
    with capture_logs() as entries:
        serve.run(Settings(http_port=0))
    assert "SCENEGATE_HTPP_PORT is not a setting; did you mean SCENEGATE_HTTP_PORT?" in [e["event"] for e in entries]


def test_a_process_whose_threads_do_not_end_is_ended(server: type[FakeServer], monkeypatch: pytest.MonkeyPatch) -> None:
    async def serve_long(self: FakeServer, sockets: list[socket.socket]) -> None:
        self.on_shutdown()
        await asyncio.to_thread(ended.wait, SECONDS)
        await self.app.state.context.close()
        sockets[0].close()

    ended = threading.Event()
    codes: list[int] = []

    def exit_(code: int) -> None:
        codes.append(code)
        ended.set()

    monkeypatch.setattr(server, "serve", serve_long)
    monkeypatch.setattr(serve_app, "RESPONSE_SECONDS", 0.0)
    monkeypatch.setattr(serve_app, "CLOSE_SECONDS", 0.0)
    monkeypatch.setattr(os, "_exit", exit_)
    with capture_logs() as entries:
        serve.run(Settings(http_port=0, shutdown_seconds=0.0))
    assert codes == [0]
    assert entries[-1]["event"] == "Scenegate has stopped"
