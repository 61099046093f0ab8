"""``scenegate stream`` with our own camera."""

import asyncio
import socket
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi import FastAPI
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import read_profile
from gateway.adapters.stereo.imaging.recorded_pairs import read_geometry
from gateway.adapters.stereo.routes.truth_routes import truth_router
from gateway.runtime.http.http_server import PortService
from scenegate.camera import image_interface_pb2 as pb
from scenegate.camera.files import BadImageError, depth, intrinsics, nanoseconds, pixels, preview
from scenegate.camera.stream import Progress, StreamFailure, StreamOptions, receive, receive_all
from scenegate.gateway_http import GatewayError
from tests.adapters.stereo.conftest import Start, renderer, start
from tests.support.command import scenegate
from tests.support.waiting import SECONDS, until

__all__ = ["renderer", "start"]


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for connections as long as every test does."""
    monkeypatch.setattr("scenegate.camera.stream.CONNECT_SECONDS", SECONDS)


def read_image(*args: Any) -> NDArray[Any]:
    image: NDArray[Any] | None = cv2.imread(*args)
    assert image is not None
    return image


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
    assert len(files) == 16
    base = f"image_{progress.timestamp}"
    names = ("left.png", "disparity.png", "disparity_param.txt", "mesh.ply")
    assert {f"{base}_{n}" for n in names} | {f"{base}.npz"} <= set(files)
    data = np.load(tmp_path / "sets" / f"{base}.npz")
    stored = read_image(str(tmp_path / "sets" / f"{base}_disparity.png"), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    assert (stored == data["disparity"]).all()
    valid = data["disparity"] > 0
    expected = data["disparity_K"][0, 0] * data["baseline"] / (data["disparity"][valid] / 16)
    assert np.allclose(data["depth"][valid], expected)
    assert np.isinf(data["depth"][~valid]).all()
    assert read_image(str(tmp_path / "preview.png")).shape == (240, 2 * 320 + 3 * 160 + 4 * 4, 3)


@pytest.mark.parametrize("quality", ["Low", "High"])
async def test_cvkit_s_tools_find_depth_in_the_files(start: Start, tmp_path: Path, quality: str) -> None:
    """Names, keys and formula follow cvkit's USAGE.md for perspective disparity images."""
    camera = await start(rate="max", model=read_profile("rc_visard_160c").model, depth_mode="ground_truth")
    camera.service.parameters.set("rc_stereomatching", [("quality", quality)])
    options = StreamOptions(f"127.0.0.1:{camera.service.port}", disparity=True, count=1, output=tmp_path)
    progress = await asyncio.to_thread(receive_all, options)
    base = f"{tmp_path}/image_{progress.timestamp}"
    # <prefix>_param.txt, where the prefix is the part of the image's name up to the last dot.
    text = Path(f"{base}_disparity_param.txt").read_text("ascii")  # noqa: ASYNC240 - nothing else runs
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    values = dict(line.split("=", 1) for line in lines)
    assert list(values) == [
        "camera.A", "camera.height", "camera.width", "rho", "t", "camera.exposure_time", "camera.gain", "camera.noise",
        "camera.out1_reduction", "camera.brightness", "disp.scale", "disp.offset", "disp.inv",
    ]  # fmt: skip
    a = np.array([row.split() for row in values["camera.A"].strip("[]").split(";")], float)
    stored = read_image(f"{base}_disparity.png", cv2.IMREAD_UNCHANGED)
    assert stored.shape == (int(values["camera.height"]), int(values["camera.width"]))
    valid = stored != float(values["disp.inv"])
    z = float(values["rho"]) / (stored[valid] * float(values["disp.scale"]) + float(values["disp.offset"]))
    data = np.load(f"{base}.npz")
    assert valid.mean() > 0.5
    assert np.allclose(z, data["depth"][valid], rtol=1e-6)
    assert np.allclose(a, data["disparity_K"], rtol=1e-7)
    assert float(values["rho"]) == pytest.approx(a[0, 0] * float(values["t"]), rel=1e-6)


