"""Images, intrinsics, disparity, depth and points of image sets: values that independent readers have in files."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from scenegate.camera import image_interface_pb2 as pb
from scenegate.recording.ros2_messages import definition
from tests.client.recording.conftest import write_values
from tests.client.recording.readers import foxglove_messages, ros2_messages, rosbags_typesys

BASELINE, FOCAL, WIDTH, HEIGHT = 0.16, 540.5, 64, 48
SCALE = 1 / 16
RNG = np.random.default_rng(4)


def image(array: NDArray[Any], focal: float, seconds: int, *, bigendian: bool = False, padding: int = 0) -> pb.Image:
    encoding = "rgb8" if array.ndim == 3 else "mono8" if array.dtype == np.uint8 else "mono16"
    rows = array.astype(array.dtype.newbyteorder(">" if bigendian else "<")).reshape(len(array), -1).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    return pb.Image(
        timestamp=pb.Time(sec=seconds, nsec=7), height=len(array), width=array.shape[1], focal_length=focal,
        principal_point_u=array.shape[1] / 2, principal_point_v=array.shape[0] / 2, encoding=encoding,
        is_bigendian=bigendian, step=rows.shape[1], data=rows.tobytes(),
    )  # fmt: skip


LEFT = RNG.integers(0, 255, (2 * HEIGHT, 2 * WIDTH), np.uint8)
RIGHT = RNG.integers(0, 255, (2 * HEIGHT, 2 * WIDTH), np.uint8)
STORED = np.where(RNG.random((HEIGHT, WIDTH)) < 0.2, 0, RNG.integers(200, 2000, (HEIGHT, WIDTH))).astype(np.uint16)


def image_set(*, bigendian: bool = False, padding: int = 0, depth_seconds: int = 100) -> pb.ImageSet:
    stored = image(STORED, FOCAL, depth_seconds, bigendian=bigendian, padding=padding)
    return pb.ImageSet(
        timestamp=pb.Time(sec=100),
        left=image(LEFT, 2 * FOCAL, 100, padding=padding),
        right=image(RIGHT, 2 * FOCAL, 100),
        disparity=pb.DisparityImage(scale=SCALE, baseline=BASELINE, delta_d=1 / 16, image=stored),
    )


def ros2(path: Path, *values: Any) -> dict[str, Any]:
    """Return the last message of each topic."""
    write_values(path, "ros2", values)
    return {message.topic: message.value for message in ros2_messages(path)}


def pixels(message: Any) -> NDArray[Any]:
    dtype = {"mono8": "u1", "rgb8": "u1", "32FC1": "<f4"}[message.encoding]
    shape = (message.height, message.width, 3) if message.encoding == "rgb8" else (message.height, message.width)
    return np.frombuffer(bytes(message.data), dtype).reshape(shape)


@pytest.mark.parametrize(("bigendian", "padding"), [(False, 0), (True, 6)])
def test_images_are_those_of_the_set(tmp_path: Path, bigendian: bool, padding: int) -> None:
    """Rows are without padding and little-endian, whatever the camera sends."""
    topics = ros2(tmp_path / "a.mcap", image_set(bigendian=bigendian, padding=padding))
    np.testing.assert_array_equal(pixels(topics["/stereo/left/image_rect"]), LEFT)
    np.testing.assert_array_equal(pixels(topics["/stereo/right/image_rect"]), RIGHT)
    disparity = topics["/stereo/disparity"]
    values = pixels(disparity.image)
    assert disparity.image.step == 4 * WIDTH
    valid = STORED > 0
    np.testing.assert_array_equal(values[valid], STORED[valid] * SCALE)
    assert (values[~valid] < disparity.min_disparity).all()
    assert values.max() == disparity.max_disparity
    depth = pixels(topics["/stereo/depth/image_rect"])
    np.testing.assert_allclose(depth[valid], disparity.f * disparity.t / values[valid], rtol=1e-6)
    assert np.isnan(depth[~valid]).all()
    for message in (topics["/stereo/left/image_rect"], topics["/stereo/left/camera_info"], disparity):
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (100, 7)
        assert message.header.frame_id == "stereo_left_optical_frame"


def test_colour_images(tmp_path: Path) -> None:
    rgb = RNG.integers(0, 255, (20, 30, 3), np.uint8)
    topics = ros2(tmp_path / "a.mcap", pb.ImageSet(left=image(rgb, 100.0, 3)))
    np.testing.assert_array_equal(pixels(topics["/stereo/left/image_rect"]), rgb)


def test_projections_are_opencv_s(tmp_path: Path) -> None:
    """A point of the cloud is seen by both cameras at the pixel that has its disparity."""
    topics = ros2(tmp_path / "a.mcap", image_set())
    cloud = topics["/stereo/points2"]
    points = np.frombuffer(bytes(cloud.data), np.dtype([("xyz", "<f4", 3), ("bgr", "u1", 4)]))
    rows, columns = np.nonzero(STORED)
    assert cloud.width == len(points) == len(rows)
    left, right = topics["/stereo/left/camera_info"], topics["/stereo/right/camera_info"]
    K, P = left.k.reshape(3, 3), right.p.reshape(3, 4)
    assert P[0, 3] == pytest.approx(-2 * FOCAL * BASELINE, rel=1e-6)
    in_left, _ = cv2.projectPoints(points["xyz"].astype(float), np.zeros(3), np.zeros(3), K, left.d)
    # The centre of pixel (i, j) of the disparity image is the corner of four pixels of the left image, whose centres
    # are at whole numbers.
    expected = 2 * np.stack((columns, rows), axis=1) + 0.5
    np.testing.assert_allclose(in_left[:, 0], expected, atol=1e-3)
    homogeneous = np.c_[points["xyz"], np.ones(len(points))] @ P.T
    in_right = homogeneous[:, :2] / homogeneous[:, 2:]
    np.testing.assert_allclose(in_right[:, 1], expected[:, 1], atol=1e-3)
    np.testing.assert_allclose(expected[:, 0] - in_right[:, 0], 2 * STORED[rows, columns] * SCALE, atol=1e-3)
    np.testing.assert_array_equal(points["bgr"][:, 0], LEFT[2 * rows + 1, 2 * columns + 1])
    np.testing.assert_array_equal(points["bgr"][:, 3], 0)


def test_points_are_those_of_opencv_from_the_disparity_image(tmp_path: Path) -> None:
    topics = ros2(tmp_path / "a.mcap", image_set())
    disparity, info = topics["/stereo/disparity"], topics["/stereo/depth/camera_info"]
    K = info.k.reshape(3, 3)
    Q = np.array(((1, 0, 0, -K[0, 2]), (0, 1, 0, -K[1, 2]), (0, 0, 0, K[0, 0]), (0, 0, 1 / disparity.t, 0)), np.float64)
    values = pixels(disparity.image)
    expected = cv2.reprojectImageTo3D(values, Q)[values > 0]
    data = np.frombuffer(bytes(topics["/stereo/points2"].data), np.dtype([("xyz", "<f4", 3), ("bgr", "u1", 4)]))
    np.testing.assert_allclose(data["xyz"], expected, rtol=1e-4, atol=1e-5)


def test_depth_of_another_exposure_has_its_own_time(tmp_path: Path) -> None:
    topics = ros2(tmp_path / "a.mcap", image_set(depth_seconds=101))
    assert topics["/stereo/left/image_rect"].header.stamp.sec == 100
    assert topics["/stereo/depth/image_rect"].header.stamp.sec == 101


def test_right_images_wait_for_the_baseline(tmp_path: Path) -> None:
    only_images = pb.ImageSet(left=image(LEFT, FOCAL, 1), right=image(RIGHT, FOCAL, 1))
    write_values(tmp_path / "a.mcap", "ros2", [only_images, image_set(), only_images])
    found = [message.topic for message in ros2_messages(tmp_path / "a.mcap")]
    assert found.count("/stereo/left/image_rect") == 3
    assert found.count("/stereo/right/image_rect") == found.count("/stereo/right/camera_info") == 2


def test_foxglove_has_the_same_values(tmp_path: Path) -> None:
    topics = ros2(tmp_path / "ros2.mcap", image_set())
    write_values(tmp_path / "foxglove.mcap", "foxglove", [image_set()])
    found = {message.topic: message.value for message in foxglove_messages(tmp_path / "foxglove.mcap")}
    assert found.keys() == topics.keys()
    for name in ("left", "right", "depth"):
        for topic in (f"/stereo/{name}/image_rect", f"/stereo/{name}/camera_info"):
            ours, theirs = found[topic], topics[topic]
            assert (ours.width, ours.height, ours.frame_id) == (theirs.width, theirs.height, theirs.header.frame_id)
            assert (ours.timestamp.seconds, ours.timestamp.nanos) == (100, 7)
        np.testing.assert_array_equal(found[f"/stereo/{name}/camera_info"].P, topics[f"/stereo/{name}/camera_info"].p)
        np.testing.assert_array_equal(found[f"/stereo/{name}/camera_info"].K, topics[f"/stereo/{name}/camera_info"].k)
        ours, theirs = found[f"/stereo/{name}/image_rect"], topics[f"/stereo/{name}/image_rect"]
        assert (ours.encoding, ours.step, ours.data) == (theirs.encoding, theirs.step, bytes(theirs.data))
    cloud = found["/stereo/points2"]
    fields = np.dtype([("xyz", "<f4", 3), ("rgba", "u1", 4)])
    assert cloud.point_stride == fields.itemsize
    assert [(each.name, each.offset) for each in cloud.fields] == [
        ("x", 0), ("y", 4), ("z", 8), ("red", 12), ("green", 13), ("blue", 14), ("alpha", 15)
    ]  # fmt: skip
    ours, theirs = np.frombuffer(cloud.data, fields), np.frombuffer(bytes(topics["/stereo/points2"].data), fields)
    np.testing.assert_array_equal(ours["xyz"], theirs["xyz"])
    np.testing.assert_array_equal(ours["rgba"][:, :3], theirs["rgba"][:, 2::-1])


def test_definitions_are_those_of_ros_2() -> None:
    """rosbags has the definitions of all releases. Readers take the constants from the file, as KISS-ICP does."""
    types = (
        "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/PointCloud2",
        "sensor_msgs/msg/JointState", "stereo_msgs/msg/DisparityImage", "tf2_msgs/msg/TFMessage",
        "visualization_msgs/msg/MarkerArray",
    )  # fmt: skip
    for release in ("ROS2_HUMBLE", "ROS2_JAZZY"):
        store = rosbags_typesys.get_typestore(rosbags_typesys.Stores[release])
        for name in types:
            ours = rosbags_typesys.get_types_from_msg(definition(name), name)
            for each, (constants, fields) in ours.items():
                assert fields == store.fielddefs[each][1], (release, each)
                assert set(constants) <= set(store.fielddefs[each][0]), (release, each)
                assert release != "ROS2_HUMBLE" or constants == store.fielddefs[each][0], each
