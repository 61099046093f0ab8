"""The device's REST interface."""

import io
import math
import time
from datetime import UTC, datetime
from typing import Any

import httpx2 as httpx
import numpy as np
import pytest
import structlog
from hypothesis import given
from hypothesis import strategies as st

from gateway.adapters.stereo.device.parameter_specs import NODES, Spec
from gateway.adapters.stereo.device.parameters import ParameterError, Parameters
from gateway.adapters.stereo.device.timestamps import timestamp_text
from gateway.adapters.stereo.routes.device_content import node_status
from renderers.stereo.model import StereoModel
from tests.adapters.stereo.conftest import Camera, Start, nanoseconds, pixels

V2 = "/api/v2/pipelines/0/nodes"
SPECS = [(node, spec) for node, specs in NODES.items() for spec in specs.values()]


async def test_nodes_and_their_parameters(rest_client: httpx.AsyncClient) -> None:
    nodes = (await rest_client.get(V2)).json()
    assert [n["name"] for n in nodes] == ["rc_camera", "rc_stereomatching", "rc_iocontrol", "rc_measure"]
    assert all(n["status"] == "running" for n in nodes)
    assert "acquisition_trigger" in nodes[1]["services"]
    quality = (await rest_client.get(f"{V2}/rc_stereomatching/parameters", params={"name": "quality"})).json()
    fields = ("name", "type", "value", "min", "max")
    assert [[q[name] for name in fields] for q in quality] == [["quality", "string", "High", "", ""]]
    fps = (await rest_client.get(f"{V2}/rc_camera/parameters/fps")).json()
    assert (fps["value"], fps["min"], fps["max"], fps["default"], fps["type"]) == (25, 1, 25, 25, "float64")


@pytest.mark.parametrize(
    "path",
    [
        f"{V2}/rc_stereomatching/parameters",
        f"{V2}/rc_stereomatching/parameters/parameters",
        f"{V2}/rc_stereomatching/services/parameters",
        "/api/v1/nodes/rc_stereomatching/parameters",
    ],
)
async def test_ways_to_set_a_parameter_by_query(rest_client: httpx.AsyncClient, camera: Camera, path: str) -> None:
    response = await rest_client.put(path, params={"quality": "Low", "minconf": "0.75"})
    assert response.status_code == 200
    assert [(p["name"], p["value"]) for p in response.json()] == [("quality", "Low"), ("minconf", 0.75)]
    assert camera.service.settings.quality.value == "Low"


async def test_query_and_body_are_both_optional(rest_client: httpx.AsyncClient) -> None:
    path = f"{V2}/rc_camera/parameters"
    nothing = await rest_client.put(path)
    assert nothing.status_code == 200
    assert nothing.json() == (await rest_client.get(path)).json()
    combined = await rest_client.put(f"{path}?fps=5&wb_auto=false", json=[{"name": "gain_value", "value": 3}])
    values = {"fps": 5.0, "wb_auto": False, "gain_value": 3.0}
    assert {p["name"]: p["value"] for p in combined.json()} == values
    assert (await rest_client.put(f"{path}?fps=6", content=b"x")).status_code == 400
    assert (await rest_client.get(f"{path}/fps")).json()["value"] == 5.0


async def test_a_call_has_an_object_or_nothing_as_its_body(rest_client: httpx.AsyncClient) -> None:
    for body, status in (("", 200), ('{"args": null}', 200), ("[]", 400), ('{"args": 1}', 400)):
        response = await rest_client.put(f"{V2}/rc_iocontrol/services/get_io_values", content=body)
        assert response.status_code == status, response.text


async def test_setting_by_body(rest_client: httpx.AsyncClient, camera: Camera) -> None:
    response = await rest_client.put(f"{V2}/rc_camera/parameters", json=[{"name": "fps", "value": 5}])
    assert response.json()[0]["value"] == 5.0
    response = await rest_client.put("/api/v1/nodes/rc_stereocamera/parameters/exp_auto", json={"value": False})
    assert response.json()["value"] is False
    assert camera.service.settings.auto_exposure is None
    assert (await rest_client.get(f"{V2}/rc_camera/parameters/exp_control")).json()["value"] == "Manual"


