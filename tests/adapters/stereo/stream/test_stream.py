"""Image stream of one client."""

import asyncio
import time
from types import MappingProxyType
from typing import Any

import grpc
import numpy as np
import pytest

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.parameter_specs import DeviceLimits
from renderers.compiler import pending
from renderers.drawlist import DrawList, Image, ImageError, Instance, Material, Mesh, Texture
from renderers.raster import CpuRenderer
from renderers.stereo.model import Quality
from renderers.stereo.realism import REALISM_PARTS
from tests.adapters.stereo.conftest import EVERYTHING, SMALL, Start, nanoseconds, pixels, running, seen
from tests.adapters.stereo.scenes import table
from tests.support.waiting import until


async def test_all_messages_of_a_set_have_one_timestamp(start: Start) -> None:
    camera = await start(depth_mode="ground_truth")
    (image_set,) = await camera.take(**EVERYTHING)
    messages = (getattr(image_set, name.removesuffix("_enabled")) for name in EVERYTHING)
    stamps = {nanoseconds(each.timestamp) for each in (image_set, *messages, image_set.disparity.image)}
    assert len(stamps) == 1
    for image in (image_set.left, image_set.right):
        assert (image.width, image.height, image.encoding) == (320, 240, "mono8")
        assert image.focal_length == pytest.approx(0.8449 * 320)
        assert (image.principal_point_u, image.principal_point_v) == (160, 120)
        assert (image.gpios.outputs, image.gpios.inputs, image.gpios.values) == (3, 12, 0)
        assert image.gamma == 1
        assert 0 < image.brightness <= 1
        assert image.noise > 0
        assert image.exposure_time > 0
        assert pixels(image).std() > 5
    d = image_set.disparity
    assert (d.scale, d.offset, d.invalid_data_value, d.delta_d) == (0.0625, 0, 0, 0.0625)
    assert d.baseline == pytest.approx(0.16)
    assert (d.image.width, d.image.height, d.image.encoding) == (160, 120, "mono16")
    assert d.image.focal_length == pytest.approx(0.8449 * 160)
    assert d.image.brightness == pytest.approx(image_set.left.brightness, abs=0.03)
    valid = pixels(d.image) > 0
    assert valid.mean() > 0.6
    for image in (image_set.disparity_error, image_set.confidence):
        assert ((pixels(image) > 0) == valid).all()
    assert image_set.mesh.format == "ply"
    assert image_set.mesh.data.startswith(b"ply\nformat binary_little_endian 1.0\n")


@pytest.mark.parametrize("names", [(), *((name,) for name in EVERYTHING)])
async def test_unrequested_messages_are_absent(start: Start, names: tuple[str, ...]) -> None:
    camera = await start()
    (image_set,) = await camera.take(**dict.fromkeys(names, True))
    assert {f.name for f, _ in image_set.ListFields()} == {"timestamp", *(n.removesuffix("_enabled") for n in names)}


async def test_timestamps_keep_the_period(start: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the event loop's time has large steps, as on uvloop."""
    monkeypatch.setattr(asyncio.get_running_loop(), "time", lambda: time.monotonic() // 0.01 * 0.01)
    camera = await start()
    stamps = np.array([nanoseconds(image_set.timestamp) for image_set in await camera.take(20)])
    periods = np.diff(stamps) / 40_000_000
    assert np.median(np.abs(periods - np.rint(periods))) < 0.01


async def test_quality_determines_size_and_intrinsics(start: Start) -> None:
    camera = await start(rate="max")
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "High")])
    for quality, size, divisor in (
        ("Low", (54, 40), 6),
        ("Medium", (80, 60), 4),
        ("High", (160, 120), 2),
        ("Full", (320, 240), 1),
    ):
        camera.service.parameters.set("rc_stereomatching", [("quality", quality), ("fill", 0)])
        (image_set,) = await camera.take(disparity_enabled=True, disparity_error_enabled=True)
        image = image_set.disparity.image
        assert (image.width, image.height) == size
        assert image.focal_length == pytest.approx(0.8449 * 320 / divisor)
        assert (image.principal_point_u, image.principal_point_v) == pytest.approx((160 / divisor, 120 / divisor))
        valid = pixels(image) > 0
        assert valid.any()
        assert ((pixels(image_set.disparity_error) > 0) == valid).all()
        assert (image_set.disparity.scale, image_set.disparity.delta_d) == (1 / 16, 1 / 16)


