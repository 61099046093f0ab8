"""All interfaces of one process on one live scene, each used through its clients' own library."""

import socket
from collections.abc import Iterator
from typing import Any

import cv2
import grpc
import numpy as np
import pytest

from scenegate import Box, TreeViewer
from scenegate.camera import image_interface_pb2 as pb
from tests.support import clients
from tests.support.gateway_process import GatewayProcess, gateway_process
from tests.support.waiting import SECONDS


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


def publish_box(running: Running) -> None:
    """Publish a box of 0.5 m at the origin."""
    with TreeViewer(running.interface("treeviewer")["tcpq"]["url"], timeout=SECONDS) as viewer:
        viewer["crate"].set(Box((0.5, 0.5, 0.5), color="red"))


def test_everything_is_ready(running: Running) -> None:
    ready = running.http.get("/readyz")
    assert ready.status_code == 200
    described = ready.json()
    assert described["status"] == "ready"
    assert {"kernels", "render", "scene", "treeviewer", "stereo", "rest"} <= described["interfaces"].keys()


def test_renders_a_published_box(running: Running) -> None:
    publish_box(running)
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
