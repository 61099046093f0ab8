"""Values of the device's status, services and system information, and several cameras in one gateway."""

import time
from typing import Any

import pytest

from gateway.adapters.stereo.routes import device_content as device
from gateway.adapters.stereo.routes.fault_routes import fault_router
from gateway.adapters.stereo.routes.system_routes import system_router
from gateway.adapters.stereo.routes.truth_routes import truth_router
from gateway.adapters.stereo.stream.faults import Faults
from renderers.stereo.model import StereoModel
from tests.adapters.stereo.conftest import Camera, Start, http_client
from tests.support.waiting import until

OTHER = StereoModel("other", 160, 120, 0.75, 0.065)


def status_values(camera: Camera, node: str) -> dict[str, str]:
    values: dict[str, str] = device.node_status(camera.service, node)["values"]
    return values


async def test_status_of_an_idle_camera(start: Start) -> None:
    camera = await start(image_noise=0.5)
    camera.service.parameters.set("rc_camera", [("exp_control", "Manual"), ("gain_value", 6.0)])
    values = status_values(camera, "rc_camera")
    sigma = camera.service.last_metered.exposure.mid_grey_noise
    assert float(values.pop("noise")) == pytest.approx(0.5 * sigma)
    assert status_values(await start(noise=False), "rc_camera")["noise"] == "0"
    assert values == {
        "exp": "0.005", "gain": "6", "gamma": "1", "brightness": "0", "out1_reduction": "0", "fps": "0",
        "width": "320", "height": "240", "focal": "0.8449", "baseline": "0.16", "color": "1", "temp_left": "35",
        "temp_right": "35", "test": "0", "time": "0", "params_override_active": "0", "selfcalib_counter": "0",
        "selfcalib_offset": "0",
    }  # fmt: skip
    measured = {"data_acquisition_time", "last_timestamp_processed", "processing_time"}
    assert measured <= status_values(camera, "rc_measure").keys()
    values = status_values(camera, "rc_stereomatching")
    assert float(values.pop("mindepth")) > 0.0
    zero = ("fps", "latency", "time_matching", "time_postprocessing", "reduced_depth_range")
    assert values == {**dict.fromkeys(zero, "0"), "width": "160", "height": "120", "maxdepth": "100"}


@pytest.mark.parametrize(
    ("request_", "mode", "camera_rate", "depth_rate"),
    [
        ({"left_enabled": True}, "Continuous", "10", "0"),
        ({"disparity_enabled": True}, "Continuous", "10", "3"),  # at quality High
        ({"disparity_enabled": True}, "SingleFrame", "10", "0"),
    ],
)
async def test_rates_are_those_of_subscribed_images(
    start: Start, request_: dict[str, Any], mode: str, camera_rate: str, depth_rate: str
) -> None:
    camera = await start()
    camera.service.parameters.set("rc_camera", [("fps", 10.0)])
    camera.service.parameters.set("rc_stereomatching", [("acquisition_mode", mode)])
    call = camera.stream(**request_)
    await until(lambda: len(camera.service.hub))
    assert status_values(camera, "rc_camera")["fps"] == camera_rate
    assert status_values(camera, "rc_stereomatching")["fps"] == depth_rate
    call.cancel()


@pytest.mark.parametrize(
    ("out1", "out2", "bits"), [("Low", "Low", 0), ("High", "Low", 1), ("Low", "High", 2), ("High", "High", 3)]
)
async def test_outputs(start: Start, out1: str, out2: str, bits: int) -> None:
    camera = await start()
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", out1), ("out2_mode", out2)])
    response = (await device.call_service(camera.service, "rc_iocontrol", "get_io_values", {}))["response"]
    stamp = response.pop("timestamp")
    assert abs(stamp["sec"] + 1e-9 * stamp["nsec"] - time.time()) < 1000.0
    assert 0 <= stamp["nsec"] < 10**9
    masks = {"input_mask": 12, "output_mask": 3, "inverter_mask": 0, "ratio_mask": 0}
    assert response == {"values": bits, **masks, "return_code": {"value": 0, "message": ""}}
    levels = {"out1": str(bits & 1), "out2": str(bits >> 1), "in1": "0", "in2": "0"}
    assert status_values(camera, "rc_iocontrol") == levels


async def test_system_information_is_that_of_the_first_camera(start: Start) -> None:
    cameras = [await start(serial="1"), await start(serial="2", model=OTHER, hostname="second")]
    services = [camera.service for camera in cameras]
    system = device.system_info(services)
    now = time.time()
    assert (system["serial"], system["hostname"], system["model_name"]) == ("1", "scenegate", "small")
    assert 0.0 <= system["uptime"] <= now - services[0].started
    assert abs(system["time"] - now) < 1000.0
    assert system["network"]["ip_address"] == "127.0.0.1"
    assert system["link_speed"] == 1000
    assert not system["firmware"]["fallback_booted"]
    assert system["network"]["settings"]["dhcp_enabled"]
    assert not system["network"]["settings"]["persistent_ip_enabled"]
    assert (system["ntp"]["enabled"], system["ntp"]["synchronized"], system["ui_lock"]["enabled"]) == (False,) * 3
    offsets = dict.fromkeys(("offset", "offset_dev", "offset_mean"), 0.0)
    assert system["ptp_status"] == {"master_ip": "", "state": "off", **offsets}
    listed = {
        "0": {"type": "rc_visard", "model_name": "small", "ready": True},
        "1": {"type": "rc_visard", "model_name": "other", "ready": True},
    }
    assert system["pipelines"]["config"] == {"max_pipelines": 2, "pending_changes": False, "pipelines": listed}
    async with http_client(system_router(*services)) as rest:
        assert (await rest.get("/api/v2/pipelines")).json() == listed
        assert (await rest.get("/api/v2/pipelines/1")).json() == listed["1"]
        assert (await rest.get("/api/v2/pipelines/2")).status_code == 404
        assert (await rest.get("/api/v2/datastreams")).json() == []


async def test_the_pipeline_of_a_request(start: Start) -> None:
    cameras = [await start(faults=True), await start(faults=True, model=OTHER)]
    first, second = (camera.service for camera in cameras)
    async with http_client(fault_router(first, second), truth_router(first, second)) as rest:
        await rest.put("/stereo/faults", json={"drop": 0.25})
        await rest.put("/stereo/faults?pipeline=1", json={"drop": 0.5})
        assert first.injector is not None
        assert second.injector is not None
        assert (first.injector.faults.drop, second.injector.faults.drop) == (0.25, 0.5)
        assert (await rest.get("/stereo/faults")).json()["drop"] == 0.25
        assert (await rest.get("/stereo/faults?pipeline=1")).json()["drop"] == 0.5
        await rest.delete("/stereo/faults")
        assert (first.injector.faults, second.injector.faults.drop) == (Faults(), 0.5)
        calls = [(method, "faults") for method in ("GET", "PUT", "DELETE")]
        for method, path in (*calls, ("POST", "faults/disconnect"), ("GET", "truth.npz")):
            response = await rest.request(method, f"/stereo/{path}?pipeline=2")
            assert (response.status_code, response.json()["message"]) == (404, "there is no pipeline 2")
            assert (await rest.request(method, f"/stereo/{path}?pipeline=-1")).status_code == 422
        assert (await rest.post("/stereo/faults/disconnect")).json() == {"streams": 0}
