"""The ROS 2 node on a stand-in of rclpy, with a gateway. There is no ROS 2 here: see docs/ros2.md."""

import importlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.ros2 import stand_in
from tests.ros2.stand_in import Node, Publisher, ReliabilityPolicy
from tests.support import clients
from tests.support.certificates import certificate
from tests.support.gateway_process import gateway_process
from tests.support.ports import free_ports
from tests.support.waiting import wait_until

pytest.importorskip("mcap_ros2", reason="needs the extra mcap")
OPTICAL = "stereo_left_optical_frame"
IMAGES = {
    "left": ("stereo/left/image_rect", "stereo/left/camera_info"),
    "right": ("stereo/right/image_rect", "stereo/right/camera_info"),
    "depth": ("stereo/depth/image_rect", "stereo/depth/camera_info"),
}
Start = Callable[..., Any]


@pytest.fixture(scope="module")
def gateway() -> Iterator[dict[str, str]]:
    """Addresses of a gateway with the demo scene."""
    (grpc_port,) = free_ports(1)
    with gateway_process("--demo", "--grpc-port", str(grpc_port), "--tcpq-port", "0", "--lcm-url", "off") as (_, url):
        yield {"url": url, "camera": f"127.0.0.1:{grpc_port}"}


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    """Starts nodes with parameters."""
    stand_in.install(monkeypatch)
    module = importlib.import_module("scenegate_ros2.node")
    with ExitStack() as nodes:

        def start(**parameters: Any) -> Any:
            monkeypatch.setattr(Node, "given", parameters)
            node = module.ScenegateNode()
            nodes.callback(node.destroy_node)
            nodes.callback(node.feeds.stop)
            node.feeds.start()
            return node

        yield start


def stamp(message: Any) -> int:
    nanoseconds: int = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    return nanoseconds


def stereo(url: str) -> dict[str, Any]:
    """Return the figures of the gateway's camera."""
    figures: dict[str, Any] = clients.get(f"{url}/healthz").json()["interfaces"]["stereo"]
    return figures


def test_each_image_has_its_camera_info(gateway: dict[str, str], start: Start) -> None:
    node = start(**gateway)
    camera = clients.get(f"{gateway['url']}/cameras/stereo").json()
    with ExitStack() as subscriptions:
        topics = {name: [subscriptions.enter_context(node.topics[each].subscriber()) for each in both]
                  for name, both in IMAGES.items()}  # fmt: skip
        for name, (images, infos) in topics.items():
            image = images.wait_for(count=2)[1]
            (info,) = infos.wait_for(lambda each, image=image: stamp(each) == stamp(image))
            assert image.header.frame_id == info.header.frame_id == OPTICAL, "StereoCameraModel wants one frame"
            assert (image.width, image.height) == (info.width, info.height)
            assert (info.width, info.height) == tuple(camera["images"][name][side] for side in ("width", "height"))
            np.testing.assert_allclose(info.k.reshape(3, 3), camera["images"][name]["K_opencv"])
            np.testing.assert_array_equal(info.p.reshape(3, 4)[:, :3], info.k.reshape(3, 3))
            baseline = -info.p[3] / info.p[0]
            assert baseline == pytest.approx(camera["baseline"] if name == "right" else 0.0, abs=1e-6)
            assert image.encoding == ("32FC1" if name == "depth" else "mono8")
            assert len(image.data) == image.step * image.height
    depth = topics["depth"][0].received[-1].data.view("<f4")
    assert np.isnan(depth).any()
    assert 0.3 < np.nanmin(depth) < np.nanpercentile(depth, 95) < 20, "in metres; the matcher is wrong at single pixels"