async def test_exposure_and_gpios_are_written_on_request(start: Start, tmp_path: Path) -> None:
    camera = await start(rate="max")
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "ExposureAlternateActive")])
    camera.service.parameters.set("rc_camera", [("exp_control", "Manual"), ("exp_value", 0.004), ("gain_value", 3)])
    port = camera.service.port
    options = StreamOptions(
        f"127.0.0.1:{port}", left=True, disparity=True, count=1, output=tmp_path, exposure=True, gpio=True
    )
    progress = await asyncio.to_thread(receive_all, options)
    base = f"image_{progress.timestamp}"
    files = {p.name for p in tmp_path.iterdir()}  # noqa: ASYNC240 - nothing else runs
    # The vendor's client: outputs, then inputs, the highest line first.
    bits = {"left_00_00.png", "disparity_01_00.png", "disparity_01_00_param.txt"}
    assert files == {f"{base}.npz"} | {f"{base}_{name}" for name in bits}
    data = np.load(tmp_path / f"{base}.npz")
    assert data["left_exposure_time"] == pytest.approx(0.004)
    assert data["disparity_gain"] == pytest.approx(3)
    assert 0 < data["left_brightness"] < data["disparity_brightness"]
    assert (data["left_gpio_values"], data["disparity_gpio_values"]) == (0, 1)
    assert (data["left_gpio_outputs"], data["left_gpio_inputs"]) == (3, 12)
    assert list(read_geometry(tmp_path) or ()) == [pytest.approx(0.8449), pytest.approx(0.160)]


async def test_a_reader_that_pauses_gets_few_old_sets(start: Start) -> None:
    camera = await start(rate="max")
    sets = receive(StreamOptions(f"127.0.0.1:{camera.service.port}", left=True, color=True))
    for _ in range(50):  # the receive window must not grow meanwhile
        _, size = await asyncio.to_thread(next, sets)
    newest = (await camera.take(100, left_enabled=True, color=True))[-1]
    old = 0
    while nanoseconds((await asyncio.to_thread(next, sets))[0].timestamp) < nanoseconds(newest.timestamp):
        old += 1
    await asyncio.to_thread(sets.close)
    assert old * size <= 3 << 20, "1 MiB in the window, and those that were being sent and received"


def test_distinguishes_closed_ports_from_silent_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenegate.camera.stream.CONNECT_SECONDS", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        target = f"127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(StreamFailure, match="only one side uses TLS"):
            receive_all(StreamOptions(target, count=1))
    with pytest.raises(StreamFailure, match=f"no answer from {target}"):
        receive_all(StreamOptions(target, count=1))


def test_rejects_targets_without_a_port_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenegate.camera.stream.CONNECT_SECONDS", 0.2)
    with pytest.raises(StreamFailure, match="'camera' is not a port"):
        receive_all(StreamOptions("localhost:camera", count=1))
    for target in ("http://localhost:50051", None):
        with pytest.raises(StreamFailure, match=r"address .*127\.0\.0\.1:50051"):
            receive_all(StreamOptions(target, count=1))


async def test_a_refusal_is_one_sentence(start: Start) -> None:
    camera = await start()
    options = StreamOptions(f"127.0.0.1:{camera.service.port}", mesh=True, max_points=10)
    with pytest.raises(StreamFailure, match=r"mesh_options\.max_points .*10"):
        await asyncio.to_thread(receive_all, options)


async def test_the_command(start: Start, tmp_path: Path) -> None:
    camera = await start(rate="max")
    arguments = [f"127.0.0.1:{camera.service.port}", "--mesh", "--count", "1", "-o", str(tmp_path)]
    result = await asyncio.to_thread(scenegate, "stream", *arguments)
    assert result.exit_code == 0, result.stderr
    assert "1 sets" in result.stderr
    assert [p.suffix for p in tmp_path.iterdir()] == [".ply"]  # noqa: ASYNC240 - nothing else runs


