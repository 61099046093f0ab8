"""``rc_measure``, and the device's settings below ``/system``."""

import time
from typing import Any

import grpc
import httpx2 as httpx
import numpy as np
import pytest

from gateway.adapters.stereo.routes.device_content import node_status
from tests.adapters.stereo.conftest import Camera, Start

SYSTEM, NODES = "/api/v2/system", "/api/v2/pipelines/0/nodes"


@pytest.fixture
async def camera(start: Start) -> Camera:
    return await start(depth_mode="ground_truth")


async def measure(rest_client: httpx.AsyncClient, **arguments: Any) -> Any:
    path = f"{NODES}/rc_measure/services/measure_depth"
    response = await rest_client.put(path, json={"args": {"pose_frame": "camera", **arguments}})
    assert response.status_code == 200
    return response.json()["response"]


async def test_measured_depth_is_that_of_the_disparity_image(rest_client: httpx.AsyncClient, camera: Camera) -> None:
    found = await measure(rest_client, cell_count={"x": 3, "y": 2})
    assert found["return_code"] == {"value": 0, "message": ""}
    images, k = camera.service.measured, camera.service.config.model.intrinsics(2)
    assert images is not None
    units = images.images.disparity.astype(float)
    depth = np.where(units > 0, k.focal_length * 0.16 * 16 / np.where(units > 0, units, 1), np.nan)
    overall = found["overall"]
    assert overall["coverage"] == pytest.approx((units > 0).mean())
    assert overall["mean_z"] == {"x": 0.0, "y": 0.0, "z": pytest.approx(np.nanmean(depth))}
    assert overall["min_z"]["z"] == pytest.approx(np.nanmin(depth))
    rows, columns = np.nonzero(depth == np.nanmin(depth))
    x = (columns + 0.5 - k.cx) / k.focal_length * np.nanmin(depth)
    y = (rows + 0.5 - k.cy) / k.focal_length * np.nanmin(depth)
    assert np.isclose(overall["min_z"]["x"], x).any()
    assert np.isclose(overall["min_z"]["y"], y).any()
    cells = found["cells"]
    assert len(cells) == 6
    assert min(cell["min_z"]["z"] for cell in cells if cell["coverage"]) == overall["min_z"]["z"]
    third = depth[: k.height // 2, round(2 * k.width / 3) :]
    assert cells[2]["mean_z"]["z"] == pytest.approx(np.nanmean(third))
    again = await measure(
        rest_client, data_acquisition_mode="USE_LAST", region_of_interest_2d={"width": 20, "height": 10}
    )
    assert again["timestamp"] == found["timestamp"]
    assert again["region_of_interest_2d"] == {"offset_x": 0, "offset_y": 0, "width": 20, "height": 10}
    assert again["overall"]["coverage"] == pytest.approx((units[:5, :10] > 0).mean())


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"pose_frame": "external"}, "pose_frame"),
        ({"cell_count": {"x": 101, "y": 1}}, "cell_count"),
        ({"cell_count": {"x": -1, "y": 1}}, "cell_count"),
        ({"region_of_interest_2d": {"offset_x": 310, "width": 11, "height": 5}}, "region_of_interest_2d"),
        ({"region_of_interest_2d": {"offset_y": 240}}, "region_of_interest_2d"),
        ({"region_of_interest_2d_id": "box"}, "box"),
        ({"data_acquisition_mode": "USE_LAST"}, "USE_LAST"),
    ],
)
async def test_arguments_that_cannot_be_measured(rest_client: httpx.AsyncClient, arguments: Any, name: str) -> None:
    found = await measure(rest_client, **arguments)
    assert found.keys() == {"return_code"}
    assert found["return_code"]["value"] == -1
    assert name in found["return_code"]["message"]