def test_points_and_disparity_fit_together(gateway: dict[str, str], start: Start) -> None:
    node = start(**gateway)
    with node.topics["stereo/points2"].subscriber() as clouds, node.topics["stereo/disparity"].subscriber() as images:
        cloud = clouds.wait_for()[0]
        (image,) = images.wait_for(lambda each: stamp(each) == stamp(cloud))
    disparity = image.image.data.view("<f4").reshape(image.image.height, image.image.width)
    assert cloud.header.frame_id == image.header.frame_id == OPTICAL
    assert [each.name for each in cloud.fields] == ["x", "y", "z", "rgb"]
    values = cloud.data.view("<f4").reshape(-1, cloud.point_step // 4)
    valid = disparity[disparity > image.min_disparity]
    np.testing.assert_allclose(values[:, 2], image.f * image.t / valid, rtol=1e-6)


def test_images_are_requested_while_somebody_subscribes(gateway: dict[str, str], start: Start) -> None:
    node = start(**gateway)
    node.topics["/tf"].subscribers += 1
    node.topics["/tf"].wait_for()
    wait_until(lambda: stereo(gateway["url"])["clients"] == 0 or None)  # other tests have ended
    frames = stereo(gateway["url"])["frames"]
    node.topics["/tf"].wait_for(count=30)
    assert stereo(gateway["url"])["frames"] == frames
    with node.topics["stereo/right/image_rect"].subscriber() as right:
        right.wait_for()
        assert not node.topics["stereo/left/image_rect"].received
        assert stereo(gateway["url"])["clients"] == 1
    wait_until(lambda: stereo(gateway["url"])["clients"] == 0 or None)
    assert node.logger.warnings == []


def world(transforms: dict[str, Any], frame: str) -> NDArray[np.float64]:
    """Return the position of a frame, (3,), from the chain of transforms up to ``world``."""
    position = np.zeros(3)
    while frame != "world":
        each = transforms[frame]
        q, t = each.transform.rotation, each.transform.translation
        vector = np.array((q.x, q.y, q.z))
        position = position + 2 * np.cross(vector, np.cross(vector, position) + q.w * position) + (t.x, t.y, t.z)
        frame = each.header.frame_id
    return position


def test_late_listeners_get_all_transforms(gateway: dict[str, str], start: Start) -> None:
    node = start(**gateway)
    tf: Publisher = node.topics["/tf"]
    tf.subscribers += 1
    tf.wait_for(lambda message: any(each.child_frame_id == OPTICAL for each in message.transforms))
    wait_for_repetition(node)
    tf.wait_for(lambda message: any(each.child_frame_id == OPTICAL for each in message.transforms), count=2)
    transforms = {each.child_frame_id: each for message in tf.received for each in message.transforms}
    nodes = {
        "/".join(["scene", *node["path"]]): node for node in clients.get(f"{gateway['url']}/scene").json()["nodes"]
    }
    for frame in ("scene/demo/table", "scene/demo/floor", "scene/demo/robot"):
        there = np.asarray(nodes[frame]["transform"])[:3, 3]
        np.testing.assert_allclose(world(transforms, frame), there, atol=1e-6)
    right = world(transforms, "stereo_right_optical_frame") - world(transforms, OPTICAL)
    assert np.linalg.norm(right) == pytest.approx(0.16)


def wait_for_repetition(node: Any) -> None:
    """Wait until transforms that do not change are published twice from now on."""
    tf = node.topics["/tf"]
    with tf.arrived:
        tf.received.clear()
    tf.wait_for(lambda message: any(each.child_frame_id == "scene/demo/table" for each in message.transforms), count=2)


@pytest.mark.slow
def test_new_subscribers_get_all_markers(gateway: dict[str, str], start: Start) -> None:
    node = start(**gateway)
    node.topics["/tf"].subscribers += 1
    node.topics["/tf"].wait_for(count=3)
    for _ in range(2):
        with node.topics["scene"].subscriber() as markers:
            (message,) = markers.wait_for(lambda each: any(m.ns == "scene/demo/table" for m in each.markers))
            table = next(marker for marker in message.markers if marker.ns == "scene/demo/table")
            assert table.header.frame_id == "scene/demo/table"
            assert table.frame_locked
            assert len(table.points) % 3 == 0
            with markers.arrived:
                markers.received.clear()
        wait_for_repetition(node)  # and so for a look at the number of subscribers, which is 0


@pytest.mark.slow
def test_the_clock_is_that_of_the_images(start: Start) -> None:
    (grpc_port,) = free_ports(1)
    flags = ("--demo", "--clock", "simulated", "--grpc-port", str(grpc_port), "--tcpq-port", "0", "--lcm-url", "off")
    with gateway_process(*flags) as (_, url):
        node = start(url=url, camera=f"127.0.0.1:{grpc_port}", publish_clock=True)
        topics = [node.topics[name] for name in ("/clock", "/tf", "stereo/left/image_rect")]
        for topic in topics:
            topic.subscribers += 1
        clock, tf, left = topics
        images = left.wait_for(count=3)
        times = [each.clock.sec * 10**9 + each.clock.nanosec for each in clock.wait_for(count=3)]
        assert times == sorted(set(times))
        assert stamp(images[-1]) in [each.clock.sec * 10**9 + each.clock.nanosec for each in clock.received]
        transform = tf.wait_for()[0].transforms[0]
        assert stamp(transform) in [each.clock.sec * 10**9 + each.clock.nanosec for each in clock.received]
        node.feeds.stop()


def test_a_lost_connection_is_reported_once_and_made_again(
    gateway: dict[str, str], start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = importlib.import_module("scenegate_ros2.feeds")
    monkeypatch.setattr(module, "RETRY_SECONDS", 0.01)
    (free,) = free_ports(1)
    connect, addresses = module.scene_frames, iter([f"http://127.0.0.1:{free}"] * 3)
    monkeypatch.setattr(module, "scene_frames", lambda _, *others: connect(next(addresses, gateway["url"]), *others))
    node = start(camera="", url="http://127.0.0.1")
    node.topics["/tf"].subscribers += 1
    node.topics["/tf"].wait_for(lambda message: len(message.transforms) > 10)
    (warning,) = node.logger.warnings
    assert str(free) in warning


@pytest.mark.parametrize(
    ("parameters", "reason"),
    [
        ({"reliability": "maybe"}, "reliability is 'maybe'; it must be reliable or best_effort"),
        ({"tf_rate": 0.0}, "tf_rate is 0.0 Hz; it must be above 0 and at most 1000"),
    ],
)
def test_wrong_parameters_are_refused(start: Start, parameters: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        start(camera="", url="", **parameters)


def test_quality_of_service(start: Start) -> None:
    node = start(camera="", url="")
    assert {each.qos.reliability for each in node.topics.values()} == {ReliabilityPolicy.RELIABLE}
    node = start(camera="", url="", reliability="best_effort")
    best_effort = {name for name, each in node.topics.items() if each.qos.reliability is ReliabilityPolicy.BEST_EFFORT}
    assert best_effort == node.topics.keys() - {"/tf"}


def test_the_scene_has_the_time_of_another_clock(
    gateway: dict[str, str], start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Node, "clock_ns", 0)
    node = start(url=gateway["url"], camera="", use_sim_time=True)
    tf = node.topics["/tf"]
    with tf.subscriber():
        node.feeds.repeat_scene()
        assert not tf.received, "the clock has not begun"
        monkeypatch.setattr(Node, "clock_ns", 7_000_000_005)
        (message,) = tf.wait_for(lambda each: len(each.transforms) > 3)
    assert {stamp(each) for each in message.transforms} == {7_000_000_005}


@pytest.mark.slow
def test_a_gateway_with_tls_and_a_token(start: Start, tmp_path: Path) -> None:
    pem, key = certificate(tmp_path)
    tokens = tmp_path / "tokens"
    tokens.write_text("secret-0123456789-0123\n")
    (grpc_port,) = free_ports(1)
    flags = ["--demo", "--grpc-port", str(grpc_port), "--tcpq-port", "0", "--lcm-url", "off"]
    for edge in ("http", "grpc"):
        flags += [f"--{edge}-certificate", str(pem), f"--{edge}-key", str(key), f"--{edge}-token-file", str(tokens)]
    with gateway_process(*flags) as (_, url):
        node = start(url=url, camera=f"127.0.0.1:{grpc_port}", token_file=str(tokens), ca=str(pem))
        with node.topics["/tf"].subscriber() as tf, node.topics["stereo/left/image_rect"].subscriber() as left:
            tf.wait_for(lambda message: len(message.transforms) > 3)
            left.wait_for()
        assert node.logger.warnings == []
