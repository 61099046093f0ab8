"""The node without ROS 2, in a process of its own: a second one receives over Zenoh what it publishes."""

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from tests.ros2.stand_in import PACKAGE, STORE
from tests.support.gateway_process import gateway_process
from tests.support.ports import free_ports
from tests.support.waiting import wait_until

zenoh_ros2_sdk = pytest.importorskip("zenoh_ros2_sdk", reason="zenoh-ros2-sdk is not installed")
pytest.importorskip("mcap_ros2", reason="needs the extra mcap")


@pytest.mark.slow
def test_another_process_receives_images_and_their_camera_info() -> None:
    from scenegate.recording.ros2_messages import definition

    grpc_port, zenoh_port = free_ports(2)
    flags = ("--demo", "--grpc-port", str(grpc_port), "--tcpq-port", "0", "--lcm-url", "off")
    command = [sys.executable, "-m", "scenegate_ros2.zenoh_node", "--router", f"127.0.0.1:{zenoh_port}"]
    # There is no router: the node listens in its place.
    listen = f'listen/endpoints=["tcp/127.0.0.1:{zenoh_port}"];connect/endpoints=[]'
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE), "ZENOH_CONFIG_OVERRIDE": listen}
    received: dict[str, dict[int, Any]] = {}

    def subscribe(topic: str, message_type: str) -> Any:
        def take(message: Any) -> None:
            stamp = message.header.stamp
            received.setdefault(topic, {})[stamp.sec * 10**9 + stamp.nanosec] = message

        of_type = {"msg_definition": definition(message_type), "type_hash": STORE.hash_rihs01(message_type)}
        return zenoh_ros2_sdk.ROS2Subscriber(topic, message_type, **of_type, callback=take, router_port=zenoh_port)

    def same_times() -> set[int]:
        return set(received.get("/stereo/left/image_rect", ())) & set(received.get("/stereo/left/camera_info", ()))

    with gateway_process(*flags) as (_, url):
        command += ["--url", url, "--camera", f"127.0.0.1:{grpc_port}", "--no-scene"]
        with subprocess.Popen(command, env=environment) as node:
            try:
                subscribers = [
                    subscribe("/stereo/left/image_rect", "sensor_msgs/msg/Image"),
                    subscribe("/stereo/left/camera_info", "sensor_msgs/msg/CameraInfo"),
                ]
                wait_until(lambda: same_times() or node.poll() is not None)
                assert node.poll() is None, "the node has ended"
                time = min(same_times())
                for subscriber in subscribers:
                    subscriber.close()
            finally:
                node.terminate()
    image, info = received["/stereo/left/image_rect"][time], received["/stereo/left/camera_info"][time]
    assert image.header.frame_id == info.header.frame_id == "stereo_left_optical_frame"
    assert (image.width, image.height, image.encoding) == (1280, 960, "mono8") == (info.width, info.height, "mono8")
    assert np.asarray(image.data).std() > 20
    np.testing.assert_allclose(info.k.reshape(3, 3), ((1081.472, 0, 639.5), (0, 1081.472, 479.5), (0, 0, 1)))