async def test_same_seed_scene_and_frame_give_the_same_bytes(start: Start) -> None:
    async def run(seed: int) -> list[bytes]:
        realism = frozenset(REALISM_PARTS)
        camera = await start(simulated_clock=True, rate="max", seed=seed, realism=realism)
        return [image_set.SerializeToString(deterministic=True) for image_set in await camera.take(3, **EVERYTHING)]

    first, second, other = await run(1), await run(1), await run(2)
    assert first == second
    assert len(set(first)) == 3
    assert not set(first) & set(other)


async def test_alternate_exposure(start: Start) -> None:
    camera = await start()
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "AlternateExposureActive")])
    (image_set,) = await camera.take(**EVERYTHING)
    assert (
        nanoseconds(image_set.timestamp)
        == nanoseconds(image_set.disparity.timestamp)
        == nanoseconds(image_set.mesh.timestamp)
    )
    assert nanoseconds(image_set.timestamp) - nanoseconds(image_set.left.timestamp) == 40_000_000
    assert nanoseconds(image_set.left.timestamp) == nanoseconds(image_set.right.timestamp)
    exposed = (image_set.left, image_set.disparity.image, image_set.confidence)
    assert [image.gpios.values for image in exposed] == [0, 1, 1]
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "High")])
    (lit,) = await camera.take(left_enabled=True)
    assert lit.left.gpios.values == 1
    # The projector's dots are what the difference is: neighbouring pixels of the wall differ much more.
    rough = [float(np.abs(np.diff(pixels(i.left)[:60].astype(float), axis=1)).mean()) for i in (image_set, lit)]
    assert rough[1] > 5 * rough[0]


async def test_depth_on_demand(start: Start) -> None:
    camera = await start()
    parameters = camera.service.parameters
    assert camera.service.fire_trigger()[0] == -8
    parameters.set("rc_stereomatching", [("acquisition_mode", "SingleFrame")])
    assert camera.service.fire_trigger()[0] == 102
    depth = camera.stream(disparity_enabled=True)
    pending = asyncio.ensure_future(depth.read())
    # Camera images keep coming while depth waits for its trigger.
    await camera.take(4, left_enabled=True)
    assert not pending.done()
    assert camera.service.fire_trigger()[0] == 0
    assert camera.service.fire_trigger()[0] == 101
    assert (await pending).HasField("disparity")


@pytest.mark.parametrize("out1", ["Low", "High", "ExposureAlternateActive"])
async def test_depth_on_demand_with_out1_has_a_separate_exposure(start: Start, out1: str) -> None:
    camera = await start(simulated_clock=True)
    parameters = camera.service.parameters
    parameters.set("rc_iocontrol", [("out1_mode", out1)])
    parameters.set("rc_stereomatching", [("acquisition_mode", "SingleFrameOut1")])
    depth, left = camera.stream(left_enabled=True, disparity_enabled=True), camera.stream(left_enabled=True)
    pending = asyncio.ensure_future(depth.read())
    await left.read()
    await until(lambda: len(camera.service.hub) == 2)
    assert camera.service.fire_trigger()[0] == 0
    image_set = await pending
    taken, exposed = nanoseconds(image_set.left.timestamp), nanoseconds(image_set.disparity.timestamp)
    assert (image_set.left.gpios.values, image_set.disparity.image.gpios.values) == (0, 1)
    assert exposed - taken == 40_000_000
    assert nanoseconds(image_set.timestamp) == exposed
    # Camera images go on, but none is exposed until the depth exposure is over.
    stamps = [nanoseconds((await left.read()).left.timestamp)]
    while stamps[-1] < exposed + 200_000_000:
        image = (await left.read()).left
        assert image.gpios.values == 0
        stamps.append(nanoseconds(image.timestamp))
    assert not [timestamp_ns for timestamp_ns in stamps if taken < timestamp_ns < exposed + 40_000_000]