@pytest.mark.parametrize(
    ("body", "status", "sentence"),
    [
        ('[{"name": "fps", "value": 5}, {"name": "gain_value", "value": 19}]', 400, "gain_value: 19 is out of range"),
        ('[{"name": "fps", "value": 5}, {"name": "speed", "value": 1}]', 404, "rc_camera has no parameter 'speed'"),
        ('[{"name": "fps", "value": "fast"}]', 400, "fps: 'fast' is not a number"),
        ('[{"name": "fps", "value": true}]', 400, "fps: True is not a number"),
        ('[{"name": "fps", "value": [5]}]', 400, "fps: a list is not a number"),
        ('[{"name": "exp_auto", "value": {}}]', 400, "exp_auto: an object is not true or false"),
        ('[{"name": "fps", "value": %s}]' % ("[" * 30_000 + "]" * 30_000), 400, "nested too deep"),
        ('[{"name": "fps", "value": 1e400}]', 400, "Number out of range"),
        ('[{"name": "fps", "value": NaN}]', 400, "the body is not like"),
        ('{"fps": 5}', 400, "the body is not like"),
        ('[{"name": "fps", "value": "5"}]', 400, "fps: '5' is not a number"),
        ('[{"name": "exp_auto", "value": "true"}]', 400, "exp_auto: 'true' is not true or false"),
        ("[" * 100_000, 413, "larger than"),
    ],
)
async def test_invalid_requests_are_rejected_without_effect(
    rest_client: httpx.AsyncClient, camera: Camera, body: str, status: int, sentence: str
) -> None:
    before = dict(camera.service.parameters.values("rc_camera"))
    response = await rest_client.put(f"{V2}/rc_camera/parameters", content=body)
    assert response.status_code == status
    assert sentence in response.json()["message"]
    assert response.json()["return_code"]["value"] != 0
    assert dict(camera.service.parameters.values("rc_camera")) == before


@pytest.mark.parametrize("name", ["fps", "exp_auto", "exp_control"])
async def test_rejects_arbitrary_bodies_for_one_parameter(rest_client: httpx.AsyncClient, name: str) -> None:
    path = f"{V2}/rc_camera/parameters/{name}"
    for depth in (*range(850, 1000, 3), 5000, 30_000):  # about the depth at which the interpreter gives up, and beyond
        nested = await rest_client.put(path, content='{"value": %s}' % ("[" * depth + "]" * depth))
        assert nested.status_code == 400
        assert len(nested.json()["message"]) < 200
    unknown = await rest_client.put(path, content='{"value": 1, "other": %s}' % ("[" * 30_000 + "]" * 30_000))
    assert unknown.status_code == 400
    for text in (b"\xff", b"\xed\xa0\x80"):  # not UTF-8
        assert (await rest_client.put(path, content=b'{"value": "%b"}' % text)).status_code == 400
    long = await rest_client.put(path, content='{"value": "%s"}' % ("a" * 60_000))
    assert long.status_code == 400
    assert len(long.json()["message"]) < 200


async def test_unknown_things_are_404(rest_client: httpx.AsyncClient) -> None:
    for path in (f"{V2}/rc_pick", f"{V2}/rc_pick/status", f"{V2}/rc_camera/parameters/x", f"{V2}/rc_camera/services/x"):
        assert (await rest_client.get(path)).status_code == 404, path
    assert (await rest_client.put(f"{V2}/rc_camera/services/x")).status_code == 404
    assert (await rest_client.get(f"{V2}/rc_camera/parameters", params={"name": "x"})).status_code == 404


async def test_the_devices_address_of_the_description_leads_to_ours(rest_client: httpx.AsyncClient) -> None:
    found = await rest_client.get("/api/swagger")
    assert (found.status_code, found.headers["location"]) == (307, "../docs")


async def test_services(rest_client: httpx.AsyncClient, camera: Camera) -> None:
    response = await rest_client.put(f"{V2}/rc_stereomatching/services/acquisition_trigger", json={"args": {}})
    code = {"value": -8, "message": "Triggering is only possible in SingleFrame acquisition mode"}
    assert response.json() == {"name": "acquisition_trigger", "response": {"return_code": code}}
    await rest_client.put(f"{V2}/rc_iocontrol/parameters/out1_mode", json={"value": "High"})
    values = (await rest_client.put(f"{V2}/rc_iocontrol/services/get_io_values")).json()["response"]
    assert values["values"] == 1
    reset = (await rest_client.put(f"{V2}/rc_iocontrol/services/reset_defaults", json={"args": {}})).json()
    assert reset == {"name": "reset_defaults", "response": {"return_code": {"value": 0, "message": ""}}}
    assert camera.service.settings.out1_mode == "Low"
    listed = (await rest_client.get(f"{V2}/rc_stereomatching/services")).json()
    assert {s["name"] for s in listed} == {"acquisition_trigger", "reset_defaults"}


