"""The device's REST interface."""

from __future__ import annotations

import io
import logging
import math
import time
from collections.abc import AsyncIterator, Iterator
from datetime import UTC, datetime
from typing import Any

import httpx2 as httpx
import numpy as np
import pytest
import structlog
from fastapi import FastAPI
from hypothesis import given
from hypothesis import strategies as st

from gateway.runtime import logs
from gateway.stereo.device import status
from gateway.stereo.node_routes import node_router
from gateway.stereo.parameter_specs import NODES, Spec
from gateway.stereo.parameters import ParameterError, Parameters, check
from gateway.stereo.system_routes import system_router
from gateway.stereo.truth import parse_timestamp, timestamp_text, truth_router
from renderers.stereo.model import MODELS, StereoModel
from tests.stereo.conftest import Camera, Start, pixels

V2 = "/api/v2/pipelines/0/nodes"
SPECS = [(node, spec) for node, specs in NODES.items() for spec in specs.values()]


@pytest.fixture(autouse=True)
def _restore_logs() -> Iterator[None]:
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers[:], root.level = handlers, level
    structlog.reset_defaults()


@pytest.fixture
async def camera(start: Start) -> Camera:
    return await start()


@pytest.fixture
async def rest(camera: Camera) -> AsyncIterator[httpx.AsyncClient]:
    app = FastAPI()
    app.include_router(node_router(camera.service))
    app.include_router(system_router(camera.service))
    app.include_router(truth_router(camera.service))
    transport = httpx.ASGITransport(app=app)
    async with httpx.AsyncClient(transport=transport, base_url="http://device") as client:
        yield client


async def test_nodes_and_their_parameters(rest: httpx.AsyncClient) -> None:
    nodes = (await rest.get(V2)).json()
    assert [n["name"] for n in nodes] == ["rc_camera", "rc_stereomatching", "rc_iocontrol"]
    assert all(n["status"] == "running" for n in nodes)
    assert "acquisition_trigger" in nodes[1]["services"]
    quality = (await rest.get(f"{V2}/rc_stereomatching/parameters", params={"name": "quality"})).json()
    assert [(q["name"], q["type"], q["value"], q["min"], q["max"]) for q in quality] == [
        ("quality", "string", "High", "", "")
    ]
    fps = (await rest.get(f"{V2}/rc_camera/parameters/fps")).json()
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
async def test_ways_to_set_a_parameter_by_query(rest: httpx.AsyncClient, camera: Camera, path: str) -> None:
    answer = await rest.put(path, params={"quality": "Low", "minconf": "0.75"})
    assert answer.status_code == 200
    assert [(p["name"], p["value"]) for p in answer.json()] == [("quality", "Low"), ("minconf", 0.75)]
    assert camera.service.settings.quality.value == "Low"


async def test_query_and_body_are_both_optional(rest: httpx.AsyncClient) -> None:
    path = f"{V2}/rc_camera/parameters"
    nothing = await rest.put(path)
    assert nothing.status_code == 200
    assert nothing.json() == (await rest.get(path)).json()
    both = await rest.put(f"{path}?fps=5&wb_auto=false", json=[{"name": "gain_value", "value": 3}])
    assert [(p["name"], p["value"]) for p in both.json()] == [("fps", 5.0), ("wb_auto", False), ("gain_value", 3.0)]
    assert (await rest.put(f"{path}?fps=6", content=b"x")).status_code == 400
    assert (await rest.get(f"{path}/fps")).json()["value"] == 5.0


@pytest.mark.parametrize(("body", "status"), [("", 200), ('{"args": null}', 200), ("[]", 400), ('{"args": 1}', 400)])
async def test_a_call_has_an_object_or_nothing_as_its_body(rest: httpx.AsyncClient, body: str, status: int) -> None:
    answer = await rest.put(f"{V2}/rc_iocontrol/services/get_io_values", content=body)
    assert answer.status_code == status, answer.text


async def test_setting_by_body(rest: httpx.AsyncClient, camera: Camera) -> None:
    answer = await rest.put(f"{V2}/rc_camera/parameters", json=[{"name": "fps", "value": 5}])
    assert answer.json()[0]["value"] == 5.0
    answer = await rest.put("/api/v1/nodes/rc_stereocamera/parameters/exp_auto", json={"value": False})
    assert answer.json()["value"] is False
    assert camera.service.settings.auto_exposure is None
    assert (await rest.get(f"{V2}/rc_camera/parameters/exp_control")).json()["value"] == "Manual"


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
    rest: httpx.AsyncClient, camera: Camera, body: str, status: int, sentence: str
) -> None:
    before = dict(camera.service.parameters.values("rc_camera"))
    answer = await rest.put(f"{V2}/rc_camera/parameters", content=body)
    assert answer.status_code == status
    assert sentence in answer.json()["message"]
    assert answer.json()["return_code"]["value"] != 0
    assert dict(camera.service.parameters.values("rc_camera")) == before


