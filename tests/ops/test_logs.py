"""Logs: one format for structlog and the standard library."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator

import pytest
import structlog

from gateway.ops import logs


@pytest.fixture(autouse=True)
def _restore() -> Iterator[None]:
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers[:], root.level = handlers, level
    structlog.reset_defaults()


def test_json_lines_carry_level_logger_and_context(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure("json", "info")
    with structlog.contextvars.bound_contextvars(request_id="r1"):
        structlog.get_logger("gateway.x").info("drawn", ms=3)
        logging.getLogger("some.library").warning("%d left", 2)
    structlog.get_logger("gateway.x").debug("not shown")
    first, second = (json.loads(line) for line in capsys.readouterr().err.splitlines())
    assert (first["event"], first["ms"], first["logger"], first["request_id"]) == ("drawn", 3, "gateway.x", "r1")
    assert (second["event"], second["level"], second["request_id"]) == ("2 left", "warning", "r1")
    assert first["timestamp"].endswith("Z")


def test_what_is_not_logged_is_not_made_ready(capsys: pytest.CaptureFixture[str]) -> None:
    class Asked:
        def __repr__(self) -> str:
            raise AssertionError

    seen: list[object] = []
    logs.configure("json", "info")
    processors = structlog.get_config()["processors"]
    structlog.configure(processors=[processors[0], lambda logger, name, event: seen.append(event) or event])
    structlog.get_logger("gateway.x").debug("not shown", value=Asked())
    assert seen == []
    logging.getLogger("gateway.x").setLevel("DEBUG")
    try:
        assert processors[0](logging.getLogger("gateway.x"), "debug", {}) == {}
    finally:
        logging.getLogger("gateway.x").setLevel("NOTSET")


def test_auto_is_json_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure("auto", "info")
    structlog.get_logger().info("hello")
    assert json.loads(capsys.readouterr().err)["event"] == "hello"


def test_human_lines_start_with_the_time(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure("human", "info")
    structlog.get_logger("gateway").error("broken", why="x")
    line = capsys.readouterr().err
    assert "broken" in line
    assert "why=x" in line
    assert not line.startswith("{")


def test_an_exception_stays_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure("json", "info")
    try:
        raise KeyError("gone")
    except KeyError:
        structlog.get_logger().exception("failed")
    (line,) = capsys.readouterr().err.splitlines()
    assert "KeyError: 'gone'" in json.loads(line)["exception"]
