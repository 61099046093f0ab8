"""Logs: one format for structlog and the standard library."""

import io
import json
import logging
import os
import socket
import subprocess
import sys
from collections.abc import Iterator, MutableMapping
from pathlib import Path
from typing import Any

import pytest
import structlog
import uvicorn

from gateway.runtime.logs import log_setup
from tests.support.certificates import certificate
from tests.support.waiting import SECONDS


@pytest.fixture(autouse=True)
def _restore() -> Iterator[None]:
    loggers = [logging.getLogger(name) for name in (None, "uvicorn", "uvicorn.error", "uvicorn.access")]
    before = [(logger.handlers[:], logger.level, logger.propagate) for logger in loggers]
    yield
    for logger, (handlers, level, propagate) in zip(loggers, before, strict=True):
        logger.handlers[:], logger.propagate = handlers, propagate
        logger.setLevel(level)
    structlog.reset_defaults()


def test_json_lines_carry_level_logger_and_context(capsys: pytest.CaptureFixture[str]) -> None:
    log_setup.configure("json", "info")
    with structlog.contextvars.bound_contextvars(request_id="r1"):
        structlog.get_logger("gateway.x").info("drawn", ms=3)
        logging.getLogger("some.library").warning("%d left", 2)
    structlog.get_logger("gateway.x").debug("not shown")
    first, second = (json.loads(line) for line in capsys.readouterr().err.splitlines())
    assert (first["event"], first["ms"], first["logger"], first["request_id"]) == ("drawn", 3, "gateway.x", "r1")
    assert (second["event"], second["level"], second["request_id"]) == ("2 left", "warning", "r1")
    assert first["timestamp"].endswith("Z")


@pytest.mark.parametrize(
    ("environment", "colored"), [({}, True), ({"NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)]
)
def test_lines_in_a_terminal_are_coloured(
    monkeypatch: pytest.MonkeyPatch, environment: dict[str, str], colored: bool
) -> None:
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    log_setup.configure("auto", "info")
    structlog.get_logger("gateway.x").info("drawn", why="x")
    assert "drawn" in terminal.getvalue()
    assert not terminal.getvalue().startswith("{")
    assert ("\x1b[" in terminal.getvalue()) is colored


def test_lines_of_one_of_several_processes_have_its_number(capsys: pytest.CaptureFixture[str]) -> None:
    log_setup.configure("json", "info", worker=4711)
    structlog.get_logger("gateway.x").info("drawn")
    logging.getLogger("some.library").warning("left")
    assert [json.loads(line)["worker"] for line in capsys.readouterr().err.splitlines()] == [4711, 4711]


def test_entries_below_the_level_are_not_formatted(capsys: pytest.CaptureFixture[str]) -> None:
    class Asked:
        def __repr__(self) -> str:
            raise AssertionError

    seen: list[object] = []

    def collect(logger: object, name: str, event: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
        seen.append(event)
        return event

    log_setup.configure("json", "info")
    processors = structlog.get_config()["processors"]
    structlog.configure(processors=[processors[0], collect])
    structlog.get_logger("gateway.x").debug("not shown", value=Asked())
    assert seen == []
    logging.getLogger("gateway.x").setLevel("DEBUG")
    try:
        assert processors[0](logging.getLogger("gateway.x"), "debug", {}) == {}
    finally:
        logging.getLogger("gateway.x").setLevel("NOTSET")


def test_auto_is_json_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    log_setup.configure("auto", "info")
    structlog.get_logger().info("hello")
    assert json.loads(capsys.readouterr().err)["event"] == "hello"


@pytest.mark.parametrize(
    ("level", "uvicorn_level", "shown"), [("info", "info", 2), ("warning", "info", 1), ("info", "error", 0)]
)
def test_lines_of_uvicorns_command_are_json(
    capfd: pytest.CaptureFixture[str], level: str, uvicorn_level: str, shown: int
) -> None:
    uvicorn.Config("gateway.app:app", log_level=uvicorn_level)  # gives its loggers handlers, as its command does
    log_setup.configure("json", level, log_uvicorn=True)
    logging.getLogger("uvicorn.error").info("Started server process [%d]", 7, extra={"color_message": "coloured"})
    logging.getLogger("uvicorn.error").warning("Invalid HTTP request received.")
    assert not logging.getLogger("uvicorn.access").hasHandlers()  # what uvicorn asks before it logs a request
    out, err = capfd.readouterr()
    assert out == ""
    events = [json.loads(line)["event"] for line in err.splitlines()]
    assert events == ["Started server process [7]", "Invalid HTTP request received."][2 - shown :]


def test_scenegate_serve_hides_uvicorns_start_and_end(capfd: pytest.CaptureFixture[str]) -> None:
    log_setup.configure("json", "info")
    logging.getLogger("uvicorn.error").info("Started server process")
    logging.getLogger("uvicorn.error").warning("Invalid HTTP request received.")
    (line,) = capfd.readouterr().err.splitlines()
    assert json.loads(line)["logger"] == "uvicorn.error"


def test_text_of_clients_is_escaped_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    log_setup.configure("human", "info")
    channel = "\x1b[31mred\r\nFAKE"
    structlog.get_logger().warning(f"unknown {channel}", channel=channel, bare="\x1b")
    logging.getLogger("some.library").warning("%s left", channel)
    try:
        raise ValueError(channel)
    except ValueError:
        structlog.get_logger().exception("failed")
    lines = capsys.readouterr().err.split("\n")
    assert all(line.isprintable() for line in lines)
    assert not any(line.startswith("FAKE") for line in lines)
    assert sum(r"\x1b[31mred\r" in line for line in lines) == 3


def test_an_exception_stays_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    log_setup.configure("json", "info")
    try:
        raise KeyError("gone")
    except KeyError:
        structlog.get_logger().exception("failed")
    (line,) = capsys.readouterr().err.splitlines()
    assert "KeyError: 'gone'" in json.loads(line)["exception"]


GRPC_SERVER = """
import concurrent.futures, pathlib, sys
from gateway.runtime.logs import log_setup
from tests.support.certificates import certificate
from tests.support.waiting import SECONDS
log_setup.configure("json")
import grpc, structlog
certificate, key = (pathlib.Path(path).read_bytes() for path in sys.argv[1:])
server = grpc.server(concurrent.futures.ThreadPoolExecutor(1))
port = server.add_secure_port("127.0.0.1:0", grpc.ssl_server_credentials([(key, certificate)]))
server.start()
print(port, flush=True)
sys.stdin.read()
structlog.get_logger("gateway").info("end")
server.stop(0).wait()
"""


def test_every_line_is_json_whatever_the_core_of_grpc_says(tmp_path: Path) -> None:
    """It writes an error of its own when a client without TLS connects."""
    command = [sys.executable, "-c", GRPC_SERVER, *map(str, certificate(tmp_path))]
    environment = {name: value for name, value in os.environ.items() if name != "GRPC_VERBOSITY"}
    pipes: dict[str, Any] = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, env=environment, text=True, **pipes) as server:
        with socket.create_connection(("127.0.0.1", int(server.stdout.readline())), SECONDS) as client:
            client.sendall(b"no TLS\r\n" * 10)
            while client.recv(4096):  # until the server has refused
                pass
        _, errors = server.communicate(timeout=SECONDS)
    assert [json.loads(line)["event"] for line in errors.splitlines()] == ["end"]
