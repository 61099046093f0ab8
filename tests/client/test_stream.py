"""``scenegate stream`` against our own camera."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from gateway.client.command import stream
from gateway.client.stream import Progress, StreamFailure, StreamOptions, receive_all
from gateway.client.stream_files import BadImageError, depth, pixels, preview
from gateway.generated import image_interface_pb2 as pb
from tests.stereo.conftest import Start, renderer, start
from tests.support.waiting import SECONDS

__all__ = ["renderer", "start"]


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Waits for connections as long as every test does."""
    monkeypatch.setattr("gateway.client.stream._CONNECT_SECONDS", SECONDS)


async def test_sets_become_files(start: Start, tmp_path: Path) -> None:
    camera = await start(rate="max")
    seen: list[str] = []
    options = StreamOptions(
        f"127.0.0.1:{camera.service.port}",
        left=True, right=True, disparity=True, error=True, confidence=True, mesh=True,
        count=2, output=tmp_path / "sets", preview=tmp_path / "preview.png",
    )  # fmt: skip
    progress = await asyncio.to_thread(receive_all, options, lambda p: seen.append(p.line()))
    assert progress.sets == len(seen) == 2
    assert "2 sets" in seen[-1]
    files = sorted(p.name for p in (tmp_path / "sets").iterdir())
    assert len(files) == 14
    base = f"image_{progress.stamp}"
    assert {f"{base}_{n}" for n in ("left.png", "disparity.png", "mesh.ply")} | {f"{base}.npz"} <= set(files)
    data = np.load(tmp_path / "sets" / f"{base}.npz")
    stored = cv2.imread(str(tmp_path / "sets" / f"{base}_disparity.png"), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    assert (stored == data["disparity"]).all()
    valid = data["disparity"] > 0
    expected = data["disparity_K"][0, 0] * data["baseline"] / (data["disparity"][valid] / 16)
    assert np.allclose(data["depth"][valid], expected)
    assert np.isinf(data["depth"][~valid]).all()
    assert cv2.imread(str(tmp_path / "preview.png")).shape == (240, 2 * 320 + 3 * 160 + 4 * 4, 3)


def test_who_listens_without_answering_is_told_from_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.client.stream._CONNECT_SECONDS", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        target = f"127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(StreamFailure, match="takes connections, but does not answer: only one side uses TLS"):
            receive_all(StreamOptions(target, count=1))
    with pytest.raises(StreamFailure, match=f"nobody answers at {target}"):
        receive_all(StreamOptions(target, count=1))


def test_a_target_without_a_port_number_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.client.stream._CONNECT_SECONDS", 0.2)
    with pytest.raises(StreamFailure, match="'camera' is no port"):
        receive_all(StreamOptions("localhost:camera", count=1))


async def test_a_refusal_is_one_sentence(start: Start) -> None:
    camera = await start()
    options = StreamOptions(f"127.0.0.1:{camera.service.port}", mesh=True, max_points=10)
    with pytest.raises(StreamFailure, match=r"INVALID_ARGUMENT: mesh_options\.max_points is 10"):
        await asyncio.to_thread(receive_all, options)


async def test_the_command(start: Start, tmp_path: Path) -> None:
    camera = await start(rate="max")
    app = typer.Typer()
    app.command()(stream)
    arguments = [f"127.0.0.1:{camera.service.port}", "--mesh", "--count", "1", "-o", str(tmp_path)]
    result = await asyncio.to_thread(CliRunner().invoke, app, arguments)
    assert result.exit_code == 0, result.output
    assert "1 sets" in result.output
    assert [p.suffix for p in tmp_path.iterdir()] == [".ply"]  # noqa: ASYNC240 - nothing else runs


def test_left_and_disparity_when_nothing_is_chosen() -> None:
    request = StreamOptions("x").request()
    assert {f.name for f, _ in request.ListFields()} == {"left_enabled", "disparity_enabled"}


def test_rows_with_padding_and_other_byte_orders_are_understood() -> None:
    values = (np.arange(6) * 300).astype(">u2").reshape(2, 3)
    rows = np.zeros((2, 8), np.uint8)
    rows[:, :6] = values.view(np.uint8)
    image = pb.Image(width=3, height=2, encoding="mono16", is_bigendian=True, step=8, data=rows.tobytes())
    assert (pixels(image) == values).all()
    image.data = image.data[:10]
    with pytest.raises(BadImageError, match="too few"):
        pixels(image)
    with pytest.raises(BadImageError, match="yuv"):
        pixels(pb.Image(encoding="yuv"))


def test_depth_by_the_published_formula_with_offset() -> None:
    data = np.array([[0, 160]], "<u2").tobytes()
    image = pb.Image(width=2, height=1, encoding="mono16", step=4, data=data, focal_length=500)
    z = depth(pb.DisparityImage(image=image, scale=0.0625, offset=2.0, invalid_data_value=0, baseline=0.1))
    assert np.isinf(z[0, 0])
    assert z[0, 1] == pytest.approx(500 * 0.1 / 12)


def test_a_set_of_timestamps_only() -> None:
    assert preview(pb.ImageSet()).shape == (1, 1, 3)
    assert Progress(sets=1).rate == 0
