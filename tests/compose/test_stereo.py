"""The stereo camera from outside; message types come from the server, by gRPC reflection."""

import base64
import io
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import grpc
import numpy as np
import pytest
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import ProtoReflectionDescriptorDatabase

from tests.support import clients
from tests.support.gateway_process import gateway_process
from tests.support.waiting import SECONDS

pytestmark = pytest.mark.compose

API = "/api/v2/pipelines/0/nodes"
OCTETS = "data:application/octet-stream;base64,"
_CORNERS = np.array(((-1, 0, -1), (1, 0, -1), (0, 0, 1)), np.float32)
TRIANGLE = {
    "asset": {"version": "2.0"},
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [-1, 0, -1], "max": [1, 0, 1]}
    ],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36, "uri": f"{OCTETS}{base64.b64encode(_CORNERS.tobytes()).decode()}"}],
    "materials": [{"doubleSided": True}],
}
"""A triangle."""


@pytest.fixture(scope="module")
def channel(url: str, interfaces: dict[str, Any]) -> Iterator[grpc.Channel]:
    options = [("grpc.max_receive_message_length", -1)]
    with grpc.insecure_channel(f"{urlsplit(url).hostname}:{interfaces['stereo']['port']}", options) as opened:
        yield opened


def take(channel: grpc.Channel, **enabled: Any) -> Any:
    """The first set of a stream, its classes made from what the server says of itself."""
    pool = DescriptorPool(ProtoReflectionDescriptorDatabase(channel))
    service = pool.FindServiceByName("ImageInterface")
    method = service.methods_by_name["StreamImageSets"]
    request, answer = GetMessageClass(method.input_type), GetMessageClass(method.output_type)
    stream = channel.unary_stream("/ImageInterface/StreamImageSets", request.SerializeToString, answer.FromString)
    call = stream(request(**enabled), timeout=SECONDS)
    one = next(call)
    call.cancel()
    return one


def test_image_sets_of_the_demo_scene(url: str, channel: grpc.Channel) -> None:
    one = take(channel, left_enabled=True, disparity_enabled=True, confidence_enabled=True, mesh_enabled=True)
    assert not one.HasField("right")
    assert (one.left.width, one.left.height, one.left.encoding) == (1280, 960, "mono8")
    left = np.frombuffer(one.left.data, np.uint8)
    assert left.std() > 3, "something is to be seen"
    d = one.disparity
    disparity = np.frombuffer(d.image.data, "<u2").reshape(d.image.height, d.image.width)
    assert (disparity > 0).mean() > 0.05
    assert d.baseline > 0
    assert one.mesh.data.startswith(b"ply\n")

    stamp = f"{one.timestamp.sec}.{one.timestamp.nsec:09d}"
    truth = np.load(io.BytesIO(clients.get(f"{url}/stereo/truth.npz", params={"timestamp": stamp}).content))
    both = (disparity > 0) & (truth["disparity"] > 0)
    error = disparity[both] / 16 - truth["disparity"][both]
    assert 0.02 < float(np.percentile(np.abs(error), 68)) < 0.4, "measured: neither the truth nor noise, in pixels"
    assert np.allclose(d.image.focal_length * d.baseline / truth["depth"][both], truth["disparity"][both], rtol=1e-3)


def test_parameters_change_the_stream(url: str, channel: grpc.Channel) -> None:
    quality = f"{url}{API}/rc_stereomatching/parameters/quality"
    try:
        assert clients.put(quality, json={"value": "Low"}).status_code == 200
        assert take(channel, disparity_enabled=True).disparity.image.width == 214
        refused = clients.put(quality, json={"value": "Best"})
        assert refused.status_code == 400
        assert "Best" in refused.json()["message"]
        assert clients.get(quality).json()["value"] == "Low"
    finally:
        clients.put(quality, json={"value": "High"})
    assert take(channel, disparity_enabled=True).disparity.image.width == 640


@pytest.mark.slow
@pytest.mark.skipif("SCENEGATE_URL" in os.environ, reason="starts gateways of its own")
def test_a_simulated_clock_gives_the_same_bytes_in_every_run(tmp_path: Path) -> None:
    scene = tmp_path / "triangle.gltf"
    scene.write_text(json.dumps(TRIANGLE))
    flags = ["--only", "stereo", "--grpc-port", "0", "--stereo-scene", str(scene), "--clock", "simulated"]
    flags += ("--stereo-rate", "max", "--stereo-pose", "eye=2,-2,2;target=0,0,0")
    runs = []
    for _ in range(2):
        with gateway_process(*flags) as (_, started):
            port = clients.get(f"{started}/healthz").json()["interfaces"]["stereo"]["port"]
            with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
                one = take(channel, left_enabled=True, right_enabled=True, disparity_enabled=True, mesh_enabled=True)
                assert any(one.disparity.image.data)
                runs.append(one.SerializeToString(deterministic=True))
    assert runs[0] == runs[1]


@pytest.mark.slow
@pytest.mark.skipif("SCENEGATE_URL" in os.environ, reason="starts gateways of its own")
def test_several_cameras_recorded_pairs_and_faults(tmp_path: Path) -> None:
    ramp = np.tile(np.arange(160, dtype=np.uint8), (120, 1))
    for side, shift in (("left", 0), ("right", 8)):
        cv2.imwrite(str(tmp_path / f"1_{side}.png"), np.roll(ramp, -shift, axis=1))
    flags = ["--only", "stereo", "--grpc-port", "0", "--stereo-images", str(tmp_path), "--stereo-faults"]
    flags += ("--stereo-cameras", 'eye=1,1,1;target=0,0,0|["robot", "hand"]')
    with gateway_process(*flags) as (_, base), clients.Client(base_url=base) as http:
        assert list(http.get("/api/v2/pipelines").json()) == ["0", "1", "2"]
        interfaces = http.get("/healthz").json()["interfaces"]
        ports = [interfaces[name]["port"] for name in ("stereo", "stereo 1", "stereo 2")]
        assert len(set(ports)) == 3
        answer = http.put("/api/v2/pipelines/1/nodes/rc_stereomatching/parameters?quality=Low")
        assert answer.status_code == 200
        sizes = []
        for port in ports:
            with grpc.insecure_channel(f"127.0.0.1:{port}") as channel:
                one = take(channel, left_enabled=True, disparity_enabled=True)
            assert np.array_equal(np.frombuffer(one.left.data, np.uint8).reshape(120, 160), ramp)
            sizes.append(one.disparity.image.width)
        assert sizes == [80, 27, 80]
        assert http.put("/stereo/faults?pipeline=2", json={"drop": 1}).json()["drop"] == 1
        assert http.get("/stereo/faults?pipeline=1").json()["drop"] == 0
        assert http.get("/stereo/truth.npz?pipeline=1").status_code == 404
