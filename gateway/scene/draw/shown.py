"""Parses what a query shows of the live scene besides its camera: hidden nodes and the background."""

import re
from typing import Final

import msgspec

from gateway.scene.draw.cameras import quoted
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import Path, TreeEdit

_COLOR: Final = re.compile(r"[0-9a-fA-F]{6}")
COLOR_PATTERN: Final = f"^{_COLOR.pattern}$"
"""Pattern of a colour, for API descriptions: red, green and blue in hexadecimal."""
_paths_decoder: Final = msgspec.json.Decoder(tuple[Path, ...])


class ShownError(ValueError):
    """A parameter that cannot be parsed. The message has its name, its value and an example."""


def parse_paths(name: str, text: str) -> tuple[Path, ...]:
    """Parse the JSON list of paths in the parameter ``name``. Raises ShownError if it is no such list."""
    try:
        return _paths_decoder.decode(text)
    except (msgspec.DecodeError, UnicodeEncodeError) as error:
        raise ShownError(
            f"""{name}={quoted(text)} is not a JSON list of paths such as '[["robot","arm"]]'"""
        ) from error


def parse_color(name: str, text: str) -> tuple[int, int, int]:
    """Return red, green and blue, 0 .. 255, of the parameter ``name``. Raises ShownError without six hex digits."""
    if _COLOR.fullmatch(text) is None:
        raise ShownError(f"{name}={quoted(text)} is not a colour in six hexadecimal digits such as 'cce5ff'")
    red, green, blue = bytes.fromhex(text)
    return red, green, blue


def with_visibility(snapshot: Snapshot, hide: tuple[Path, ...], show: tuple[Path, ...]) -> Snapshot:
    """Return a snapshot with nodes hidden and shown. Paths that are not in the scene are left out."""
    if not (hide or show):
        return snapshot
    edit = TreeEdit(snapshot.root)
    for paths, visible in ((hide, False), (show, True)):
        for path in paths:
            if snapshot.root.find(path) is not None:
                edit.set_visible(path, visible)
    return Snapshot(edit.commit(), snapshot.revision)