async def test_truth_is_written_for_each_set(start: Start, tmp_path: Path) -> None:
    camera = await start(rate="max", depth_mode="ground_truth")
    app = FastAPI()
    app.include_router(truth_router(camera.service))
    http = PortService(app, "127.0.0.1", 0)
    serving = asyncio.create_task(http.run())
    await until(lambda: http.ready)
    options = StreamOptions(
        f"127.0.0.1:{camera.service.port}", disparity=True, count=2, output=tmp_path,
        truth=f"http://127.0.0.1:{http.status()['port']}",
    )  # fmt: skip
    progress = await asyncio.to_thread(receive_all, options)
    data = np.load(tmp_path / f"image_{progress.timestamp}.npz")
    truth = np.load(tmp_path / f"image_{progress.timestamp}_truth.npz")
    assert truth["timestamp"] == data["disparity_timestamp"]
    valid_in_both = np.isfinite(data["depth"]) & np.isfinite(truth["depth"])
    assert np.median(np.abs(data["depth"][valid_in_both] / truth["depth"][valid_in_both] - 1)) < 0.02
    assert len([p for p in tmp_path.iterdir() if p.name.endswith("_truth.npz")]) == 2  # noqa: ASYNC240 - nothing else runs
    with pytest.raises(GatewayError, match="404: there is no pipeline 3"):
        await asyncio.to_thread(receive_all, replace(options, pipeline=3))
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)
    with pytest.raises(GatewayError, match="gives no ground truth"):
        await asyncio.to_thread(receive_all, options)
    with pytest.raises(GatewayError, match="does not speak HTTP"):
        await asyncio.to_thread(receive_all, replace(options, truth=f"http://{options.target}"))
    with pytest.raises(GatewayError, match="must be like http"):
        await asyncio.to_thread(receive_all, replace(options, truth="camera:8000"))


def test_a_wrong_address_is_found_before_anything_is_received(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(GatewayError, match="must be like http"):
        receive_all(StreamOptions("127.0.0.1:1", output=out, truth="camera:8000"))
    assert not out.exists()


FLAGS = ("left", "right", "disparity", "error", "confidence", "mesh", "color", "watertight", "textured", "tls")


@pytest.mark.parametrize("flags", [(), *((flag,) for flag in FLAGS), FLAGS])
def test_flags_of_the_command(flags: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    received: list[StreamOptions] = []

    def receive(options: StreamOptions, report: Any) -> Progress:
        received.append(options)
        return Progress()

    monkeypatch.setattr("scenegate.camera.stream.receive_all", receive)
    scenegate("stream", "camera:1", *(f"--{flag}" for flag in flags))
    (options,) = received
    values = {flag: options.credentials.tls if flag == "tls" else getattr(options, flag) for flag in FLAGS}
    assert values == {flag: flag in flags for flag in FLAGS}
    assert (options.target, options.max_points, options.count, options.timeout) == ("camera:1", 0, 0, None)
    assert (options.output, options.preview, options.truth, options.pipeline) == (None, None, None, 0)


def test_options_for_files_need_a_folder() -> None:
    for option in (["--gpio"], ["--truth", "http://127.0.0.1:1"]):
        result = scenegate("stream", "127.0.0.1:1", *option)
        assert result.exit_code == 2
        assert "-o FOLDER" in result.stderr


def test_default_is_left_and_disparity() -> None:
    request = StreamOptions("x").request()
    assert {f.name for f, _ in request.ListFields()} == {"left_enabled", "disparity_enabled"}


def test_decodes_padded_rows_and_both_byte_orders() -> None:
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


def test_depth_with_offset() -> None:
    data = np.array([[0, 160]], "<u2").tobytes()
    image = pb.Image(width=2, height=1, encoding="mono16", step=4, data=data, focal_length=500)
    z = depth(pb.DisparityImage(image=image, scale=0.0625, offset=2.0, invalid_data_value=0, baseline=0.1))
    assert np.isinf(z[0, 0])
    assert z[0, 1] == pytest.approx(500 * 0.1 / 12)


def test_names_what_is_no_image_of_a_set() -> None:
    image_set: Any = pb.ImageSet(left=pb.Image(width=1, height=1, encoding="mono8", step=1, data=b"a"))
    with pytest.raises(BadImageError, match="the set does not have this image"):
        pixels(image_set.right)
    with pytest.raises(BadImageError, match="the set does not have this image"):
        depth(image_set.disparity)
    calls: Any = ((depth, image_set), (depth, image_set.left), (pixels, image_set.disparity), (pixels, 5))
    for function, message in calls:
        with pytest.raises(TypeError, match=r"images\..* not (5|an ImageSet|an Image|a Disp)"):
            function(message)
    with pytest.raises(TypeError, match=r"images\.left .* not a Disp"):
        intrinsics(image_set.disparity)


def test_a_set_of_timestamps_only() -> None:
    assert preview(pb.ImageSet()).shape == (1, 1, 3)
    assert Progress(sets=1).rate == 0