@pytest.mark.usefixtures("logs")
async def test_log_of_the_camera(rest_client: httpx.AsyncClient, camera: Camera) -> None:
    before = (await rest_client.get("/api/v2/logs")).json()
    assert [file["name"] for file in before] == ["stereo.log"]
    await camera.take(left_enabled=True)
    structlog.get_logger("stereo").warning("the scene could not be read", frame=3)
    (after,) = (await rest_client.get("/api/v2/logs")).json()
    assert after["size"] > before[0]["size"]
    assert after["date"] > before[0]["date"]
    log = (await rest_client.get("/api/v2/logs/stereo.log", params={"limit": 1})).json()
    assert (log["name"], log["size"], log["date"]) == ("stereo.log", after["size"], after["date"])
    (entry,) = log["log"]
    message = "the scene could not be read frame=3"
    assert entry == {"component": "stereo", "level": "WARN", "message": message, "timestamp": after["date"]}
    full = (await rest_client.get("/api/v1/logs/stereo.log")).json()["log"]
    assert any("streaming left to" in entry["message"] for entry in full)
    raw = await rest_client.get("/api/v2/logs/stereo.log", params={"format": "raw"})
    assert raw.headers["content-type"].startswith("text/plain")
    assert len(raw.content) == after["size"]
    assert raw.text.splitlines()[-1].endswith("WARN stereo: the scene could not be read frame=3")
    missing = await rest_client.get("/api/v2/logs/gev.log")
    assert missing.status_code == 404
    assert "stereo.log" in missing.json()["message"]


async def test_global_nodes_pipelines_and_time(rest_client: httpx.AsyncClient) -> None:
    assert (await rest_client.get("/api/v2/nodes")).json() == []
    for path in ("/api/v2/nodes/rc_roi_db", "/api/v2/pipelines/1", "/api/v2/pipelines/x"):
        response = await rest_client.get(path)
        assert response.status_code == 404
        assert response.json()["return_code"]["value"] == -1
    pipelines = (await rest_client.get("/api/v2/pipelines")).json()
    assert (await rest_client.get("/api/v2/pipelines/0")).json() == pipelines["0"]
    now = (await rest_client.get("/api/v2/system/time")).json()["utc"]
    shown = datetime.strptime(now, "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC)
    assert abs(shown.timestamp() - time.time()) < 60


async def test_parameters_act_on_the_stream(rest_client: httpx.AsyncClient, camera: Camera) -> None:
    async def put(node: str, **values: Any) -> None:
        body = [{"name": k, "value": v} for k, v in values.items()]
        assert (await rest_client.put(f"{V2}/{node}/parameters", json=body)).status_code == 200

    await put("rc_camera", exp_control="Manual", exp_value=0.002, gain_value=6)
    (dark,) = await camera.take(left_enabled=True)
    await put("rc_camera", exp_value=0.010)
    (bright,) = await camera.take(left_enabled=True)
    assert dark.left.exposure_time == pytest.approx(0.002)
    assert dark.left.gain == 6
    assert pixels(bright.left).mean() > 1.3 * pixels(dark.left).mean()
    await put("rc_iocontrol", out1_mode="High")
    await put("rc_stereomatching", mindepth=1.2, maxdepth=1.6, fill=0)
    (image_set,) = await camera.take(disparity_enabled=True, disparity_error_enabled=True, confidence_enabled=True)
    d = pixels(image_set.disparity.image)
    z = image_set.disparity.image.focal_length * image_set.disparity.baseline / (d[d > 0] / 16)
    assert z.size > 100
    assert z.min() >= 1.19
    assert z.max() <= 1.61
    await put("rc_stereomatching", mindepth=0.1, maxdepth=100, minconf=0.9)
    (sure,) = await camera.take(confidence_enabled=True)
    c = pixels(sure.confidence)
    assert c[c > 0].min() >= 0.9 * 255
    await put("rc_stereomatching", minconf=0.5, maxdeptherr=0.01)
    (near,) = await camera.take(disparity_enabled=True, disparity_error_enabled=True)
    d, e = pixels(near.disparity.image).astype(float), pixels(near.disparity_error).astype(float)
    focal_times_baseline = near.disparity.image.focal_length * near.disparity.baseline
    assert (e[d > 0] / 16 * focal_times_baseline / (d[d > 0] / 16) ** 2).max() <= 0.01 + 1e-9


@pytest.mark.parametrize("mode", ["matched", "ground_truth"])
async def test_status_has_the_nearest_measured_depth(start: Start, mode: str) -> None:
    model = StereoModel("small", 320, 240, 0.8449, 0.160, full_max_disparities=30)
    camera = await start(model=model, rate="max", depth_mode=mode, noise=False)
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "High")])
    camera.service.parameters.set("rc_stereomatching", [("quality", "Full")])
    (image_set,) = await camera.take(disparity_enabled=True)
    d = pixels(image_set.disparity.image)
    assert (d > 0).mean() > 0.1
    z = image_set.disparity.image.focal_length * image_set.disparity.baseline / (d[d > 0] * image_set.disparity.scale)
    values = node_status(camera.service, "rc_stereomatching")["values"]
    assert (values["reduced_depth_range"], z.min() >= 0.999 * float(values["mindepth"]) > 1.3) == ("1", True)


