"""Recorded requests of real clients, and the responses of Director's own viewer (see the corpus' README)."""

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from tests.support.corpus import corpus_dir, corpus_path

_SYNC = 0xEDA1DA01
_EVENT = struct.Struct(">Iqqii")
REQUEST = "DIRECTOR_TREE_VIEWER_REQUEST"


@dataclass(frozen=True)
class Event:
    """One event of an LCM log."""

    number: int
    channel: str
    data: bytes


@dataclass(frozen=True)
class Exchange:
    """One request and the response of Director's viewer."""

    number: int
    channel: str
    data: bytes
    response: dict[str, Any] | None
    """None: no response."""
    why_none: str


def events(path: Path) -> Iterator[Event]:
    """Yield the events of an LCM log in order, without liblcm."""
    data = path.read_bytes()
    at = 0
    while at < len(data):
        sync, number, _time, channel_size, size = _EVENT.unpack_from(data, at)
        assert sync == _SYNC, f"{path} is damaged at byte {at}"
        at += _EVENT.size
        channel = data[at : at + channel_size].decode()
        at += channel_size
        yield Event(number, channel, data[at : at + size])
        at += size


def folder() -> Path:
    return corpus_dir() / "treeviewer"


def names() -> list[str]:
    """Return the names of all logs; empty without a corpus."""
    root = corpus_path()
    return [] if root is None else sorted(path.stem for path in (root / "treeviewer").glob("*.log"))


@cache
def exchanges(name: str) -> tuple[Exchange, ...]:
    """Return the requests of a log with the recorded responses."""
    lines = (folder() / f"{name}.oracle.jsonl").read_text().splitlines()
    oracle = {entry["event"]: entry for entry in map(json.loads, lines)}
    return tuple(
        Exchange(
            event.number,
            event.channel,
            event.data,
            oracle[event.number].get("response"),
            str(
                next(
                    (oracle[event.number][k] for k in ("exception", "crash", "dropped") if k in oracle[event.number]),
                    "",
                )
            ),
        )
        for event in events(folder() / f"{name}.log")
        if event.channel.startswith(REQUEST)
    )


def scene(name: str) -> dict[tuple[Any, ...], dict[str, Any] | None]:
    """Return Director's final scene by path; None: a folder without geometry."""
    found: dict[str, dict[str, Any] | None] = json.loads((folder() / f"{name}.scene.json").read_text())
    return {tuple(json.loads(path)): value for path, value in found.items()}
