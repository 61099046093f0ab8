"""Recorded requests of real clients, and the responses of Director's own viewer (see the corpus' README)."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from scenegate.lcm.event_log import Event, read_events
from tests.support.corpus import corpus_dir, corpus_path

REQUEST = "DIRECTOR_TREE_VIEWER_REQUEST"


@dataclass(frozen=True)
class Exchange:
    number: int
    channel: str
    data: bytes
    response: dict[str, Any] | None
    """None: no response."""


def folder() -> Path:
    return corpus_dir() / "treeviewer"


def names() -> list[str]:
    root = corpus_path()
    return [] if root is None else sorted(path.stem for path in (root / "treeviewer").glob("*.log"))


@cache
def exchanges(name: str) -> tuple[Exchange, ...]:
    lines = (folder() / f"{name}.oracle.jsonl").read_text().splitlines()
    oracle = {entry["event"]: entry for entry in map(json.loads, lines)}
    return tuple(
        Exchange(event.number, event.channel, event.data, oracle[event.number].get("response"))
        for event in events(name)
        if event.channel.startswith(REQUEST)
    )


def events(name: str) -> list[Event]:
    with (folder() / f"{name}.log").open("rb") as file:
        return list(read_events(file, on_damage=lambda size: pytest.fail(f"{name}.log has {size} damaged bytes")))


def scene(name: str) -> dict[tuple[Any, ...], dict[str, Any] | None]:
    """Return Director's final scene by path; None: a folder without geometry."""
    found: dict[str, dict[str, Any] | None] = json.loads((folder() / f"{name}.scene.json").read_text())
    return {tuple(json.loads(path)): value for path, value in found.items()}