async def test_a_failed_image_ends_the_stream_with_the_reason(start: Start) -> None:
    def decode() -> Any:
        raise ImageError("it is broken")

    image = Image(b"x", decode)
    positions = np.array([(-9, -9, 2), (9, -9, 2), (0, 9, 2)], np.float32)
    mesh = Mesh(positions, np.array([[0, 1, 2]], np.uint32), uv0=np.zeros((3, 2), np.float32))
    material = Material(base_color_texture=Texture(image, name="wall.png"), double_sided=True)
    scene = DrawList((Instance(mesh, material, np.eye(4)),), (image,))
    camera = await start(scene=lambda: (scene, 1))
    for request in ({"left_enabled": True}, {"disparity_enabled": True}):
        with pytest.raises(grpc.aio.AioRpcError) as failure:
            await camera.stream(**request).read()
        assert failure.value.code() == grpc.StatusCode.UNAVAILABLE
        assert "wall.png" in failure.value.details()
    # Ground truth needs no texture.
    exact = await start(scene=lambda: (scene, 1), depth_mode="ground_truth")
    await exact.take(disparity_enabled=True)


async def test_a_scene_that_cannot_be_read_does_not_end_the_camera(start: Start) -> None:
    good = table()
    broken = True

    def scene() -> tuple[DrawList, int]:
        if broken:
            raise OSError("the file is gone")
        return good, 1

    camera = await start(scene=scene)
    with pytest.raises(grpc.aio.AioRpcError, match="the scene could not be read: the file is gone"):
        await camera.stream(left_enabled=True).read()
    assert "the file is gone" in camera.service.status()["warnings"][0]
    broken = False
    await camera.take(left_enabled=True)
    assert "warnings" not in camera.service.status()


@pytest.mark.parametrize(
    ("quality", "request_depth", "period"),
    [("High", False, 40), ("High", True, 1000 / 3), ("Low", True, 40), ("Medium", True, 1000 / 15)],
)
async def test_device_rates(start: Start, quality: str, request_depth: bool, period: float) -> None:
    camera = await start(simulated_clock=True)
    camera.service.parameters.set("rc_stereomatching", [("quality", quality)])
    sets = await camera.take(7, left_enabled=True, disparity_enabled=request_depth)
    steps = np.diff([nanoseconds(image_set.timestamp) for image_set in sets])
    assert set(steps % 40_000_000) == {0}
    without_lost_sets = steps[steps < (period + 40) * 1e6]  # a reader that is late loses sets
    assert without_lost_sets.mean() / 1e6 == pytest.approx(period, abs=40 / 6)


@pytest.mark.parametrize("reset", [False, True])
async def test_a_change_of_parameters_ends_the_wait_for_depth(start: Start, reset: bool) -> None:
    hours = MappingProxyType({**DeviceLimits().depth_rates, Quality.FULL: 1e-4})
    camera = await start(limits=DeviceLimits(depth_rates=hours))
    camera.service.set_parameters("rc_stereomatching", [("quality", "Full")])
    sets = camera.stream(disparity_enabled=True)
    assert (await sets.read()).disparity.image.width == 320
    if reset:
        camera.service.parameters.reset("rc_stereomatching")
    else:
        camera.service.set_parameters("rc_stereomatching", [("quality", "High")])
    assert (await sets.read()).disparity.image.width == 160


async def test_no_frame_is_captured_while_kernels_are_compiled(renderer: CpuRenderer) -> None:
    """Their time is not part of a frame's time limit."""
    scene, config = table(), StereoConfig(port=0, model=SMALL)
    with pending.announced({"stereo": lambda name: False}):
        async with running(renderer, config, seen(lambda: (scene, 1))) as camera:
            first = asyncio.ensure_future(camera.stream(left_enabled=True).read())
            await until(lambda: len(camera.service.hub) == 1)
            assert not camera.service.history
            assert not first.done()
            pending.finish("stereo")
            assert (await first).left.width == SMALL.width
