"""Point clouds with their channels, and planar lidars."""

from typing import Any

import numpy as np
import pytest

from gateway.scene.tree.geometry import PointCloud
from gateway.scene.tree.materials import material
from tests.adapters.treeviewer.conversation import CLOUD, Viewer

NAN, INF = float("nan"), float("inf")


def cloud_of(viewer: Viewer) -> PointCloud:
    shape: Any = viewer.parts()[0].shape
    return shape


def test_a_cloud_keeps_all_channels(viewer: Viewer) -> None:
    channels = {
        "rgb": [[1, 0, 0], [0, 9, 0], [NAN, 0, -1]],
        "intensity": [0, 0.5, 2],
        "range": [7, 8, 9],
        "uv": [[1, 2]] * 3,
    }
    answer = viewer.publish({**CLOUD, "channels": channels, "color": [0.2, 0.2, 0.2, 0.7]})
    assert [text.partition(" has ")[2][:2] for text in answer["warnings"]] == ["9,", "2,"]
    cloud = cloud_of(viewer)
    np.testing.assert_array_equal(cloud.channels["rgb"], np.array([[1, 0, 0], [0, 1, 0], [0, 0, 0]], np.float32))
    np.testing.assert_array_equal(cloud.channels["intensity"], np.array([0, 0.5, 1], np.float32))
    np.testing.assert_array_equal(cloud.channels["range"], np.array([7, 8, 9], np.float32))
    assert cloud.channels["uv"].shape == (3, 2)
    assert viewer.parts()[0].material is material((1.0, 1.0, 1.0, 0.7)), "channels give the colour, color the alpha"


@pytest.mark.parametrize("channels", [None, [], {}, {"rgb": []}, {"rgb": None, "intensity": {}}])
def test_empty_channels_are_none(viewer: Viewer, channels: Any) -> None:
    answer = viewer.publish({**CLOUD, "channels": channels, "color": [0.2, 0.2, 0.2]})
    assert (answer["status"], answer.get("warnings")) == (0, None)
    assert dict(cloud_of(viewer).channels) == {}
    assert viewer.parts()[0].material is material((0.2, 0.2, 0.2, 1.0))


@pytest.mark.parametrize(
    ("channels", "warning"),
    [
        ({"rgb": [[1, 0, 0]]}, 'channel "rgb" has 1 values for 3 points; it is ignored'),
        ({"rgb": [1, 2, 3]}, 'channel "rgb" has numbers, not rows of 3 or 4 numbers; it is ignored'),
        ({"intensity": ["a"] * 3}, 'channel "intensity" has something that is not a number; it is ignored'),
        ({"x": "y"}, 'channel "x" must be a list of'),
        ("red", 'channels is not an object but "red"; it is ignored'),
        ({"h\ud800": [1, 2, 3]}, "channel <str> has no text as its name; it is ignored"),
    ],
)
def test_warns_about_channels_that_do_not_fit(viewer: Viewer, channels: Any, warning: str) -> None:
    answer = viewer.publish({**CLOUD, "channels": channels})
    assert answer["status"] == 0
    assert warning in answer["warnings"][0]
    assert dict(cloud_of(viewer).channels) == {}


def test_drops_undrawable_points_with_their_channels(viewer: Viewer) -> None:
    viewer.publish(
        {
            "type": "pointcloud",
            "points": [[0, 0, 0], [NAN, 0, 0], [1, 1, 1], [INF, 0, 0], [1e300, 0, 0]],
            "channels": {"intensity": [0.1, 0.2, 0.3, 0.4, 0.5]},
        }
    )
    cloud = cloud_of(viewer)
    np.testing.assert_array_equal(cloud.points, np.array([[0, 0, 0], [1, 1, 1]], np.float32))
    np.testing.assert_array_equal(cloud.channels["intensity"], np.array([0.1, 0.3], np.float32))


def test_a_lidar_has_one_angle_for_each_range(viewer: Viewer) -> None:
    viewer.publish({"type": "planar_lidar", "ranges": [1, 2, 1, INF], "angle_start": 0.1, "angle_step": 0.1})
    angles = 0.1 + 0.1 * np.arange(3)
    expected = np.array([1, 2, 1])[:, None] * np.stack((np.cos(angles), np.sin(angles), 0 * angles), axis=1)
    np.testing.assert_allclose(cloud_of(viewer).points, expected, atol=1e-6)
    assert viewer.parts()[0].kind == "planar_lidar"
