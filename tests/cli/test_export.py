"""``scenegate export``: logs, gateways, and what is wrong with the arguments."""

from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from gateway.cli.commands import app
from gateway.files.gltf import read_gltf
from gateway.files.gltf.export import export_glb
from gateway.scene.tree.nodes import Node
from tests.adapters.treeviewer.conversation import BOX, message
from tests.adapters.viewer.recordings import headers_of
from tests.replay.logs import CHANNEL, write_log
from tests.replay.test_page_file import recording_of
from tests.support.http_stub import http_server

CYLINDER = {"type": "cylinder", "radius": 1, "length": 1}
GLB = export_glb(Node())
TURNED = {"translation": [0, 0, 0], "quaternion": [1, 0, 0, 0]}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log of two seconds in which a box moves along x, one metre a second, and becomes a cylinder at the end."""
    moves = {x: {**TURNED, "translation": [x, 0, 0]} for x in (0.5, 1.0, 1.5)}
    return write_log(
        tmp_path / "run.lcmlog",
        [
            (0.0, CHANNEL, message({"setgeometry": [{"path": ["a"], "geometry": BOX}]})),
            *((x, CHANNEL, message({"settransform": [{"path": ["a"], "transform": to}]})) for x, to in moves.items()),
            (2.0, CHANNEL, message({"setgeometry": [{"path": ["a"], "geometry": CYLINDER}]})),
        ],
    )


def export(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["export", *map(str, arguments)])


def test_a_log_as_html(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "scene.html"
    result = export(log, out, "--rate", "2")
    assert result.exit_code == 0, result.stderr
    assert result.stderr.endswith(f"{out}: {out.stat().st_size / 1e6:.1f} MB\n")
    updates = headers_of(recording_of(out.read_bytes()), "update")
    assert len({update["revision"] for update in updates}) == 5
    assert export(log, tmp_path / "long.html", "--rate", "200", "--duration", "1e9").exit_code == 0
    section = tmp_path / "section.html"
    assert export(log, section, "--rate", "2", "--start", "0.4", "--duration", "0.5").exit_code == 0
    updates = headers_of(recording_of(section.read_bytes()), "update")
    assert len({update["revision"] for update in updates}) == 2


@pytest.mark.parametrize(("options", "x"), [((), 1.5), (("--start", "1.2"), 1.0)])
def test_a_moment_of_a_log_as_gltf(log: Path, tmp_path: Path, options: tuple[str, ...], x: float) -> None:
    out = tmp_path / "scene.glb"
    result = export(log, out, *options)
    assert result.exit_code == 0, result.stderr
    scene = read_gltf(out.read_bytes())
    [path] = [path for path, _ in scene.root.walk() if path and path[-1] == "a"]
    matrix = scene.root.world_matrix(path)
    assert matrix is not None
    assert matrix[0, 3] == pytest.approx(x)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("{log}", "scene.png"), "scene.png: the file must end with .html or .glb"),
        (("missing", "scene.html"), "missing: there is no such log; the address of a gateway begins with http://"),
        (("{log}", "scene.html", "--start", "3"), "run.lcmlog: --start 3 is after its end, at 2.0 s"),
        (("{text}", "scene.html"), "text.lcmlog: "),
        (("{log}", "scene.glb", "--duration", "3"), "--duration is for OUT.html"),
        (("http://127.0.0.1:1", "scene.html", "--start", "3"), "--start is for logs: of a gateway, --duration has"),
    ],
)
def test_what_is_wrong_is_one_sentence(arguments: tuple[str, ...], sentence: str, log: Path, tmp_path: Path) -> None:
    text = tmp_path / "text.lcmlog"
    text.write_text("no log")
    out = tmp_path / arguments[1]
    result = export(arguments[0].format(log=log, text=text), out, *arguments[2:])
    assert isinstance(result.exception, ValueError)
    assert sentence in str(result.exception)
    assert not out.exists()


@pytest.fixture
def gateway() -> Iterator[tuple[str, list[tuple[str, str | None]]]]:
    """URL of a server that answers as a gateway does, and its requests with their tokens."""
    requests: list[tuple[str, str | None]] = []

    def answer(request: BaseHTTPRequestHandler) -> tuple[int, bytes]:
        requests.append((request.path, request.headers["Authorization"]))
        if "rate=240" in request.path:
            return 413, b"the recording is too large"
        return 200, GLB if "scene.glb" in request.path else b"file"

    with http_server(answer) as url:
        yield url, requests


def test_the_scene_of_a_gateway(gateway: tuple[str, list[tuple[str, str | None]]], tmp_path: Path) -> None:
    url, requests = gateway
    out = tmp_path / "scene.html"
    assert export(url, out, "--duration", "5", "--token", "secret").exit_code == 0
    assert out.read_bytes() == b"file"
    assert export(f"{url}/view?theme=dark#eye=1,2,3", tmp_path / "scene.glb").exit_code == 0
    assert requests == [("/view/scene.html?seconds=5.0&rate=30.0", "Bearer secret"), ("/scene.glb", None)]
    refused = export(url, out, "--rate", "240")
    assert str(refused.exception) == f"{url} gives no view/scene.html: 413: the recording is too large"
    assert out.read_bytes() == b"file"


def test_folders_are_no_files(tmp_path: Path) -> None:
    assert str(export(str(tmp_path), tmp_path / "a.html").exception) == f"{tmp_path} is a folder, not a log"
    refused = export("http://127.0.0.1:1", tmp_path).exception
    assert str(refused) == f"{tmp_path} is a folder; the file needs a name in it"


def test_a_gateway_that_does_not_respond(tmp_path: Path) -> None:
    refused = export("http://127.0.0.1:1", tmp_path / "scene.html")
    assert isinstance(refused.exception, ConnectionError)
    assert "http://127.0.0.1:1 gives no view/scene.html: no gateway listens there" in str(refused.exception)
