"""Text of files and clients in what commands print: nothing of it steers a terminal or begins a line."""

import base64
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegate.lcm.event_log import pack_event
from scenegate.printable import printable
from tests.support.command import scenegate

NAME = "X_\x1b]0;title\x07\x1b[31m\r\nFAKE: ok\u2028\u202e\x9b"
ESCAPED = r"X_\x1b]0;title\x07\x1b[31m\r\nFAKE: ok\u2028\u202e\x9b"


@given(st.text())
def test_text_is_one_printable_line(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert shown == text or not text.isprintable()


def gltf(folder: Path) -> Path:
    triangle = bytes(12) + b"\0\0\x80?" + bytes(12) + b"\0\0\x80?" + bytes(4)
    path = folder / "scene.gltf"
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": [NAME],
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": NAME, "extensions": {NAME: {}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [
            {"byteLength": 36, "uri": "data:application/octet-stream;base64," + base64.b64encode(triangle).decode()}
        ],
    }
    path.write_text(json.dumps(document))
    return path


def robot(folder: Path) -> Path:
    name = "arm\u2028\u202e\x9b"  # XML refuses others
    path = folder / f"{name}.urdf"
    visual = f'<visual><geometry><mesh filename="{name}.stl"/></geometry></visual>'
    path.write_text(f'<robot name="{name}"><link name="{name}">{visual}</link></robot>')
    return path


def log(folder: Path) -> Path:
    path = folder / "log.lcmlog"
    path.write_bytes(pack_event(0, 0, NAME, b"data"))
    return path


def missing(folder: Path) -> Path:
    return folder / f"{NAME.replace('/', '')}.obj"


@pytest.mark.parametrize(
    ("command", "write", "arguments"),
    [
        ("render", gltf, ("-o", "out.png")),
        ("render", robot, ("-o", "out.png")),
        ("render", robot, ("-o", "out", "--strict")),
        ("convert", log, ("out.mcap",)),
        ("export", log, ("out.html",)),
        ("view", log, ()),
        ("publish", missing, ()),
        ("play", missing, ()),
    ],
)
def test_names_of_files_are_escaped(
    command: str,
    write: Callable[[Path], Path],
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = scenegate(command, str(write(tmp_path)), *arguments)
    lines = (ran.stdout + ran.stderr).split("\n")
    assert all(line.isprintable() for line in lines), lines
    assert not any(line.startswith("FAKE") for line in lines)
    assert any("\\x9b" in line for line in lines), lines