@pytest.mark.parametrize("name", ["fps", "exp_auto", "exp_control"])
async def test_rejects_arbitrary_bodies_for_one_parameter(rest: httpx.AsyncClient, name: str) -> None:
    path = f"{V2}/rc_camera/parameters/{name}"
    for depth in (*range(850, 1000, 3), 5000, 30_000):  # about the depth at which the interpreter gives up, and beyond
        nested = await rest.put(path, content='{"value": %s}' % ("[" * depth + "]" * depth))
        assert nested.status_code == 400
        assert len(nested.json()["message"]) < 200
    unknown = await rest.put(path, content='{"value": 1, "other": %s}' % ("[" * 30_000 + "]" * 30_000))
    assert unknown.status_code == 400
    long = await rest.put(path, content='{"value": "%s"}' % ("a" * 60_000))
    assert long.status_code == 400
    assert len(long.json()["message"]) < 200


async def test_unknown_things_are_404(rest: httpx.AsyncClient) -> None:
    for path in (f"{V2}/rc_pick", f"{V2}/rc_pick/status", f"{V2}/rc_camera/parameters/x", f"{V2}/rc_camera/services/x"):
        assert (await rest.get(path)).status_code == 404, path
    assert (await rest.put(f"{V2}/rc_camera/services/x")).status_code == 404
    assert (await rest.get(f"{V2}/rc_camera/parameters", params={"name": "x"})).status_code == 404


async def test_status_values_are_strings(rest: httpx.AsyncClient, camera: Camera) -> None:
    await camera.take(left_enabled=True, disparity_enabled=True)
    for node, wanted in (
        ("rc_camera", {"focal", "baseline", "exp", "gain", "brightness", "fps", "width", "height"}),
        ("rc_stereomatching", {"time_matching", "latency", "fps", "mindepth", "width", "reduced_depth_range"}),
        ("rc_iocontrol", {"out1", "out2"}),
    ):
        status = (await rest.get(f"{V2}/{node}/status")).json()
        assert status["status"] == "running"
        assert wanted <= set(status["values"])
        assert all(isinstance(v, str) for v in status["values"].values())
    values = (await rest.get("/api/v1/nodes/rc_camera/status")).json()["values"]
    assert (values["focal"], values["baseline"]) == ("0.8449", "0.16")
    assert float(values["brightness"]) > 0


async def test_services(rest: httpx.AsyncClient, camera: Camera) -> None:
    answer = await rest.put(f"{V2}/rc_stereomatching/services/acquisition_trigger", json={"args": {}})
    assert answer.json() == {
        "name": "acquisition_trigger",
        "response": {
            "return_code": {"value": -8, "message": "Triggering is only possible in SingleFrame acquisition mode"}
        },
    }
    await rest.put(f"{V2}/rc_iocontrol/parameters/out1_mode", json={"value": "High"})
    values = (await rest.put(f"{V2}/rc_iocontrol/services/get_io_values")).json()["response"]
    assert (values["values"], values["output_mask"], values["input_mask"]) == (1, 3, 12)
    await rest.put(f"{V2}/rc_iocontrol/services/reset_defaults", json={"args": {}})
    assert camera.service.settings.out1_mode == "Low"
    listed = (await rest.get(f"{V2}/rc_stereomatching/services")).json()
    assert {s["name"] for s in listed} == {"acquisition_trigger", "reset_defaults"}


async def test_system(rest: httpx.AsyncClient) -> None:
    for version in ("v1", "v2"):
        system = (await rest.get(f"/api/{version}/system")).json()
        assert system["ready"] is True
        assert len(system["firmware"]["active_image"]["image_version"].split(".")) == 3
    assert list((await rest.get("/api/v2/pipelines")).json()) == ["0"]