async def test_a_backup_restores_parameters(rest_client: httpx.AsyncClient, camera: Camera) -> None:
    camera.service.set_parameters("rc_camera", [("exp_control", "HDR"), ("fps", 12)])
    camera.service.set_parameters("rc_stereomatching", [("quality", "Low")])
    backup = (await rest_client.get(f"{SYSTEM}/backup")).json()
    part = (await rest_client.get(f"{SYSTEM}/backup", params={"pipelines": False, "grippers": False})).json()
    assert part == {"load_carriers": [], "regions_of_interest": []}
    for node in ("rc_camera", "rc_stereomatching"):
        await rest_client.put(f"{NODES}/{node}/services/reset_defaults")
    backup["pipelines"]["0"]["nodes"]["rc_camera"]["parameters"] |= {"exp_auto": True, "gain_value": 99, "median": 1}
    backup["pipelines"]["7"] = {}
    restored = (await rest_client.post(f"{SYSTEM}/backup", json=backup)).json()
    assert restored["return_code"]["value"] == 0
    for name in ("gain_value", "median", "'7'"):
        assert any(name in each for each in restored["warnings"]), name
    values = camera.service.parameters.values
    assert (values("rc_camera")["exp_control"], values("rc_camera")["fps"]) == ("HDR", 12.0)
    assert values("rc_stereomatching")["quality"] == "Low"
    assert (await rest_client.post(f"{SYSTEM}/backup", json=[])).status_code == 400


async def test_the_time_of_timestamps(rest_client: httpx.AsyncClient, camera: Camera) -> None:
    utc = "2030-01-02 03:04:05"
    assert (await rest_client.put(f"{SYSTEM}/time", params={"utc": utc})).json() == {"utc": utc}
    assert (await rest_client.get(f"{SYSTEM}/time")).json()["utc"].startswith("2030-01-02 03:04:")
    (image_set,) = await camera.take(left_enabled=True)
    assert image_set.timestamp.sec == pytest.approx(1893553445, abs=30)
    assert node_status(camera.service, "rc_camera")["timestamp"] == pytest.approx(1893553445, abs=30)
    for wrong in ("", "2030-01-02", "1960-01-01 00:00:00", "x" * 100):
        assert (await rest_client.put(f"{SYSTEM}/time", params={"utc": wrong})).status_code == 400


async def test_a_reboot_ends_streams(rest_client: httpx.AsyncClient, camera: Camera) -> None:
    stream, before = camera.stream(), camera.service.started
    await stream.read()
    assert (await rest_client.put(f"{SYSTEM}/reboot")).status_code == 200
    assert await stream.code() == grpc.StatusCode.UNAVAILABLE
    assert before < camera.service.started <= time.time()
    await camera.take(left_enabled=True)


async def test_lock_and_what_the_computer_decides(rest_client: httpx.AsyncClient) -> None:
    async def lock(**values: Any) -> Any:
        return (await rest_client.post(f"{SYSTEM}/ui_lock", params=values)).json()

    assert await lock(hash="abc") == {"enabled": False, "valid": False}
    assert await lock(hash="abc", set=True) == {"enabled": True, "valid": True}
    assert await lock(hash="abd") == {"enabled": True, "valid": False}
    assert (await rest_client.get("/api/v1/system/ui_lock")).json() == {"enabled": True}
    assert (await rest_client.delete(f"{SYSTEM}/ui_lock")).json() == {"enabled": False, "valid": False}
    system = (await rest_client.get(SYSTEM)).json()
    assert (await rest_client.get(f"{SYSTEM}/network")).json() == system["network"]
    assert (await rest_client.get(f"{SYSTEM}/network/settings")).json() == system["network"]["settings"]
    assert (await rest_client.get(f"{SYSTEM}/ntp")).json() == {"ntp": system["ntp"]}
    assert (await rest_client.get(f"{SYSTEM}/dns")).json() == {"dns": system["dns"]}
    assert (await rest_client.get(f"{SYSTEM}/update")).json() == system["firmware"]
    assert (await rest_client.get(f"{SYSTEM}/license")).json()["components"]["stereo"] is True
    for method, name, status in (("PUT", "dns", 403), ("POST", "update", 400), ("PUT", "rollback", 400)):
        refused = await rest_client.request(method, f"{SYSTEM}/{name}")
        assert (refused.status_code, refused.json()["return_code"]["value"]) == (status, -1)
