"""All interfaces of one process on one live scene, each used through its clients' own library."""

import json
import socket
import struct
from collections.abc import Iterator
from typing import Any

import cv2
import grpc
import numpy as np
import pytest

from scenegate.camera import image_interface_pb2 as pb
from tests.support import clients
from tests.support.gateway_process import GatewayProcess, gateway_process
from tests.support.liblcm import liblcm
from tests.support.waiting import MILLISECONDS, SECONDS

FINGERPRINT = 0xD368E03F33C568BE
"""Fingerprint of robotlocomotion.viewer2_comms_t, as lcm-gen computes it."""


class Running:
    """A gateway with all interfaces on free ports, without LCM over UDP: the machine may have no multicast."""

    def __init__(self, process: GatewayProcess, url: str) -> None:
        self.process = process
        self.http = clients.Client(base_url=url)

    def interface(self, name: str) -> dict[str, Any]:
        described: dict[str, Any] = self.http.get("/healthz").json()["interfaces"][name]
        return described


@pytest.fixture(scope="module")
def running() -> Iterator[Running]:
    flags = ("--lcm-url", "off", "--tcpq-port", "0", "--grpc-port", "0", "--rest-port", "0")
    with gateway_process(*flags) as (process, url):
        running = Running(process, url)
        yield running
        running.http.close()
        assert process.stop() == 0
        assert not [entry for entry in process.rest_of_log() if entry["level"] in ("error", "critical", "raw")]


def viewer2_comms(request: dict[str, Any]) -> bytes:
    data = json.dumps(request).encode()
    name = b"treeviewer_json\0"
    head = struct.pack(">QqI", FINGERPRINT, request["utime"], len(name))
    return head + name + struct.pack(">iii", 1, 0, len(data)) + data


def publish_box(running: Running) -> dict[str, Any]:
    """Publish a box of 0.5 m at the origin with LCM's own library; return the response."""
    lcm = liblcm()
    bus = lcm.LCM(running.interface("treeviewer")["tcpq"]["url"])
    responses: list[dict[str, Any]] = []

    def on_response(_: str, message: bytes) -> None:
        response = json.loads(message[message.index(b"\0", 20) + 13 :])
        if response.get("timestamp") == request["timestamp"]:
            responses.append(response)

    bus.subscribe("DIRECTOR_TREE_VIEWER_RESPONSE_<e2e>", on_response)
    box = {"type": "box", "lengths": [0.5, 0.5, 0.5], "color": [1.0, 0.0, 0.0, 1.0]}
    pose = {"translation": [0, 0, 0], "quaternion": [1, 0, 0, 0]}
    request: dict[str, Any] = {
        "utime": 1,
        "timestamp": 1,
        "delete": [],
        "setgeometry": [{"path": ["crate"], "geometry": box}],
        "settransform": [{"path": ["crate"], "transform": pose}],
    }
    bus.publish("DIRECTOR_TREE_VIEWER_REQUEST_<e2e>", viewer2_comms(request))
    while not responses:
        assert bus.handle_timeout(MILLISECONDS), "no response"
    return responses[0]


def test_everything_is_ready(running: Running) -> None:
    ready = running.http.get("/readyz")
    assert ready.status_code == 200
    described = ready.json()
    assert described["status"] == "ready"
    assert {"kernels", "render", "scene", "treeviewer", "stereo", "rest"} <= described["interfaces"].keys()


def test_renders_a_published_box(running: Running) -> None:
    response = publish_box(running)
    assert response["status"] == 0, response
    listed = running.http.get("/scene").json()
    (crate,) = [node for node in listed["nodes"] if node["path"] == ["crate"]]
    query: dict[str, Any] = {"camera": "eye=2,0,0;target=0,0,0;fovy=30", "type": "label", "width": 64, "height": 64}
    image = running.http.get("/scene/render", params=query)
    assert image.status_code == 200, image.text
    bgr: Any = cv2.imdecode(np.frombuffer(image.content, np.uint8), cv2.IMREAD_COLOR)
    labels = bgr[:, :, ::-1].astype(int)
    value = labels[32, 32] @ (1, 256, 65536)
    assert value == crate["label"]
    assert (labels[0, 0] == 255).all()
    assert int(image.headers["x-scene-revision"]) >= 1


def test_the_stereo_camera_sees_a_published_box(running: Running) -> None:
    publish_box(running)
    target = f"127.0.0.1:{running.interface('stereo')['port']}"
    with grpc.insecure_channel(target, options=[("grpc.max_receive_message_length", -1)]) as channel:
        stream = channel.unary_stream(
            "/ImageInterface/StreamImageSets",
            request_serializer=pb.ImageSetRequest.SerializeToString,
            response_deserializer=pb.ImageSet.FromString,
        )
        request = pb.ImageSetRequest(left_enabled=True, disparity_enabled=True, color=True)
        sets = stream(request, timeout=SECONDS)
        images = next(sets)
        sets.cancel()
    assert (images.left.width, images.left.height) == (1280, 960)
    left = np.frombuffer(images.left.data, np.uint8).reshape(960, 1280, 3).astype(int)
    red = (left[:, :, 0] > left[:, :, 1] + 40) & (left[:, :, 0] > left[:, :, 2] + 40)
    assert red.sum() > 1000
    parameters = running.http.get("/api/v2/pipelines/0/nodes/rc_camera/parameters")
    assert parameters.status_code == 200
    further = clients.get(f"http://127.0.0.1:{running.interface('rest')['port']}/api/v2/system")
    assert further.status_code == 200


@pytest.mark.slow
def test_a_taken_port_of_one_interface_leaves_the_others() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        flags = ("--only", "render,stereo,treeviewer", "--lcm-url", "off", "--tcpq-port", "off")
        with gateway_process(*flags, "--grpc-port", str(port)) as (process, url):
            ready = clients.get(f"{url}/readyz")
            assert ready.status_code == 200
            described = ready.json()
            assert described["status"] == "degraded"
            assert described["interfaces"]["render"]["state"] == "ready"
            stereo = described["interfaces"]["stereo"]
            assert stereo["state"] == "failed"
            assert f":{port}" in stereo["problem"]
            assert "taken" in stereo["problem"]
            errors = [entry for entry in process.log if entry["level"] == "error"]
            assert [line["event"].startswith("Stereo camera cannot be used: ") for line in errors] == [True]
            assert all("exception" not in line for line in errors)
            assert process.stop() == 0