async def test_log_of_the_camera(rest: httpx.AsyncClient, camera: Camera) -> None:
    logs.configure("json", "info")
    before = (await rest.get("/api/v2/logs")).json()
    assert [file["name"] for file in before] == ["stereo.log"]
    await camera.take(left_enabled=True)
    structlog.get_logger("stereo").warning("the scene could not be read", frame=3)
    (after,) = (await rest.get("/api/v2/logs")).json()
    assert after["size"] > before[0]["size"]
    assert after["date"] > before[0]["date"]
    log = (await rest.get("/api/v2/logs/stereo.log", params={"limit": 1})).json()
    assert (log["name"], log["size"], log["date"]) == ("stereo.log", after["size"], after["date"])
    (entry,) = log["log"]
    assert entry == {
        "component": "stereo",
        "level": "WARN",
        "message": "the scene could not be read frame=3",
        "timestamp": after["date"],
    }
    full = (await rest.get("/api/v1/logs/stereo.log")).json()["log"]
    assert any("streaming left to" in entry["message"] for entry in full)
    raw = await rest.get("/api/v2/logs/stereo.log", params={"format": "raw"})
    assert raw.headers["content-type"].startswith("text/plain")
    assert len(raw.content) == after["size"]
    assert raw.text.splitlines()[-1].endswith("WARN stereo: the scene could not be read frame=3")
    missing = await rest.get("/api/v2/logs/gev.log")
    assert missing.status_code == 404
    assert "stereo.log" in missing.json()["message"]