async def test_truth_of_a_set(rest_client: httpx.AsyncClient, camera: Camera) -> None:
    assert (await rest_client.get("/stereo/truth.npz")).status_code == 404
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "High")])
    (image_set,) = await camera.take(left_enabled=True, disparity_enabled=True)
    timestamp = nanoseconds(image_set.timestamp)
    response = await rest_client.get("/stereo/truth.npz", params={"timestamp": timestamp_text(timestamp)})
    assert response.status_code == 200
    truth = np.load(io.BytesIO(response.content))
    assert (truth["timestamp"], truth["revision"]) == (timestamp, 1)
    d = pixels(image_set.disparity.image)
    valid = (d > 0) & (truth["disparity"] > 0)
    assert valid.mean() > 0.5
    error = d[valid] / 16 - truth["disparity"][valid]
    assert abs(float(np.median(error))) < 0.02
    f = image_set.disparity.image.focal_length
    assert np.allclose(f * image_set.disparity.baseline / truth["depth"][valid], truth["disparity"][valid], rtol=1e-4)
    assert {0, 1, 2, 3, 4, 5} <= set(np.unique(truth["left_label"]).tolist())
    assert truth["left_depth"].shape == (240, 320)
    intrinsics = [camera.service.config.model.intrinsics(divisor) for divisor in (2, 1)]  # quality High
    for name, k in zip(("K", "K_left"), intrinsics, strict=True):
        assert truth[name].tolist() == [[k.focal_length, 0, k.cx], [0, k.focal_length, k.cy], [0, 0, 1]]
    assert (truth["frame"], truth["camera_timestamp"], truth["baseline"]) == (1, truth["timestamp"], 0.16)
    shift = np.linalg.inv(truth["X_world_left"]) @ truth["X_world_right"]
    assert np.allclose(shift[:3, 3], (0.16, 0, 0))
    assert (await rest_client.get("/stereo/truth.npz", params={"timestamp": "1.5"})).status_code == 404
    assert (await rest_client.get("/stereo/truth.npz", params={"timestamp": "now"})).status_code == 400


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=80),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(st.sampled_from(SPECS), json_values)
def test_any_value_is_stored_in_range_or_rejected(named: tuple[str, Spec], value: object) -> None:
    node, spec = named
    parameters = Parameters()
    before = parameters.values(node)[spec.name]
    try:
        parameters.set(node, [(spec.name, value)])
    except ParameterError as error:
        assert spec.name in str(error)
        assert len(str(error)) < 400
        assert parameters.values(node)[spec.name] == before
        return
    stored = parameters.values(node)[spec.name]
    assert type(stored) is type(spec.default)
    if isinstance(stored, (int, float)) and not isinstance(stored, bool):
        assert math.isfinite(stored)
        assert float(spec.minimum) <= stored <= float(spec.maximum)