async def test_global_nodes_pipelines_and_time(rest: httpx.AsyncClient) -> None:
    assert (await rest.get("/api/v2/nodes")).json() == []
    for path in ("/api/v2/nodes/rc_roi_db", "/api/v2/pipelines/1", "/api/v2/pipelines/x"):
        answer = await rest.get(path)
        assert answer.status_code == 404
        assert answer.json()["return_code"]["value"] == -1
    pipelines = (await rest.get("/api/v2/pipelines")).json()
    assert (await rest.get("/api/v2/pipelines/0")).json() == pipelines["0"]
    now = (await rest.get("/api/v2/system/time")).json()["utc"]
    shown = datetime.strptime(now, "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC)
    assert abs(shown.timestamp() - time.time()) < 60


async def test_both_spellings_of_alternate_exposure(rest: httpx.AsyncClient) -> None:
    for name in ("AlternateExposureActive", "ExposureAlternateActive"):
        answer = await rest.put(f"{V2}/rc_iocontrol/parameters/out1_mode", json={"value": name})
        assert answer.json()["value"] == "ExposureAlternateActive"


async def test_only_parameters_without_effect_are_described_so(rest: httpx.AsyncClient) -> None:
    silent = set()
    for node in NODES:
        for parameter in (await rest.get(f"{V2}/{node}/parameters")).json():
            if "without effect" in parameter["description"]:
                silent.add(parameter["name"])
    assert silent == {"exposure_adapt_timeout", "smooth"}


async def test_parameters_act_on_the_stream(rest: httpx.AsyncClient, camera: Camera) -> None:
    async def put(node: str, **values: Any) -> None:
        body = [{"name": k, "value": v} for k, v in values.items()]
        assert (await rest.put(f"{V2}/{node}/parameters", json=body)).status_code == 200

    await put("rc_camera", exp_control="Manual", exp_value=0.002, gain_value=6)
    (dark,) = await camera.take(left_enabled=True)
    await put("rc_camera", exp_value=0.010)
    (bright,) = await camera.take(left_enabled=True)
    assert dark.left.exposure_time == pytest.approx(0.002)
    assert dark.left.gain == 6
    assert pixels(bright.left).mean() > 1.3 * pixels(dark.left).mean()
    await put("rc_stereomatching", mindepth=1.2, maxdepth=1.6, fill=0)
    (one,) = await camera.take(disparity_enabled=True, disparity_error_enabled=True, confidence_enabled=True)
    d = pixels(one.disparity.image)
    z = one.disparity.image.focal_length * one.disparity.baseline / (d[d > 0] / 16)
    assert z.size > 100
    assert z.min() >= 1.19
    assert z.max() <= 1.61
    await put("rc_stereomatching", mindepth=0.1, maxdepth=100, minconf=0.99)
    (sure,) = await camera.take(confidence_enabled=True)
    c = pixels(sure.confidence)
    assert c[c > 0].min() >= 0.99 * 255
    await put("rc_stereomatching", minconf=0.5, maxdeptherr=0.01)
    (near,) = await camera.take(disparity_enabled=True, disparity_error_enabled=True)
    d, e = pixels(near.disparity.image).astype(float), pixels(near.disparity_error).astype(float)
    ft = near.disparity.image.focal_length * near.disparity.baseline
    assert (e[d > 0] / 16 * ft / (d[d > 0] / 16) ** 2).max() <= 0.01 + 1e-9


async def test_the_depth_range_at_full_quality_is_limited_by_memory(start: Start) -> None:
    camera = await start(model=MODELS["rc_visard 160-4"], rate="max", noise=False)
    app = FastAPI()
    app.include_router(node_router(camera.service))
    transport = httpx.ASGITransport(app=app)
    async with httpx.AsyncClient(transport=transport, base_url="http://device") as rest:

        async def range_at(**parameters: object) -> tuple[float, str]:
            body = [{"name": name, "value": value} for name, value in parameters.items()]
            assert (await rest.put(f"{V2}/rc_stereomatching/parameters", json=body)).status_code == 200
            values = (await rest.get(f"{V2}/rc_stereomatching/status")).json()["values"]
            return float(values["mindepth"]), values["reduced_depth_range"]

        assert await range_at(quality="High") == (0.4, "0")
        nearest, reduced = await range_at(quality="Full")
        # 256 disparities from that of maxdepth on; f t = 1081.472 * 0.16.
        assert nearest == pytest.approx(173.0355 / (173.0355 / 100 + 256), rel=1e-5)
        assert reduced == "1"
        # A smaller maxdepth brings mindepth nearer.
        assert await range_at(maxdepth=0.9) == (0.4, "0")
        nearest, reduced = await range_at(maxdepth=2.0)
        assert 0.4 < nearest < 0.6
        assert reduced == "1"
        assert await range_at(mindepth=0.7) == (0.7, "0")


@pytest.mark.parametrize("mode", ["ground_truth", "matched"])
async def test_status_has_the_nearest_measured_depth(start: Start, mode: str) -> None:
    model = StereoModel("small", 320, 240, 0.8449, 0.160, full_max_disparities=30)
    camera = await start(model=model, rate="max", depth_mode=mode, noise=False)
    camera.service.parameters.set("rc_iocontrol", [("out1_mode", "High")])
    camera.service.parameters.set("rc_stereomatching", [("quality", "Full")])
    (one,) = await camera.take(disparity_enabled=True)
    d = pixels(one.disparity.image)
    assert (d > 0).mean() > 0.1
    z = one.disparity.image.focal_length * one.disparity.baseline / (d[d > 0] * one.disparity.scale)
    assert z.min() >= 0.999 * float(status(camera.service, "rc_stereomatching")["values"]["mindepth"]) > 1.3


async def test_truth_of_a_set(rest: httpx.AsyncClient, camera: Camera) -> None:
    assert (await rest.get("/stereo/truth.npz")).status_code == 404
    (one,) = await camera.take(left_enabled=True, disparity_enabled=True)
    stamp = timestamp_text(one.timestamp.sec * 10**9 + one.timestamp.nsec)
    answer = await rest.get("/stereo/truth.npz", params={"timestamp": stamp})
    assert answer.status_code == 200
    truth = np.load(io.BytesIO(answer.content))
    assert truth["timestamp"] == one.timestamp.sec * 10**9 + one.timestamp.nsec
    assert truth["revision"] == 1
    d = pixels(one.disparity.image)
    valid = (d > 0) & (truth["disparity"] > 0)
    assert valid.mean() > 0.6
    error = d[valid] / 16 - truth["disparity"][valid]
    assert abs(float(np.median(error))) < 0.02
    f = one.disparity.image.focal_length
    assert np.allclose(f * one.disparity.baseline / truth["depth"][valid], truth["disparity"][valid], rtol=1e-4)
    assert {0, 1, 2, 3, 4, 5} <= set(np.unique(truth["left_label"]).tolist())
    assert truth["left_depth"].shape == (240, 320)
    shift = np.linalg.inv(truth["X_world_left"]) @ truth["X_world_right"]
    assert np.allclose(shift[:3, 3], (0.16, 0, 0))
    assert (await rest.get("/stereo/truth.npz", params={"timestamp": "1.5"})).status_code == 404
    assert (await rest.get("/stereo/truth.npz", params={"timestamp": "now"})).status_code == 400


@given(st.integers(0, 10**20))
def test_timestamp_text_round_trips(nanoseconds: int) -> None:
    assert parse_timestamp(timestamp_text(nanoseconds)) == nanoseconds


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=80),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(st.sampled_from(SPECS), json_values)
def test_any_value_is_stored_in_range_or_rejected(named: tuple[str, Spec], value: object) -> None:
    node, spec = named
    parameters = Parameters()
    before = parameters.get(node, spec.name)
    try:
        parameters.set(node, [(spec.name, value)])
    except ParameterError as error:
        assert spec.name in str(error)
        assert len(str(error)) < 400
        assert parameters.get(node, spec.name) == before
        return
    stored = parameters.get(node, spec.name)
    assert type(stored) is type(spec.default)
    if isinstance(stored, (int, float)) and not isinstance(stored, bool):
        assert math.isfinite(stored)
        assert float(spec.low) <= stored <= float(spec.high)


@pytest.mark.parametrize(("node", "spec"), SPECS, ids=lambda v: getattr(v, "name", v))
def test_defaults_and_limits_are_allowed(node: str, spec: Spec) -> None:
    for value in (spec.default, spec.low, spec.high, *spec.choices, *spec.aliases):
        if value != "":
            check(spec, value)
